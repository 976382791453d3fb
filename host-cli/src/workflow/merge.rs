//! From partial fits, merged, to a calibration: all that a fit over the rows says but what takes the rows
//! again, their largest errors and how errors and loads are distributed.

use super::WorkflowError;
use super::factored::of_rows;
use super::model_choice::choose_from;
use super::model_choice::{CovarianceRule, HeldOut, ModelChoice, ModelChoiceOptions, RANDOM_FOLDS};
use super::selection::UsedRows;
use super::uncertainty::Uncertainty;
use calibration::exact::{Moments, PartitionedMoments, SolveError};
use calibration::factored::FactoredRows;
use calibration::quality::AxisQuality;
use calibration::reading_ranges::ReadingRanges;
use calibration::solver::{Solution, SolverKind, solve_moments};
use calibration::validation::{ValidationError, factored, selection};
use calibration::{Basis, Calibration, FitError, Model};
use calibration_file::{
    CalibrationFile, Diagnostics, MergeError, Origin, PartialFit, SolverRecord, Sums,
};
use log_file::ReadOptions;
use shell_data::wrench::PerAxis;

/// What is to be fitted to the sums, and what is asked of it.
#[derive(Clone, Copy, Debug)]
pub struct MergedFitOptions {
    /// The model.
    pub model: MergedModel,
    /// λ of a ridge on columns of norm one; 0 for none, or for the best of several where the model is
    /// chosen.
    pub ridge: f64,
    /// Find the errors on each group, or on so many folds of groups.
    pub cross_validation: Option<Option<usize>>,
    /// What the covariance is found from.
    pub covariance: CovarianceRule,
}

/// Which family of features.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MergedModel {
    /// That of the partial fits.
    Same,
    /// One within it.
    Given(Basis),
    /// The smallest within it that predicts new groups as well as the best.
    Auto,
}

/// A calibration from sums.
#[derive(Debug)]
pub struct MergedFit {
    /// The calibration.
    pub calibration: Calibration,
    /// What the solver says.
    pub solution: Solution,
    /// The solver.
    pub solver: SolverKind,
    /// What the groups said before.
    pub choice: ModelChoice,
    /// Why groups were asked for and the covariance is that of independent rows.
    pub not_grouped: Option<ValidationError>,
    /// Errors on the training rows.
    pub train: PerAxis<AxisQuality>,
}

/// Fits a calibration to the sums of `merged`, which is [in order](PartialFit::put_in_order).
///
/// # Errors
/// [`WorkflowError`] if the rows do not determine the coefficients, or something is asked of groups
/// where there are none.
pub fn fit(merged: &PartialFit, options: &MergedFitOptions) -> Result<MergedFit, WorkflowError> {
    let Solved { choice, solver, solution, ranges, train } = match &merged.sums {
        Sums::Exact(moments) => solve_exactly(merged, moments, options)?,
        Sums::Factored(rows) => solve_triangle(merged, rows, options)?,
    };
    let mut calibration = Calibration::of_solution(&solution, &ranges);
    calibration.axes = merged.axes;
    let from = choice.covariance_from(options.covariance);
    let Uncertainty { covariance, not_grouped } =
        Uncertainty::of(&solution, (solver, None), choice.ridge, from);
    calibration.covariance = covariance;
    Ok(MergedFit { calibration, solution, solver, choice, not_grouped, train })
}

/// The coefficients, and what they were found with.
struct Solved {
    choice: ModelChoice,
    solver: SolverKind,
    solution: Solution,
    ranges: ReadingRanges,
    /// Errors on the training rows.
    train: PerAxis<AxisQuality>,
}

fn solve_exactly(
    merged: &PartialFit,
    moments: &Moments,
    options: &MergedFitOptions,
) -> Result<Solved, WorkflowError> {
    let choice = choose(merged, options)?;
    let model = Model { basis: choice.basis, ..merged.model };
    let parts = PartitionedMoments::new(moments, &model);
    if let Err(error @ SolveError::OtherFeatures { .. }) = parts {
        return Err(ValidationError::from(error).into());
    }
    let ranges = moments.reading_ranges();
    let solution = solve_moments(moments, &model, choice.ridge, &ranges)?;
    let train = parts.and_then(|parts| parts.in_sample(choice.ridge));
    let train = train.map_err(|_| FitError::NearlyDependent)?;
    Ok(Solved { choice, solver: SolverKind::Exact, solution, ranges, train })
}

/// The same from the triangle of rows that could not be summed exactly.
fn solve_triangle(
    merged: &PartialFit,
    rows: &FactoredRows,
    options: &MergedFitOptions,
) -> Result<Solved, WorkflowError> {
    let choice = choose_triangles(merged, options)?;
    let model = Model { basis: choice.basis, ..merged.model };
    let solution = rows.solve(&model, choice.ridge)?;
    let train = rows.quality(&solution).ok_or(WorkflowError::NoRows)?;
    let ranges = rows.reading_ranges().clone();
    Ok(Solved { choice, solver: SolverKind::Tsqr, solution, ranges, train })
}

/// Chooses and validates as [`choose`] does, from triangles.
fn choose_triangles(
    merged: &PartialFit,
    options: &MergedFitOptions,
) -> Result<ModelChoice, WorkflowError> {
    let asked = asked(merged, options);
    let Some((group_by, groups)) = merged.factored() else { return asked.without_groups() };
    let intercept = merged.model.intercept;
    let mut choice = asked.open(Some(group_by.into()));
    if asked.basis.is_none() {
        let given = [asked.ridge];
        let ridges = if asked.ridge > 0.0 { &given[..] } else { &selection::RIDGES };
        let selection = factored::select(&groups, intercept, ridges)?;
        let chosen = &selection.candidates[selection.chosen];
        (choice.basis, choice.ridge) = (chosen.basis, chosen.ridge);
        choice.selection = Some(selection);
    }
    if let Some(folds) = options.cross_validation {
        let model = Model { basis: choice.basis, ..merged.model };
        let found = factored::cross_validate(&groups, &model, choice.ridge, folds);
        choice.cross_validation = Some(found.map_err(of_rows)?);
    }
    match choice.by_group {
        true => asked.decide_factored(choice, Ok(groups)),
        false => Ok(choice),
    }
}

impl MergedFit {
    /// The calibration file of a fit to `merged`.
    pub fn file(self, merged: &PartialFit, sensor_serial: Option<String>) -> CalibrationFile {
        let Self { calibration, solution, solver, choice, train, .. } = self;
        CalibrationFile {
            calibration,
            origin: Origin {
                made_by: merged.made_by.clone(),
                date: merged.date.clone(),
                sensor_serial,
                solver: Some(SolverRecord { name: solver, ridge: choice.ridge, truncate: None }),
                diagnostics: Some(Diagnostics {
                    rows: solution.rows,
                    skipped_rows: merged.skipped_rows,
                    repeated_rows: merged.repeated_rows,
                    rank: solution.rank,
                    condition: solution.condition.is_finite().then_some(solution.condition),
                    train,
                    test: None,
                    cross_validation: choice.cross_validation,
                    selection: choice.selection,
                    excitation: None,
                }),
                sources: merged.sources.clone(),
                columns: merged.columns.clone(),
            },
        }
    }
}

fn asked(merged: &PartialFit, options: &MergedFitOptions) -> ModelChoiceOptions<'static> {
    ModelChoiceOptions {
        basis: match options.model {
            MergedModel::Same => Some(merged.model.basis),
            MergedModel::Given(basis) => Some(basis),
            MergedModel::Auto => None,
        },
        intercept: merged.model.intercept,
        ridge: options.ridge,
        solver: SolverKind::Exact,
        cross_validation: options.cross_validation.map(HeldOut::from),
        seed: 0,
        covariance: options.covariance,
        used: UsedRows::default(),
        memory: 0,
        read: ReadOptions::default(),
    }
}

fn choose(merged: &PartialFit, options: &MergedFitOptions) -> Result<ModelChoice, WorkflowError> {
    let asked = asked(merged, options);
    let random_folds = options.cross_validation.map(|folds| folds.unwrap_or(RANDOM_FOLDS));
    match merged.grouped(random_folds)? {
        Some((group_by, sums)) => choose_from(sums, group_by.into(), &asked),
        None => asked.without_groups(),
    }
}

impl From<MergeError> for WorkflowError {
    fn from(error: MergeError) -> Self {
        match error {
            MergeError::NotExact(error) => FitError::NotExact(error).into(),
            error => WorkflowError::Merge(error),
        }
    }
}
