//! How well a calibration predicts the wrench that a log has measured.

use super::WorkflowError;
use super::selection::UsedRows;
use crate::figures::FitPlot;
use calibration::Calibration;
use calibration::magnitudes::Magnitudes;
use calibration::quality::{self, AxisErrors, AxisQuality};
use calibration::validation::outliers::{self, Judge, Judged, Spread};
use log_file::{Log, ReadOptions, ReadSummary, Wanted};
use shell_data::block::Block;
use shell_data::wrench::PerAxis;

/// Which rows are used, and what is kept of them.
#[derive(Clone, Copy, Default)]
pub struct EvalOptions<'a> {
    /// Which rows are used.
    pub used: UsedRows<'a>,
    /// The place of the log among those that this is said of.
    pub place: usize,
    /// Counts errors by their size, in these units per axis.
    pub size_unit: Option<PerAxis<f64>>,
    /// How logs are read.
    pub read: ReadOptions<'a>,
}

/// Errors of a calibration over some logs.
#[derive(Clone, Debug, Default)]
pub struct Evaluation {
    /// Rows used.
    pub rows: u64,
    /// Wrong rows that were left out.
    pub skipped_rows: u64,
    /// Rows whose readings repeat those of the row before, used or not.
    pub repeated_rows: u64,
    /// Rows used with a reading outside the range of the training data.
    pub out_of_range_rows: u64,
    /// Predicted less measured, per axis.
    pub errors: PerAxis<AxisErrors>,
    /// Sizes of the errors, if asked for.
    pub sizes: Option<PerAxis<Magnitudes>>,
    /// The checksum of the log, if asked for; of the last, after a merge.
    pub checksum: Option<String>,
}

impl Evaluation {
    /// Adds the rows of `other`.
    pub fn merge(&mut self, other: &Evaluation) {
        self.rows += other.rows;
        self.skipped_rows += other.skipped_rows;
        self.repeated_rows += other.repeated_rows;
        self.out_of_range_rows += other.out_of_range_rows;
        quality::merge(&mut self.errors, &other.errors);
        merge_sizes(&mut self.sizes, other.sizes.as_ref());
        self.checksum.clone_from(&other.checksum);
    }

    /// Whether the largest error of an axis is far above the others.
    pub fn has_large_errors(&self) -> bool {
        let is_large =
            |axis: &AxisQuality| axis.max.is_some_and(|max| max > outliers::LIMIT * axis.rms);
        self.quality().is_some_and(|axes| axes.iter().any(is_large))
    }

    /// The quality of every axis; `None` without rows.
    pub fn quality(&self) -> Option<PerAxis<AxisQuality>> {
        let [fx, fy, fz, mx, my, mz] = self.errors.map(|errors| errors.quality());
        Some([fx?, fy?, fz?, mx?, my?, mz?])
    }
}

/// What is known of one block. Predictions and measurements are kept only if they are to be drawn.
pub(super) struct BlockErrors {
    rows: u64,
    out_of_range: u64,
    errors: PerAxis<AxisErrors>,
    sizes: Option<PerAxis<Magnitudes>>,
    drawn: Option<Drawn>,
    /// Whether a row may not belong and matter, as far as a judge was asked.
    pub(super) stands_out: bool,
}

struct Drawn {
    predicted: PerAxis<Vec<f64>>,
    measured: Vec<Vec<f64>>,
}

impl BlockErrors {
    /// The errors alone, with room for predictions that is used again.
    pub(super) fn in_room(
        predicted: &mut PerAxis<Vec<f64>>,
        calibration: &Calibration,
        block: &Block,
        size_unit: Option<&PerAxis<f64>>,
    ) -> Self {
        calibration.wrench(&block.readings, predicted);
        Self {
            rows: block.rows as u64,
            out_of_range: calibration.rows_out_of_range(&block.readings),
            errors: quality::errors(predicted, &block.wrench),
            sizes: size_unit.map(|unit| sizes(predicted, &block.wrench, unit)),
            stands_out: false,
            drawn: None,
        }
    }

    /// Compares the wrench that `calibration` predicts for the rows of `block` with the measured
    /// one. Errors are counted by size in units of `size_unit`, if there is one.
    pub(super) fn of(
        calibration: &Calibration,
        block: &Block,
        size_unit: Option<&PerAxis<f64>>,
        is_drawn: bool,
        judge: Option<(&Judge, &Spread)>,
    ) -> Self {
        let mut predicted = PerAxis::default();
        let errors = Self::in_room(&mut predicted, calibration, block, size_unit);
        Self {
            stands_out: judge.is_some_and(|(judge, spread)| {
                let judged = judge.judge_predicted(block, &predicted, spread);
                judged.iter().any(Judged::may_matter)
            }),
            drawn: is_drawn.then(|| Drawn { predicted, measured: block.wrench.clone() }),
            ..errors
        }
    }
}

impl Evaluation {
    /// Adds the rows of a block; what is to be drawn is added to `plot`.
    pub(super) fn add(&mut self, block: &BlockErrors, plot: Option<&mut FitPlot>) {
        self.rows += block.rows;
        self.out_of_range_rows += block.out_of_range;
        quality::merge(&mut self.errors, &block.errors);
        merge_sizes(&mut self.sizes, block.sizes.as_ref());
        if let (Some(plot), Some(drawn)) = (plot, &block.drawn) {
            plot.add(&drawn.predicted, &drawn.measured);
        }
    }

    /// Takes over what is known of the log as a whole.
    pub(super) fn note(&mut self, summary: &ReadSummary) {
        self.skipped_rows = summary.skipped_rows;
        self.repeated_rows = summary.repeated_rows;
        self.checksum.clone_from(&summary.checksum);
    }
}

/// Compares the wrench that `calibration` predicts with the one that `log` has measured; what is
/// to be drawn is added to `plot`.
///
/// # Errors
/// [`WorkflowError`] if the log cannot be read or has not the calibration's number of channels.
pub fn eval(
    calibration: &Calibration,
    log: &Log,
    options: &EvalOptions<'_>,
    mut plot: Option<&mut FitPlot>,
) -> Result<Evaluation, WorkflowError> {
    let wanted = Wanted { readings: true, wrench: true, ..Wanted::default() };
    log.require(&wanted)?;
    super::check_channels(log, calibration.channels())?;
    let is_drawn = plot.is_some();
    let mut all = Evaluation::default();
    let map = |block: &mut Block| {
        options.used.select(options.place, block);
        BlockErrors::of(calibration, block, options.size_unit.as_ref(), is_drawn, None)
    };
    let summary = log.read(&wanted, &options.read, map, |block| -> Result<(), WorkflowError> {
        all.add(&block, plot.as_deref_mut());
        Ok(())
    })?;
    all.note(&summary);
    Ok(all)
}

fn sizes(
    predicted: &PerAxis<Vec<f64>>,
    measured: &[Vec<f64>],
    unit: &PerAxis<f64>,
) -> PerAxis<Magnitudes> {
    let of_axis =
        |axis: usize| Magnitudes::of_differences(&predicted[axis], &measured[axis], unit[axis]);
    std::array::from_fn(of_axis)
}

fn merge_sizes(all: &mut Option<PerAxis<Magnitudes>>, part: Option<&PerAxis<Magnitudes>>) {
    match (all, part) {
        (Some(all), Some(part)) => all.iter_mut().zip(part).for_each(|(all, part)| all.merge(part)),
        (all @ None, Some(part)) => *all = Some(part.clone()),
        (_, None) => {}
    }
}
