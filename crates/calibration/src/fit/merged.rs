//! From the sums of partial fits to a calibration: all that a fit to the rows says but what takes the rows again,
//! their largest errors and how errors and loads are distributed.

use super::model_choice::ModelChoice;
use super::polynomial::covariance;
use super::{Fit, FitMethod, FitOptions};
use crate::conversion::Calibration;
use crate::error::FitError;
use crate::exact::Moments;
use crate::factored::{FactoredGroups, FactoredRows};
use crate::quality::AxisQuality;
use crate::reading_ranges::ReadingRanges;
use crate::solver::{Solution, SolverKind};
use crate::validation::factored;
use crate::validation::grouped::{GroupKind, GroupedMoments};
use shell_data::wrench::{Axes, PerAxis};

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
    let (choice, solver, solution, ranges, train) = match sums {
        RowSums::Exact(total, groups) => solve_exactly(total, groups, options)?,
        RowSums::Factored(total, groups) => solve_r_factor(total, groups, options)?,
    };
    let mut calibration = Calibration::from_solution(&solution, &ranges);
    calibration.axes = axes;
    let (covariance, not_grouped) = covariance(&solution, solver, &choice, options);
    calibration.covariance = covariance;
    let warnings = options.warn_of_groups(&choice, not_grouped)?.collect();
    let how = FitMethod::polynomial(solution, solver, None);
    Ok(Fit { warnings, ..Fit::new(calibration, choice, how, train) })
}

/// The choice of a model, the solver, what it found, and the errors on the training rows.
type MergedSolution = (ModelChoice, SolverKind, Solution, ReadingRanges, PerAxis<AxisQuality>);

fn solve_exactly(
    total: &Moments,
    groups: Option<(GroupKind, GroupedMoments)>,
    options: &FitOptions<'_>,
) -> Result<MergedSolution, FitError> {
    let choice = match groups {
        Some((by, sums)) => options.decide(options.open(Some(by.into())), sums)?,
        None => options.without_groups()?,
    };
    let model = options.model_without_memory(choice.basis, total.channels());
    let fit = total.solve(&model, choice.ridge)?;
    let train = fit.quality(total);
    Ok((choice, SolverKind::Exact, fit.solution, total.reading_ranges(), train))
}

/// The same from the R factor of rows that could not be summed exactly.
fn solve_r_factor(
    total: &FactoredRows,
    groups: Option<(GroupKind, FactoredGroups)>,
    options: &FitOptions<'_>,
) -> Result<MergedSolution, FitError> {
    let choice = match groups {
        Some((by, groups)) => choose_r_factors(by, groups, options)?,
        None => options.without_groups()?,
    };
    let model = options.model_without_memory(choice.basis, total.channels());
    let solution = total.solve(&model, choice.ridge)?;
    let train = total.quality(&solution).ok_or(FitError::NoRows)?;
    let ranges = total.reading_ranges().clone();
    Ok((choice, SolverKind::Tsqr, solution, ranges, train))
}

fn choose_r_factors(
    by: GroupKind,
    groups: FactoredGroups,
    options: &FitOptions<'_>,
) -> Result<ModelChoice, FitError> {
    let mut choice = options.open(Some(by.into()));
    if options.basis().is_none() {
        choice.take(factored::select(&groups, options.intercept, options.ridges())?);
    }
    if options.validation().is_some() {
        let channels = groups.groups.first().map_or(0, |(_, rows)| rows.channels());
        let model = options.model_without_memory(choice.basis, channels);
        let found = factored::cross_validate(&groups, &model, choice.ridge, options.folds())?;
        choice.cross_validation = Some(found);
    }
    Ok(match choice.by_group {
        true => options.decide_by_r_factors(choice, groups),
        false => choice,
    })
}

impl FitOptions<'_> {
    /// What is known where there are no groups.
    fn without_groups(&self) -> Result<ModelChoice, FitError> {
        let asks = self.validates() || self.covariance == super::CovarianceRule::Groups;
        if asks { Err(FitError::NoGroupSums) } else { Ok(self.open(None)) }
    }
}

impl Fit {
    /// Whether a fit to sums has held groups out without a random split to compare with.
    pub fn lacks_random_split(&self) -> bool {
        self.cross_validation.as_ref().is_some_and(|cv| cv.random_folds == 0)
    }
}
