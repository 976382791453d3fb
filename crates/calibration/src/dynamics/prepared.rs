//! Clock of the rows, and preparation of data sets: memory terms, and the wrench at the time of the readings.

use std::fmt;
use std::ops::Range;
use std::sync::Arc;

use super::{FitError, GAP_PERIODS};
use crate::memory::{MemoryTerms, NoTime, TimeBase};
use crate::quality::significant;
use shell_data::block::Block;
use shell_data::dataset::{Dataset, LogRows, sample};
use shell_data::statistics::upper_median;

/// Delay with which the reference shows a load, relative to the readings of the same row.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct ReferenceLag {
    pub time_base: TimeBase,
    /// In units of the time base; negative if the readings lag behind the reference.
    pub by: f64,
}

impl ReferenceLag {
    /// Converts the time of readings, s, to the time at which the reference shows the same force.
    /// Unchanged if the lag is in rows.
    pub fn moved_s(&self, time_s: f64) -> f64 {
        /// Largest time that is rounded to a nanosecond, which a double still resolves there.
        const LARGEST_S: f64 = 1e6;
        match self.time_base {
            TimeBase::Rows => time_s,
            TimeBase::Seconds if time_s.abs() > LARGEST_S => time_s + self.by,
            TimeBase::Seconds => ((time_s + self.by) * 1e9).round() / 1e9,
        }
    }
}

impl fmt::Display for ReferenceLag {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (factor, unit) = super::unit(self.by.abs(), self.time_base);
        write!(f, "{} {unit}", significant(factor * self.by.abs(), 3))
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct RowClock {
    pub(super) time_base: TimeBase,
    pub(super) period: f64,
}

impl RowClock {
    /// Counts rows if a log has no time, or if time stands still.
    pub(super) fn new(data: &Dataset) -> Self {
        let by_rows = Self { time_base: TimeBase::Rows, period: 1.0 };
        let mut steps = Vec::new();
        for (_, block) in data.blocks() {
            if block.rows.time_s.len() != block.rows.rows {
                return by_rows;
            }
            steps.extend(block.rows.time_s.windows(2).map(|pair| pair[1] - pair[0]));
        }
        let Some(period) = median_step(steps) else { return by_rows };
        Self { time_base: TimeBase::Seconds, period }
    }

    pub(super) fn gap(&self) -> Option<f64> {
        (self.time_base == TimeBase::Seconds).then_some(GAP_PERIODS * self.period)
    }

    /// Returns [`FitError::TimeConstant`] if a time constant is not positive and finite.
    pub(super) fn memory(&self, time_constants: &[f64]) -> Result<MemoryTerms, FitError> {
        let is_wrong = |tau: &&f64| !(**tau > 0.0 && tau.is_finite());
        if let Some(&wrong) = time_constants.iter().find(is_wrong) {
            return Err(FitError::TimeConstant(wrong));
        }
        let mut time_constants = time_constants.to_vec();
        time_constants.sort_unstable_by(f64::total_cmp);
        time_constants.dedup();
        Ok(MemoryTerms { time_base: self.time_base, time_constants, gap: self.gap() })
    }
}

fn median_step(mut steps: Vec<f64>) -> Option<f64> {
    steps.retain(|&step| step > 0.0);
    upper_median(&mut steps)
}

#[derive(Clone, Copy, Debug)]
pub(super) struct BetweenRows {
    before: usize,
    after: usize,
    share: f64,
}

impl BetweenRows {
    /// Finds, for each of the ascending `rows`, the point in time that is later by `by`. It lies between two
    /// rows, or up to one row beyond the ends of the row's segment; further out, the value there is held.
    /// `times` ascend within each of `segments`.
    pub(super) fn later(
        times: &[f64],
        segments: &[Range<usize>],
        by: f64,
        rows: impl IntoIterator<Item = usize>,
    ) -> Vec<Self> {
        let (mut segments, mut segment) = (segments.iter(), &(0..0));
        let of_row = |row: usize| {
            while row >= segment.end
                && let Some(next) = segments.next()
            {
                segment = next;
            }
            let &Range { start, end } = segment;
            let wanted = times[row] + by;
            let last = end.saturating_sub(2).max(start);
            let mut before = row.min(last);
            while before < last && times[before + 1] <= wanted {
                before += 1;
            }
            while before > start && times[before] > wanted {
                before -= 1;
            }
            let after = (before + 1).min(end - 1);
            let span = times[after] - times[before];
            let share = if span > 0.0 { (wanted - times[before]) / span } else { 0.0 };
            Self { before, after, share: share.clamp(-1.0, 2.0) }
        };
        rows.into_iter().map(of_row).collect()
    }

    /// Value of a column at this time, linear between both rows.
    pub(super) fn value(&self, column: &[f64]) -> f64 {
        column[self.before] + self.share * (column[self.after] - column[self.before])
    }
}

/// Divides rows where time goes back or jumps by more than a given `gap`.
pub(super) fn segments(times: &[f64], gap: Option<f64>) -> Vec<Range<usize>> {
    let goes_on = |before: &f64, after: &f64| {
        let step = after - before;
        step >= 0.0 && gap.is_none_or(|gap| step <= gap)
    };
    let mut end = 0;
    let rows = |times: &[f64]| {
        end += times.len();
        end - times.len()..end
    };
    times.chunk_by(goes_on).map(rows).collect()
}

/// Appends the memory terms to the readings, and moves the wrench by the lag.
///
/// # Errors
/// [`FitError::NoTime`] if memory or lag is in seconds and a log has no time.
pub fn prepared(
    mut data: Dataset,
    memory: Option<&MemoryTerms>,
    lag: Option<ReferenceLag>,
) -> Result<Dataset, FitError> {
    if memory.is_some() || lag.is_some() {
        for log in &mut data.logs {
            prepare(log, memory, lag).map_err(|_| FitError::NoTime(log.name.clone()))?;
        }
    }
    Ok(data)
}

fn prepare(
    log: &mut LogRows,
    memory: Option<&MemoryTerms>,
    lag: Option<ReferenceLag>,
) -> Result<(), NoTime> {
    // Blocks without another owner are changed in place.
    let mut blocks: Vec<&mut Block> =
        log.blocks.iter_mut().map(|block| Arc::make_mut(&mut block.rows)).collect();
    if let Some(lag) = lag {
        move_wrench(&mut blocks, lag)?;
    }
    if let Some(memory) = memory {
        let mut state = memory.start();
        blocks.iter_mut().try_for_each(|block| state.extend(block))?;
    }
    log.sample = sample(log.blocks.iter().map(|block| &*block.rows));
    Ok(())
}

/// Replaces the wrench of each row by the one at the time when the reference shows the load of the readings.
fn move_wrench(blocks: &mut [&mut Block], lag: ReferenceLag) -> Result<(), NoTime> {
    let rows: usize = blocks.iter().map(|block| block.rows).sum();
    let (times, gap) = match lag.time_base {
        TimeBase::Rows => ((0..rows).map(|row| row as f64).collect(), None),
        TimeBase::Seconds => {
            let times: Vec<f64> =
                blocks.iter().flat_map(|block| block.time_s.iter().copied()).collect();
            if times.len() != rows {
                return Err(NoTime);
            }
            let steps = times.windows(2).map(|pair| pair[1] - pair[0]);
            let gap = median_step(steps.collect()).map(|period| GAP_PERIODS * period);
            (times, gap)
        }
    };
    let then = BetweenRows::later(&times, &segments(&times, gap), lag.by, 0..rows);
    for axis in 0..6 {
        let column: Vec<f64> =
            blocks.iter().flat_map(|block| block.wrench[axis].iter().copied()).collect();
        let loads = blocks.iter_mut().flat_map(|block| &mut block.wrench[axis]);
        loads.zip(&then).for_each(|(load, then)| *load = then.value(&column));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_straight_line_is_moved_along_itself_and_held_beyond_the_ends_of_segments() {
        let times = [0.0, 1.0, 1.5, 3.0, 50.0, 51.0];
        let segments = segments(&times, Some(10.0));
        assert_eq!(segments, [0..4, 4..6]);
        let column = times.map(|time| 2.0 * time);
        let shifted = |by: f64| -> Vec<f64> {
            let then = BetweenRows::later(&times, &segments, by, 0..times.len());
            then.iter().map(|then| then.value(&column)).collect()
        };
        let later = shifted(0.25);
        assert_eq!(later, [0.5, 2.5, 3.5, 6.5, 100.5, 102.5]);
        let earlier = shifted(-0.75);
        assert_eq!(earlier, [-1.5, 0.5, 1.5, 4.5, 98.5, 100.5]);
        let much_later = shifted(5.0);
        assert_eq!(much_later, [9.0, 9.0, 9.0, 9.0, 104.0, 104.0]);
        let some = BetweenRows::later(&times, &segments, 0.25, [1, 4]);
        assert_eq!([some[0].value(&column), some[1].value(&column)], [2.5, 100.5]);
    }

    #[test]
    fn time_that_goes_back_begins_a_segment() {
        assert_eq!(segments(&[5.0, 5.0, 6.0, 2.0, 3.0], None), [0..3, 3..5]);
        assert!(segments(&[], None).is_empty());
    }
}
