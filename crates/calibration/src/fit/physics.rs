//! The physics model: its fit to rows, and its comparison with the chosen polynomial.

use std::fmt;

use super::choice::{FitInput, ModelChoice};
use super::evaluation::{Evaluation, RowErrors};
use super::options::check_physics;
use super::outcome::Outcome;
use super::outlier_search::name_outliers;
use super::outliers::Outliers;
use super::refits::{FOLDS, MOST_ALONE};
use super::{Fit, FitMethod, FitOptions};
use crate::conversion::{Calibration, Kind};
use crate::groups::{GroupBy, HeldOut};
use least_squares::error::FitError;
use least_squares::model::{Basis, Model};
use least_squares::quality::{in_units, significant};
use least_squares::reading_ranges::ReadingRanges;
use least_squares::sums::GroupedSums;
use least_squares::validation::comparison::Comparison;
use least_squares::validation::cross_validation::{
    CrossValidation, FoldErrors, HeldOutQuality, assign_groups,
};
use least_squares::validation::grouped::SumsByGroup;
use least_squares::validation::selection;
use sensor_physics::{
    Choice, ObservationSample, PhysicsCalibration, PhysicsValidation, TrainingRows,
};
use shell_data::dataset::Dataset;
use shell_data::wrench::{Axis, PerAxis};

/// Number of groups per coefficient of the cubic model below which polynomials are unreliable between the groups.
const GROUPS_PER_FEATURE: usize = 8;

/// Ratio of squared errors on held-out groups to those on the training rows above which a polynomial is poor.
const MUCH_WORSE: f64 = 2.0;

/// Number of folds on which the physics model is first tried with default priors, and the largest ratio of its squared
/// error to the polynomial's there. Its own priors are chosen only below that ratio.
const TRIED_FIRST: usize = 5;
const OUT_OF_REACH: f64 = 4.0;

#[derive(Clone, Debug)]
pub struct PhysicsFit {
    /// Chosen priors, with all that were tried.
    pub choice: Choice,
    pub observations: usize,
    pub groups: usize,
    pub validation: Option<PhysicsValidation>,
}

impl PhysicsFit {
    /// Held-out errors. `labels` names the groups, in the order of their numbers.
    pub(super) fn cross_validation(&self, labels: &[String]) -> Option<CrossValidation> {
        let validation = self.validation.as_ref()?;
        let total = validation.total();
        let by_fold = validation.folds.iter().zip(validation.by_fold());
        let by_fold = by_fold.map(|(groups, errors)| FoldErrors {
            labels: groups.iter().map(|of| labels[of.group as usize].clone()).collect(),
            errors,
        });
        Some(CrossValidation {
            groups: self.groups,
            folds: validation.folds.len(),
            rows: total[0].rows,
            undetermined: Vec::new(),
            grouped: total.map(HeldOutQuality::from),
            random_folds: 0,
            random: None,
            by_fold: by_fold.collect(),
        })
    }
}

pub(super) type TriedPhysics = ((PhysicsCalibration, Choice), PhysicsValidation);

/// Fits the physics model and finds its errors.
pub(super) fn fit(input: FitInput<'_>, tried: Option<TriedPhysics>) -> Result<Fit, FitError> {
    // The physics model has no memory terms.
    let [train, test] = &[input.train, input.test].map(Dataset::without_memory);
    let options = input.options;
    options.workers.start("physics model");
    check_physics(train)?;
    let labelled = FitInput { train, test, ..input }.labelled(options.held_out());
    let (group_by, used) = labelled.ok_or(FitError::NoGroups)?;
    let (mut rows, labels) = TrainingRows::from_dataset(&used);
    if let Some(stated) = options.stated_loads {
        let known = (0..).zip(&labels).filter_map(|(at, label)| Some((at, *stated.get(label)?)));
        rows.judged_by = known.collect();
    }
    let ((physics, choice), validation) = match tried {
        Some((fitted, validation)) => (fitted, Some(validation)),
        None => {
            let sample = ObservationSample::from_rows(&rows)?;
            let (fitted, folds) = fit_sample(&rows, sample, group_by, options)?;
            let validate = |_| PhysicsValidation::new(&rows, &folds, &fitted.1, options.workers);
            let validation = options.cross_validation.map(validate).transpose()?;
            (fitted, validation)
        }
    };
    let mut calibration = Calibration::from_kind(Kind::Physics(Box::new(physics)));
    calibration.valid_range = Some(ReadingRanges::from_dataset(&used)?.channels);
    options.workers.start("errors on the rows");
    let errors = RowErrors::of_fit(&calibration, [&used, test], (None, None), options.workers)?;
    let of_train = Evaluation::total(&errors[0].logs);
    // Outliers are found by a polynomial, whose errors without them say nothing about this model.
    let looks = of_train.has_large_errors() && options.looks_for_outliers();
    let outliers = match looks.then(|| name_outliers(train, None, options)) {
        None => Outcome::NotAsked,
        Some(found) => found.map(|found| Outliers { rms: None, ..found }).into(),
    };
    let quality = of_train.quality().ok_or(FitError::NoRows)?;
    let physics = PhysicsFit {
        observations: choice.sample.count,
        choice,
        groups: rows.group_count(),
        validation,
    };
    let choice = ModelChoice {
        cross_validation: physics.cross_validation(&labels),
        ..options.open(Some(group_by))
    };
    let (how, found_groups) = (FitMethod::Physics(Box::new(physics)), group_by.found());
    let fitted = Fit::new(calibration, choice, how, of_train.rows, quality);
    let fitted = Fit { found_groups, outliers, ..fitted };
    Ok(fitted.with_errors(used, test, errors, options))
}

type FittedOnFolds = ((PhysicsCalibration, Choice), Vec<Vec<u64>>);

/// Fits the physics model, and assigns the folds for its held-out errors. The priors do not depend on these folds.
fn fit_sample(
    rows: &TrainingRows,
    sample: ObservationSample,
    group_by: GroupBy,
    options: &FitOptions<'_>,
) -> Result<FittedOnFolds, FitError> {
    let groups = rows.group_count();
    let folds = |held_out| assign_folds(rows, fold_count(held_out, groups, group_by));
    let usual = folds(HeldOut::Auto)?;
    let fitted = PhysicsCalibration::fit_sample(rows, sample, Some(&usual), options.workers)?;
    Ok((fitted, folds(options.held_out())?))
}

fn assign_folds(rows: &TrainingRows, folds: usize) -> Result<Vec<Vec<u64>>, FitError> {
    let groups_of = |fold: Vec<usize>| fold.into_iter().map(|group| group as u64).collect();
    Ok(assign_groups(&rows.group_sizes(), folds)?.into_iter().map(groups_of).collect())
}

/// Number of folds. Blocks of time are not held out one by one: each has many rows, and none is a pose.
fn fold_count(held_out: HeldOut, groups: usize, group_by: GroupBy) -> usize {
    match held_out {
        HeldOut::Folds(folds) => folds.min(groups),
        _ if groups <= MOST_ALONE && !group_by.is_time_blocks() => groups,
        _ => FOLDS,
    }
}

#[derive(Clone, Debug)]
pub struct ModelComparison {
    pub model: Model,
    pub ridge: f64,
    /// Physics model first.
    pub comparison: Comparison,
    pub folds: usize,
}

impl ModelComparison {
    /// Returns true if the errors of the physics model are smaller by more than a standard error.
    pub fn physics_is_better(&self) -> bool {
        self.comparison.all.first_is_better()
    }

    /// Fits the physics model without each fold of the groups on which a polynomial was chosen, and compares the
    /// errors. Returns `None` if no polynomial was chosen, or if there is little to gain: many groups, and held-out
    /// errors of the polynomial hardly above those on its training rows. Returns no physics model if its errors on
    /// the first folds are far larger.
    pub(super) fn of(
        input: FitInput<'_>,
        choice: &ModelChoice,
    ) -> Result<Option<(Self, Option<TriedPhysics>)>, FitError> {
        let options = input.options;
        let sums = choice.sums.as_ref().filter(|_| choice.selection.is_some());
        let sums = sums.and_then(GroupedSums::exact);
        // If each sum is over a set of groups, the rows of the set are unknown.
        let sums = sums.filter(|sums| sums.group_count == sums.groups.len());
        let Some(sums) = sums else { return Ok(None) };
        let labelled = input.labelled(options.held_out());
        let Some((group_by, labelled)) = labelled else { return Ok(None) };
        let (model, ridge) = (options.model_of(&labelled, choice.basis), choice.ridge);
        if !is_worth_trying(sums, group_by, &model, choice)? {
            return Ok(None);
        }
        options.workers.start("comparison with physics");
        let (rows, labels) = TrainingRows::from_dataset(&labelled);
        let sample = ObservationSample::from_rows(&rows)?;
        let held_out = options.validation().unwrap_or(HeldOut::Auto);
        let mut folds = assign_folds(&rows, fold_count(held_out, labels.len(), group_by))?;
        let position = |group: &u64| {
            let label = labels[*group as usize].as_str();
            let of_sums = sums.groups.iter().position(|(of_sums, _)| &**of_sums == label);
            of_sums.expect("sums of every group")
        };
        let in_sums = |folds: &[Vec<u64>]| -> Vec<Vec<usize>> {
            folds.iter().map(|fold| fold.iter().map(position).collect()).collect()
        };
        let mut polynomial = selection::errors_by_fold(sums, &model, ridge, &in_sums(&folds))?;
        if polynomial.is_none() {
            folds = assign_folds(&rows, labels.len().min(selection::FOLDS))?;
            polynomial = selection::errors_by_fold(sums, &model, ridge, &in_sums(&folds))?;
        }
        let polynomial = polynomial.expect("a model that was chosen by its errors on these folds");
        let whole = sums.total().expect("sums of two groups or more");
        let variances = Axis::ALL.map(|axis| whole.variance(axis));
        let every = (folds.len() / TRIED_FIRST).max(1);
        let (first, of_first): (Vec<_>, Vec<_>) =
            folds.iter().cloned().zip(polynomial.iter().copied()).step_by(every).unzip();
        let usual = PhysicsValidation::usual(&rows, &sample, &first, options.workers)?;
        let comparison = Comparison::new(&usual.by_fold(), &of_first, &variances);
        let [physics, by_polynomial] = comparison.rms.map(|rms| relative_square(&rms, &variances));
        if physics > OUT_OF_REACH * by_polynomial {
            return Ok(Some((Self { model, ridge, comparison, folds: first.len() }, None)));
        }
        let (fitted, _) = fit_sample(&rows, sample, group_by, options)?;
        let validation = PhysicsValidation::new(&rows, &folds, &fitted.1, options.workers)?;
        let comparison = Comparison::new(&validation.by_fold(), &polynomial, &variances);
        let tried = (fitted, validation);
        Ok(Some((Self { model, ridge, comparison, folds: folds.len() }, Some(tried))))
    }
}

/// Returns true for few groups, or if the polynomial errs far more on held-out groups than on its training rows.
/// Blocks of time never count as few, because each has many loads.
fn is_worth_trying(
    sums: &SumsByGroup,
    group_by: GroupBy,
    model: &Model,
    choice: &ModelChoice,
) -> Result<bool, FitError> {
    let cubic = Model { basis: Basis::Cubic, ..*model };
    let are_few = sums.groups.len() < GROUPS_PER_FEATURE * cubic.term_count();
    if are_few && !group_by.is_time_blocks() {
        return Ok(true);
    }
    let (Some(whole), Some(held_out)) = (sums.total(), &choice.cross_validation) else {
        return Ok(false);
    };
    let own = whole.solve(model, choice.ridge)?.quality(whole);
    let square = |rms: &dyn Fn(usize) -> f64| -> f64 {
        let variances = Axis::ALL.map(|axis| whole.variance(axis));
        relative_square(&std::array::from_fn(rms), &variances)
    };
    let (new, own) = (square(&|axis| held_out.grouped[axis].rms), square(&|axis| own[axis].rms));
    Ok(new > MUCH_WORSE * own)
}

/// Sum of squared errors relative to the variance of the load, over the axes that vary.
fn relative_square(rms: &PerAxis<f64>, variances: &PerAxis<f64>) -> f64 {
    let relative = rms.iter().zip(variances).map(|(rms, variance)| rms.powi(2) / variance);
    relative.filter(|square| square.is_finite()).sum()
}

impl fmt::Display for ModelComparison {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { model, ridge, comparison, folds } = self;
        let errors =
            |of: usize| in_units(Axis::ALL, |axis| significant(comparison.rms[of][axis], 3));
        let (name, all) = (model.name(), comparison.all);
        let verdict = match (self.physics_is_better(), all.value < 0.0) {
            (true, _) => "so physics is taken".to_owned(),
            (false, true) => format!("which is no more than chance does, so {name} is kept"),
            (false, false) => format!("so {name} is kept"),
        };
        let better: Vec<&str> = (Axis::ALL.iter())
            .filter(|axis| comparison.axes[axis.index()].first_is_better())
            .map(|axis| axis.name())
            .collect();
        let where_better = match better.len() {
            0 => "on no axis by more than a standard error".to_owned(),
            6 => "on every axis by more than a standard error".to_owned(),
            _ => format!("by more than a standard error on {}", better.join(", ")),
        };
        write!(
            f,
            "on the same {folds} folds of held-out groups physics errs by {}; {name} with ridge {ridge:e} by \
             {}. Averaged over folds and axes physics errs {all}, {verdict}; physics is better \
             {where_better}",
            errors(0),
            errors(1),
        )
    }
}
