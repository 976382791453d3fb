//! Functions shared by the targets, which read logs in several ways.

use std::path::PathBuf;

use log_file::{Log, LogError, LogFormat, Mapping, Meaning, ReadOptions, ReadSummary, Wanted};
use shell_data::block::Block;

/// Reads `bytes` as a log, in chunks of a few bytes and whole: rows, number of skipped rows, and error must be equal.
///
/// Repeated rows are not compared: a chunk of a few bytes does not always have the previous row as context.
pub fn read_log(bytes: &[u8], format: Option<LogFormat>, piece: usize) {
    let [whole, pieces] = read_both(bytes, format, piece);
    assert_eq!(whole, pieces);
}

/// Reads `bytes` like [`read_log`]. Returns both results as text, whole first; they are empty if `bytes` is no log.
fn read_both(
    bytes: &[u8],
    format: Option<LogFormat>,
    piece: usize,
) -> [Vec<Result<String, String>>; 2] {
    let path = file(bytes);
    let mapping = Mapping { format, ..Mapping::default() };
    let mut both = [Vec::new(), Vec::new()];
    let Ok(log) = Log::open(&path, &mapping) else { return both };
    let log = log.with_chunk_bytes(bytes.len());
    // Group labels are text.
    let is_number = |&at: &usize| log.columns()[at].meaning != Meaning::Group;
    let wanted = Wanted {
        time: log.has_time(),
        readings: log.channels() > 0,
        wrench: log.has_wrench(),
        groups: log.has_groups(),
        others: (0..log.columns().len()).filter(is_number).collect(),
        ..Wanted::default()
    };
    let Ok(in_pieces) = Log::open(&path, &mapping) else { panic!("opened once, not twice") };
    let in_pieces = in_pieces.with_chunk_bytes(piece);
    for skip_bad_rows in [false, true] {
        let whole = rows(&log, &wanted, skip_bad_rows);
        let pieces = rows(&in_pieces, &wanted, skip_bad_rows);
        if let Ok((rows, summary)) = &whole {
            assert!(rows.iter().all(|column| column.len() as u64 == summary.rows));
        }
        for (all, read) in both.iter_mut().zip([whole, pieces]) {
            let text = read.map(|read| format!("{read:?}"));
            all.push(text.map_err(|error| format!("{error:?}")));
        }
    }
    both
}

/// Reads `bytes` as a file that begins with `magic`, which is prepended if it is missing.
pub fn read_table(bytes: &[u8], magic: &[u8]) {
    // Gzip is accepted as well for the compressed formats.
    let begins = bytes.starts_with(magic) || bytes.starts_with(b"\x1f\x8b");
    let magic = if begins { &[] } else { magic };
    let [whole, pieces] = read_both(&[magic, bytes].concat(), None, bytes.len() % 499 + 100);
    // A table is decoded part by part. If a part is damaged and an earlier row is invalid, the size of the parts
    // decides which error is reported first.
    for (whole, pieces) in whole.into_iter().zip(pieces) {
        assert!(whole.is_err() && pieces.is_err() || whole == pieces, "{whole:?} {pieces:?}");
    }
}

/// Returns the columns of a log as bits, because a NaN does not equal itself.
fn rows(
    log: &Log,
    wanted: &Wanted,
    skip_bad_rows: bool,
) -> Result<(Vec<Vec<u64>>, ReadSummary), LogError> {
    let options = ReadOptions { threads: 1, skip_bad_rows, ..ReadOptions::default() };
    let mut columns: Vec<Vec<u64>> = Vec::new();
    let bits = |block: &mut Block| -> Vec<Vec<u64>> {
        let time = (!block.time_s.is_empty()).then_some(&block.time_s);
        let columns = time.into_iter().chain(&block.readings).chain(&block.wrench);
        let columns = columns.chain(&block.others);
        columns.map(|column| column.iter().map(|value| value.to_bits()).collect()).collect()
    };
    let summary = log.read(wanted, &options, bits, |block| {
        columns.resize(columns.len().max(block.len()), Vec::new());
        columns.iter_mut().zip(block).for_each(|(column, more)| column.extend(more));
        Ok::<_, LogError>(())
    })?;
    Ok((columns, ReadSummary { repeated_rows: 0, ..summary }))
}

/// Writes `bytes` to a file of this process, in `/dev/shm` (memory) if that folder exists.
fn file(bytes: &[u8]) -> PathBuf {
    let folder = Some(PathBuf::from("/dev/shm")).filter(|folder| folder.is_dir());
    let folder = folder.unwrap_or_else(std::env::temp_dir);
    let path = folder.join(format!("shellcal-fuzz-{}", std::process::id()));
    std::fs::write(&path, bytes).expect("the folder for temporary files can be written to");
    path
}
