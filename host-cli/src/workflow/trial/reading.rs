//! Reading the rows of a trial from its log, in one pass.

use super::TrialJob;
use crate::workflow::WorkflowError;
use crate::workflow::selection::{RowFilter, fresh_rows};
use calibration::Calibration;
use calibration::memory::MemoryState;
use forces::sampling::Sampling;
use forces::stationary::{ZeroMove, ZeroWatch};
use forces::{FirstRows, ForcePipeline, PipelineSetup, TareRule};
use log_file::{ColumnRef, LogError, ReadSummary, Wanted};
use shell_data::block::Block;
use shell_data::telemetry::Telemetry;
use trial::{
    Instrument, LogTimes, Profile, TraceExtent, Trial, TrialError, TrialInput, TrialResult,
    TrialRows, evaluate, used_telemetry,
};

/// Minimum margin around the window in which rows are read, s.
const MARGIN_S: f64 = 1.0;

pub(super) struct RecordedTrial {
    pub(super) times: LogTimes,
    pub(super) summary: ReadSummary,
    /// Change of the zero, if the tare does not follow it.
    pub(super) zero: Option<ZeroMove>,
    /// The job's profile, with the units that the log states.
    profile: Profile,
    rows: TrialRows,
    pipeline: Option<ForcePipeline>,
}

impl RecordedTrial {
    /// Reads the rows that a window (s) needs.
    pub(super) fn read(job: &TrialJob<'_>, window: (f64, f64)) -> Result<Self, WorkflowError> {
        let mut reading = Reading::new(job, window)?;
        let wanted = reading.wanted.clone();
        let log = job.log;
        let summary = log.read(
            &wanted,
            &job.read,
            |block| (fresh_rows(log, RowFilter::All, block), std::mem::take(block)),
            |(fresh, block)| reading.take(&fresh, block),
        )?;
        let times = reading.log_times(summary.rows)?;
        let calibration = job.instrument.calibration;
        let zero = reading.watch.as_ref().zip(calibration).and_then(|(watch, of)| watch.finish(of));
        let pipeline = reading.setup.map(|(calibration, setup)| setup.finish(calibration));
        let mut pipeline = pipeline.transpose().map_err(TrialError::from)?;
        // The lag shifts forces to the times of legs and power, which are not shifted.
        if let (Some(pipeline), Some(calibration)) = (&mut pipeline, calibration) {
            pipeline.lag = calibration.lag;
        }
        let (profile, rows) = (reading.profile, reading.trial_rows);
        Ok(Self { times, profile, rows, pipeline, zero, summary })
    }

    pub(super) fn evaluate(
        &self,
        job: &TrialJob<'_>,
        trial: &Trial,
    ) -> Result<TrialResult, TrialError> {
        evaluate(&TrialInput {
            trial,
            instrument: Instrument { profile: &self.profile, ..job.instrument },
            times: &self.times,
            rows: &self.rows,
            pipeline: self.pipeline.as_ref(),
            options: &job.options,
        })
    }
}

struct Reading<'a> {
    enter_s: f64,
    exit_s: f64,
    wanted: Wanted,
    profile: Profile,
    /// The calibration and the search for tare and clock, if there are forces.
    setup: Option<(&'a Calibration, PipelineSetup)>,
    /// The memory terms of the calibration, which need every row from the first one.
    memory: Option<MemoryState>,
    /// Watches the zero of the whole log: a drift can only be followed from one stationary interval to the next.
    watch: Option<ZeroWatch>,
    takes_all: bool,
    /// The time range of the needed rows, s, once it is known.
    needed_s: Option<(f64, f64)>,
    sampling: Sampling,
    rows: u64,
    first_s: Option<f64>,
    last_s: Option<f64>,
    trial_rows: TrialRows,
}

impl<'a> Reading<'a> {
    fn new(job: &TrialJob<'a>, window: (f64, f64)) -> Result<Self, LogError> {
        let TrialJob { log, instrument, options, .. } = *job;
        log.require_time_unit()?;
        let channels = log.channels();
        let is_traced = options.trace != TraceExtent::Nothing;
        let (mut telemetry, mut others) = (Vec::new(), Vec::new());
        let mut profile = instrument.profile.clone();
        // The left leg is needed only for traces.
        for (kind, quantity) in
            used_telemetry().filter(|(kind, _)| is_traced || *kind != Telemetry::LeftLeg)
        {
            let position = match profile.column_name(kind) {
                Some(name) => Some(log.column_positions(&[ColumnRef::Name(name.to_owned())])?[0]),
                None => log.telemetry(kind)?,
            };
            let Some(position) = position else { continue };
            if let Some(unit) = log.telemetry_unit(position, quantity, profile.unit_text(kind))? {
                profile.set_unit(kind, unit);
            }
            telemetry.push((kind, Vec::new()));
            others.push(position);
        }
        let readings = instrument.calibration.is_some() && channels > 0;
        let calibration = instrument.calibration;
        let calibration = calibration.filter(|of| of.channels() == channels);
        let setup = |of| (of, PipelineSetup::keeping_frames(options.forces));
        let tare = options.forces.tare;
        let watches = calibration.is_some() && tare != TareRule::Untared && !tare.follows_rests();
        Ok(Self {
            enter_s: window.0,
            exit_s: window.1,
            profile,
            wanted: Wanted { time: true, readings, others, ..Wanted::default() },
            setup: calibration.map(setup),
            memory: calibration.and_then(Calibration::start_memory),
            watch: watches.then(ZeroWatch::default),
            takes_all: options.trace == TraceExtent::Log,
            needed_s: None,
            sampling: Sampling::default(),
            rows: 0,
            first_s: None,
            last_s: None,
            trial_rows: TrialRows { telemetry, ..TrialRows::default() },
        })
    }

    /// The time range of the needed rows, s: unbounded until the clock of the low-pass is known.
    fn needed_s(&mut self) -> Result<(f64, f64), TrialError> {
        let everything = (f64::NEG_INFINITY, f64::INFINITY);
        if let Some(needed) = self.needed_s {
            return Ok(needed);
        }
        let (low, high) = match &self.setup {
            _ if self.takes_all => everything,
            None => (self.enter_s, self.exit_s),
            Some((_, setup)) if setup.clock.is_done() => {
                setup.needed_s(self.enter_s, self.exit_s)?
            }
            Some(_) => return Ok(everything),
        };
        let (low, high) = (low.min(self.enter_s - MARGIN_S), high.max(self.exit_s + MARGIN_S));
        Ok(*self.needed_s.insert((low, high)))
    }

    fn log_times(&self, rows: u64) -> Result<LogTimes, TrialError> {
        let ends = self.first_s.zip(self.last_s).zip(self.sampling.rate());
        let ((first_s, last_s), rate) = ends.ok_or(TrialError::NoClock(rows))?;
        Ok(LogTimes { first_s, last_s, period_s: 1.0 / rate.median_hz })
    }

    /// Takes the next rows; `fresh` marks the frames among them.
    fn take(&mut self, fresh: &[bool], mut block: Block) -> Result<(), WorkflowError> {
        let times = &*block.time_s;
        for &time in times {
            self.rows += 1;
            if let Some(before) = self.last_s.replace(time).filter(|before| time < *before) {
                Err(TrialError::Backward { row: self.rows, before, after: time })?;
            }
        }
        self.first_s = self.first_s.or(times.first().copied());
        self.sampling.add(times);
        if let Some((_, setup)) = &mut self.setup {
            setup.clock.look_at(times);
        }
        if let Some(watch) = &mut self.watch {
            let frames = block.kept(fresh);
            watch.look_at(&frames.time_s, &frames.readings);
        }
        if let Some(memory) = &mut self.memory {
            memory.extend(&mut block).expect("times, which are wanted");
        }
        if let Some((calibration, setup)) = &mut self.setup
            && setup.wants_frames(block.time_s[block.rows - 1])
        {
            let mut kinds = self.trial_rows.telemetry.iter().map(|(kind, _)| *kind);
            let leg = kinds.position(|kind| kind == Telemetry::RightLeg);
            let leg = leg.map(|at| &*block.others[at]);
            let (times_s, readings) = (&*block.time_s, &*block.readings);
            setup.look_at_frames(calibration, FirstRows { times_s, readings, fresh, leg });
        }
        let (low, high) = self.needed_s()?;
        let times = &block.time_s;
        let rows = times.partition_point(|&t| t < low)..times.partition_point(|&t| t <= high);
        if rows.is_empty() {
            return Ok(());
        }
        let taken = &mut self.trial_rows;
        taken.times_s.extend_from_slice(&times[rows.clone()]);
        taken.readings.resize_with(block.readings.len(), Vec::new);
        let columns = taken.telemetry.iter_mut().map(|(_, column)| column);
        let columns = columns.chain(&mut taken.readings);
        for (column, new) in columns.zip(block.others.iter().chain(&block.readings)) {
            column.extend_from_slice(&new[rows.clone()]);
        }
        taken.fresh.extend_from_slice(&fresh[rows]);
        Ok(())
    }
}
