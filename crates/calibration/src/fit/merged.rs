//! From the sums of partial fits to a calibration: all that a fit to the rows says but what takes the rows again,
//! their largest errors and how errors and loads are distributed.

use super::choice::ModelChoice;
use super::polynomial::covariance;
use super::{CovarianceRule, Fit, FitMethod, FitOptions};
use crate::conversion::Calibration;
use crate::error::FitError;
use crate::exact::Moments;
use crate::factored::{FactoredGroups, FactoredRows};
use crate::solver::SolverKind;
use crate::validation::factored;
use crate::validation::grouped::{GroupKind, GroupedMoments};
use shell_data::wrench::Axes;

/// What is kept of rows, and apart by group.
#[derive(Clone, Debug)]
#[expect(clippy::large_enum_variant, reason = "there is one of them, for one call")]
pub enum RowSums<'a> {
    /// Exact sums.
    Exact(&'a Moments, Option<(GroupKind, GroupedMoments)>),
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
            let decide =
                |(by, sums): (GroupKind, _)| options.decide(options.open(Some(by.into())), sums);
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
            (choice, SolverKind::Tsqr, solution, total.reading_ranges().clone(), train)
        }
    };
    let mut calibration = Calibration::from_solution(&solution, &ranges);
    calibration.axes = axes;
    let (covariance, not_grouped) = covariance(&solution, solver, &choice, options);
    calibration.covariance = covariance;
    let warnings = options.warn_of_groups(&choice, not_grouped)?.collect();
    let how = FitMethod::polynomial(solution, solver, None);
    Ok(Fit { warnings, ..Fit::new(calibration, choice, how, train) })
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
        let found = factored::cross_validate(&groups, &model, choice.ridge, options.folds())?;
        choice.cross_validation = Some(found);
    }
    Ok(match choice.by_group {
        true => options.decide_by_r_factors(choice, groups, &model),
        false => choice,
    })
}
