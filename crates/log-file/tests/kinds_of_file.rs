//! One recording in every supported format, written by common programs (`fuzz/make_seeds.py`): rows must be equal bit
//! for bit.

#![allow(
    clippy::disallowed_methods,
    clippy::disallowed_types,
    clippy::unwrap_used,
    reason = "tests read files, and may panic"
)]

use std::path::{Path, PathBuf};

use log_file::{Log, LogError, Mapping, ReadOptions, Wanted};
use shell_data::block::Block;
use table_file::write::Cells;

const FOLDERS: [&str; 12] = [
    "text", "packed", "parquet", "matlab", "hdf5", "numpy", "ods", "xlsx", "mcap", "rosbag",
    "sqlite", "tdms",
];

fn seeds() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/seeds")
}

/// Returns all files, except the one that the others are compared with.
fn files() -> Vec<PathBuf> {
    let entries =
        FOLDERS.iter().flat_map(|folder| std::fs::read_dir(seeds().join(folder)).unwrap());
    let mut files: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    files.retain(|path| !path.ends_with("text/plain.csv"));
    files.sort();
    assert!(files.len() > 24, "{files:?}");
    files
}

fn rows(path: &Path, threads: usize) -> Result<(Block, Option<String>), LogError> {
    let log = Log::open(path, &Mapping::default())?;
    let wanted = Wanted {
        time: true,
        readings: true,
        wrench: true,
        groups: log.has_groups(),
        ..Wanted::default()
    };
    let options = ReadOptions { threads, checksum: true, ..ReadOptions::default() };
    let (mut whole, summary) = log.with_chunk_bytes(700).read_whole(&wanted, &options)?;
    let mut groups: Vec<(String, usize)> = Vec::new();
    for (label, rows) in std::mem::take(&mut whole.groups) {
        match groups.last_mut() {
            Some((last, count)) if *last == label => *count += rows,
            _ => groups.push((label, rows)),
        }
    }
    Ok((Block { groups, ..whole }, summary.checksum))
}

#[test]
fn a_recording_has_the_same_rows_in_every_kind_of_file() {
    let (expected, _) = rows(&seeds().join("text/plain.csv"), 1).unwrap();
    assert_eq!((expected.rows, expected.groups.len()), (24, 4));
    for path in files() {
        let name = path.display();
        let (found, checksum) = rows(&path, 1).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(found.readings, expected.readings, "{name}");
        assert_eq!(found.wrench, expected.wrench, "{name}");
        if !found.groups.is_empty() {
            assert_eq!(found.groups, expected.groups, "{name}");
        }
        // Files with dates begin in 2026, MCAP recordings at their log time, and other files at 0 s.
        let start_s = match found.time_s[0] {
            0.0 => 0.0,
            // `date -u -d 2026-11-22T10:00:00 +%s`
            1_795_341_600.0 => 1_795_341_600.0,
            1_700_000_000.0 => 1_700_000_000.0,
            other => panic!("{name} begins at {other} s"),
        };
        for (time, expected) in found.time_s.iter().zip(&expected.time_s) {
            // A double near 1.8e9 s has a resolution of 2⁻²² s.
            let tolerance_s = if start_s == 0.0 { 0.0 } else { 2.4e-7 };
            assert!((time - start_s - expected).abs() <= tolerance_s, "{name}: {time}");
        }
        let of_file = log_file::checksum::of(&std::fs::read(&path).unwrap());
        assert_eq!(checksum, Some(of_file), "{name}");
        for threads in [2, 5] {
            assert_eq!(rows(&path, threads).unwrap().0, found, "{name}, {threads} threads");
        }
    }
}

/// A recorder that is killed leaves a bag without an index, and a chunk whose sizes it has not filled in.
#[test]
fn a_bag_whose_recorder_was_killed_is_read_to_its_last_whole_message() {
    let (expected, _) = rows(&seeds().join("rosbag/none.bag"), 1).unwrap();
    let whole = std::fs::read(seeds().join("rosbag/none.bag")).unwrap();
    let place = |of: &[u8]| whole.windows(of.len()).position(|part| part == of).unwrap() + of.len();
    let word = |at: usize| u32::from_le_bytes(*whole[at..].first_chunk().unwrap()) as usize;
    let (index, size) = (place(b"index_pos="), place(b"size="));
    // The header of the chunk ends with the size of the unpacked chunk; the length of the data follows.
    let (length, end) = (size + 4, size + 8 + word(size + 4));
    let read = |bytes: &[u8]| {
        let log = Log::in_memory(Path::new("run.bag"), bytes.into(), &Mapping::default())?;
        let wanted = Wanted { time: true, readings: true, wrench: true, ..Wanted::default() };
        let (block, _) = log.read_whole(&wanted, &ReadOptions::default())?;
        Ok::<_, LogError>((block, log.is_cut_off()))
    };
    assert!(!read(&whole).unwrap().1);
    for (share, is_filled_in) in [(2, true), (2, false), (3, false), (1, false)] {
        let mut bytes = whole[..size + 8 + (end - size - 8) / share].to_vec();
        bytes[index..index + 8].fill(0);
        if !is_filled_in {
            bytes[size..size + 4].fill(0);
            bytes[length..length + 4].fill(0);
        }
        let (found, is_cut) = read(&bytes).unwrap();
        let least = if share == 1 { 24 } else { 4 };
        assert!(is_cut && (least..=24).contains(&found.rows), "{share}: {}", found.rows);
        for (found, expected) in found.readings.iter().zip(&expected.readings) {
            assert_eq!(found[..], expected[..found.len()]);
        }
    }
    // A bag without an index has all its messages; a bag with a damaged length is an error.
    assert_eq!(read(&whole[..end]).unwrap().0.rows, 24);
    let mut damaged = whole.clone();
    damaged[length + 2] = 0xff;
    assert!(read(&damaged).unwrap_err().to_string().contains("damaged"));
}

/// Joins a table with a table, a table with a text, and a text with a table.
#[test]
fn a_companion_of_any_kind_gives_the_columns_beside_those_of_the_log() {
    let dir = tempfile::tempdir().unwrap();
    let column = |at: usize| -> Vec<f64> {
        (0..3000).map(|row| f64::from(row % 97) / 7.0 + at as f64).collect()
    };
    let readings: Vec<(String, Vec<f64>)> =
        (1..=2).map(|at| (format!("s{at}"), column(at))).collect();
    let wrench: Vec<(String, Vec<f64>)> = ["fx_n", "fy_n"]
        .iter()
        .zip(3..)
        .map(|(name, at)| ((*name).to_owned(), column(at)))
        .collect();
    let write = |name: &str, columns: &[(String, Vec<f64>)], rows: usize| {
        let cells: Vec<(String, Cells<'_>)> = columns
            .iter()
            .map(|(name, it)| (name.clone(), Cells::Full(it[..rows].into())))
            .collect();
        let mut file = std::fs::File::create(dir.path().join(name)).unwrap();
        match name.ends_with(".mat") {
            true => table_file::write::write_matlab(&mut file, &cells).unwrap(),
            false => {
                let names: Vec<&str> = columns.iter().map(|(name, _)| name.as_str()).collect();
                let row = |row: usize| {
                    columns.iter().map(|(_, it)| it[row].to_string()).collect::<Vec<_>>().join(";")
                };
                let rows: Vec<String> = (0..rows).map(row).collect();
                let text = format!("{}\n{}\n", names.join(";"), rows.join("\n"));
                std::fs::write(dir.path().join(name), text).unwrap();
            }
        }
    };
    for name in ["readings.mat", "readings.csv"] {
        write(name, &readings, 3000);
    }
    for name in ["wrench.mat", "wrench.csv"] {
        write(name, &wrench, 3000);
        write(&format!("short_{name}"), &wrench, 2999);
    }
    let open = |log: &str, companion: &str| {
        let [log, companion] = [log, companion].map(|name| dir.path().join(name));
        let log = Log::open_with_companion(&log, &companion, &Mapping::default())?;
        let wanted = Wanted { readings: true, wrench: true, ..Wanted::default() };
        log.read_whole(&wanted, &ReadOptions::default()).map(|(block, _)| block)
    };
    for (log, companion) in [
        ("readings.csv", "wrench.csv"),
        ("readings.mat", "wrench.mat"),
        ("readings.mat", "wrench.csv"),
        ("readings.csv", "wrench.mat"),
    ] {
        let block = open(log, companion).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!((block.rows, &block.readings[1]), (3000, &readings[1].1), "{log}");
        assert_eq!(block.wrench[..2], [wrench[0].1.clone(), wrench[1].1.clone()], "{companion}");
        let error = open(log, &format!("short_{companion}")).map(drop).unwrap_err().to_string();
        assert!(error.contains("is in one of them alone"), "{error}");
    }
}

/// Number of damaged files, unless `SHELLCAL_DAMAGED_CASES` says otherwise.
const DAMAGED: u64 = 2_000;

/// Each file is cut, or some of its bytes are replaced; the reader returns rows or an error.
#[test]
fn damaged_files_of_every_kind_do_not_panic() {
    let cases = std::env::var("SHELLCAL_DAMAGED_CASES");
    let cases = cases.map_or(DAMAGED, |cases| cases.parse().unwrap());
    let files: Vec<(PathBuf, Vec<u8>)> =
        files().into_iter().map(|path| (path.clone(), std::fs::read(path).unwrap())).collect();
    // xorshift64 (Marsaglia, 2003).
    let mut state = 0x9e37_79b9_7f4a_7c15_u64;
    let mut below = |bound: usize| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state % bound.max(1) as u64) as usize
    };
    let mut read = 0;
    for _ in 0..cases {
        let (path, bytes) = &files[below(files.len())];
        let mut bytes = bytes.clone();
        for _ in 0..=below(4) {
            let at = below(bytes.len());
            match below(4) {
                0 => bytes.truncate(at.max(1)),
                1 => bytes[at] ^= 1 << below(8),
                2 => bytes[at] = [0, 1, 0x7f, 0x80, 0xff][below(5)],
                _ => {
                    let end = (at + 1 + below(16)).min(bytes.len());
                    bytes[at..end].fill(if below(2) == 0 { 0 } else { 0xff });
                }
            }
        }
        let Ok(log) = Log::in_memory(path, bytes.into(), &Mapping::default()) else { continue };
        let wanted = Wanted {
            time: log.has_time(),
            readings: log.channels() > 0,
            wrench: log.has_wrench(),
            groups: log.has_groups(),
            ..Wanted::default()
        };
        let options = ReadOptions { threads: 1, ..ReadOptions::default() };
        read += u64::from(log.with_chunk_bytes(700).read_whole(&wanted, &options).is_ok());
    }
    assert!(read > cases / 20, "{read} of {cases} were read");
}
