//! The rows of a trial with readings that cannot be trusted, one by one.

use super::job::TrialJob;
use log_file::{LogError, Wanted};
use shell_data::BlockLines;
use shell_data::block::Block;

/// Rows of one log that are named.
const NAMED: usize = 20;

/// A row with readings that cannot be trusted.
#[derive(Clone, Debug, PartialEq)]
pub struct DoubtfulRow {
    /// Its line in the log.
    pub line: u64,
    /// When, s on the log's clock.
    pub time_s: f64,
    /// The channels, from 0, their readings, and why.
    pub readings: Vec<(usize, f64, Doubt)>,
}

/// Why a reading cannot be trusted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Doubt {
    /// It is at an end of the converter.
    Saturated,
    /// It is outside the range of the training data.
    OutOfRange {
        /// The least reading there.
        min: f64,
        /// The greatest.
        max: f64,
    },
}

/// A row that was found, before its line is looked up.
struct DoubtfulValue {
    offset: u64,
    row: usize,
    time_s: f64,
    readings: Vec<(usize, f64, Doubt)>,
}

/// The frames between two times (s on the log's clock) with a reading that cannot be trusted: the first of them,
/// and how many there are. Without a calibration there are none.
///
/// # Errors
/// [`LogError`] if the log cannot be read.
pub fn doubtful_rows(
    job: &TrialJob<'_>,
    window_s: [f64; 2],
) -> Result<(Vec<DoubtfulRow>, usize), LogError> {
    let log = job.log;
    let ranges = job.instrument.calibration.filter(|of| of.channels() == log.channels());
    let Some(calibration) = ranges else { return Ok((Vec::new(), 0)) };
    let doubt = |channel: usize, reading: f64| {
        let range = calibration.valid_range.as_ref().and_then(|ranges| ranges.get(channel));
        match range {
            _ if !(reading > 0.0 && reading < job.options.full_scale) => Some(Doubt::Saturated),
            Some(range) if !range.contains(reading) => {
                Some(Doubt::OutOfRange { min: range.min, max: range.max })
            }
            _ => None,
        }
    };
    let are_stale = log.repeats_are_stale();
    let wanted = Wanted { time: true, readings: true, ..Wanted::default() };
    let look = |block: &mut Block| -> Vec<DoubtfulValue> {
        let fresh = if are_stale { block.fresh_rows() } else { vec![true; block.rows] };
        let is_meant =
            |row: &usize| fresh[*row] && (window_s[0]..=window_s[1]).contains(&block.time_s[*row]);
        let found = |row: usize| {
            let readings = block.readings.iter().enumerate().filter_map(|(channel, column)| {
                doubt(channel, column[row]).map(|doubt| (channel, column[row], doubt))
            });
            DoubtfulValue {
                offset: block.offset,
                row,
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
    let rows: Vec<_> = first.iter().map(|found| (found.offset, found.row)).collect();
    let lines = log.lines_of_rows(&wanted, &rows, &BlockLines::default())?;
    let named = first.into_iter().zip(lines).map(|(found, line)| DoubtfulRow {
        line,
        time_s: found.time_s,
        readings: found.readings,
    });
    Ok((named.collect(), count))
}
