use calibration::Calibration;
use calibration::dynamics::ReferenceLag;
use calibration::uncertainty::Tare;
use shell_data::wrench::{Axis, PerAxis};

use super::clock::{Clock, ClockSearch, Grid};
use super::filter::{Butterworth, FilterError};
use super::lag::LagShift;
use super::signal::{BlockPlan, SignalFilter};
use super::stationary::StationaryInterval;
use super::tare::{FirstRows, StationaryZeros, TareSearch};
use super::{ForceOptions, LowPass, RowRule, TareFrames, TareResult, TareRule};

/// The pipeline from readings to forces, for one log. Its default follows
/// [`ForceOptions::RAW`](super::ForceOptions::RAW).
#[derive(Clone, Debug, Default)]
pub struct ForcePipeline {
    pub(super) rule: RowRule,
    /// The tare; that of the first interval, if the tare follows the stationary intervals.
    pub tare: Option<Tare>,
    /// Zeros that replace the tare's mean, if the tare follows the stationary intervals.
    pub(super) zeros: Option<StationaryZeros>,
    pub tare_result: Option<TareResult>,
    pub tare_frames: Option<TareFrames>,
    pub low_pass: Option<AppliedLowPass>,
    pub(super) filter: Option<(Clock, BlockPlan)>,
    /// The reference's lag, if forces are interpolated to the time stamps of their rows on the reference's clock.
    pub lag: Option<ReferenceLag>,
}

#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct AppliedLowPass {
    #[serde(flatten)]
    pub low_pass: LowPass,
    pub rate_hz: f64,
}

#[derive(Clone, Debug)]
pub struct ForceStream {
    low_pass: Option<(Grid, Vec<(Axis, SignalFilter)>)>,
    lag: Option<LagShift>,
}

impl ForcePipeline {
    /// Adds a stationary interval during recording, if the tare follows them.
    pub fn follow(&mut self, calibration: &Calibration, stationary: &StationaryInterval) {
        if let Some(zeros) = &mut self.zeros {
            zeros.add(calibration, stationary);
        }
    }

    /// Tared, unfiltered wrench of every row, N and N·m, with bits that do not depend on other rows. Times, s, are only
    /// needed if the tare follows the stationary intervals.
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

    /// Computes [`Self::wrench`] of rows that repeat `frames`, but converts each frame only once.
    pub fn wrench_of_rows(
        &self,
        calibration: &Calibration,
        times_s: &[f64],
        (frames, frame_of_row): (&[Vec<f64>], &[usize]),
    ) -> PerAxis<Vec<f64>> {
        let mut by_frame = PerAxis::<Vec<f64>>::default();
        calibration.wrench(frames, &mut by_frame);
        let mut wrench =
            by_frame.map(|of| frame_of_row.iter().map(|&frame| of[frame]).collect::<Vec<f64>>());
        self.tare_off(times_s, &mut wrench);
        wrench
    }

    pub fn looks_around(&self) -> bool {
        self.filter.is_some() || self.lag.is_some()
    }

    fn tare_off(&self, times_s: &[f64], wrench: &mut PerAxis<Vec<f64>>) {
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

    /// Starts low-pass and shift by the lag for `axes`. The next row must be the first of the log or the first
    /// [needed](super::PipelineSetup::needed_s).
    pub fn stream(&self, axes: &[Axis]) -> ForceStream {
        let low_pass = self.filter.as_ref().map(|(clock, plan)| {
            let filters = axes.iter().map(|axis| (*axis, SignalFilter::new(plan.clone())));
            (Grid::new(*clock, self.rule), filters.collect())
        });
        ForceStream { low_pass, lag: self.lag.map(LagShift::new) }
    }
}

impl ForceStream {
    /// Filters the next rows, at `times_s`. Returns the forces that are now known; a causal
    /// low-pass returns them all.
    ///
    /// # Errors
    /// [`FilterError::TooFewSamples`].
    pub fn push(
        &mut self,
        times_s: &[f64],
        wrench: PerAxis<Vec<f64>>,
    ) -> Result<PerAxis<Vec<f64>>, FilterError> {
        let mut outputs = wrench;
        if let Some((grid, filters)) = &mut self.low_pass {
            let slots = grid.slots(times_s);
            let wrench = std::mem::take(&mut outputs);
            for (axis, filter) in filters {
                filter.push(&slots, &wrench[axis.index()], &mut outputs[axis.index()])?;
            }
        }
        Ok(match &mut self.lag {
            Some(lag) => lag.push(times_s, outputs),
            None => outputs,
        })
    }

    /// # Errors
    /// [`FilterError::TooFewSamples`].
    pub fn finish(&mut self) -> Result<PerAxis<Vec<f64>>, FilterError> {
        let mut outputs = PerAxis::<Vec<f64>>::default();
        for (axis, filter) in self.low_pass.iter_mut().flat_map(|(_, filters)| filters) {
            filter.finish(&mut outputs[axis.index()])?;
        }
        Ok(match &mut self.lag {
            Some(lag) => lag.finish(outputs),
            None => outputs,
        })
    }
}

#[derive(Clone, Debug)]
pub struct PipelineSetup {
    options: ForceOptions,
    tare: TareSearch,
    pub clock: ClockSearch,
}

impl PipelineSetup {
    pub fn new(options: ForceOptions) -> Self {
        let tare = TareSearch::new(options.tare, options.rule);
        Self { options, tare, clock: ClockSearch::default() }
    }

    pub fn keeping_frames(options: ForceOptions) -> Self {
        let mut setup = Self::new(options);
        setup.tare.frames = Some(TareFrames::default());
        setup
    }

    /// Creates a set-up for recording. A tare that follows the stationary intervals searches only for the first; report
    /// all intervals to [`ForcePipeline::follow`].
    pub fn while_recording(options: ForceOptions) -> Self {
        let mut setup = Self::new(options);
        setup.tare.finder = None;
        setup
    }

    pub fn look_at(&mut self, calibration: &Calibration, rows: FirstRows<'_>) {
        self.clock.look_at(rows.times_s);
        self.look_at_frames(calibration, rows);
    }

    /// Takes rows [that may hold frames of the tare](Self::wants_frames), for the tare only.
    pub fn look_at_frames(&mut self, calibration: &Calibration, rows: FirstRows<'_>) {
        self.tare.look_at(calibration, rows);
    }

    /// Returns true if rows that end at `last_s` may hold frames of the tare.
    pub fn wants_frames(&self, last_s: f64) -> bool {
        self.tare.wants(last_s)
    }

    pub fn is_done(&self) -> bool {
        let needs_clock = self.options.low_pass.is_some();
        self.tare.is_done() && (!needs_clock || self.clock.is_done())
    }

    /// Returns the range of time, s, whose rows are needed for forces between two times. The clock must be
    /// [known](ClockSearch::is_done).
    ///
    /// # Errors
    /// [`ForceError::Filter`].
    pub fn needed_s(&self, from_s: f64, to_s: f64) -> Result<(f64, f64), ForceError> {
        let everything = (f64::NEG_INFINITY, f64::INFINITY);
        let Some(clock) = self.clock.finish(self.options.rate_hz) else { return Ok(everything) };
        let Some((_, plan)) = self.low_pass()? else { return Ok((from_s, to_s)) };
        // With `RowRule::Rows`, the grid is not a grid of time.
        if self.options.rule == RowRule::Rows {
            return Ok(everything);
        }
        let needed = plan.needed(clock.slot(from_s), clock.slot(to_s));
        // A row may be half a slot off its slot's time, plus the rounding error of the time itself.
        let slack = 1.0 / clock.rate_hz;
        let low =
            if needed.start == 0 { f64::NEG_INFINITY } else { clock.time_s(needed.start) - slack };
        Ok((low, clock.time_s(needed.end) + slack))
    }

    fn low_pass(&self) -> Result<Option<(AppliedLowPass, BlockPlan)>, ForceError> {
        let Some(low_pass) = self.options.low_pass else { return Ok(None) };
        let optional = self.options.low_pass_is_optional;
        let Some(clock) = self.clock.finish(self.options.rate_hz) else {
            let error = ForceError::NoRate("time does not move on between its rows");
            return if optional { Ok(None) } else { Err(error) };
        };
        match Butterworth::low_pass(low_pass.order, low_pass.cutoff_hz, clock.rate_hz) {
            // An order is never a default that a slow log does not suit.
            Err(error @ FilterError::Order(_)) => Err(error.into()),
            Ok(design) => {
                let starts_at_zero = self.options.tare != TareRule::Untared;
                let applied = AppliedLowPass { low_pass, rate_hz: clock.rate_hz };
                Ok(Some((applied, BlockPlan::new(design, low_pass.zero_phase, starts_at_zero))))
            }
            Err(_) if optional => Ok(None),
            Err(error) => Err(error.into()),
        }
    }

    /// # Errors
    /// [`ForceError`] if there were too few rows for tare or clock, or the filter is impossible.
    pub fn finish(self, calibration: &Calibration) -> Result<ForcePipeline, ForceError> {
        let (low_pass, plan) = self.low_pass()?.unzip();
        let filter = self.clock.finish(self.options.rate_hz).zip(plan);
        let tared = self.tare.finish(calibration)?;
        Ok(ForcePipeline { rule: self.options.rule, low_pass, filter, ..tared })
    }
}

#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ForceError {
    #[error("only `{found}` frames to tare on, `{wanted}` wanted")]
    TareFrames { wanted: usize, found: usize },
    /// No frame between the times of the tare; the frames read are from `first_s` to `last_s`.
    #[error(
        "no frame between `{start_s}` and `{end_s}` s to tare on: frames run from `{first_s}` to `{last_s}` s"
    )]
    TareTime { start_s: f64, end_s: f64, first_s: f64, last_s: f64 },
    #[error("the sampling rate, which a low-pass needs, is not known: {0}")]
    NoRate(&'static str),
    #[error(transparent)]
    Filter(#[from] FilterError),
}
