//! Conversion of a log of readings to a log of wrenches.
//!
//! ```text
//! survey   the first rows   tare and clock of the force pipeline
//! convert  every block      wrench − tare, standard errors, flags ─▶ low-pass ─▶ file
//! ```
//!
//! Both read the log as a stream; the survey stops once tare and clock are known. The low-pass holds back as
//! many rows as it looks ahead, plus the rest of their block, for any length of the log. It sees every row
//! even if only fresh ones are written: the choice of rows does not change the forces.

mod encode;
mod frames;
mod options;
mod summary;
mod table;
mod writer;

use std::collections::VecDeque;
use std::io::Write;

pub use options::{
    Conversion, ConvertOptions, DEFAULT_FRAME_ID, FrameMount, OutputFormat, OutputPlan,
    RecordingFrame, TableColumns, table_name,
};
pub use summary::{AxisSummary, ConvertSummary, LagMadeUp, LagRule, LoadSummary};
use summary::{StuckChannel, Totals, standard_deviation};

use super::selection::{RowFilter, fresh_rows, passed, read_with_memory};
use super::{WorkflowError, check_channels};
use calibration::dynamics::ReferenceLag;
use calibration::memory::TimeBase;
use calibration::uncertainty::NoIntervals;
use calibration::{Calibration, Kind, ReadingSpans};
use encode::{EncodedOutput, Encoder};
use figures::WrenchTrace;
use forces::payload::Inertia;
use forces::sampling::Sampling;
use forces::stationary::ZeroWatch;
use forces::{FirstRows, ForceError, ForcePipeline, FrameChange, PipelineSetup, TareRule};
use frames::{FrameConverter, TakenOff};
use log_file::Wanted;
use shell_data::wrench::{Axis, PerAxis};
use table::{ROW_COLUMN, TIME_COLUMN, WrenchTable};
use writer::Writer;

/// Half-width of an interval of this level, in standard errors. Fails with [`WorkflowError::NoCovariance`] or
/// [`WorkflowError::NoIntervals`].
pub fn interval_factors(
    calibration: &Calibration,
    level: f64,
) -> Result<PerAxis<f64>, WorkflowError> {
    match &calibration.kind {
        Kind::Polynomial(_) => {
            let covariance = calibration.covariance.as_ref().ok_or(WorkflowError::NoCovariance)?;
            Ok(covariance.interval_factors(level)?)
        }
        Kind::Physics(physics) => {
            let intervals = physics.intervals.as_ref().ok_or(WorkflowError::NoCovariance)?;
            Ok(intervals.factors(level).map_err(NoIntervals::from)?)
        }
    }
}

/// Converts a log and writes the result to `out` according to `plan`; `trace` also receives the wrench. Fails with
/// [`WorkflowError`]; the output up to then is not usable.
pub fn convert(
    conversion: &Conversion<'_>,
    plan: &OutputPlan,
    out: &mut dyn Write,
    trace: Option<&mut WrenchTrace>,
) -> Result<ConvertSummary, WorkflowError> {
    let Conversion { log, calibration, options, read } = *conversion;
    let numbers_rows = options.numbers_rows(log, calibration);
    let has_stamps = options.columns.time && !numbers_rows;
    log.require(&Wanted { readings: true, time: has_stamps, ..Wanted::default() })?;
    check_channels(log, calibration.channels())?;
    let is_whole = has_stamps && options.columns.axes.are_all();
    // A recording contains the readings as well as the wrenches.
    let keeps_readings = matches!(plan.format, OutputFormat::Mcap(_));
    if keeps_readings && !is_whole {
        return Err(WorkflowError::refused(
            "a recording in MCAP needs time and all six axes of a wrench: without, write `.csv`, `.parquet`, \
             `.mat` or `.npy`",
            None,
        ));
    }
    let absent = options.columns.axes.without(calibration.axes);
    if !absent.is_empty() {
        let message = format!("the calibration gives {}, not {absent}", calibration.axes);
        return Err(WorkflowError::refused(message, None));
    }
    if !options.frame.is_empty() && !FrameChange::is_known_from(calibration.axes) {
        let message =
            format!("another frame needs all six axes, the calibration gives {}", calibration.axes);
        return Err(WorkflowError::refused(message, None));
    }
    if options.columns.need_errors() && !calibration.has_standard_errors() {
        return Err(WorkflowError::NoCovariance);
    }
    let (mut pipeline, zero) = survey(conversion)?;
    let lag = calibration.lag.filter(|lag| lag.time_base == TimeBase::Rows || log.has_time());
    // In output with readings, forces are shifted to the readings' time stamps. They are also shifted if the lag
    // is in rows and no row number is written.
    let is_stamped = |lag: ReferenceLag| lag.time_base == TimeBase::Seconds || numbers_rows;
    let moves_stamps = lag.is_some_and(is_stamped) && !keeps_readings;
    pipeline.lag = lag.filter(|_| !moves_stamps);
    let stamp_lag = lag.filter(|_| moves_stamps);
    let time = has_stamps
        || calibration.needs_time()
        || options.forces.tare.follows_rests()
        || trace.is_some()
        || pipeline.looks_around() && log.has_time()
        || options.load.is_some();
    let OutputPlan { format, keep, keep_texts } = plan;
    let (others, texts) = (keep.clone(), keep_texts.clone());
    let wanted = Wanted { readings: true, time, others, texts, ..Wanted::default() };
    log.require(&wanted)?;
    let factors = options.columns.interval.map(|level| interval_factors(calibration, level));
    let factors = factors.transpose()?;
    let named = |positions: &[usize]| -> Vec<String> {
        positions.iter().map(|&at| log.columns()[at].name.clone()).collect()
    };
    let kept = [named(keep), named(keep_texts)];
    let readings = log.value_names().into_iter().take(log.channels()).map(str::to_owned).collect();
    let stamp = if numbers_rows { ROW_COLUMN } else { TIME_COLUMN };
    let factors = factors.unwrap_or_default();
    let table = WrenchTable::new((options.columns, stamp), factors, &kept, readings);
    let encoder = Encoder { table, format };
    let repeats_are_frames = !log.repeats_are_stale() && options.rows == RowFilter::All;
    let watch = (time && options.load.is_none()).then_some(repeats_are_frames);
    let pipeline = &pipeline;
    let converter =
        FrameConverter { calibration, pipeline, zero, options, stamp_lag, keeps_readings, watch };
    let mut zero_watch = ZeroWatch::default();
    let scatter = options.load.as_ref().map(|_| PerAxis::default());
    let mut writer = Writer {
        path: log.path(),
        encoder: &encoder,
        output: EncodedOutput::new(&encoder, out)?,
        trace,
        stream: pipeline.stream(&Axis::ALL),
        waiting: VecDeque::new(),
        known: PerAxis::default(),
        waiting_rows: Vec::new(),
        sampling: Sampling::default(),
        latest_s: f64::NEG_INFINITY,
        axes: calibration.axes,
        totals: Totals { scatter, ..Totals::default() },
    };
    let mut taken_off = TakenOff::default();
    let mut spans = ReadingSpans::default();
    let summary = read_with_memory(
        log,
        (&wanted, &read),
        (calibration, numbers_rows),
        |block| {
            let rows = converter.convert(block);
            // Frames that need no filter are encoded by the workers.
            let encoded = (!pipeline.looks_around()).then(|| encoder.encode(&rows.frames));
            (rows, encoded)
        },
        |(rows, encoded)| {
            taken_off.merge(&rows.taken_off);
            spans.merge(&rows.spans);
            if let Some((times_s, readings)) = &rows.watched {
                zero_watch.look_at(times_s, readings);
            }
            match encoded {
                Some(encoded) => writer.write_at_once(&rows.frames, encoded?),
                None => writer.filter(rows),
            }
        },
    )?;
    let (totals, sampling) = writer.finish()?;
    if totals.frames == 0 {
        let message = format!("`{}`: no row is left to convert", log.path().display());
        return Err(WorkflowError::refused(message, None));
    }
    let names = log.value_names();
    let stuck_channel = |(channel, reading): (usize, f64)| {
        let name = names.get(channel).filter(|name| !name.is_empty());
        let name = name.map_or_else(|| format!("s{}", channel + 1), |name| (*name).to_owned());
        StuckChannel { name, reading }
    };
    let [out_of_range_frames, saturated_frames, insensitive_frames, left_out_frames] =
        totals.flagged;
    Ok(ConvertSummary {
        rows: summary.rows,
        repeated_rows: summary.repeated_rows,
        skipped_rows: summary.skipped_rows,
        frames: totals.frames,
        rows_used: options.rows,
        tare: pipeline.tare_result.clone(),
        low_pass: pipeline.low_pass,
        sampling,
        clock: clock(calibration, lag, moves_stamps),
        out_of_range_frames,
        saturated_frames,
        insensitive_frames,
        left_out_frames,
        stuck_channels: spans.stuck(calibration).into_iter().map(stuck_channel).collect(),
        axes: calibration.axes.values(&totals.axes()),
        zero: zero_watch.finish(calibration),
        load: options.load.as_ref().map(|load| LoadSummary {
            has_inertia: load.inertia != Inertia::Nothing,
            turning_n: (load.inertia == Inertia::WithoutTurning).then(|| load.payload.turning_n()),
            rescaled: load.rescaled,
            lag: load.lag,
            lag_taken_s: load.lag.map(|lag| lag.taken_s()),
            rows_without_motion: taken_off.rows_without_motion,
            standard_deviation: calibration.axes.values(&totals.standard_deviation()),
            standard_deviation_before: calibration
                .axes
                .values(&taken_off.before.map(|scatter| standard_deviation(&scatter))),
        }),
    })
}

fn clock(
    calibration: &Calibration,
    made_up_for: Option<ReferenceLag>,
    moves_stamps: bool,
) -> Option<LagMadeUp> {
    let how = match made_up_for {
        None => LagRule::NotMadeUp,
        Some(_) if moves_stamps => LagRule::Stamps,
        Some(_) => LagRule::BetweenRows,
    };
    calibration.lag.map(|lag| LagMadeUp { lag, how })
}

/// Reads as much of the log as tare and clock need. Also returns the wrench to subtract at each row besides
/// the load: the sensor's zero or, for tared wrenches, the load that the tare has already subtracted.
fn survey(conversion: &Conversion<'_>) -> Result<(ForcePipeline, PerAxis<f64>), WorkflowError> {
    let Conversion { log, calibration, options, read } = conversion;
    let path = || log.path().display().to_string();
    let mut forces = options.forces;
    if forces.low_pass.is_some() && !log.has_time() && forces.low_pass_is_optional {
        forces.low_pass = None;
    }
    if forces.tare.follows_rests() {
        if options.load.is_some() {
            return Err(WorkflowError::refused(
                "a tare that follows the stationary intervals takes what the sensor carries for its zero",
                "leave out `--tare rests`, or take the weight off by `payload subtract` first",
            ));
        }
        if !log.has_time() {
            return Err(WorkflowError::refused(
                format!(
                    "`{}` has no time column, without which no rests are found for the tare to follow",
                    path()
                ),
                "name it with `--time`, or tare on the first frames",
            ));
        }
    }
    let is_by_time = forces.low_pass.is_some() && !forces.low_pass_is_optional
        || forces.tare.follows_rests()
        || matches!(forces.tare, TareRule::Between(..))
        || calibration.needs_time()
        || calibration.lag.is_some_and(|lag| lag.time_base == TimeBase::Seconds);
    if is_by_time {
        log.require_time_unit()?;
    }
    let mut setup = match options.load {
        Some(_) => PipelineSetup::keeping_frames(forces),
        None => PipelineSetup::new(forces),
    };
    if !setup.is_done() {
        let by_time = matches!(forces.tare, TareRule::Between(..));
        let by_time = by_time || calibration.needs_time();
        let time = log.has_time() || by_time || forces.low_pass.is_some() || options.load.is_some();
        if forces.low_pass.is_some() && !log.has_time() {
            let error = ForceError::NoRate("it has no time column");
            return Err(WorkflowError::Forces { path: path(), error });
        }
        let wanted = Wanted { readings: true, time, ..Wanted::default() };
        let read = read_with_memory(
            log,
            (&wanted, read),
            (calibration, false),
            |block| (fresh_rows(log, options.rows, block), std::mem::take(block)),
            |(fresh, block)| {
                let (times_s, readings) = (&*block.time_s, &*block.readings);
                let rows = FirstRows { times_s, readings, fresh: &fresh, leg: None };
                setup.look_at(calibration, rows);
                if setup.is_done() { Err(None) } else { Ok(()) }
            },
        );
        passed(read)?;
    }
    let pipeline = setup.finish(calibration);
    let pipeline = pipeline.map_err(|error| WorkflowError::Forces { path: path(), error })?;
    let zero = options.load.as_ref().map(|load| {
        let frames = pipeline.tare_frames.as_ref();
        let tared = frames.and_then(|frames| load.mean(&frames.times_s));
        tared.map_or(load.payload.bias(), |mean| mean.map(|load| -load))
    });
    Ok((pipeline, zero.unwrap_or_default()))
}
