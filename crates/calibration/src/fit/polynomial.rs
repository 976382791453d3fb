//! A polynomial in the readings: the fit of the model that was chosen, its errors and covariance; to rows, or to the
//! sums of partial fits. Those say all that rows do but what takes the rows again, their largest errors and how errors
//! and loads are distributed.

use std::mem::take;

use super::choice::{Clusters, FitInput, ModelChoice};
use super::evaluation::{Evaluation, RowErrors};
use super::options::{CovarianceRule, FitOptions};
use super::outlier_search::{KnownFit, name_outliers};
use super::refits::{PolynomialProblem, Solved, check_sizes, solve};
use super::warning::Warning;
use super::{Fit, FitMethod};
use crate::conversion::Calibration;
use crate::validation::outliers::{RowTest, Spread, TestedRow};
use least_squares::error::FitError;
use least_squares::exact::ExactSums;
use least_squares::factored::{FactoredGroups, FactoredRows};
use least_squares::methods::Method;
use least_squares::passes::Rows;
use least_squares::solver::{Solution, SolverKind};
use least_squares::uncertainty::{Covariance, ErrorShape};
use least_squares::validation::factored;
use least_squares::validation::grouped::{GroupKind, SumsByGroup};
use shell_data::dataset::Dataset;
use shell_data::fingerprint::Fingerprint;
use shell_data::wrench::{Axes, PerAxis};

/// The covariance as far as it can be had, and why not by groups where it is of independent rows.
fn covariance(
    solution: &Solution,
    solver: SolverKind,
    choice: &ModelChoice,
    options: &FitOptions<'_>,
) -> (Option<Covariance>, Option<FitError>) {
    if options.covariance == CovarianceRule::Nothing || choice.few_groups.is_some() {
        return (None, None);
    }
    let by_rows = || Covariance::from_rows(solution);
    let (ridge, workers) = (choice.ridge, options.workers);
    let found = match (&choice.clusters, &choice.sums) {
        _ if !choice.by_group => return (by_rows(), None),
        (Some(Clusters::Rows(rows)), _) => {
            Covariance::from_clipped_groups(rows, solution, ridge, workers)
        }
        (Some(Clusters::RFactors { rows, held_out_together }), _) => {
            let method = Method { solver, truncate: options.truncate };
            let together = held_out_together.as_deref();
            Covariance::from_factored(rows, together, solution, (method, ridge), workers)
        }
        (None, Some(sums)) => {
            let are_long =
                choice.has_long_stretches(sums.groups.len(), solution.rows, &solution.model);
            Covariance::from_groups(sums, &solution.model, ridge, are_long, workers)
        }
        (None, None) => return (by_rows(), None),
    };
    match found {
        Ok(covariance) => (Some(covariance), None),
        Err(error) => (by_rows(), Some(error)),
    }
}

/// Below this condition number refined QR has all digits of the coefficients (docs/accuracy.md), and the covariance from
/// its R factor, which is not refined, six at the least.
const AS_GOOD_AS_EXACT: f64 = 1e10;

/// Fits the model that was chosen, and finds its errors on the training rows and on those of tests.
pub(super) fn fit(input: FitInput<'_>, mut choice: ModelChoice) -> Result<Fit, FitError> {
    let FitInput { test, options, .. } = input;
    let train = choice.labelled.take().unwrap_or_else(|| input.used());
    let problem = PolynomialProblem {
        model: options.model_of(&train, choice.basis),
        solver: match options.solver {
            // What the exact solver leaves to others; memory terms are rounded themselves.
            SolverKind::Exact if train.has_weights() => SolverKind::RefinedTsqr,
            SolverKind::Exact if train.memory_terms() > 0 => SolverKind::Tsqr,
            solver => solver,
        },
        ridge: choice.ridge,
        truncate: options.truncate,
    };
    let total = choice.sums.as_ref().and_then(SumsByGroup::total);
    let sample = train.logs.first().map(|log| &log.sample);
    let solved = solve(&problem, total, &Rows::new(&train, options.workers), sample)?;
    let Solved { solution, ranges, solver, not_exact, .. } = &solved;
    let mut calibration = Calibration::from_solution(solution, ranges);
    calibration.axes = train.logs[0].axes;
    let (mut covariance, not_grouped) = covariance(solution, *solver, &choice, options);
    let unit = covariance.as_ref().map(|_| root_mean_square(solution));
    // Outliers are told by a fit to rows that count alike.
    let looks = options.looks_for_outliers() && !train.has_weights();
    let spread = looks.then(|| Spread::new(&train, options.workers)).transpose()?;
    let row_test = spread.as_ref().and_then(|spread| RowTest::new(solution, spread));
    let look = (unit.as_ref(), row_test.as_ref());
    let [mut errors, of_tests] =
        RowErrors::of_fit(&calibration, [&train, test], look, options.workers)?;
    check_copies([&train, test], [&errors, &of_tests])?;
    let quality = Evaluation::total(&errors.logs).quality().ok_or(FitError::NoRows)?;
    let tested = Evaluation::total(&of_tests.logs).quality();
    check_sizes(&calibration, [Some(&quality), tested.as_ref()].into_iter().flatten())?;
    if let (Some(covariance), Some(unit)) = (&mut covariance, unit) {
        let rms = quality.map(|axis| axis.rms);
        let sizes = errors.sizes.as_ref();
        covariance.shape = sizes.map(|sizes| ErrorShape::from_errors(sizes, &unit, &rms));
    }
    calibration.covariance = covariance;

    let mut warnings = Vec::new();
    if train.has_weights() && options.solver == SolverKind::Exact {
        warnings.push(Warning::Weighted);
    }
    let loses_digits = solution.condition.is_nan() || solution.condition > AS_GOOD_AS_EXACT;
    warnings.extend(not_exact.clone().filter(|_| loses_digits).map(Warning::NotExact));
    warnings.extend(options.warn_of_groups(&choice, not_grouped)?);
    let has_outliers = errors.tested.iter().flatten().any(TestedRow::starts_search);
    let outliers = spread.filter(|_| has_outliers).map(|spread| {
        let judged_by = FitOptions { model: choice.basis.into(), ridge: choice.ridge, ..*options };
        let uses_all = !options.fresh && input.excluded.is_empty();
        let is_same_fit = uses_all && options.solver == SolverKind::Exact;
        let known = KnownFit { fit: &solved, spread, tested: take(&mut errors.tested) };
        name_outliers(input.train, is_same_fit.then_some(known), &judged_by).into()
    });
    let outliers = outliers.unwrap_or_default();
    let (rows, solution, truncate) = (solution.rows, Box::new(solved.solution), options.truncate);
    let how = FitMethod::Polynomial { solution, solver: solved.solver, truncate };
    let fitted = Fit { outliers, warnings, ..Fit::new(calibration, choice, how, rows, quality) };
    Ok(fitted.with_errors(train, test, [errors, of_tests], options))
}

/// What is kept of rows, and apart by group.
#[derive(Clone, Debug)]
#[expect(clippy::large_enum_variant, reason = "there is one of them, for one call")]
pub enum RowSums<'a> {
    /// Exact sums.
    Exact(&'a ExactSums, Option<(GroupKind, SumsByGroup)>),
    /// R factors.
    Factored(&'a FactoredRows, Option<(GroupKind, FactoredGroups)>),
}

/// Fits a calibration of `axes` to what is kept of some rows. Of a physics model or outliers it knows nothing.
///
/// # Errors
/// [`FitError`] if the rows do not determine the coefficients, or something is asked of groups
/// where there are none.
pub fn fit_sums(sums: RowSums<'_>, axes: Axes, options: &FitOptions<'_>) -> Result<Fit, FitError> {
    let none = || match options.validates() || options.covariance == CovarianceRule::Groups {
        true => Err(FitError::NoGroupSums),
        false => Ok(options.open(None)),
    };
    let (choice, solver, solution, ranges, train) = match sums {
        RowSums::Exact(total, groups) => {
            let decide = |(by, sums): (GroupKind, SumsByGroup)| {
                let mut choice = options.open(Some(by.into()));
                if options.basis().is_none() {
                    options.select(&mut choice, &sums)?;
                }
                options.decide(choice, sums)
            };
            let choice = groups.map_or_else(none, decide)?;
            let model = options.model_without_memory(choice.basis, total.channels());
            let fit = total.solve(&model, choice.ridge)?;
            let train = fit.quality(total);
            (choice, SolverKind::Exact, fit.solution, total.reading_ranges(), train)
        }
        // Of rows that could not be summed exactly.
        RowSums::Factored(total, groups) => {
            let choice = groups.map_or_else(none, |groups| choose_r_factors(groups, options))?;
            let model = options.model_without_memory(choice.basis, total.model().channels);
            let solution = total.solve(&model, choice.ridge)?;
            let train = total.quality(&solution).ok_or(FitError::NoRows)?;
            (choice, SolverKind::Tsqr, solution, total.ranges.clone(), train)
        }
    };
    let mut calibration = Calibration::from_solution(&solution, &ranges);
    calibration.axes = axes;
    let (covariance, not_grouped) = covariance(&solution, solver, &choice, options);
    calibration.covariance = covariance;
    let warnings = options.warn_of_groups(&choice, not_grouped)?.collect();
    let rows = solution.rows;
    let how = FitMethod::Polynomial { solution: Box::new(solution), solver, truncate: None };
    Ok(Fit { warnings, ..Fit::new(calibration, choice, how, rows, train) })
}

fn choose_r_factors(
    (by, groups): (GroupKind, FactoredGroups),
    options: &FitOptions<'_>,
) -> Result<ModelChoice, FitError> {
    let mut choice = options.open(Some(by.into()));
    let channels = groups.groups.first().map_or(0, |(_, rows)| rows.model().channels);
    if options.basis().is_none() {
        choice.take(factored::select(&groups, options.intercept, options.ridges())?);
    }
    let model = options.model_without_memory(choice.basis, channels);
    if options.validation().is_some() {
        let folds = options.folds(groups.groups.len());
        let found = factored::cross_validate(&groups, &model, choice.ridge, folds)?;
        choice.cross_validation = Some(found);
    }
    Ok(match choice.by_group {
        true => options.decide_by_r_factors(choice, groups, &model),
        false => choice,
    })
}

/// Refuses a log that has the rows of one before it.
fn check_copies(data: [&Dataset; 2], errors: [&RowErrors; 2]) -> Result<(), FitError> {
    let fingerprints = errors.map(|of| &of.fingerprints[..]).concat();
    let Some(positions) = Fingerprint::first_copy(&fingerprints) else { return Ok(()) };
    let logs = data.into_iter().flat_map(|data| &data.logs);
    let [earlier, later] = <[usize; 2]>::from(positions)
        .map(|at| logs.clone().nth(at).map(|log| log.name.clone()).unwrap_or_default());
    Err(FitError::Copy { earlier, later })
}

/// The root mean square of the errors of each axis; one where there are none.
fn root_mean_square(solution: &Solution) -> PerAxis<f64> {
    std::array::from_fn(|axis| {
        let square = solution.residual_products[(axis, axis)] / solution.rows as f64;
        if square > 0.0 { square.sqrt() } else { 1.0 }
    })
}
