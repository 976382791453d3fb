//! The physics model weighed against the polynomial that was chosen, on the same held-out groups.

use std::collections::HashMap;

use super::WorkflowError;
use super::groups::GroupBy;
use super::physics::read_rows;
use super::selection::UsedRows;
use calibration::Model;
use calibration::physics::PhysicsValidation;
use calibration::validation::comparison::Comparison;
use calibration::validation::grouped::GroupedMoments;
use calibration::validation::selection;
use log_file::{Log, ReadOptions};
use shell_data::wrench::Axis;

/// What the weighing has found.
#[derive(Clone, Debug)]
pub struct Weighing {
    /// The polynomial.
    pub model: Model,
    /// Its ridge.
    pub ridge: f64,
    /// Errors of physics and polynomial, in this order.
    pub comparison: Comparison,
    /// Folds of groups.
    pub folds: usize,
}

impl Weighing {
    /// Whether the physics model errs less, by more than a standard error of the paired difference.
    pub fn physics_is_better(&self) -> bool {
        self.comparison.all.first_is_better()
    }
}

/// Fits the physics model without each fold of the groups of `sums`, which are those of the rows of
/// `train`, and compares its errors there with those of `model`.
///
/// # Errors
/// [`WorkflowError`] if the logs cannot be read or the rows do not determine either model.
pub fn weigh(
    train: &[Log],
    sums: &GroupedMoments,
    group_by: &GroupBy,
    (model, ridge): (Model, f64),
    used: UsedRows<'_>,
    read: &ReadOptions<'_>,
) -> Result<Weighing, WorkflowError> {
    let grouped = read_rows(train, Some(group_by), used, read)?;
    let places: HashMap<&str, u64> = grouped.labels.iter().map(String::as_str).zip(0..).collect();
    let group = |&group: &usize| places[sums.groups[group].0.as_str()];
    let folds: Vec<Vec<u64>> =
        selection::folds(sums)?.iter().map(|fold| fold.iter().map(group).collect()).collect();
    let polynomial = selection::errors_by_fold(sums, &model, ridge)?;
    let polynomial = polynomial.expect("a model that was chosen by its errors on these folds");
    let physics = PhysicsValidation::of(&grouped.rows, &folds)?.by_fold();
    let whole = sums.total().expect("sums of two groups or more");
    let variances = Axis::ALL.map(|axis| whole.variance(axis));
    let comparison = Comparison::of(&physics, &polynomial, &variances);
    Ok(Weighing { model, ridge, comparison, folds: folds.len() })
}
