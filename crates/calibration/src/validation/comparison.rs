//! Two models compared by their errors on the same groups.
//!
//! Folds that are hard for one model are mostly hard for the other, so the difference is known better
//! than either error (Dietterich, Neural Computation 10, 1998, on paired tests). Its standard error is
//! that of a mean weighted by rows, as in [selection](super::selection).

use crate::exact::HeldOutErrors;
use shell_data::wrench::PerAxis;

/// Squared errors of a model less those of another, on the same held-out rows, relative to the variance
/// of each axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Comparison {
    /// Root mean square errors of both, N and N·m.
    pub rms: [PerAxis<f64>; 2],
    /// The difference of each axis, and its standard error.
    pub axes: PerAxis<Difference>,
    /// That of the mean over the axes.
    pub all: Difference,
}

/// A difference and its standard error.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Difference {
    /// Below zero if the first model errs less.
    pub value: f64,
    /// Its standard error over the folds.
    pub standard_error: f64,
}

impl Difference {
    /// Whether the first model errs less by more than a standard error.
    pub fn first_is_better(&self) -> bool {
        self.value < -self.standard_error
    }
}

impl Comparison {
    /// Of the errors on each fold, in the same order for both models; `variances` are those of the
    /// measured wrench, squares of N and N·m.
    ///
    /// # Panics
    /// If there are not as many folds of either, or fewer than two.
    pub fn new(
        first: &[PerAxis<HeldOutErrors>],
        second: &[PerAxis<HeldOutErrors>],
        variances: &PerAxis<f64>,
    ) -> Self {
        assert!(first.len() == second.len() && first.len() > 1, "two folds or more, of both");
        let varying: Vec<usize> = (0..6).filter(|&axis| variances[axis] > 0.0).collect();
        let relative = |errors: &PerAxis<HeldOutErrors>, axis: usize| {
            errors[axis].squares / errors[axis].rows as f64 / variances[axis]
        };
        let difference = |axes: &[usize]| {
            let of_fold = |(a, b): (&PerAxis<HeldOutErrors>, &PerAxis<HeldOutErrors>)| {
                let sum: f64 = axes.iter().map(|&axis| relative(a, axis) - relative(b, axis)).sum();
                (b[0].rows as f64, sum / axes.len().max(1) as f64)
            };
            mean(&first.iter().zip(second).map(of_fold).collect::<Vec<_>>())
        };
        let rms = [first, second].map(|folds| {
            let mut all = PerAxis::<HeldOutErrors>::default();
            for errors in folds {
                all.iter_mut().zip(errors).for_each(|(all, errors)| all.merge(errors));
            }
            all.map(|errors| errors.rms())
        });
        let axis = |axis: usize| match variances[axis] > 0.0 {
            true => difference(&[axis]),
            false => Difference::default(),
        };
        Self { rms, axes: std::array::from_fn(axis), all: difference(&varying) }
    }
}

/// The weighted mean of values with weights, and its standard error (Cochran, Sampling Techniques, 3rd
/// ed., §6.3, of a ratio).
fn mean(values: &[(f64, f64)]) -> Difference {
    let total: f64 = values.iter().map(|(weight, _)| weight).sum();
    let mean = values.iter().map(|(weight, value)| weight * value).sum::<f64>() / total;
    let spread: f64 =
        values.iter().map(|(weight, value)| (weight / total * (value - mean)).powi(2)).sum();
    let n = values.len() as f64;
    Difference { value: mean, standard_error: (spread * n / (n - 1.0)).sqrt() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn with_folds_of_one_size_it_is_the_paired_mean_and_its_standard_error() {
        let fold = |square: f64| [HeldOutErrors { rows: 10, sum: 0.0, squares: 10.0 * square }; 6];
        let (first, second) = ([1.0, 5.0, 3.0].map(fold), [2.0, 8.0, 5.0].map(fold));
        let found = Comparison::new(&first, &second, &[2.0; 6]);
        // Differences −1, −3 and −2 over a variance of 2: mean −1, s = 0.5, over √3.
        assert!((found.all.value + 1.0).abs() < 1e-15);
        assert!((found.all.standard_error - 0.5 / 3f64.sqrt()).abs() < 1e-15);
        assert!(found.all.first_is_better() && found.axes[3] == found.all);
        assert!((found.rms[0][0] - 3f64.sqrt()).abs() < 1e-15);
    }
}
