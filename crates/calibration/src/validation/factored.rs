//! Errors on groups that were held out, and the choice of a model, from [R factors](crate::factored).
//!
//! The R factor of all other folds is put together from theirs, from both ends on: nothing is taken away from
//! anything, and no fold is merged more than four times.

use super::ValidationError;
use super::cross_validation::{CrossValidation, HeldOutQuality, assign_groups};
use super::selection::{ErrorsByRidge, FOLDS, Selection, choose};
use crate::exact::HeldOutErrors;
use crate::factored::{FactoredGroups, FactoredRows};
use crate::model::{Basis, Model};
use shell_data::wrench::PerAxis;

/// The rows of a fold, and all others.
struct Fold {
    groups: Vec<usize>,
    held_out: FactoredRows,
    rest: FactoredRows,
}

/// As [`cross_validate`](super::cross_validation::cross_validate), without rows that were assigned at random.
///
/// # Errors
/// [`ValidationError`] if there are too few groups, or no fold leaves enough rows to fit.
pub fn cross_validate(
    rows: &FactoredGroups,
    model: &Model,
    ridge: f64,
    folds: Option<usize>,
) -> Result<CrossValidation, ValidationError> {
    let assigned = match folds {
        Some(folds) => assign_groups(&sizes(rows), folds)?,
        None => (0..rows.groups.len()).map(|group| vec![group]).collect(),
    };
    let folds = parted(rows, assigned)?;
    let mut all = PerAxis::<HeldOutErrors>::default();
    let (mut undetermined, mut reason) = (Vec::new(), None);
    for fold in &folds {
        let errors = fold.rest.solve(model, ridge).map(|solution| fold.held_out.errors(&solution));
        match errors {
            Ok(errors) => {
                let errors = errors.into_iter().flatten();
                all.iter_mut().zip(errors).for_each(|(all, fold)| all.merge(&fold));
            }
            Err(error) => {
                undetermined.extend(fold.groups.iter().map(|&group| rows.groups[group].0.clone()));
                reason = Some(error);
            }
        }
    }
    if let Some(reason) = reason.filter(|_| undetermined.len() == rows.groups.len()) {
        return Err(ValidationError::Rows(Box::new(reason)));
    }
    Ok(CrossValidation {
        groups: rows.groups.len(),
        folds: folds.len(),
        rows: rows.groups.iter().map(|(_, rows)| rows.rows()).sum(),
        undetermined,
        grouped: all.map(|errors| HeldOutQuality { rms: errors.rms(), bias: errors.bias() }),
        random_folds: 0,
        random: None,
    })
}

/// As [`select`](super::selection::select), of the families within the one that was kept.
///
/// # Errors
/// [`ValidationError`] if there are too few groups, or no model can be fitted.
pub fn select(
    rows: &FactoredGroups,
    intercept: bool,
    ridges: &[f64],
) -> Result<Selection, ValidationError> {
    let assigned = assign_groups(&sizes(rows), rows.groups.len().clamp(1, FOLDS));
    let folds = parted(rows, assigned.map_err(|_| too_few(rows))?)?;
    let total = rows.total().ok_or_else(|| too_few(rows))?;
    let model = |basis| Model { basis, intercept, channels: total.channels(), memory: 0 };
    let errors_of = |basis: Basis| -> Result<Option<ErrorsByRidge<'_>>, ValidationError> {
        if !total.has_features_of(&model(basis)) {
            return Ok(None);
        }
        let folds = &folds;
        Ok(Some(Box::new(move |ridge| {
            let errors = |fold: &Fold| {
                let solution = fold.rest.solve(&model(basis), ridge).ok()?;
                fold.held_out.errors(&solution)
            };
            Ok(folds.iter().map(errors).collect())
        })))
    };
    choose(model, ridges, &total.load_variances(), errors_of)
}

fn too_few(rows: &FactoredGroups) -> ValidationError {
    ValidationError::TooFewGroups { found: rows.groups.len() }
}

fn sizes(rows: &FactoredGroups) -> Vec<u64> {
    rows.groups.iter().map(|(_, rows)| rows.rows()).collect()
}

/// The rows of each fold of groups and of all others.
fn parted(rows: &FactoredGroups, assigned: Vec<Vec<usize>>) -> Result<Vec<Fold>, ValidationError> {
    if rows.groups.len() < 2 {
        return Err(too_few(rows));
    }
    let merged = |all: Option<&FactoredRows>, more: &FactoredRows| match all {
        Some(all) => {
            let mut all = all.clone();
            all.merge(more);
            all
        }
        None => more.clone(),
    };
    let of_fold = |groups: &Vec<usize>| {
        let parts = groups.iter().map(|&group| &rows.groups[group].1);
        parts.fold(None, |all: Option<FactoredRows>, part| Some(merged(all.as_ref(), part)))
    };
    let parts: Vec<FactoredRows> = assigned.iter().filter_map(of_fold).collect();
    // What is after each fold, from the last on.
    let mut after: Vec<Option<FactoredRows>> = vec![None];
    for part in parts.iter().skip(1).rev() {
        let last = after.last().and_then(Option::as_ref);
        after.push(Some(last.map_or_else(|| part.clone(), |last| merged(Some(part), last))));
    }
    let mut before: Option<FactoredRows> = None;
    let mut folds = Vec::with_capacity(parts.len());
    for (groups, held_out) in assigned.into_iter().zip(parts) {
        let rest = match (&before, after.pop().flatten()) {
            (None, rest) => rest,
            (Some(before), None) => Some(before.clone()),
            (Some(before), Some(after)) => Some(merged(Some(before), &after)),
        };
        before = Some(merged(before.as_ref(), &held_out));
        folds.push(Fold { groups, held_out, rest: rest.ok_or_else(|| too_few(rows))? });
    }
    Ok(folds)
}
