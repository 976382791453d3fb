//! The pipeline once tare and clock are known.

use calibration::Calibration;
use calibration::uncertainty::Tare;
use shell_data::wrench::{Axis, PerAxis};

use super::clock::{Clock, Grid};
use super::filter::FilterError;
use super::signal::{BlockPlan, SignalFilter};
use super::stationary::{StationaryInterval, StationaryZeros};
use super::{LowPass, RowRule, TareResult};

/// From readings to forces, for one log. The default has the calibration's own zero, unfiltered: what
/// [`ForceOptions::RAW`](super::ForceOptions::RAW) gives on any log.
#[derive(Clone, Debug, Default)]
pub struct ForcePipeline {
    pub(super) rule: RowRule,
    /// The tare; of one that follows the stationary intervals, the first.
    pub tare: Option<Tare>,
    /// What is subtracted in place of the tare's mean, where the tare follows the stationary intervals.
    pub(super) zeros: Option<StationaryZeros>,
    /// What was taken as unloaded.
    pub tare_result: Option<TareResult>,
    /// The low-pass; `None` if forces are not filtered.
    pub low_pass: Option<AppliedLowPass>,
    pub(super) filter: Option<(Clock, BlockPlan)>,
}

/// A low-pass, and the rate of its grid.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct AppliedLowPass {
    /// The filter.
    #[serde(flatten)]
    pub low_pass: LowPass,
    /// Slots per second, Hz.
    pub rate_hz: f64,
}

/// The low-pass over rows in order; without one, rows pass as they are.
#[derive(Clone, Debug)]
pub struct ForceStream {
    grid: Option<Grid>,
    filters: PerAxis<Option<SignalFilter>>,
}

impl ForcePipeline {
    /// Follows another rest, if the tare does that, while a log is recorded.
    pub fn follow(&mut self, calibration: &Calibration, rest: &StationaryInterval) {
        if let Some(zeros) = &mut self.zeros {
            zeros.add(calibration, rest);
        }
    }

    /// The wrench of every row, tared, not filtered: N and N·m. The bits of a row do not depend on
    /// the rows beside it. Times, s, are for a tare that follows the stationary intervals.
    pub fn wrench(
        &self,
        calibration: &Calibration,
        times_s: &[f64],
        readings: &[Vec<f64>],
    ) -> PerAxis<Vec<f64>> {
        let mut wrench = PerAxis::default();
        calibration.wrench(readings, &mut wrench);
        self.tare_off(times_s, &mut wrench);
        wrench
    }

    /// Takes the tare off wrenches at `times_s`. Columns may be empty.
    pub fn tare_off(&self, times_s: &[f64], wrench: &mut PerAxis<Vec<f64>>) {
        if let Some(zeros) = &self.zeros {
            for (row, &time_s) in times_s.iter().enumerate() {
                for (column, zero) in wrench.iter_mut().zip(zeros.at(time_s)) {
                    column.get_mut(row).into_iter().for_each(|value| *value -= zero);
                }
            }
        } else if let Some(tare) = &self.tare {
            for (column, zero) in wrench.iter_mut().zip(tare.wrench) {
                column.iter_mut().for_each(|value| *value -= zero);
            }
        }
    }

    /// The low-pass along `axes`, from the first row of the log on, or, by time, from any row of those
    /// [needed](super::PipelineSetup::needed_s).
    pub fn stream(&self, axes: &[Axis]) -> ForceStream {
        let filter = |axis: usize| {
            let (_, plan) = self.filter.as_ref()?;
            let wanted = axes.iter().any(|wanted| wanted.index() == axis);
            wanted.then(|| SignalFilter::new(plan.clone()))
        };
        let grid = self.filter.as_ref().map(|(clock, _)| Grid::new(*clock, self.rule));
        ForceStream { grid, filters: std::array::from_fn(filter) }
    }
}

impl ForceStream {
    /// Filters the next rows, at `times_s`. What is returned are the forces of the oldest rows that are
    /// not answered yet, as many as are known by now: of a causal low-pass all of them.
    ///
    /// # Errors
    /// [`FilterError::TooFewSamples`].
    pub fn push(
        &mut self,
        times_s: &[f64],
        wrench: PerAxis<Vec<f64>>,
    ) -> Result<PerAxis<Vec<f64>>, FilterError> {
        let Some(grid) = &mut self.grid else { return Ok(wrench) };
        let slots = grid.slots(times_s);
        let mut answers = PerAxis::<Vec<f64>>::default();
        for ((filter, values), answers) in self.filters.iter_mut().zip(&wrench).zip(&mut answers) {
            if let Some(filter) = filter {
                filter.push(&slots, values, answers)?;
            }
        }
        Ok(answers)
    }

    /// The forces of the rows that are not answered yet.
    ///
    /// # Errors
    /// [`FilterError::TooFewSamples`].
    pub fn finish(&mut self) -> Result<PerAxis<Vec<f64>>, FilterError> {
        let mut answers = PerAxis::<Vec<f64>>::default();
        for (filter, answers) in self.filters.iter_mut().zip(&mut answers) {
            if let Some(filter) = filter {
                filter.finish(answers)?;
            }
        }
        Ok(answers)
    }
}
