//! How well a calibration predicts the wrench that rows have measured.

use crate::conversion::Calibration;
use crate::error::FitError;
use crate::magnitudes::Magnitudes;
use crate::passes::{Workers, each};
use crate::quality::{self, AxisErrors, AxisQuality};
use crate::validation::outliers::{self, RowTest, TestedRow};
use shell_data::block::Block;
use shell_data::dataset::{Dataset, LabelledBlock, LogRows};
use shell_data::wrench::PerAxis;

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
}

impl Evaluation {
    /// Of rows of which nothing is known but how they were read.
    pub(super) fn before(log: &LogRows) -> Self {
        Self {
            skipped_rows: log.summary.skipped_rows,
            repeated_rows: log.summary.repeated_rows,
            ..Self::default()
        }
    }

    /// Of all rows of some logs.
    pub fn total(evaluations: &[Self]) -> Self {
        let mut total = Self::default();
        evaluations.iter().for_each(|evaluation| total.merge(evaluation));
        total
    }

    /// Adds the rows of `other`.
    pub fn merge(&mut self, other: &Self) {
        self.rows += other.rows;
        self.skipped_rows += other.skipped_rows;
        self.repeated_rows += other.repeated_rows;
        self.out_of_range_rows += other.out_of_range_rows;
        quality::merge(&mut self.errors, &other.errors);
    }

    /// Whether there are rows, and none is within the range of the training rows.
    pub fn is_out_of_range(&self) -> bool {
        self.rows > 0 && self.out_of_range_rows == self.rows
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

/// The errors of a calibration on each log of a data set.
///
/// # Errors
/// [`FitError::Interrupted`].
pub fn evaluate(
    calibration: &Calibration,
    data: &Dataset,
    workers: Workers<'_>,
) -> Result<Vec<Evaluation>, FitError> {
    let mut evaluations: Vec<_> = data.logs.iter().map(Evaluation::before).collect();
    let work = |evaluator: &mut BlockEvaluator, (log, block): &(usize, &LabelledBlock)| {
        Ok((*log, evaluator.evaluate(calibration, &block.rows, &EvalOptions::default()).0))
    };
    let fold = |(log, errors): (usize, Evaluation)| {
        evaluations[log].merge(&errors);
        Ok(())
    };
    let blocks: Vec<_> = data.blocks().collect();
    each(&blocks, |(_, block)| &block.rows, workers, BlockEvaluator::default, work, fold)?;
    Ok(evaluations)
}

/// What is looked at beside the errors.
#[derive(Clone, Copy, Default)]
pub(super) struct EvalOptions<'a> {
    /// Errors are counted by their size, in these units, if there are any.
    pub(super) size_unit: Option<&'a PerAxis<f64>>,
    /// Says which rows may be outliers.
    pub(super) row_test: Option<&'a RowTest<'a>>,
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
    /// Beside the errors are the rows that were tested as outliers, if that was asked for.
    pub(super) fn evaluate(
        &mut self,
        calibration: &Calibration,
        block: &Block,
        options: &EvalOptions<'_>,
    ) -> (Evaluation, Vec<TestedRow>) {
        let Self { predicted, sizes } = self;
        calibration.wrench(&block.readings, predicted);
        if let Some(units) = options.size_unit {
            for (axis, sizes) in sizes.get_or_insert_default().iter_mut().enumerate() {
                sizes.add_differences(&predicted[axis], &block.wrench[axis], units[axis]);
            }
        }
        let test =
            |test: &RowTest<'_>| test.test(block, &test.suspects(block, predicted), predicted);
        let tested = options.row_test.map(test).unwrap_or_default();
        let errors = Evaluation {
            rows: block.rows as u64,
            out_of_range_rows: calibration.rows_out_of_range(&block.readings),
            errors: quality::errors(predicted, &block.wrench),
            ..Evaluation::default()
        };
        (errors, tested)
    }

    /// The sizes of errors that the evaluators of all threads have counted, added up.
    pub(super) fn sizes(all: impl IntoIterator<Item = Self>) -> Option<PerAxis<Magnitudes>> {
        all.into_iter().filter_map(|evaluator| evaluator.sizes).reduce(|mut all, part| {
            all.iter_mut().zip(&part).for_each(|(all, part)| all.merge(part));
            all
        })
    }
}
