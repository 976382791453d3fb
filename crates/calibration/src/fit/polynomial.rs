//! Fits of a polynomial to rows or to the sums of partial fits. Sums give the same results, except
//! for the largest errors and the distributions of errors and loads, which need another pass.

use std::mem::take;

use super::choice::{FitInput, ModelChoice};
use super::evaluation::{Evaluation, RowErrors};
use super::options::{CovarianceRule, FitOptions};
use super::outlier_search::{KnownFit, name_outliers};
use super::refits::{PolynomialProblem, Solved, check_sizes, solve};
use super::warning::Warning;
use super::{Fit, FitMethod};
use crate::conversion::Calibration;
use crate::validation::outliers::{RowTest, Spread, TestedRow};
use least_squares::error::FitError;
use least_squares::passes::Rows;
use least_squares::solver::{Solution, SolverKind};
use least_squares::sums::{GroupedSums, RowSums, SolvedSums};
use least_squares::uncertainty::{Covariance, ErrorShape};
use least_squares::validation::grouped::{GroupKind, SumsByGroup};
use shell_data::dataset::Dataset;
use shell_data::fingerprint::Fingerprint;
use shell_data::wrench::{Axes, PerAxis};

/// The covariance, and the reason if it falls back from groups to independent rows.
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
    let sums = choice.covariance_sums().filter(|_| choice.by_group);
    let Some(sums) = sums else { return (by_rows(), None) };
    let by = (solver, choice.ridge);
    let found = sums.covariance(solution, by, choice.time_blocks.as_deref(), options.workers);
    match found {
        Ok(covariance) => (Some(covariance), None),
        Err(error) => (by_rows(), Some(error)),
    }
}

/// Condition number below which refined QR has all digits of the coefficients (docs/accuracy.md).
/// The covariance then has at least six correct digits; it comes from the R factor of the QR, which
/// is not refined.
const AS_GOOD_AS_EXACT: f64 = 1e10;

pub(super) fn fit(input: FitInput<'_>, mut choice: ModelChoice) -> Result<Fit, FitError> {
    let FitInput { test, options, .. } = input;
    let train = choice.labelled.take().unwrap_or_else(|| input.used());
    let problem = PolynomialProblem {
        model: options.model_of(&train, choice.basis),
        solver: match options.solver {
            // The exact solver takes neither weights nor memory terms. Memory terms are rounded, so
            // refinement would gain nothing.
            SolverKind::Exact if train.has_weights() => SolverKind::RefinedTsqr,
            SolverKind::Exact if train.memory_terms() > 0 => SolverKind::Tsqr,
            solver => solver,
        },
        ridge: choice.ridge,
        truncate: options.truncate,
    };
    let total = choice.sums.as_ref().and_then(GroupedSums::exact).and_then(SumsByGroup::total);
    let sample = train.logs.first().map(|log| &log.sample);
    options.workers.start("coefficients");
    let solved = solve(&problem, total, &Rows::new(&train, options.workers), sample)?;
    let Solved { solution, ranges, solver, not_exact, .. } = &solved;
    let mut calibration = Calibration::from_solution(solution, ranges);
    calibration.axes = train.logs[0].axes;
    options.workers.start("standard errors");
    let (mut covariance, not_grouped) = covariance(solution, *solver, &choice, options);
    let unit = covariance.as_ref().map(|_| root_mean_square(solution));
    let looks = options.looks_for_outliers() && !train.has_weights();
    let spread = looks.then(|| Spread::new(&train, options.workers)).transpose()?;
    let row_test = spread.as_ref().and_then(|spread| RowTest::new(solution, spread));
    options.workers.start("errors on the rows");
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
    warnings.extend(choice.group_warnings(options.covariance, not_grouped)?);
    let has_outliers = errors.tested.iter().flatten().any(TestedRow::starts_search);
    let outliers = spread.filter(|_| has_outliers).map(|spread| {
        options.workers.start("outliers");
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

/// Fits a calibration of `axes` to sums, without the physics model or a search for outliers.
///
/// # Errors
/// [`FitError`] if the rows do not determine the coefficients, or necessary groups are missing.
pub fn fit_sums(
    total: &RowSums,
    groups: Option<(GroupKind, GroupedSums)>,
    axes: Axes,
    options: &FitOptions<'_>,
) -> Result<Fit, FitError> {
    let choice = match groups {
        Some((by, sums)) => {
            let mut choice = options.open(Some(by.into()));
            if options.basis().is_none() {
                options.select(&mut choice, &sums)?;
            }
            options.decide(choice, sums)?
        }
        None if options.validates() || options.covariance == CovarianceRule::Groups => {
            return Err(FitError::NoGroupSums);
        }
        None => options.open(None),
    };
    let model = options.model_without_memory(choice.basis, total.channels());
    let SolvedSums { solution, quality, ranges, solver } = total.solve(&model, choice.ridge)?;
    let mut calibration = Calibration::from_solution(&solution, &ranges);
    calibration.axes = axes;
    let (covariance, not_grouped) = covariance(&solution, solver, &choice, options);
    calibration.covariance = covariance;
    let warnings = choice.group_warnings(options.covariance, not_grouped)?.collect();
    let rows = solution.rows;
    let how = FitMethod::Polynomial { solution: Box::new(solution), solver, truncate: None };
    Ok(Fit { warnings, ..Fit::new(calibration, choice, how, rows, quality) })
}

fn check_copies(data: [&Dataset; 2], errors: [&RowErrors; 2]) -> Result<(), FitError> {
    let fingerprints = errors.map(|of| &of.fingerprints[..]).concat();
    let Some(positions) = Fingerprint::first_copy(&fingerprints) else { return Ok(()) };
    let logs = data.into_iter().flat_map(|data| &data.logs);
    let [earlier, later] = <[usize; 2]>::from(positions)
        .map(|at| logs.clone().nth(at).map(|log| log.name.clone()).unwrap_or_default());
    Err(FitError::Copy { earlier, later })
}

/// Root mean square errors of the fit; 1 for an axis without errors.
fn root_mean_square(solution: &Solution) -> PerAxis<f64> {
    std::array::from_fn(|axis| {
        let square = solution.residual_products[(axis, axis)] / solution.rows as f64;
        if square > 0.0 { square.sqrt() } else { 1.0 }
    })
}
