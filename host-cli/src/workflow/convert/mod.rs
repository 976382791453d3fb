//! From a log of readings to a log of wrenches.
//!
//! ```text
//! survey   (only if asked for)  tare: mean of some frames; low-pass: rate of the frames
//! convert  every block          wrench = W(readings) − tare, standard errors, flags ─▶ filter ─▶ CSV
//! ```
//!
//! Both read the log as a stream; the survey stops where the tare window ends unless it needs the
//! rate of the whole log. Only the zero-phase filter, which must see the end first, holds all frames.

mod frames;
mod survey;
mod table;

use std::io::{self, Write};

pub use survey::TareResult;
pub use table::Columns;

use super::sampling::Rate;
use super::selection::{Rows, TimeWindow, by_column};
use super::{ChannelMismatch, check_channels};
use crate::figures::WrenchTrace;
use crate::forces::filter::{Butterworth, Filter, FilterError};
use calibration::Calibration;
use frames::{Converter, Frames};
use log_file::{Log, LogError, ReadOptions, Wanted};
use shell_data::wrench::PerAxis;
use survey::survey;
use table::Table;

/// What is done to the readings of a log.
#[derive(Clone, Debug)]
pub struct ConvertOptions {
    /// Which rows are used.
    pub rows: Rows,
    /// Which frames are taken as unloaded.
    pub tare: TareWindow,
    /// The low-pass filter, if any.
    pub low_pass: Option<LowPass>,
    /// What is written of every frame.
    pub columns: Columns,
    /// The highest reading that the converter can give, in counts: a reading there, or at zero, is
    /// saturated. `None` to leave saturation unflagged.
    pub full_scale: Option<f64>,
}

/// Which frames are taken as unloaded; their mean wrench is subtracted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum TareWindow {
    /// None: the calibration's own zero.
    Untared,
    /// The first frames used.
    First(usize),
    /// The frames used in a stretch of time. The log is searched up to the first row beyond it.
    Time(TimeWindow),
}

/// A Butterworth low-pass over the frames used.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct LowPass {
    /// Where a causal filter attenuates to 1/√2 (a zero-phase one to 1/2), Hz.
    pub cutoff_hz: f64,
    /// Number of poles.
    pub order: usize,
    /// Forward and backward over the whole log, without delay.
    pub zero_phase: bool,
    /// Frames per second; `None` to take the mean rate of the frames used.
    pub rate_hz: Option<f64>,
}

/// What a conversion has done.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct ConvertSummary {
    /// Rows in the log.
    pub rows: u64,
    /// Those whose readings equal those of the row before.
    pub repeated_rows: u64,
    /// Rows that were wrong and left out.
    pub skipped_rows: u64,
    /// Frames converted.
    pub frames: u64,
    /// Which rows these were.
    pub rows_used: Rows,
    /// What was taken as unloaded.
    pub tare: Option<TareResult>,
    /// The filter, and the rate that it was designed for.
    pub low_pass: Option<LowPass>,
    /// How the frames used follow one another, where the filter needed to know.
    pub sampling: Option<Rate>,
    /// Frames with a reading outside the range of the training data.
    pub out_of_range_frames: u64,
    /// Frames with a saturated reading.
    pub saturated_frames: u64,
    /// Smallest, mean and largest value of each axis, N and N·m.
    #[serde(serialize_with = "by_column")]
    pub axes: PerAxis<AxisSummary>,
}

/// The values of one axis over all frames, N or N·m.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct AxisSummary {
    /// The smallest.
    pub min: f64,
    /// The mean.
    pub mean: f64,
    /// The largest.
    pub max: f64,
}

/// A log that cannot be converted as asked.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ConvertError {
    /// The log cannot be read.
    #[error(transparent)]
    Log(#[from] LogError),
    /// The calibration is for another sensor.
    #[error(transparent)]
    Channels(#[from] ChannelMismatch),
    /// Too few frames for the tare.
    #[error("`{path}` has only `{found}` frames, `{wanted}` are to be taken as unloaded")]
    TareFrames {
        /// The log.
        path: String,
        /// Frames asked for.
        wanted: usize,
        /// Frames in the log.
        found: usize,
    },
    /// No frame within the tare window.
    #[error(
        "`{path}` has no frame between `{start}` and `{end}` s to tare on: \
         its frames run from `{first}` to `{last}` s", start = window.start_s, end = window.end_s
    )]
    TareTime {
        /// The log.
        path: String,
        /// The window asked for.
        window: TimeWindow,
        /// Time of the first frame.
        first: f64,
        /// Time of the last frame read.
        last: f64,
    },
    /// The rate is needed and cannot be told from the log.
    #[error("`{path}` does not tell the sampling rate, which a low-pass needs: {reason}")]
    NoRate {
        /// The log.
        path: String,
        /// Why.
        reason: &'static str,
    },
    /// The filter is impossible.
    #[error(transparent)]
    Filter(#[from] FilterError),
    /// Standard errors were asked for by name, and cannot be given.
    #[error("the calibration carries no covariance, from which standard errors and intervals come")]
    NoCovariance,
    /// Readings so large that the wrench overflows.
    #[error("`{path}`: the wrench of frame `{frame}` is not finite")]
    NotFinite {
        /// The log.
        path: String,
        /// Number of the frame among those used, from 1.
        frame: u64,
    },
    /// The result cannot be written.
    #[error("cannot write the result")]
    Output(#[from] io::Error),
}

/// Converts a log and writes the result to `out` as CSV; `trace` is given the wrench as well.
///
/// # Errors
/// [`ConvertError`]; what has been written to `out` until then is not of use.
pub fn convert(
    log: &Log,
    calibration: &Calibration,
    options: &ConvertOptions,
    read: &ReadOptions<'_>,
    out: &mut dyn Write,
    mut trace: Option<&mut WrenchTrace>,
) -> Result<ConvertSummary, ConvertError> {
    let path = || log.path().display().to_string();
    let wants_time = options.columns.time || trace.is_some();
    let wanted = Wanted { readings: true, time: wants_time, ..Wanted::default() };
    log.require(&wanted)?;
    check_channels(log, calibration.model().channels)?;
    if options.columns.need_errors() && calibration.covariance.is_none() {
        return Err(ConvertError::NoCovariance);
    }
    let covariance = calibration.covariance.as_ref().zip(options.columns.interval);
    let factors = covariance.map(|(covariance, level)| covariance.interval_factors(level));
    let survey = survey(log, calibration, options, read)?;
    let low_pass = options.low_pass.map(|low_pass| LowPass {
        rate_hz: low_pass.rate_hz.or(survey.rate.map(|rate| rate.mean_hz)),
        ..low_pass
    });
    let design = low_pass.map(|low_pass| {
        let rate = low_pass.rate_hz.unwrap_or(f64::NAN);
        Butterworth::low_pass(low_pass.order, low_pass.cutoff_hz, rate)
    });
    let design = design.transpose()?;

    let table = Table::new(options.columns, factors.unwrap_or_default());
    let converter = Converter { calibration, tare: survey.tare.as_ref(), options };
    let mut low_pass_stage = design.as_ref().zip(low_pass).map(|(design, low_pass)| LowPassStage {
        design,
        zero_phase: low_pass.zero_phase,
        is_tared: survey.tare.is_some(),
        filters: None,
        held: Frames::default(),
    });
    let is_filtered = low_pass_stage.is_some();
    let mut totals = Totals::default();
    let mut text = Vec::new();
    table.header(&mut text);
    out.write_all(&text)?;
    let mut finish = |frames: &Frames| -> Result<(), ConvertError> {
        totals.add(frames).map_err(|frame| ConvertError::NotFinite { path: path(), frame })?;
        if let Some(trace) = &mut trace {
            trace.add(&frames.time_s, &frames.wrench);
        }
        Ok(())
    };
    let summary = log.read(
        &wanted,
        read,
        |block| {
            options.rows.select(block);
            let frames = converter.convert(block);
            // What is not filtered is written out by the workers.
            let mut text = Vec::new();
            if !is_filtered {
                table.rows(&frames, &mut text);
            }
            (frames, text)
        },
        |(mut frames, mut text)| -> Result<(), ConvertError> {
            if let Some(stage) = &mut low_pass_stage {
                match stage.pass(frames) {
                    None => return Ok(()),
                    Some(passed) => frames = passed,
                }
                table.rows(&frames, &mut text);
            }
            finish(&frames)?;
            Ok(out.write_all(&text)?)
        },
    )?;
    if let Some(frames) = low_pass_stage.map(LowPassStage::finish).transpose()?.flatten() {
        finish(&frames)?;
        for start in (0..frames.len()).step_by(ROWS_AT_ONCE) {
            text.clear();
            table.rows_between(&frames, start..frames.len().min(start + ROWS_AT_ONCE), &mut text);
            out.write_all(&text)?;
        }
    }
    Ok(ConvertSummary {
        rows: summary.rows,
        repeated_rows: summary.repeated_rows,
        skipped_rows: summary.skipped_rows,
        frames: totals.frames,
        rows_used: options.rows,
        tare: survey.tare_result,
        low_pass,
        sampling: survey.rate,
        out_of_range_frames: totals.out_of_range,
        saturated_frames: totals.saturated,
        axes: totals.axes(),
    })
}

/// How many rows of text are made before they are written.
const ROWS_AT_ONCE: usize = 4096;

/// The filter between the conversion and the output.
struct LowPassStage<'a> {
    design: &'a Butterworth,
    zero_phase: bool,
    is_tared: bool,
    filters: Option<PerAxis<Filter>>,
    /// All frames, for the zero-phase filter.
    held: Frames,
}

impl LowPassStage<'_> {
    /// Filters the next frames; holds them back if the filter must see the end first.
    ///
    /// The causal filter starts at rest at zero when tared, where the signal is (what the lab's
    /// `lfilter` after taring did), and at the first frame's value when not.
    fn pass(&mut self, mut frames: Frames) -> Option<Frames> {
        if self.zero_phase {
            self.held.append(frames);
            return None;
        }
        if frames.len() > 0 {
            let filters = self.filters.get_or_insert_with(|| {
                frames.wrench.each_ref().map(|column| {
                    let mut filter = Filter::new(self.design);
                    filter.settle(if self.is_tared { 0.0 } else { column[0] });
                    filter
                })
            });
            for (filter, column) in filters.iter_mut().zip(&mut frames.wrench) {
                filter.process(column);
            }
        }
        Some(frames)
    }

    /// The frames held back, filtered.
    fn finish(mut self) -> Result<Option<Frames>, FilterError> {
        if !self.zero_phase {
            return Ok(None);
        }
        for column in &mut self.held.wrench {
            self.design.zero_phase(column)?;
        }
        Ok(Some(self.held))
    }
}

/// Counts and extremes over all frames.
#[derive(Default)]
struct Totals {
    frames: u64,
    out_of_range: u64,
    saturated: u64,
    axes: PerAxis<Option<(f64, f64, f64)>>,
}

impl Totals {
    /// Adds some frames; the number of the first whose wrench is not finite is an error.
    fn add(&mut self, frames: &Frames) -> Result<(), u64> {
        for (total, column) in self.axes.iter_mut().zip(&frames.wrench) {
            let (mut min, mut sum, mut max) = total.unwrap_or((f64::INFINITY, 0.0, -f64::INFINITY));
            for &value in column {
                min = min.min(value);
                max = max.max(value);
                sum += value;
            }
            let finite = min.is_finite() && max.is_finite() && sum.is_finite();
            if !finite && !column.is_empty() {
                let bad = column.iter().position(|value| !value.is_finite()).unwrap_or(0);
                return Err(self.frames + bad as u64 + 1);
            }
            if !column.is_empty() {
                *total = Some((min, sum, max));
            }
        }
        let marked = |flags: &[u64]| flags.iter().filter(|&&channels| channels != 0).count() as u64;
        self.frames += frames.len() as u64;
        self.out_of_range += marked(&frames.out_of_range);
        self.saturated += marked(&frames.saturated);
        Ok(())
    }

    fn axes(&self) -> PerAxis<AxisSummary> {
        self.axes.map(|total| {
            let (min, sum, max) = total.unwrap_or_default();
            AxisSummary { min, mean: sum / self.frames.max(1) as f64, max }
        })
    }
}
