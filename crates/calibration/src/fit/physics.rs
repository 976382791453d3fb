//! The physics model: fitted to rows, held against the polynomial that was chosen.

use std::collections::HashMap;
use std::fmt;

use super::FitOptions;
use super::choice::{ModelChoice, Training};
use super::evaluation::EvalOptions;
use super::groups::{GroupBy, HeldOut};
use super::polynomial::Errors;
use super::refits::{FOLDS, MOST_ALONE};
use crate::conversion::{Calibration, Kind};
use crate::error::FitError;
use crate::model::Model;
use crate::passes::Workers;
use crate::physics::{Choice, PhysicsCalibration, PhysicsValidation, TrainingRows};
use crate::quality::significant;
use crate::reading_ranges::ReadingRange;
use crate::validation::comparison::Comparison;
use crate::validation::cross_validation::{CrossValidation, HeldOutQuality};
use crate::validation::excitation::WrenchSums;
use crate::validation::grouped::GroupedMoments;
use crate::validation::selection;
use shell_data::dataset::Dataset;
use shell_data::wrench::{Axes, Axis};

/// What rows were held out together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HeldOutGroups {
    /// Groups of rows.
    Groups(GroupBy),
    /// The rows of a stretch of time, where there are none.
    Stretches,
}

/// What a physics fit knows beside the calibration.
#[derive(Clone, Debug)]
pub struct PhysicsFit {
    /// What the priors were chosen from.
    pub choice: Choice,
    /// Means that the rows were reduced to.
    pub observations: usize,
    /// Groups.
    pub groups: usize,
    /// What they are.
    pub held_out: HeldOutGroups,
    /// Errors on groups that were held out, where that was asked for.
    pub validation: Option<PhysicsValidation>,
}

impl PhysicsFit {
    /// What a calibration file says of the held-out errors.
    pub(super) fn cross_validation(&self) -> Option<CrossValidation> {
        let validation = self.validation.as_ref()?;
        let total = validation.total();
        Some(CrossValidation {
            groups: self.groups,
            folds: validation.folds.len(),
            rows: total[0].rows,
            undetermined: Vec::new(),
            grouped: total.map(|of| HeldOutQuality { rms: of.rms(), bias: of.bias() }),
            random_folds: 0,
            random: None,
        })
    }
}

/// Checks that rows have all axes of the wrench, to which every sensor answers, and count alike.
///
/// # Errors
/// [`FitError::PhysicsAxes`], [`FitError::Weights`].
pub(super) fn check(data: &Dataset) -> Result<(), FitError> {
    if data.has_weights() {
        return Err(FitError::Weights { what: "the physics model" });
    }
    let found = data.logs.first().map_or(Axes::ALL, |log| log.axes);
    if found.are_all() { Ok(()) } else { Err(FitError::PhysicsAxes { found }) }
}

/// A calibration by the physics model, the rows that were used, and how well it does.
pub(super) struct Fitted {
    pub(super) calibration: Calibration,
    pub(super) used: Dataset,
    pub(super) physics: PhysicsFit,
    pub(super) errors: Errors,
}

/// Fits the physics model and finds its errors on the training rows and on those of tests.
pub(super) fn fit(
    training: Training<'_>,
    test: &Dataset,
    options: &FitOptions<'_>,
) -> Result<Fitted, FitError> {
    check(training.data)?;
    let labelled = training.labelled(options.held_out().unwrap_or(HeldOut::Auto));
    let held_out = match &labelled {
        Some((by, _)) => HeldOutGroups::Groups(*by),
        None => HeldOutGroups::Stretches,
    };
    let used = labelled.map_or_else(|| training.used(), |(_, data)| data);
    let (mut rows, _) = TrainingRows::from_dataset(&used);
    if held_out == HeldOutGroups::Stretches {
        rows.group_by_time();
    }
    let (physics, choice) = PhysicsCalibration::fit(&rows, options.workers)?;
    let validate = |held_out| validate(&rows, held_out, &choice, options);
    let validation = options.cross_validation.map(validate).transpose()?;
    let mut calibration = Calibration::of(Kind::Physics(Box::new(physics)));
    calibration.valid_range = Some(rows.readings.iter().map(|column| range(column)).collect());
    let mut errors = Errors::of(&calibration, &used, test, &EvalOptions::default(), options)?;
    // Of all rows at once, as they are fitted.
    errors.loads = WrenchSums::of(&rows.wrench);
    let physics = PhysicsFit {
        choice,
        observations: rows.observations()?.len(),
        groups: rows.group_count(),
        held_out,
        validation,
    };
    Ok(Fitted { calibration, used, physics, errors })
}

fn validate(
    rows: &TrainingRows,
    held_out: HeldOut,
    whole: &Choice,
    options: &FitOptions<'_>,
) -> Result<PhysicsValidation, FitError> {
    let groups = rows.group_count();
    let folds = match held_out {
        HeldOut::Folds(folds) => folds,
        _ if groups <= MOST_ALONE => groups,
        _ => FOLDS,
    };
    PhysicsValidation::of(rows, &rows.folds(folds), whole, options.workers)
}

fn range(column: &[f64]) -> ReadingRange {
    let range = ReadingRange { min: f64::INFINITY, max: f64::NEG_INFINITY };
    column.iter().fold(range, |range, &reading| ReadingRange {
        min: range.min.min(reading),
        max: range.max.max(reading),
    })
}

/// The physics model beside the polynomial that was chosen, on the same held-out groups.
#[derive(Clone, Debug)]
pub struct ModelComparison {
    /// The polynomial.
    pub model: Model,
    /// Its ridge.
    pub ridge: f64,
    /// Errors of physics and polynomial, in this order.
    pub comparison: Comparison,
    /// Folds of groups.
    pub folds: usize,
}

impl ModelComparison {
    /// Whether the physics model errs less, by more than a standard error of the paired difference.
    pub fn physics_is_better(&self) -> bool {
        self.comparison.all.first_is_better()
    }

    /// Fits the physics model without each fold of the groups that a polynomial was chosen on, and compares its
    /// errors there. `None` where none was chosen by sums.
    pub(super) fn of(
        training: Training<'_>,
        choice: &ModelChoice,
        options: &FitOptions<'_>,
    ) -> Option<Result<Self, FitError>> {
        let (sums, _) = choice.sums.as_ref().zip(choice.selection.as_ref())?;
        let held_out = options.held_out().unwrap_or(HeldOut::Auto);
        let (_, labelled) = training.labelled(held_out)?;
        let model = options.model_of(&labelled, choice.basis);
        Some(Self::new(&labelled, sums, (model, choice.ridge), options.workers))
    }

    fn new(
        labelled: &Dataset,
        sums: &GroupedMoments,
        (model, ridge): (Model, f64),
        workers: Workers<'_>,
    ) -> Result<Self, FitError> {
        let (rows, labels) = TrainingRows::from_dataset(labelled);
        let places: HashMap<&str, u64> = labels.iter().map(String::as_str).zip(0..).collect();
        let group = |&group: &usize| places[sums.groups[group].0.as_str()];
        let folds: Vec<Vec<u64>> =
            selection::folds(sums)?.iter().map(|fold| fold.iter().map(group).collect()).collect();
        let polynomial = selection::errors_by_fold(sums, &model, ridge)?;
        let polynomial = polynomial.expect("a model that was chosen by its errors on these folds");
        let (_, whole) = PhysicsCalibration::fit(&rows, workers)?;
        let physics = PhysicsValidation::of(&rows, &folds, &whole, workers)?.by_fold();
        let whole = sums.total().expect("sums of two groups or more");
        let variances = Axis::ALL.map(|axis| whole.variance(axis));
        let comparison = Comparison::of(&physics, &polynomial, &variances);
        Ok(Self { model, ridge, comparison, folds: folds.len() })
    }
}

impl fmt::Display for ModelComparison {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { model, ridge, comparison, folds } = self;
        let errors = |of: usize| {
            let error = |axis: Axis| {
                let rms = significant(comparison.rms[of][axis.index()], 3);
                format!("{} {rms} {}", axis.name(), axis.unit())
            };
            Axis::ALL.map(error).join(", ")
        };
        let (name, all) = (model.name(), comparison.all);
        let (difference, error) = (significant(all.value, 2), significant(all.standard_error, 2));
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
             {}. The paired difference of squared errors, relative to the variance, is {difference} ± {error}, \
             {verdict}; physics is better {where_better}",
            errors(0),
            errors(1),
        )
    }
}
