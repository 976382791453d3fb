//! From a log of readings to a log of wrenches.
//!
//! ```text
//! survey   the first rows   tare and clock of the force pipeline
//! convert  every block      wrench − tare, standard errors, flags ─▶ low-pass ─▶ CSV
//! ```
//!
//! Both read the log as a stream; the survey stops where tare and clock are known. The low-pass holds
//! back as many rows as it needs to see ahead, whatever the length of the log. It sees every row, also
//! where only fresh ones are written: which rows are written does not change the forces.

mod columns;
mod error;
mod frames;
mod job;
mod summary;
mod survey;
mod table;
mod writer;

use std::io::Write;

pub use columns::Columns;
pub use error::ConvertError;
pub use job::{Conversion, ConvertOptions};
pub use summary::{AxisSummary, ConvertSummary};

use super::check_channels;
use crate::figures::WrenchTrace;
use calibration::{Calibration, Kind};
use frames::Converter;
use log_file::Wanted;
use shell_data::wrench::PerAxis;
use survey::survey;
use table::Table;
use writer::Writer;

/// How many standard errors an interval of this level reaches either way.
fn interval_factors(calibration: &Calibration, level: f64) -> Result<PerAxis<f64>, ConvertError> {
    match calibration.kind() {
        Kind::Polynomial(_) => {
            let covariance = calibration.covariance.as_ref().ok_or(ConvertError::NoCovariance)?;
            Ok(covariance.interval_factors(level))
        }
        Kind::Physics(physics) => {
            let intervals = physics.intervals.as_ref().ok_or(ConvertError::NoCovariance)?;
            Ok(intervals.factors(level)?)
        }
    }
}

/// Converts a log and writes the result to `out` as CSV; `trace` is given the wrench as well.
///
/// # Errors
/// [`ConvertError`]; what has been written to `out` until then is not of use.
pub fn convert(
    conversion: &Conversion<'_>,
    out: &mut dyn Write,
    trace: Option<&mut WrenchTrace>,
) -> Result<ConvertSummary, ConvertError> {
    let Conversion { log, calibration, options, read } = *conversion;
    log.require(&Wanted { readings: true, time: options.columns.time, ..Wanted::default() })?;
    check_channels(log, calibration.channels())?;
    if options.columns.need_errors() && !calibration.has_standard_errors() {
        return Err(ConvertError::NoCovariance);
    }
    let pipeline = survey(conversion)?;
    let time = options.columns.time || trace.is_some() || pipeline.low_pass().is_some();
    let wanted = Wanted { readings: true, time, ..Wanted::default() };
    log.require(&wanted)?;
    let factors = options.columns.interval.map(|level| interval_factors(calibration, level));
    let factors = factors.transpose()?;
    let table = Table::new(options.columns, factors.unwrap_or_default());
    let converter = Converter { calibration, pipeline: &pipeline, options };
    let mut writer = Writer::new(log.path(), &table, &pipeline, out, trace);
    writer.header()?;
    let summary = log.read(
        &wanted,
        &read,
        |block| {
            let rows = converter.convert(block);
            // What is not filtered is written out by the workers.
            let mut text = Vec::new();
            if pipeline.low_pass().is_none() {
                table.rows(&rows.frames, &mut text);
            }
            (rows, text)
        },
        |(rows, text)| match pipeline.low_pass() {
            None => writer.write(&rows.frames, &text),
            Some(_) => writer.filter(rows),
        },
    )?;
    let (totals, sampling) = writer.finish()?;
    if totals.frames == 0 {
        return Err(ConvertError::NoFrames { path: log.path().display().to_string() });
    }
    Ok(ConvertSummary {
        rows: summary.rows,
        repeated_rows: summary.repeated_rows,
        skipped_rows: summary.skipped_rows,
        frames: totals.frames,
        rows_used: options.rows,
        tare: pipeline.tare_result().cloned(),
        low_pass: pipeline.low_pass(),
        sampling,
        out_of_range_frames: totals.out_of_range,
        saturated_frames: totals.saturated,
        left_out_frames: totals.left_out,
        axes: totals.axes(),
    })
}
