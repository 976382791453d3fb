//! Cross-validation on groups, with rows that are held out at random for comparison.

use std::collections::HashMap;

use super::grouped::SumsByGroup;
use crate::error::FitError;
use crate::exact::{ExactSums, PartitionedSums};
use crate::held_out_errors::{COVERAGE_LEVEL, HeldOutErrors};
use crate::model::Model;
use crate::uncertainty::student_quantile;
use shell_data::wrench::{Axis, PerAxis};

/// Ratio of the error on new groups to that of a random split above which rows in groups are suspiciously similar.
pub const SUSPICIOUS_RATIO: f64 = 2.0;

/// Errors on held-out rows, on one axis, in N or N·m.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct HeldOutQuality {
    pub rms: f64,
    /// Mean error, predicted minus measured.
    pub bias: f64,
}

impl From<HeldOutErrors> for HeldOutQuality {
    fn from(errors: HeldOutErrors) -> Self {
        Self { rms: errors.rms(), bias: errors.bias() }
    }
}

/// Errors, on the groups of a fold, of a fit without that fold.
#[derive(Clone, Debug, PartialEq)]
pub struct FoldErrors {
    /// Labels of the groups of the fold.
    pub labels: Vec<String>,
    pub errors: PerAxis<HeldOutErrors>,
}

/// Errors over all held-out rows, each counted once.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct CrossValidation {
    pub groups: usize,
    /// Number of folds, each held out once; equal to `groups` in leave-one-group-out.
    pub folds: usize,
    pub rows: u64,
    /// Groups without which the model cannot be fitted; `grouped` excludes them.
    pub undetermined: Vec<String>,
    #[serde(with = "shell_data::by_axis")]
    pub grouped: PerAxis<HeldOutQuality>,
    /// Number of random parts of the rows, held out in turn; 0 without any.
    pub random_folds: usize,
    /// Errors on rows held out at random; `None` if not requested or not possible.
    #[serde(with = "shell_data::by_axis::option")]
    pub random: Option<PerAxis<HeldOutQuality>>,
    /// Not stored in documents.
    #[serde(skip)]
    pub by_fold: Vec<FoldErrors>,
}

impl CrossValidation {
    /// Errors on the groups by label, if each was held out alone; empty otherwise.
    pub fn errors_alone(&self) -> HashMap<&str, &PerAxis<HeldOutErrors>> {
        let alone = self.by_fold.iter().map(|fold| match &fold.labels[..] {
            [label] => Some((label.as_str(), &fold.errors)),
            _ => None,
        });
        alone.collect::<Option<_>>().unwrap_or_default()
    }

    /// Combines the errors on folds, with the labels of their groups, and the numbers of groups and rows.
    ///
    /// # Errors
    /// The error of a fold, if no fold could be held out.
    pub fn from_folds(
        (groups, rows): (usize, u64),
        folds: impl ExactSizeIterator<Item = (Vec<String>, Result<PerAxis<HeldOutErrors>, FitError>)>,
    ) -> Result<Self, FitError> {
        let count = folds.len();
        let (mut known, mut undetermined, mut reason) = (Vec::new(), Vec::new(), None);
        for (labels, errors) in folds {
            match errors {
                Ok(errors) => known.push(FoldErrors { labels, errors }),
                Err(error) => {
                    undetermined.extend(labels);
                    reason = Some(error);
                }
            }
        }
        let total = HeldOutErrors::total(known.iter().map(|fold| &fold.errors));
        match reason.filter(|_| total[0].rows == 0) {
            Some(reason) => Err(reason),
            None => Ok(Self {
                groups,
                folds: count,
                rows,
                undetermined,
                grouped: total.map(HeldOutQuality::from),
                random_folds: 0,
                random: None,
                by_fold: known,
            }),
        }
    }

    pub fn beside_random(
        self,
        random_folds: usize,
        errors: Option<Vec<PerAxis<HeldOutErrors>>>,
    ) -> Self {
        let errors = errors.filter(|errors| !errors.is_empty());
        let random = errors.map(|errors| HeldOutErrors::total(&errors).map(HeldOutQuality::from));
        Self { random_folds, random, ..self }
    }

    #[must_use]
    pub fn without_folds(self) -> Self {
        Self { by_fold: Vec::new(), ..self }
    }

    /// Upper end of the 95 % interval of the errors of a new fold, relative to the mean error, from the scatter of
    /// folds; `None` for a single fold.
    pub fn spread(&self) -> Option<PerAxis<f64>> {
        let n = self.by_fold.len() as f64;
        if n < 2.0 {
            return None;
        }
        let t = student_quantile(COVERAGE_LEVEL, n - 1.0);
        Some(std::array::from_fn(|axis| {
            let square = |fold: &FoldErrors| fold.errors[axis].rms().powi(2);
            let squares: Vec<f64> = self.by_fold.iter().map(square).collect();
            let mean = squares.iter().sum::<f64>() / n;
            let scatter = squares.iter().map(|of| (of - mean).powi(2)).sum::<f64>() / (n - 1.0);
            let above = t * (scatter * (1.0 + 1.0 / n)).sqrt();
            if mean > 0.0 { ((mean + above) / mean).sqrt() } else { 1.0 }
        }))
    }

    /// Grouped error over random error; `None` without a random error.
    pub fn ratios(&self) -> PerAxis<Option<f64>> {
        std::array::from_fn(|axis| {
            let random = self.random?[axis].rms;
            (random > 0.0).then(|| self.grouped[axis].rms / random)
        })
    }

    /// Axis with the largest ratio, if it exceeds [`SUSPICIOUS_RATIO`].
    pub fn suspicious(&self) -> Option<(Axis, f64)> {
        let ratios = self.ratios();
        let known = Axis::ALL.iter().filter_map(|&axis| Some((axis, ratios[axis.index()]?)));
        known.max_by(|a, b| a.1.total_cmp(&b.1)).filter(|&(_, ratio)| ratio > SUSPICIOUS_RATIO)
    }
}

/// Fits `model` without each group, or each of `folds` folds of groups (see [`assign_groups`]), and without random
/// rows, and computes the errors on what is left out. `ridge` is as in [`ExactSums::solve`].
///
/// # Errors
/// [`FitError`] if there are too few groups, or no fold leaves enough rows to fit.
pub fn cross_validate(
    sums: &SumsByGroup,
    model: &Model,
    ridge: f64,
    folds: Option<usize>,
) -> Result<CrossValidation, FitError> {
    let parts = sums.partitioned(model)?;
    let folds = assign_to_folds(&sizes(sums), folds)?;
    let on_fold = |fold: &Vec<usize>| {
        (labels_of(&sums.groups, fold), errors_on(&parts, &sums.of_fold(fold), ridge))
    };
    let of_all = (sums.group_count, parts.total.rows());
    let found = CrossValidation::from_folds(of_all, folds.iter().map(on_fold));
    let with_rows = sums.random.iter().filter(|moments| moments.rows() > 0);
    let at_random = with_rows.map(|part| errors_on(&parts, part, ridge).ok());
    Ok(found
        .map_err(|error| FitError::Undetermined(Box::new(error)))?
        .beside_random(sums.random.len(), at_random.collect()))
}

pub fn labels_of<T>(groups: &[(String, T)], positions: &[usize]) -> Vec<String> {
    positions.iter().map(|&group| groups[group].0.clone()).collect()
}

pub fn errors_on(
    parts: &PartitionedSums<'_>,
    held_out: &ExactSums,
    ridge: f64,
) -> Result<PerAxis<HeldOutErrors>, FitError> {
    parts.held_out(held_out, &parts.part(held_out), ridge)
}

pub fn sizes(sums: &SumsByGroup) -> Vec<u64> {
    sums.groups.iter().map(|(_, moments)| moments.rows()).collect()
}

/// Assigns groups with these numbers of rows to folds; each group alone if `folds` is `None`.
pub(super) fn assign_to_folds(
    rows: &[u64],
    folds: Option<usize>,
) -> Result<Vec<Vec<usize>>, FitError> {
    match folds {
        Some(folds) => assign_groups(rows, folds),
        None => Ok((0..rows.len()).map(|group| vec![group]).collect()),
    }
}

/// Assigns groups with these numbers of rows to even folds: largest first, each to the fold with fewest rows.
///
/// # Errors
/// [`FitError::Folds`] unless there are at least two folds and at most as many as groups.
pub fn assign_groups(rows: &[u64], folds: usize) -> Result<Vec<Vec<usize>>, FitError> {
    let groups = rows.len();
    if !(2..=groups).contains(&folds) {
        return Err(FitError::Folds { folds, groups });
    }
    let mut order: Vec<usize> = (0..groups).collect();
    order.sort_unstable_by_key(|&group| (std::cmp::Reverse(rows[group]), group));
    let mut assigned = vec![(0, Vec::new()); folds];
    for group in order {
        let (of_fold, fold) = (assigned.iter_mut())
            .min_by_key(|(rows, fold)| (*rows, fold.len()))
            .map(|(rows, fold)| (rows, fold))
            .expect("two folds or more");
        *of_fold += rows[group];
        fold.push(group);
    }
    Ok(assigned.into_iter().map(|(_, fold)| fold).collect())
}
