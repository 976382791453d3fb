//! Reading logs into memory.

use super::all::read_all;
use super::request::{ReadOptions, Wanted};
use crate::error::LogError;
use crate::log::Log;
use shell_data::block::Block;
use shell_data::dataset::{Dataset, LogRows};

/// Reads all rows of some logs into memory, of each log what is wanted of it: time, readings, wrench and
/// groups. [`sample_logs`] takes a sample of them.
///
/// # Errors
/// As [`Log::read`], the first error in the order of logs and rows.
pub fn read_dataset(
    logs: &[(&Log, Wanted)],
    options: &ReadOptions<'_>,
) -> Result<Dataset, LogError> {
    let rows = |(log, wanted): &(&Log, Wanted)| LogRows {
        name: log.path().to_path_buf(),
        axes: log.axes(),
        channels: log.channels(),
        has_groups: wanted.groups,
        is_sampled_at_start: log.compression().is_some(),
        ..LogRows::default()
    };
    let mut data = Dataset { logs: logs.iter().map(rows).collect() };
    // A copy takes what it needs and no more; the block stays, as memory for the next.
    let copy = |(): &mut (), _, block: &mut Block| block.clone();
    let keep = |log: usize, mut block: Block| {
        data.logs[log].lines.insert(block.offset, std::mem::take(&mut block.lines));
        data.logs[log].blocks.push(block.into());
        Ok::<_, LogError>(())
    };
    let (summaries, _) = read_all(logs, options, || (), copy, keep)?;
    data.logs.iter_mut().zip(summaries).for_each(|(log, summary)| log.summary = summary);
    Ok(data)
}

/// Reads the same of some logs, and takes a sample of each.
///
/// # Errors
/// As [`read_dataset`].
pub fn read_logs(
    logs: &[Log],
    wanted: &Wanted,
    options: &ReadOptions<'_>,
) -> Result<Dataset, LogError> {
    let asked: Vec<(&Log, Wanted)> = logs.iter().map(|log| (log, wanted.clone())).collect();
    let mut data = read_dataset(&asked, options)?;
    sample_logs(&mut data, logs, wanted)?;
    Ok(data)
}

/// Takes a sample of each log of a data set, of what is wanted of it but for its groups.
///
/// # Errors
/// As [`Log::sample`].
pub fn sample_logs<'a>(
    data: &mut Dataset,
    logs: impl IntoIterator<Item = &'a Log>,
    wanted: &Wanted,
) -> Result<(), LogError> {
    let wanted = Wanted { groups: false, ..wanted.clone() };
    for (rows, log) in data.logs.iter_mut().zip(logs) {
        rows.sample = log.sample(&wanted)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::mapping::Mapping;

    fn check_lines(between: [&str; 2]) {
        let mut text = "time,s0,s1\n".to_owned();
        let (mut line, mut lines_of_times) = (1, Vec::new());
        for row in 0..4000_u32 {
            let between = match row % 7 {
                0 => between[0],
                3 => between[1],
                _ => "",
            };
            text += between;
            line += u64::from(!between.is_empty()) + 1;
            lines_of_times.push(line);
            text += &format!("{row},{},{}\n", row % 100, row % 90);
        }
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log.csv");
        // The last line has no end.
        std::fs::write(&path, text.trim_end()).unwrap();
        let mut log = Log::open(&path, &Mapping::default()).unwrap();
        log.chunk_bytes = 4096;
        let wanted = Wanted { time: true, readings: true, ..Wanted::default() };
        let options = ReadOptions { skip_bad_rows: true, ..ReadOptions::default() };
        let (mut rows, mut expected) = (Vec::new(), Vec::new());
        let of_block = |block: &mut Block| {
            let lines = (0..block.rows).map(|row| block.lines.line(row)).collect::<Vec<_>>();
            (block.offset, block.time_s.clone(), lines)
        };
        log.read(&wanted, &options, of_block, |(offset, times, lines)| {
            for (row, (time, line)) in times.into_iter().zip(lines).enumerate() {
                rows.push((offset, row));
                expected.push(lines_of_times[time as usize]);
                assert_eq!(expected.last(), Some(&line));
            }
            Ok::<_, LogError>(())
        })
        .unwrap();
        assert_eq!(rows.len(), 4000);
        let data = read_dataset(&[(&log, wanted)], &options).unwrap();
        let of_blocks = &data.logs[0].lines;
        let lines = rows.iter().map(|(offset, row)| of_blocks[offset].line(*row));
        assert_eq!(lines.collect::<Vec<_>>(), expected);
    }

    #[test]
    fn rows_are_found_at_their_lines_whatever_is_between_them() {
        check_lines(["\n", "oops,1,2\n"]);
        check_lines(["# talk\n", " \t\n"]);
        check_lines(["", "1,\"2,3\n"]);
        check_lines(["", ""]);
    }
}
