//! A trial from its log: one pass, in which of most rows the time alone is parsed.

use super::sampling::Sampling;
use crate::trial::{
    Clock, LowPass, NoWindow, Profile, Proposal, Remark, Stretch, TareRule, TareSearch, Trace,
    TraceExtent, Trial, TrialError, TrialOptions, TrialResult, check_window, evaluate,
    propose_window, warm_up_s,
};
use calibration::Calibration;
use log_file::{Log, LogError, ReadOptions, ReadSummary, Selection, Wanted};
use shell_data::block::Block;
use shell_data::telemetry::Telemetry;

/// Rows are looked for this far around the window at least, s.
const MARGIN_S: f64 = 1.0;

/// The time from row to row where the first rows do not tell, s.
const USUAL_PERIOD_S: f64 = 1e-3;

/// What trials are evaluated with.
#[derive(Clone, Copy, Debug)]
pub struct Instrument<'a> {
    /// The robot.
    pub profile: &'a Profile,
    /// The calibration of its shell; without one there are no forces.
    pub calibration: Option<&'a Calibration>,
}

/// A trial that could not be evaluated on its log.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TrialLogError {
    /// The log cannot be read.
    #[error(transparent)]
    Log(#[from] LogError),
    /// The trial cannot be evaluated on it.
    #[error(transparent)]
    Trial(#[from] TrialError),
    /// The window was to be found, and cannot be.
    #[error("no window found")]
    Window(#[from] NoWindow),
    /// The window was to be found in forces that there are not.
    #[error("no window found: there are no forces to find it in")]
    NoForces,
}

/// A trial, and the log that it was found on.
#[derive(Clone, Debug, PartialEq)]
pub struct Evaluated {
    /// The results.
    pub result: TrialResult,
    /// The log's clock.
    pub clock: Clock,
    /// Rows in the log.
    pub rows: u64,
    /// The log's checksum, if it was asked for.
    pub checksum: Option<String>,
}

/// Evaluates a trial on its log.
///
/// # Errors
/// [`TrialLogError`] if the log cannot be read or the trial not be evaluated on it.
pub fn evaluate_log(
    log: &Log,
    trial: &Trial,
    instrument: Instrument<'_>,
    options: &TrialOptions,
    read: &ReadOptions<'_>,
) -> Result<Evaluated, TrialLogError> {
    let window = (trial.t_enter_s, trial.t_exit_s);
    let recorded = Recorded::read(log, window, instrument, options, read)?;
    // What is wrong with the window says more than that there are no rows in it.
    check_window(trial, &recorded.clock)?;
    let rows = recorded.summary.skipped_rows;
    let mut evaluated = recorded.evaluate(trial, instrument, options)?;
    if rows > 0 {
        evaluated.result.remarks.push(Remark::SkippedRows { rows });
    }
    Ok(evaluated)
}

/// Evaluates a log from its first row to its last, with its trace, as if it were one trial: what a
/// window is looked for in.
///
/// # Errors
/// [`TrialLogError`] as of [`evaluate_log`].
pub fn evaluate_whole(
    log: &Log,
    instrument: Instrument<'_>,
    options: &TrialOptions,
    read: &ReadOptions<'_>,
) -> Result<Evaluated, TrialLogError> {
    let options = TrialOptions { trace: TraceExtent::Log, ..*options };
    let everything = (f64::NEG_INFINITY, f64::INFINITY);
    let recorded = Recorded::read(log, everything, instrument, &options, read)?;
    let Clock { first_s, last_s, .. } = recorded.clock;
    let trial = Trial::of_window(log.path().display().to_string(), (first_s, last_s));
    recorded.evaluate(&trial, instrument, &options)
}

/// Proposes entry and exit from the drag, filtered without delay whatever `options` say.
///
/// # Errors
/// [`TrialLogError`] if the log cannot be evaluated, or tells no window.
pub fn find_window(
    log: &Log,
    instrument: Instrument<'_>,
    options: &TrialOptions,
    read: &ReadOptions<'_>,
) -> Result<Proposal, TrialLogError> {
    let low_pass = options.low_pass.map(|low_pass| LowPass { zero_phase: true, ..low_pass });
    let options = TrialOptions { low_pass, ..*options };
    let TrialResult { row, trace, .. } = evaluate_whole(log, instrument, &options, read)?.result;
    let Trace { t_s, wrench: [fx, ..], .. } = trace.unwrap_or_default();
    let drag: Vec<f64> = fx.iter().map(|fx| -fx).collect();
    if drag.is_empty() {
        return Err(TrialLogError::NoForces);
    }
    Ok(propose_window(&t_s, &drag, row.stride_frequency_hz.map(f64::recip))?)
}

/// What was taken from a log.
struct Recorded {
    clock: Clock,
    stretch: Stretch,
    tare: TareSearch,
    summary: ReadSummary,
}

impl Recorded {
    fn read(
        log: &Log,
        window: (f64, f64),
        instrument: Instrument<'_>,
        options: &TrialOptions,
        read: &ReadOptions<'_>,
    ) -> Result<Self, TrialLogError> {
        let mut reading = Reading::new(log, window, instrument, options)?;
        let wanted = reading.wanted.clone();
        let summary = log.read_where(&wanted, read, &mut reading)?;
        let clock = reading.clock(summary.rows)?;
        Ok(Self { clock, stretch: reading.stretch, tare: reading.tare, summary })
    }

    fn evaluate(
        self,
        trial: &Trial,
        Instrument { profile, calibration }: Instrument<'_>,
        options: &TrialOptions,
    ) -> Result<Evaluated, TrialLogError> {
        let Self { clock, stretch, tare, summary } = self;
        let tare = tare.finish()?;
        let result =
            evaluate(trial, profile, calibration, &clock, tare.as_ref(), &stretch, options)?;
        Ok(Evaluated { result, clock, rows: summary.rows, checksum: summary.checksum })
    }
}

/// What is taken from the log as it goes by.
struct Reading<'a> {
    options: &'a TrialOptions,
    enter_s: f64,
    exit_s: f64,
    wanted: Wanted,
    kinds: Vec<Telemetry>,
    tare: TareSearch,
    /// The times between which rows are needed, s; found with the first piece.
    needed_s: Option<(f64, f64)>,
    sampling: Sampling,
    rows: u64,
    first_s: Option<f64>,
    last_s: Option<f64>,
    has_begun: bool,
    /// Whether equal readings in a row are one frame.
    repeats_are_stale: bool,
    stretch: Stretch,
}

impl<'a> Reading<'a> {
    fn new(
        log: &Log,
        window: (f64, f64),
        instrument: Instrument<'_>,
        options: &'a TrialOptions,
    ) -> Result<Self, LogError> {
        let forces = instrument.calibration.is_some() && log.channels() > 0;
        let mut kinds = Telemetry::POWER.to_vec();
        kinds.push(Telemetry::RightLeg);
        if options.trace != TraceExtent::Nothing {
            kinds.push(Telemetry::LeftLeg);
        }
        let mut found = Vec::new();
        for kind in kinds {
            found.extend(log.telemetry(kind)?.map(|place| (kind, place)));
        }
        let (kinds, others): (Vec<_>, Vec<_>) = found.into_iter().unzip();
        let tare = if forces { options.tare } else { TareRule::Untared };
        Ok(Self {
            options,
            enter_s: window.0,
            exit_s: window.1,
            wanted: Wanted { time: true, readings: forces, others, ..Wanted::default() },
            tare: TareSearch::new(tare, options.rule),
            needed_s: None,
            sampling: Sampling::new(),
            rows: 0,
            first_s: None,
            last_s: None,
            has_begun: false,
            repeats_are_stale: log.repeats_are_stale(),
            stretch: Stretch {
                telemetry: kinds.iter().map(|kind| (*kind, Vec::new())).collect(),
                ..Stretch::default()
            },
            kinds,
        })
    }

    /// The times between which rows are needed, s.
    fn needed_s(&mut self) -> Result<(f64, f64), TrialError> {
        if let Some(needed) = self.needed_s {
            return Ok(needed);
        }
        let (before, after) = match self.options.trace {
            TraceExtent::Log => (f64::INFINITY, f64::INFINITY),
            _ => {
                let rate = self.sampling.rate();
                warm_up_s(self.options, rate.map_or(USUAL_PERIOD_S, |rate| 1.0 / rate.median_hz))?
            }
        };
        let low = self.enter_s - before.max(MARGIN_S);
        Ok(*self.needed_s.insert((low, self.exit_s + after.max(MARGIN_S))))
    }

    /// The clock of the log, once it has been read.
    fn clock(&self, rows: u64) -> Result<Clock, TrialError> {
        let ends = self.first_s.zip(self.last_s).zip(self.sampling.rate());
        let ((first_s, last_s), rate) = ends.ok_or(TrialError::NoClock { rows })?;
        Ok(Clock { first_s, last_s, period_s: 1.0 / rate.median_hz })
    }
}

impl Selection for Reading<'_> {
    type Error = TrialLogError;

    fn is_of_interest(&mut self, times: &[f64]) -> Result<bool, TrialLogError> {
        for &time in times {
            self.rows += 1;
            match self.last_s.replace(time) {
                Some(before) if time < before => {
                    Err(TrialError::Backward { row: self.rows, before, after: time })?;
                }
                _ => {}
            }
        }
        self.first_s = self.first_s.or(times.first().copied());
        self.sampling.add(times);
        let (low, high) = self.needed_s()?;
        let (first, last) = (times[0], times[times.len() - 1]);
        Ok(self.tare.wants(last) || (last >= low && first <= high))
    }

    fn take(&mut self, block: &mut Block) -> Result<(), TrialLogError> {
        let fresh = match self.repeats_are_stale {
            true => block.fresh_rows(),
            false => vec![true; block.rows],
        };
        if self.tare.wants(block.time_s[block.rows - 1]) {
            let leg = self.kinds.iter().position(|kind| *kind == Telemetry::RightLeg);
            let leg = leg.map(|at| &*block.others[at]);
            self.tare.look_at(&block.time_s, &block.readings, &fresh, leg);
        }
        let (low, high) = self.needed_s.unwrap_or((f64::NEG_INFINITY, f64::INFINITY));
        let times = &block.time_s;
        let rows = times.partition_point(|&t| t < low)..times.partition_point(|&t| t <= high);
        let stretch = &mut self.stretch;
        if !rows.is_empty() {
            stretch.starts_log |= !self.has_begun && rows.start == 0;
            stretch.times_s.extend_from_slice(&times[rows.clone()]);
            stretch.readings.resize_with(block.readings.len(), Vec::new);
            let columns = stretch.telemetry.iter_mut().map(|(_, column)| column);
            let columns = columns.chain(&mut stretch.readings);
            for (column, new) in columns.zip(block.others.iter().chain(&block.readings)) {
                column.extend_from_slice(&new[rows.clone()]);
            }
            stretch.fresh.extend_from_slice(&fresh[rows]);
        }
        self.has_begun = true;
        Ok(())
    }
}
