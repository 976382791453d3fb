//! Errors on groups that were not trained on, beside those on rows that were held out at random.

use super::grouped::SumsByGroup;
use crate::error::FitError;
use crate::exact::{ExactSums, PartitionedSums};
use crate::held_out_errors::{COVERAGE_LEVEL, HeldOutErrors};
use crate::model::Model;
use crate::uncertainty::student_quantile;
use shell_data::wrench::{Axis, PerAxis};

/// How many times the error of a random split the error on new groups may be before it is worth a word
/// that rows of a group resemble each other.
pub const SUSPICIOUS_RATIO: f64 = 2.0;

/// Errors on rows that were held out, on one axis, N or N·m.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct HeldOutQuality {
    /// Root mean square.
    pub rms: f64,
    /// Mean, predicted less measured.
    pub bias: f64,
}

impl From<HeldOutErrors> for HeldOutQuality {
    fn from(errors: HeldOutErrors) -> Self {
        Self { rms: errors.rms(), bias: errors.bias() }
    }
}

/// What cross-validation has found. Errors are over all rows that were held out, each once.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct CrossValidation {
    /// Groups of rows.
    pub groups: usize,
    /// Folds of groups, each held out once: as many as groups where one is left out at a time.
    pub folds: usize,
    /// Rows.
    pub rows: u64,
    /// The groups without which the model cannot be fitted; they are not in `grouped`.
    pub undetermined: Vec<String>,
    /// Errors on groups that were not trained on.
    #[serde(with = "shell_data::by_axis")]
    pub grouped: PerAxis<HeldOutQuality>,
    /// Parts of the rows that were drawn at random and held out in turn; 0 if there were none.
    pub random_folds: usize,
    /// Errors on rows that were held out at random; `None` if that was not asked for, or not
    /// possible.
    #[serde(with = "shell_data::by_axis::option")]
    pub random: Option<PerAxis<HeldOutQuality>>,
    /// Errors on each fold; no part of a document.
    #[serde(skip)]
    pub by_fold: Vec<PerAxis<HeldOutErrors>>,
}

impl CrossValidation {
    /// From the errors on folds of so many groups and rows, each with the labels of its groups.
    ///
    /// # Errors
    /// That of a fold, if no row could be held out.
    pub fn from_folds(
        (groups, rows): (usize, u64),
        folds: impl ExactSizeIterator<Item = (Vec<String>, Result<PerAxis<HeldOutErrors>, FitError>)>,
    ) -> Result<Self, FitError> {
        let count = folds.len();
        let (mut known, mut undetermined, mut reason) = (Vec::new(), Vec::new(), None);
        for (labels, errors) in folds {
            match errors {
                Ok(errors) => known.push(errors),
                Err(error) => {
                    undetermined.extend(labels);
                    reason = Some(error);
                }
            }
        }
        let total = HeldOutErrors::total(&known);
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

    /// The same beside the errors on so many folds of rows that were drawn at random, where they are known.
    pub fn beside_random(
        self,
        random_folds: usize,
        errors: Option<Vec<PerAxis<HeldOutErrors>>>,
    ) -> Self {
        let errors = errors.filter(|errors| !errors.is_empty());
        let random = errors.map(|errors| HeldOutErrors::total(&errors).map(HeldOutQuality::from));
        Self { random_folds, random, ..self }
    }

    /// The same as a document has it.
    #[must_use]
    pub fn without_folds(self) -> Self {
        Self { by_fold: Vec::new(), ..self }
    }

    /// How many times its error that of a new fold may be, with 95 % probability, from the scatter between so many folds;
    /// `None` of one.
    pub fn spread(&self) -> Option<PerAxis<f64>> {
        let n = self.by_fold.len() as f64;
        if n < 2.0 {
            return None;
        }
        let t = student_quantile(COVERAGE_LEVEL, n - 1.0);
        Some(std::array::from_fn(|axis| {
            let squares: Vec<f64> =
                self.by_fold.iter().map(|fold| fold[axis].rms().powi(2)).collect();
            let mean = squares.iter().sum::<f64>() / n;
            let scatter = squares.iter().map(|of| (of - mean).powi(2)).sum::<f64>() / (n - 1.0);
            let above = t * (scatter * (1.0 + 1.0 / n)).sqrt();
            if mean > 0.0 { ((mean + above) / mean).sqrt() } else { 1.0 }
        }))
    }

    /// For each axis how many times the random error the grouped one is; `None` where there is
    /// no random error to compare with.
    pub fn ratios(&self) -> PerAxis<Option<f64>> {
        std::array::from_fn(|axis| {
            let random = self.random?[axis].rms;
            (random > 0.0).then(|| self.grouped[axis].rms / random)
        })
    }

    /// The axis with the largest ratio and that ratio, if it is more than [`SUSPICIOUS_RATIO`].
    pub fn suspicious(&self) -> Option<(Axis, f64)> {
        let ratios = self.ratios();
        let known = Axis::ALL.iter().filter_map(|&axis| Some((axis, ratios[axis.index()]?)));
        known.max_by(|a, b| a.1.total_cmp(&b.1)).filter(|&(_, ratio)| ratio > SUSPICIOUS_RATIO)
    }
}

/// Fits `model` without each group, or without each of `folds` folds of groups, and finds the
/// errors there; the same with the rows that were assigned at random.
///
/// Folds are filled with the largest groups first, each into the fold with the fewest rows. `ridge`
/// is as in [`ExactSums::solve`].
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

/// The labels of some of `groups`.
pub fn labels_of<T>(groups: &[(String, T)], positions: &[usize]) -> Vec<String> {
    positions.iter().map(|&group| groups[group].0.clone()).collect()
}

/// The errors on some of the rows of a fit to all others.
pub fn errors_on(
    parts: &PartitionedSums<'_>,
    held_out: &ExactSums,
    ridge: f64,
) -> Result<PerAxis<HeldOutErrors>, FitError> {
    parts.held_out(held_out, &parts.part(held_out), ridge)
}

/// The rows of each group.
pub fn sizes(sums: &SumsByGroup) -> Vec<u64> {
    sums.groups.iter().map(|(_, moments)| moments.rows()).collect()
}

/// Groups of so many rows in so many folds, or each alone.
pub(super) fn assign_to_folds(
    rows: &[u64],
    folds: Option<usize>,
) -> Result<Vec<Vec<usize>>, FitError> {
    match folds {
        Some(folds) => assign_groups(rows, folds),
        None => Ok((0..rows.len()).map(|group| vec![group]).collect()),
    }
}

/// Groups of so many rows, by their positions, assigned to folds of about the same number of rows: the largest
/// first, each into the fold with the fewest.
///
/// # Errors
/// [`FitError::Folds`] unless there are two folds to as many as groups.
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
