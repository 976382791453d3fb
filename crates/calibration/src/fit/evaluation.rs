//! How well a calibration predicts the wrench that rows have measured.

use crate::conversion::Calibration;
use crate::error::FitError;
use crate::magnitudes::Magnitudes;
use crate::passes::{Workers, each};
use crate::quality::{self, AxisErrors, AxisQuality};
use crate::validation::excitation::WrenchSums;
use crate::validation::leaks::{LEAKY, RowSample};
use crate::validation::outliers::{self, RowTest, TestedRow};
use shell_data::dataset::{Dataset, LabelledBlock};
use shell_data::fingerprint::Fingerprint;
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
    Ok(RowErrors::new(calibration, data, EvalOptions::default(), workers)?.logs)
}

/// What is looked at beside the errors.
#[derive(Clone, Copy, Default)]
struct EvalOptions<'a> {
    /// Errors are counted by their size, in these units, if there are any.
    size_unit: Option<&'a PerAxis<f64>>,
    /// Says which rows may be outliers.
    row_test: Option<&'a RowTest<'a>>,
    /// Whether rows are compared with those of other logs.
    compares: bool,
    /// Whether the wrench that was measured is summed up.
    sums_loads: bool,
}

/// How a calibration does on the rows of a data set, and what else is said of these.
#[derive(Default)]
pub(super) struct RowErrors {
    /// The errors on each log.
    pub(super) logs: Vec<Evaluation>,
    /// How large they are, if that was asked for.
    pub(super) sizes: Option<PerAxis<Magnitudes>>,
    /// The rows that were tested as outliers, by block, if that was asked for.
    pub(super) tested: Vec<Vec<TestedRow>>,
    /// The wrench that was measured, if that was asked for.
    pub(super) loads: WrenchSums,
    /// What tells the rows of each log from those of others, if they are compared.
    pub(super) fingerprints: Vec<Fingerprint>,
    /// Rows of all logs, if they are compared.
    pub(super) sample: RowSample,
}

impl RowErrors {
    /// Passes over the rows.
    fn new(
        calibration: &Calibration,
        data: &Dataset,
        look: EvalOptions<'_>,
        workers: Workers<'_>,
    ) -> Result<Self, FitError> {
        let mut all =
            Self { fingerprints: vec![Fingerprint::default(); data.logs.len()], ..Self::default() };
        all.logs.extend(data.logs.iter().map(|log| Evaluation {
            skipped_rows: log.summary.skipped_rows,
            repeated_rows: log.summary.repeated_rows,
            ..Evaluation::default()
        }));
        let stride = RowSample::stride(data.rows());
        // The state of a thread: room for predictions, and the sizes of the errors of all its blocks so far.
        type State = (PerAxis<Vec<f64>>, Option<PerAxis<Magnitudes>>);
        let work = |(predicted, sizes): &mut State, &(log, block): &(usize, &LabelledBlock)| {
            let rows = &*block.rows;
            calibration.wrench(&rows.readings, predicted);
            if let Some(units) = look.size_unit {
                for (axis, sizes) in sizes.get_or_insert_default().iter_mut().enumerate() {
                    sizes.add_differences(&predicted[axis], &rows.wrench[axis], units[axis]);
                }
            }
            let test =
                |test: &RowTest<'_>| test.test(rows, &test.suspects(rows, predicted), &|_| false);
            let tested = look.row_test.map(test).unwrap_or_default();
            let errors = Evaluation {
                rows: rows.rows as u64,
                out_of_range_rows: calibration.rows_out_of_range(&rows.readings),
                errors: quality::errors(predicted, &rows.wrench),
                ..Evaluation::default()
            };
            let compared =
                look.compares.then(|| (Fingerprint::new(rows), RowSample::new(rows, stride)));
            let loads = look.sums_loads.then(|| WrenchSums::new(&rows.wrench));
            Ok((log, errors, tested, compared, loads))
        };
        let fold = |(log, errors, tested, compared, loads): (usize, _, _, Option<_>, Option<_>)| {
            all.logs[log].merge(&errors);
            all.tested.push(tested);
            if let Some((fingerprint, sample)) = compared {
                all.fingerprints[log].merge(fingerprint);
                all.sample.add(sample);
            }
            loads.iter().for_each(|loads| all.loads.merge(loads));
            Ok(())
        };
        let blocks: Vec<_> = data.blocks().collect();
        let init = State::default;
        let states = each(&blocks, |(_, block)| &block.rows, workers, init, work, fold)?;
        let sizes = states.into_iter().filter_map(|(_, sizes)| sizes);
        all.sizes = sizes.reduce(|mut all, part| {
            all.iter_mut().zip(&part).for_each(|(all, part)| all.merge(part));
            all
        });
        Ok(all)
    }

    /// Passes over the rows of a fit and over test rows. Errors on the former are counted by their size in units, and
    /// rows are tested as outliers, where these are given.
    pub(super) fn of_fit(
        calibration: &Calibration,
        [train, test]: [&Dataset; 2],
        (size_unit, row_test): (Option<&PerAxis<f64>>, Option<&RowTest<'_>>),
        workers: Workers<'_>,
    ) -> Result<[Self; 2], FitError> {
        // A single log cannot be a copy of another.
        let compares = train.logs.len() + test.logs.len() > 1;
        // Training rows are within the range that they define: there is nothing to look for.
        let mut without_range = calibration.clone();
        without_range.valid_range = None;
        let look = EvalOptions { size_unit, row_test, compares, sums_loads: true };
        let of_test = EvalOptions { compares, ..EvalOptions::default() };
        Ok([
            Self::new(&without_range, train, look, workers)?,
            Self::new(calibration, test, of_test, workers)?,
        ])
    }
}

/// Rows on both sides of a split, as far as rows are made of poses.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Leaks {
    /// The share of test rows at poses of the training rows.
    pub test: Option<f64>,
    /// The share of training rows whose pose other groups have rows of, too.
    pub groups: Option<f64>,
}

impl Leaks {
    /// Whether errors on test rows say nothing of new poses.
    pub fn in_test(&self) -> Option<f64> {
        self.test.filter(|&share| share >= LEAKY)
    }

    /// Whether errors on held-out groups say nothing of new poses.
    pub fn in_groups(&self) -> Option<f64> {
        self.groups.filter(|&share| share >= LEAKY)
    }
}
