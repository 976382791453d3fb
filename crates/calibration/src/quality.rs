//! How well a calibration does: errors against a measured wrench, and noise at zero load.
//!
//! Everything is a mean and a sum of squared deviations from it, found block by block in two steps
//! and merged by the formula of Chan, Golub and LeVeque (Amer. Statist. 37, 1983), which cancels
//! nothing: a bias that is large against the noise costs no digits.

use pulp::{Arch, NullaryFnOnce};
use serde::{Deserialize, Serialize};

use shell_data::wrench::PerAxis;

/// Number, mean and spread of a quantity. Merges with that of other rows.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Moments {
    /// Number of values.
    pub count: u64,
    /// Their mean.
    pub mean: f64,
    /// Sum of their squared deviations from the mean.
    pub squares: f64,
}

/// How far predictions are from measurements, on one axis, while it is being summed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AxisErrors {
    error: Moments,
    measured: Moments,
    max: f64,
}

/// How far predictions are from measurements, on one axis, in N or N·m.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct AxisQuality {
    /// Root mean square of the error.
    pub rms: f64,
    /// Largest magnitude of the error; absent where only sums over the rows are left.
    pub max: Option<f64>,
    /// Mean error, predicted less measured.
    pub bias: f64,
    /// Coefficient of determination, 1 − Σ error² / Σ (measured − mean)²; absent where the
    /// measured wrench never changes.
    pub r_squared: Option<f64>,
}

impl Moments {
    /// Of the values in `column`.
    pub fn of(column: &[f64]) -> Self {
        Arch::new().dispatch(MomentsOf(column))
    }

    /// Adds the values of `other`.
    pub fn merge(&mut self, other: &Moments) {
        if other.count == 0 {
            return;
        }
        let (n, m) = (self.count as f64, other.count as f64);
        let difference = other.mean - self.mean;
        self.mean += difference * (m / (n + m));
        self.squares += other.squares + difference * difference * (n * m / (n + m));
        self.count += other.count;
    }

    /// Root mean square deviation from the mean; NaN of no values.
    pub fn rms_about_mean(&self) -> f64 {
        (self.squares / self.count as f64).sqrt()
    }

    /// Root mean square; NaN of no values.
    pub fn rms(&self) -> f64 {
        (self.squares / self.count as f64 + self.mean * self.mean).sqrt()
    }
}

impl AxisErrors {
    /// Of one block: `predicted` and `measured` are as long as each other, N or N·m.
    ///
    /// # Panics
    /// If they are not.
    pub fn of(predicted: &[f64], measured: &[f64]) -> Self {
        Self::with_room(predicted, measured, &mut Vec::new())
    }

    /// The same with room for the errors, which may be used again.
    fn with_room(predicted: &[f64], measured: &[f64], errors: &mut Vec<f64>) -> Self {
        assert_eq!(predicted.len(), measured.len(), "a prediction for every measurement");
        Arch::new().dispatch(ErrorsOf { predicted, measured, errors })
    }

    /// Adds the rows of `other`.
    pub fn merge(&mut self, other: &AxisErrors) {
        self.error.merge(&other.error);
        self.measured.merge(&other.measured);
        self.max = self.max.max(other.max);
    }

    /// Number of rows.
    pub fn rows(&self) -> u64 {
        self.error.count
    }

    /// The figures; `None` of no rows.
    pub fn quality(&self) -> Option<AxisQuality> {
        let Moments { count, mean, squares } = self.error;
        let total = self.measured.squares;
        (count > 0).then(|| AxisQuality {
            rms: self.error.rms(),
            max: Some(self.max),
            bias: mean,
            r_squared: (total > 0.0).then(|| 1.0 - (squares + count as f64 * mean * mean) / total),
        })
    }
}

/// The errors of all axes over one block. Columns are as long as each other, N and N·m.
pub fn errors(predicted: &PerAxis<Vec<f64>>, measured: &[Vec<f64>]) -> PerAxis<AxisErrors> {
    let mut room = Vec::new();
    std::array::from_fn(|axis| AxisErrors::with_room(&predicted[axis], &measured[axis], &mut room))
}

/// Adds the rows of `other` to `all`, axis by axis.
pub fn merge(all: &mut PerAxis<AxisErrors>, other: &PerAxis<AxisErrors>) {
    all.iter_mut().zip(other).for_each(|(all, other)| all.merge(other));
}

/// [`Moments::of`], inlined whole into code for the widest vectors of the machine.
struct MomentsOf<'a>(&'a [f64]);

impl NullaryFnOnce for MomentsOf<'_> {
    type Output = Moments;

    #[inline(always)]
    fn call(self) -> Moments {
        moments(self.0)
    }
}

/// [`AxisErrors::of`], likewise.
struct ErrorsOf<'a> {
    predicted: &'a [f64],
    measured: &'a [f64],
    errors: &'a mut Vec<f64>,
}

impl NullaryFnOnce for ErrorsOf<'_> {
    type Output = AxisErrors;

    #[inline(always)]
    fn call(self) -> AxisErrors {
        let Self { predicted, measured, errors } = self;
        errors.clear();
        errors.extend(predicted.iter().zip(measured).map(|(p, m)| p - m));
        let mut largest = [0.0; LANES];
        for chunk in errors.chunks(LANES) {
            for (largest, error) in largest.iter_mut().zip(chunk) {
                *largest = if error.abs() > *largest { error.abs() } else { *largest };
            }
        }
        AxisErrors {
            error: moments(errors),
            measured: moments(measured),
            max: largest.into_iter().fold(0.0, f64::max),
        }
    }
}

/// Interleaved sums.
const LANES: usize = 16;

#[inline(always)]
fn moments(column: &[f64]) -> Moments {
    if column.is_empty() {
        return Moments::default();
    }
    let n = column.len() as f64;
    // Sums of differences from some value of the column keep a large offset out of them.
    let (origin, sum) = (column[0], sums_about(column, column[0]).0);
    let mean = origin + sum / n;
    let (sum, squares) = sums_about(column, mean);
    let rest = sum / n;
    Moments {
        count: column.len() as u64,
        mean: mean + rest,
        squares: (squares - n * rest * rest).max(0.0),
    }
}

/// The sums of `x − origin` and of its square over a column.
#[inline(always)]
fn sums_about(column: &[f64], origin: f64) -> (f64, f64) {
    let (mut sums, mut squares) = ([0.0; LANES], [0.0; LANES]);
    let (chunks, rest) = column.as_chunks::<LANES>();
    for chunk in chunks {
        for i in 0..LANES {
            let x = chunk[i] - origin;
            sums[i] += x;
            squares[i] += x * x;
        }
    }
    for (i, x) in rest.iter().enumerate() {
        let x = x - origin;
        sums[i] += x;
        squares[i] += x * x;
    }
    (sums.iter().sum(), squares.iter().sum())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_of_a_small_example_worked_by_hand() {
        // Errors 1, −1, 3, 1; measured 0, 2, 4, 6 with Σ(m − 3)² = 20.
        let errors = AxisErrors::of(&[1.0, 1.0, 7.0, 7.0], &[0.0, 2.0, 4.0, 6.0]);
        let quality = errors.quality().unwrap();
        assert_eq!(quality.bias, 1.0);
        assert_eq!(quality.max, Some(3.0));
        assert_eq!(quality.rms, 3f64.sqrt());
        assert_eq!(quality.r_squared, Some(1.0 - 12.0 / 20.0));
    }

    #[test]
    fn a_large_offset_costs_no_digits() {
        // ±1 about 10¹²: variance exactly 1.
        let column: Vec<f64> = (0..1000).map(|i| 1e12 + f64::from(1 - 2 * (i % 2))).collect();
        let mut merged = Moments::default();
        column.chunks(7).for_each(|part| merged.merge(&Moments::of(part)));
        assert_eq!(Moments::of(&column).rms_about_mean(), 1.0);
        // The means of the parts are rounded at 10¹² · 2⁻⁵³ = 1e-4; a sum of squares would be off by
        // 10²⁴ · 2⁻⁵³ = 1e8.
        assert!((merged.rms_about_mean() - 1.0).abs() < 1e-4);
    }

    #[test]
    fn parts_merge_to_the_whole() {
        let column: Vec<f64> = (0..100).map(|i| f64::from(i * i % 37)).collect();
        let whole = Moments::of(&column);
        let mut merged = Moments::default();
        column.chunks(13).for_each(|part| merged.merge(&Moments::of(part)));
        assert_eq!(merged.count, 100);
        // Sums of a hundred terms: 100 · 2⁻⁵³ relative.
        assert!((merged.mean - whole.mean).abs() < 1e-14 * whole.mean);
        assert!((merged.squares - whole.squares).abs() < 1e-13 * whole.squares);
    }

    #[test]
    fn a_wrench_that_never_changes_has_no_r_squared_and_no_rows_have_no_figures() {
        let quality = AxisErrors::of(&[1.0, 2.0], &[5.0, 5.0]).quality().unwrap();
        assert_eq!(quality.r_squared, None);
        assert_eq!(AxisErrors::default().quality(), None);
    }
}
