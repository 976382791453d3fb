//! Comparison of two models by their errors on the same groups.
//!
//! Folds that are hard for one model are mostly hard for the other, so the difference is known better than either error
//! (Dietterich, Neural Computation 10, 1998, on paired tests). The measure is the ratio of root mean square errors,
//! averaged over folds by rows: the hardest fold would dominate a mean of squared errors.

use std::fmt;

use crate::held_out_errors::HeldOutErrors;
use crate::quality::significant;
use shell_data::wrench::PerAxis;

/// Error, relative to the standard deviation of the loads, that is added to all errors: smaller ones are rounding.
const NO_ERROR: f64 = 1e-8;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Comparison {
    /// Root mean square errors of both models over all rows, in N and N·m.
    pub rms: [PerAxis<f64>; 2],
    /// Mean logarithm of the error ratio on each axis.
    pub axes: PerAxis<FoldMean>,
    /// Geometric mean over the axes.
    pub all: FoldMean,
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FoldMean {
    /// Mean over the folds, weighted by their rows.
    pub value: f64,
    pub standard_error: f64,
}

impl FoldMean {
    /// Mean from the rows and the value of each fold (Cochran, Sampling Techniques, 3rd ed., §6.3, for a ratio).
    pub fn new(folds: &[(u64, f64)]) -> Self {
        let total: f64 = folds.iter().map(|(rows, _)| *rows as f64).sum();
        let share = |rows: u64| rows as f64 / total;
        let value = folds.iter().map(|&(rows, value)| share(rows) * value).sum::<f64>();
        let spread: f64 =
            folds.iter().map(|&(rows, of)| (share(rows) * (of - value)).powi(2)).sum();
        let n = folds.len() as f64;
        Self { value, standard_error: (spread * n / (n - 1.0)).sqrt() }
    }

    /// Returns true if the first error is smaller by more than a standard error of the log ratio.
    pub fn first_is_better(self) -> bool {
        self.value < -self.standard_error
    }

    /// Returns true if the second error is smaller by more than a standard error of the log ratio.
    pub fn second_is_better(self) -> bool {
        self.value > self.standard_error
    }

    /// Log ratio with the models exchanged.
    #[must_use]
    pub fn reversed(self) -> Self {
        Self { value: -self.value, ..self }
    }
}

/// Formats a log ratio as the percentage by which the error of the first model is smaller or larger.
impl fmt::Display for FoldMean {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ratio = libm::exp(self.value);
        let (percent, error) = (100.0 * (ratio - 1.0), 100.0 * ratio * self.standard_error);
        let side = if percent > 0.0 { "more" } else { "less" };
        write!(f, "{} ± {} % {side}", significant(percent.abs(), 2), significant(error, 2))
    }
}

impl Comparison {
    /// Compares errors on the same folds in the same order. `variances` of the measured wrench are in N² and (N·m)².
    ///
    /// # Panics
    /// If the numbers of folds differ, or are below two.
    pub fn new(
        first: &[PerAxis<HeldOutErrors>],
        second: &[PerAxis<HeldOutErrors>],
        variances: &PerAxis<f64>,
    ) -> Self {
        assert!(first.len() == second.len() && first.len() > 1, "two folds or more, of both");
        let [of_first, of_second] =
            [first, second].map(|folds| RelativeErrors::new(folds, variances));
        let ratio = |axes: &[usize]| of_first.log_ratio(&of_second, axes);
        let rms = [first, second].map(|folds| HeldOutErrors::total(folds).map(|of| of.rms()));
        let axis = |axis: usize| match variances[axis] > 0.0 {
            true => ratio(&[axis]),
            false => FoldMean::default(),
        };
        Self { rms, axes: std::array::from_fn(axis), all: ratio(&varying(variances)) }
    }
}

pub(super) fn varying(variances: &PerAxis<f64>) -> Vec<usize> {
    (0..6).filter(|&axis| variances[axis] > 0.0).collect()
}

/// Errors on folds, relative to the standard deviation of the loads.
pub(super) struct RelativeErrors {
    folds: Vec<(u64, PerAxis<f64>)>,
    means: PerAxis<f64>,
}

impl RelativeErrors {
    pub(super) fn new(folds: &[PerAxis<HeldOutErrors>], variances: &PerAxis<f64>) -> Self {
        let relative = |fold: &PerAxis<HeldOutErrors>| {
            let error = |axis: usize| fold[axis].rms() / variances[axis].sqrt() + NO_ERROR;
            (fold[0].rows, std::array::from_fn(error))
        };
        let folds: Vec<(u64, PerAxis<f64>)> = folds.iter().map(relative).collect();
        let mean = |axis: usize| {
            FoldMean::new(&folds.iter().map(|(rows, of)| (*rows, of[axis])).collect::<Vec<_>>())
                .value
        };
        Self { means: std::array::from_fn(mean), folds }
    }

    /// Logarithm of the mean error over the folds, averaged over `axes`, and its standard error.
    pub(super) fn log(&self, axes: &[usize]) -> FoldMean {
        FoldMean { value: self.log_mean(axes), ..FoldMean::new(&self.shares(axes)) }
    }

    fn log_ratio(&self, other: &Self, axes: &[usize]) -> FoldMean {
        let (own, others) = (self.shares(axes), other.shares(axes));
        let apart = own.iter().zip(&others).map(|((rows, own), (_, other))| (*rows, own - other));
        let value = self.log_mean(axes) - other.log_mean(axes);
        FoldMean { value, ..FoldMean::new(&apart.collect::<Vec<_>>()) }
    }

    fn log_mean(&self, axes: &[usize]) -> f64 {
        axes.iter().map(|&axis| libm::log(self.means[axis])).sum::<f64>() / axes.len().max(1) as f64
    }

    /// Error on each fold relative to the mean over folds, averaged over some axes.
    fn shares(&self, axes: &[usize]) -> Vec<(u64, f64)> {
        let share = |(rows, errors): &(u64, PerAxis<f64>)| {
            let of = axes.iter().map(|&axis| errors[axis] / self.means[axis]);
            (*rows, of.sum::<f64>() / axes.len().max(1) as f64)
        };
        self.folds.iter().map(share).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fold(square: f64) -> PerAxis<HeldOutErrors> {
        [HeldOutErrors { rows: 10, sum: 0.0, squares: 10.0 * square }; 6]
    }

    #[test]
    fn equal_folds_give_the_ratio_of_two_means_and_its_standard_error() {
        let (first, second) = ([1.0, 4.0, 9.0].map(fold), [4.0, 16.0, 9.0].map(fold));
        let found = Comparison::new(&first, &second, &[4.0; 6]);
        // Means 2 and 3; 1/2 − 2/3, 2/2 − 4/3 and 3/2 − 3/3 are −1/6, −1/3 and 1/2: s = 0.441, over √3.
        let FoldMean { value, standard_error } = found.all;
        assert!((value - (2.0_f64 / 3.0).ln()).abs() < 1e-7);
        assert!((standard_error - (7.0_f64 / 36.0 / 3.0).sqrt()).abs() < 1e-7);
        assert!(found.all.first_is_better() && !found.all.second_is_better());
        assert!((found.axes[3].value - value).abs() < 1e-14);
        assert_eq!(found.all.to_string(), "33 ± 17 % less");
        assert_eq!(found.all.reversed().to_string(), "50 ± 38 % more");
        assert!((found.rms[0][0] - (14.0 / 3.0_f64).sqrt()).abs() < 1e-15);
    }

    #[test]
    fn a_model_that_is_better_on_all_folds_but_the_hardest_is_better() {
        let first = [0.8, 0.7, 0.8, 0.7, 0.8, 0.7, 0.8, 6.2].map(fold);
        let second = [1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 5.0].map(fold);
        assert!(Comparison::new(&first, &second, &[1e4; 6]).all.first_is_better());
        // The hard fold offsets the others: no significant difference.
        let second = [1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 2.0].map(fold);
        let found = Comparison::new(&first, &second, &[1e4; 6]).all;
        assert!(!found.first_is_better() && !found.second_is_better(), "{found:?}");
    }

    #[test]
    fn errors_that_are_rounding_are_alike() {
        let found = Comparison::new(&[fold(1e-24); 3], &[fold(0.0); 3], &[1.0; 6]);
        assert!(found.all.value.abs() < 1e-3, "{:?}", found.all);
    }
}
