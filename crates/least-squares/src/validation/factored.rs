//! Errors on held-out groups, and the choice of a model, from [R factors](crate::factored).

use super::cross_validation::{CrossValidation, assign_groups, assign_to_folds, labels_of};
use super::selection::{ErrorsByRidge, FOLDS, Selection, choose};
use crate::error::FitError;
use crate::factored::{FactoredGroups, FactoredRows};
use crate::model::{Basis, Model};
use crate::scaling::Scaling;

struct Fold {
    groups: Vec<usize>,
    held_out: FactoredRows,
    rest: FactoredRows,
}

/// Cross-validates like [`cross_validate`](super::cross_validation::cross_validate), without randomly assigned rows.
///
/// # Errors
/// [`FitError`] if there are too few groups, or no fold leaves enough rows to fit.
pub fn cross_validate(
    rows: &FactoredGroups,
    model: &Model,
    ridge: f64,
    folds: Option<usize>,
) -> Result<CrossValidation, FitError> {
    let sizes = sizes(rows);
    let on_fold = |fold: Fold| {
        let solution = fold.rest.solve(model, ridge);
        let errors = solution.map(|of| fold.held_out.errors(&of).unwrap_or_default());
        (labels_of(&rows.groups, &fold.groups), errors)
    };
    let on_folds = parted(rows, assign_to_folds(&sizes, folds)?)?.into_iter().map(on_fold);
    CrossValidation::from_folds((sizes.len(), sizes.iter().sum()), on_folds)
}

/// Selects like [`select`](super::selection::select), among the families within the one that the R factors have.
///
/// # Errors
/// [`FitError`] if there are too few groups, or no model can be fitted.
pub fn select(
    rows: &FactoredGroups,
    intercept: bool,
    ridges: &[f64],
) -> Result<Selection, FitError> {
    let assigned = assign_groups(&sizes(rows), rows.groups.len().clamp(1, FOLDS));
    let folds = parted(rows, assigned.map_err(|_| too_few(rows))?)?;
    let total = rows.total().ok_or_else(|| too_few(rows))?;
    let model = |basis| Model { basis, intercept, channels: total.model().channels, memory: 0 };
    let errors_of = |basis: Basis| -> Option<ErrorsByRidge<'_>> {
        let (model, folds) = (model(basis), &folds);
        let can_fit = total.change(&model, &Scaling::identity(model.columns())).is_some();
        can_fit.then_some(Box::new(move |ridge| {
            let errors = |fold: &Fold| fold.held_out.errors(&fold.rest.solve(&model, ridge).ok()?);
            folds.iter().map(errors).collect()
        }))
    };
    Ok(choose(model, ridges, total.load_variances(), errors_of)?.selection)
}

fn too_few(rows: &FactoredGroups) -> FitError {
    FitError::TooFewGroups { found: rows.groups.len() }
}

fn sizes(rows: &FactoredGroups) -> Vec<u64> {
    rows.groups.iter().map(|(_, rows)| rows.rows()).collect()
}

fn parted(rows: &FactoredGroups, assigned: Vec<Vec<usize>>) -> Result<Vec<Fold>, FitError> {
    let merged = |groups: &Vec<usize>| {
        let all = FactoredRows::merged(groups.iter().map(|&group| &rows.groups[group].1))?;
        Some((String::new(), all))
    };
    let folds = FactoredGroups { groups: assigned.iter().filter_map(merged).collect() };
    let others = folds.without_each().ok_or_else(|| too_few(rows))?;
    let of_fold = |((groups, (_, held_out)), rest)| Fold { groups, held_out, rest };
    Ok(assigned.into_iter().zip(folds.groups).zip(others).map(of_fold).collect())
}
