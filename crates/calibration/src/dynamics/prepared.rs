//! Data sets with memory terms beside their readings and the wrench at the time of the readings.

use std::sync::Arc;

use super::lag::{BetweenRows, ReferenceLag, segments};
use super::{FitError, GAP_PERIODS};
use crate::memory::{MemoryTerms, NoTime, TimeBase};
use shell_data::block::Block;
use shell_data::dataset::{Dataset, LogRows, sample};
use shell_data::statistics::upper_median;

/// How time passes in some logs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct RowClock {
    pub(super) time_base: TimeBase,
    /// The usual time between rows, in units of the time base.
    pub(super) period: f64,
}

impl RowClock {
    /// By rows where a log has no time, or where it stands still.
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

    /// A longer step of the clock is a gap.
    pub(super) fn gap(&self) -> Option<f64> {
        (self.time_base == TimeBase::Seconds).then_some(GAP_PERIODS * self.period)
    }

    /// The memory of time constants.
    ///
    /// # Errors
    /// [`FitError::TimeConstant`] if one is not positive.
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

/// The median of the steps that move on.
fn median_step(mut steps: Vec<f64>) -> Option<f64> {
    steps.retain(|&step| step > 0.0);
    upper_median(&mut steps)
}

/// The rows as a calibration with this memory and lag takes them.
///
/// # Errors
/// [`FitError::NoTime`] if either is by time and a log has none.
pub fn prepared(
    mut data: Dataset,
    memory: Option<&MemoryTerms>,
    lag: Option<ReferenceLag>,
) -> Result<Dataset, FitError> {
    if memory.is_some() || lag.is_some() {
        for log in &mut data.logs {
            prepare(log, memory, lag).map_err(|_| FitError::NoTime { log: log.name.clone() })?;
        }
    }
    Ok(data)
}

fn prepare(
    log: &mut LogRows,
    memory: Option<&MemoryTerms>,
    lag: Option<ReferenceLag>,
) -> Result<(), NoTime> {
    // Blocks that nobody else has are changed where they are.
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

/// Replaces the wrench of every row by that of the time when the reference shows what the readings do.
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
