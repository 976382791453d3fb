//! The rows of a trial with readings that cannot be trusted, one by one.

use super::job::TrialJob;
use log_file::{LogError, Wanted};
use shell_data::block::Block;

/// Rows of one log that are named.
const NAMED: usize = 20;

/// The frames between two times (s on the log's clock) with a reading that cannot be trusted: lines of the first of
/// them, with the readings in words, and how many there are. Without a calibration there are none.
///
/// # Errors
/// [`LogError`] if the log cannot be read.
pub fn doubtful_rows(
    job: &TrialJob<'_>,
    window_s: [f64; 2],
) -> Result<(Vec<(u64, String)>, usize), LogError> {
    let log = job.log;
    let ranges = job.instrument.calibration.filter(|of| of.channels() == log.channels());
    let Some(calibration) = ranges else { return Ok((Vec::new(), 0)) };
    let doubt = |channel: usize, reading: f64| {
        let range = calibration.valid_range.as_ref().and_then(|ranges| ranges.get(channel));
        let why = match range {
            _ if !(reading > 0.0 && reading < job.options.full_scale) => {
                "an end of the converter".to_owned()
            }
            Some(range) if !range.contains(reading) => {
                format!("calibrated from {} to {}", range.min, range.max)
            }
            _ => return None,
        };
        Some(format!("`s{}` is {reading}, {why}", channel + 1))
    };
    let are_stale = log.repeats_are_stale();
    let wanted = Wanted { time: true, readings: true, ..Wanted::default() };
    let look = |block: &mut Block| -> Vec<(u64, String)> {
        let fresh = if are_stale { block.fresh_rows() } else { vec![true; block.rows] };
        let words = |row: usize| {
            let time_s = block.time_s[row];
            if !fresh[row] || !(window_s[0]..=window_s[1]).contains(&time_s) {
                return None;
            }
            let readings = block.readings.iter().enumerate();
            let doubts = readings.filter_map(|(channel, column)| doubt(channel, column[row]));
            let doubts: Vec<String> = doubts.collect();
            let words = || format!("{time_s:.3} s: {}", doubts.join("; "));
            (!doubts.is_empty()).then(|| (block.lines.line(row), words()))
        };
        (0..block.rows).filter_map(words).collect()
    };
    let (mut first, mut count) = (Vec::new(), 0);
    log.read(&wanted, &job.read, look, |found| {
        count += found.len();
        let room = NAMED.saturating_sub(first.len());
        first.extend(found.into_iter().take(room));
        Ok::<_, LogError>(())
    })?;
    Ok((first, count))
}
