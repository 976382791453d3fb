//! The rows of a trial with readings that cannot be trusted, one by one.

use super::job::TrialJob;
use calibration::reading_ranges::ReadingRange;
use log_file::{LogError, Wanted};
use shell_data::block::Block;

/// Rows of one log that are named.
const NAMED: usize = 20;

/// A row with readings that cannot be trusted.
struct DoubtfulRow {
    line: u64,
    time_s: f64,
    readings: Vec<DoubtfulReading>,
}

struct DoubtfulReading {
    channel: usize,
    reading: f64,
    /// The range of the training data that it is outside of; `None` at an end of the converter.
    range: Option<ReadingRange>,
}

impl DoubtfulRow {
    fn words(&self) -> String {
        let of = |of: &DoubtfulReading| {
            let why = match of.range {
                None => "an end of the converter".to_owned(),
                Some(ReadingRange { min, max, .. }) => format!("calibrated from {min} to {max}"),
            };
            format!("`s{}` is {}, {why}", of.channel + 1, of.reading)
        };
        let readings: Vec<String> = self.readings.iter().map(of).collect();
        format!("{:.3} s: {}", self.time_s, readings.join("; "))
    }
}

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
        let range = match range {
            _ if !(reading > 0.0 && reading < job.options.full_scale) => None,
            Some(range) if !range.contains(reading) => Some(*range),
            _ => return None,
        };
        Some(DoubtfulReading { channel, reading, range })
    };
    let are_stale = log.repeats_are_stale();
    let wanted = Wanted { time: true, readings: true, ..Wanted::default() };
    let look = |block: &mut Block| -> Vec<DoubtfulRow> {
        let fresh = if are_stale { block.fresh_rows() } else { vec![true; block.rows] };
        let is_meant =
            |row: &usize| fresh[*row] && (window_s[0]..=window_s[1]).contains(&block.time_s[*row]);
        let found = |row: usize| {
            let readings = block.readings.iter().enumerate();
            let readings = readings.filter_map(|(channel, column)| doubt(channel, column[row]));
            DoubtfulRow {
                line: block.lines.line(row),
                time_s: block.time_s[row],
                readings: readings.collect(),
            }
        };
        let rows = (0..block.rows).filter(is_meant).map(found);
        rows.filter(|found| !found.readings.is_empty()).collect()
    };
    let (mut first, mut count) = (Vec::new(), 0);
    log.read(&wanted, &job.read, look, |found| {
        count += found.len();
        let room = NAMED.saturating_sub(first.len());
        first.extend(found.into_iter().take(room));
        Ok::<_, LogError>(())
    })?;
    Ok((first.iter().map(|found| (found.line, found.words())).collect(), count))
}
