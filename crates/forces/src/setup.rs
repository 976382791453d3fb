//! What must be known before the first force: tare and clock, from the first rows of a log.

use calibration::Calibration;

use super::clock::ClockSearch;
use super::filter::Butterworth;
use super::pipeline::{AppliedLowPass, ForcePipeline};
use super::signal::BlockPlan;
use super::tare::{FirstRows, FoundTare, TareSearch};
use super::{ForceError, ForceOptions, RowRule, TareFrames, TareRule};

/// The search for tare and clock.
#[derive(Clone, Debug)]
pub struct PipelineSetup {
    options: ForceOptions,
    tare: TareSearch,
    /// The clock, as far as times have been read.
    pub clock: ClockSearch,
}

impl PipelineSetup {
    /// Nothing read yet.
    pub fn new(options: ForceOptions) -> Self {
        let tare = TareSearch::new(options.tare, options.rule);
        Self { options, tare, clock: ClockSearch::default() }
    }

    /// The same, keeping the frames of the tare.
    pub fn keeping_frames(options: ForceOptions) -> Self {
        let mut setup = Self::new(options);
        setup.tare.frames = Some(TareFrames::default());
        setup
    }

    /// The same while a log is recorded: of a tare that follows the stationary intervals only the first is looked for,
    /// and [`ForcePipeline::follow`] is told of all of them.
    pub fn while_recording(options: ForceOptions) -> Self {
        let mut setup = Self::new(options);
        setup.tare.ends_at_first_rest = true;
        setup
    }

    /// Takes the next rows, for tare and clock.
    pub fn look_at(&mut self, calibration: &Calibration, rows: FirstRows<'_>) {
        self.clock.look_at(rows.times_s);
        self.look_at_frames(calibration, rows);
    }

    /// Takes the next rows [that may hold frames of the tare](Self::wants_frames), for the tare alone.
    pub fn look_at_frames(&mut self, calibration: &Calibration, rows: FirstRows<'_>) {
        self.tare.look_at(calibration, rows);
    }

    /// Whether rows that end at `last_s` may hold frames of the tare.
    pub fn wants_frames(&self, last_s: f64) -> bool {
        self.tare.wants(last_s)
    }

    /// Whether all is known, so that no more rows are needed.
    pub fn is_done(&self) -> bool {
        let needs_clock = self.options.low_pass.is_some();
        self.tare.is_done && (!needs_clock || self.clock.is_done())
    }

    /// The times between which rows are needed to know the forces between two times, s, if the clock
    /// is [known](ClockSearch::is_done).
    ///
    /// # Errors
    /// [`ForceError::Filter`].
    pub fn needed_s(&self, from_s: f64, to_s: f64) -> Result<(f64, f64), ForceError> {
        let everything = (f64::NEG_INFINITY, f64::INFINITY);
        let Some(clock) = self.clock.finish(self.options.rate_hz) else { return Ok(everything) };
        let Some((_, plan)) = self.low_pass()? else { return Ok((from_s, to_s)) };
        // By row the grid is not one of time.
        if self.options.rule == RowRule::Rows {
            return Ok(everything);
        }
        let needed = plan.needed(clock.slot(from_s), clock.slot(to_s));
        // Half a slot is rounded away, and a time of its own rounds as well.
        let slack = 1.0 / clock.rate_hz;
        let low =
            if needed.start == 0 { f64::NEG_INFINITY } else { clock.time_s(needed.start) - slack };
        Ok((low, clock.time_s(needed.end) + slack))
    }

    /// The low-pass at the clock's rate; `None` for none.
    fn low_pass(&self) -> Result<Option<(AppliedLowPass, BlockPlan)>, ForceError> {
        let Some(low_pass) = self.options.low_pass else { return Ok(None) };
        let optional = self.options.low_pass_is_optional;
        let Some(clock) = self.clock.finish(self.options.rate_hz) else {
            let error = ForceError::NoRate("time does not move on between its rows");
            return if optional { Ok(None) } else { Err(error) };
        };
        match Butterworth::low_pass(low_pass.order, low_pass.cutoff_hz, clock.rate_hz) {
            Ok(design) => {
                let at_rest = self.options.tare != TareRule::Untared;
                let applied = AppliedLowPass { low_pass, rate_hz: clock.rate_hz };
                Ok(Some((applied, BlockPlan::new(design, low_pass.zero_phase, at_rest))))
            }
            Err(_) if optional => Ok(None),
            Err(error) => Err(error.into()),
        }
    }

    /// The pipeline from here on, and the frames of the tare if they were kept.
    ///
    /// # Errors
    /// [`ForceError`] if the rows were too few for tare or clock, or the filter is impossible.
    pub fn finish(
        self,
        calibration: &Calibration,
    ) -> Result<(ForcePipeline, Option<TareFrames>), ForceError> {
        let low_pass = self.low_pass()?;
        let clock = self.clock.finish(self.options.rate_hz);
        let FoundTare { tare, result, frames, zeros } = self.tare.finish(calibration)?;
        let (low_pass, plan) = low_pass.unzip();
        let (rule, filter) = (self.options.rule, clock.zip(plan));
        Ok((ForcePipeline { rule, tare, zeros, tare_result: result, low_pass, filter }, frames))
    }
}
