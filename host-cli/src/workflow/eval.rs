//! How well a calibration predicts the wrench that a log has measured.

use super::WorkflowError;
use super::selection::UsedRows;
use calibration::Calibration;
use calibration::magnitudes::Magnitudes;
use calibration::quality::{self, AxisErrors, AxisQuality};
use calibration::validation::outliers::{self, Judge, Judged, Spread};
use figures::FitPlot;
use log_file::{Log, ReadOptions, ReadSummary, Wanted};
use shell_data::block::Block;
use shell_data::wrench::PerAxis;

/// Which rows are used, and how they are read.
#[derive(Clone, Copy, Default)]
pub struct EvalOptions<'a> {
    /// Which rows are used.
    pub used: UsedRows<'a>,
    /// The place of the log among those that this is said of.
    pub place: usize,
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
    drawn: Option<Drawn>,
    /// Whether a row may not belong and matter, as far as a judge was asked.
    pub(super) stands_out: bool,
}

struct Drawn {
    predicted: PerAxis<Vec<f64>>,
    measured: Vec<Vec<f64>>,
}

impl Drawn {
    fn new(predicted: &PerAxis<Vec<f64>>, block: &Block) -> Self {
        Self { predicted: predicted.clone(), measured: block.wrench.clone() }
    }
}

/// What is looked at beside the errors.
#[derive(Clone, Copy, Default)]
pub(super) struct Look<'a> {
    /// Errors are counted by their size, in these units, if there are any.
    pub(super) size_unit: Option<&'a PerAxis<f64>>,
    /// Whether predictions and measurements are drawn.
    pub(super) plot: bool,
    /// Says which rows may not belong.
    pub(super) judge: Option<(&'a Judge, &'a Spread)>,
}

/// Finds the errors of blocks on one thread.
#[derive(Default)]
pub(super) struct BlockEvaluator {
    /// Room for predictions, which is used again.
    predicted: PerAxis<Vec<f64>>,
    /// The sizes of the errors of all blocks so far, if they are counted.
    sizes: Option<PerAxis<Magnitudes>>,
}

impl BlockEvaluator {
    /// Compares the wrench that `calibration` predicts for the rows of `block` with the measured one.
    pub(super) fn evaluate(
        &mut self,
        calibration: &Calibration,
        block: &Block,
        look: &Look<'_>,
    ) -> BlockErrors {
        let Self { predicted, sizes } = self;
        calibration.wrench(&block.readings, predicted);
        if let Some(units) = look.size_unit {
            for (axis, sizes) in sizes.get_or_insert_default().iter_mut().enumerate() {
                sizes.add_differences(&predicted[axis], &block.wrench[axis], units[axis]);
            }
        }
        BlockErrors {
            rows: block.rows as u64,
            out_of_range: calibration.rows_out_of_range(&block.readings),
            errors: quality::errors(predicted, &block.wrench),
            stands_out: look.judge.is_some_and(|(judge, spread)| {
                let judged = judge.judge_predicted(block, predicted, spread);
                judged.iter().any(Judged::may_matter)
            }),
            drawn: look.plot.then(|| Drawn::new(predicted, block)),
        }
    }

    /// The sizes of errors that the evaluators of all threads have counted, added up.
    pub(super) fn sizes(all: impl IntoIterator<Item = Self>) -> Option<PerAxis<Magnitudes>> {
        all.into_iter().filter_map(|evaluator| evaluator.sizes).reduce(|mut all, part| {
            all.iter_mut().zip(&part).for_each(|(all, part)| all.merge(part));
            all
        })
    }
}

impl Evaluation {
    /// Adds the rows of a block; what is to be drawn is added to `plot`.
    pub(super) fn add(&mut self, block: &BlockErrors, plot: Option<&mut FitPlot>) {
        self.rows += block.rows;
        self.out_of_range_rows += block.out_of_range;
        quality::merge(&mut self.errors, &block.errors);
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
    let look = Look { plot: plot.is_some(), ..Look::default() };
    let mut all = Evaluation::default();
    let map = |block: &mut Block| {
        options.used.select(options.place, block);
        BlockEvaluator::default().evaluate(calibration, block, &look)
    };
    let summary = log.read(&wanted, &options.read, map, |block| -> Result<(), WorkflowError> {
        all.add(&block, plot.as_deref_mut());
        Ok(())
    })?;
    all.note(&summary);
    Ok(all)
}
