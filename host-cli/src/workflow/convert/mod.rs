//! From a log of readings to a log of wrenches.
//!
//! ```text
//! survey   the first rows   tare and clock of the force pipeline
//! convert  every block      wrench − tare, standard errors, flags ─▶ low-pass ─▶ file
//! ```
//!
//! Both read the log as a stream; the survey stops where tare and clock are known. The low-pass holds
//! back as many rows as it needs to see ahead, whatever the length of the log. It sees every row, also
//! where only fresh ones are written: which rows are written does not change the forces.

mod encode;
mod frames;
mod options;
mod remarks;
mod summary;
mod survey;
mod table;
mod writer;

use std::io::Write;

pub use options::{
    BadMount, Conversion, ConvertOptions, DEFAULT_FRAME_ID, FrameMount, OutputFormat, OutputPlan,
    RecordingFrame, TableColumns, UnknownExtension, table_name,
};
use summary::Totals;
pub use summary::{AxisSummary, ConvertSummary, LoadSummary};

use super::selection::{RowFilter, read_with_memory};
use super::{WorkflowError, check_channels};
use calibration::uncertainty::NoIntervals;
use calibration::{Calibration, Kind};
use encode::{EncodedOutput, Encoder};
use figures::WrenchTrace;
use forces::sampling::Sampling;
use forces::stationary::ZeroWatch;
use frames::{ConvertedFrames, FrameConverter};
use log_file::Wanted;
use shell_data::wrench::{Axis, PerAxis};
use survey::survey;
use table::WrenchTable;
use writer::Writer;

/// How many standard errors an interval of this level reaches either way.
pub(super) fn interval_factors(
    calibration: &Calibration,
    level: f64,
) -> Result<PerAxis<f64>, WorkflowError> {
    match calibration.kind() {
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

/// Converts a log and writes the result to `out`, as `plan` says; `trace` is given the wrench as well.
///
/// # Errors
/// [`WorkflowError`]; what has been written to `out` until then is not of use.
pub fn convert(
    conversion: &Conversion<'_>,
    plan: &OutputPlan,
    out: &mut dyn Write,
    trace: Option<&mut WrenchTrace>,
) -> Result<ConvertSummary, WorkflowError> {
    let Conversion { log, calibration, options, read } = *conversion;
    log.require(&Wanted { readings: true, time: options.columns.time, ..Wanted::default() })?;
    check_channels(log, calibration.channels())?;
    let is_whole = options.columns.time && options.columns.axes.are_all();
    // Beside the wrenches, such a recording has the readings.
    let keeps_readings = matches!(plan.format, OutputFormat::Mcap(_));
    if keeps_readings && !is_whole {
        return Err(WorkflowError::PartOfWrench);
    }
    let absent = options.columns.axes.without(calibration.axes);
    if !absent.is_empty() {
        return Err(WorkflowError::AbsentAxes { absent, axes: calibration.axes });
    }
    if options.columns.need_errors() && !calibration.has_standard_errors() {
        return Err(WorkflowError::NoCovariance);
    }
    let (pipeline, zero) = survey(conversion)?;
    let time = options.columns.time
        || calibration.needs_time()
        || options.forces.tare.follows_rests()
        || trace.is_some()
        || pipeline.low_pass.is_some()
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
    let table = WrenchTable::new(options.columns, factors.unwrap_or_default(), &kept, readings);
    let encoder = Encoder { table, format };
    let repeats_are_frames = !log.repeats_are_stale() && options.rows == RowFilter::All;
    let watch = (time && options.load.is_none()).then_some(repeats_are_frames);
    let converter =
        FrameConverter { calibration, pipeline: &pipeline, zero, options, keeps_readings, watch };
    let mut zero_watch = ZeroWatch::default();
    let scatter = options.load.as_ref().map(|_| PerAxis::default());
    let mut writer = Writer {
        path: log.path(),
        encoder: &encoder,
        output: EncodedOutput::new(&encoder, out)?,
        trace,
        stream: pipeline.stream(&Axis::ALL),
        waiting: ConvertedFrames::default(),
        waiting_rows: Vec::new(),
        sampling: Sampling::default(),
        latest_s: f64::NEG_INFINITY,
        axes: calibration.axes,
        totals: Totals { scatter, ..Totals::default() },
    };
    let mut rows_without_motion = 0;
    let summary = read_with_memory(
        log,
        (&wanted, &read),
        calibration,
        |block| {
            let rows = converter.convert(block);
            // What is not filtered is encoded by the workers.
            let encoded = pipeline.low_pass.is_none().then(|| encoder.encode(&rows.frames));
            (rows, encoded)
        },
        |(rows, encoded)| {
            rows_without_motion += rows.without_motion;
            if let Some((times_s, readings)) = &rows.watched {
                zero_watch.look_at(times_s, readings);
            }
            match encoded {
                Some(encoded) => writer.write(&rows.frames, encoded?),
                None => writer.filter(rows),
            }
        },
    )?;
    let (totals, sampling) = writer.finish()?;
    if totals.frames == 0 {
        return Err(WorkflowError::NoFrames(log.path().display().to_string()));
    }
    Ok(ConvertSummary {
        rows: summary.rows,
        repeated_rows: summary.repeated_rows,
        skipped_rows: summary.skipped_rows,
        frames: totals.frames,
        rows_used: options.rows,
        tare: pipeline.tare_result.clone(),
        low_pass: pipeline.low_pass,
        sampling,
        out_of_range_frames: totals.out_of_range,
        saturated_frames: totals.saturated,
        left_out_frames: totals.left_out,
        axes: calibration.axes.values(&totals.axes()),
        zero: zero_watch.finish(calibration),
        load: options.load.as_ref().map(|load| LoadSummary {
            has_inertia: load.has_inertia,
            lag: load.lag,
            lag_taken_s: load.lag.map(|lag| lag.taken_s()),
            rows_without_motion,
            standard_deviation: calibration.axes.values(&totals.standard_deviation()),
        }),
    })
}
