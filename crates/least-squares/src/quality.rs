//! Errors against a measured wrench, block by block.

use shell_data::statistics::RunningVariance;
use shell_data::vectorised;
use shell_data::wrench::{Axis, PerAxis};

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AxisErrors {
    error: RunningVariance,
    measured: RunningVariance,
    max: f64,
}

/// Prediction errors on one axis, in N or N·m.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct AxisQuality {
    pub rms: f64,
    /// Largest magnitude; absent if only sums over the rows are known.
    pub max: Option<f64>,
    /// Predicted minus measured.
    pub bias: f64,
    /// 1 − Σ error² / Σ (measured − mean)²; absent if the measured wrench is constant.
    pub r_squared: Option<f64>,
}

impl AxisErrors {
    /// Errors of one block, in N or N·m.
    ///
    /// # Panics
    /// If the lengths differ.
    pub fn new(predicted: &[f64], measured: &[f64]) -> Self {
        assert_eq!(predicted.len(), measured.len(), "a prediction for every measurement");
        axis_errors(predicted, measured)
    }

    pub fn merge(&mut self, other: &AxisErrors) {
        self.error.merge(&other.error);
        self.measured.merge(&other.measured);
        self.max = self.max.max(other.max);
    }

    pub fn rows(&self) -> u64 {
        self.error.count
    }

    /// `None` for zero rows.
    pub fn quality(&self) -> Option<AxisQuality> {
        let RunningVariance { count, mean, squares } = self.error;
        let total = self.measured.squares;
        (count > 0).then(|| AxisQuality {
            rms: self.error.rms(),
            max: Some(self.max),
            bias: mean,
            r_squared: (total > 0.0).then(|| 1.0 - (squares + count as f64 * mean * mean) / total),
        })
    }
}

/// The errors of all axes over one block. Columns have the same length, in N and N·m.
pub fn errors(predicted: &PerAxis<Vec<f64>>, measured: &[Vec<f64>]) -> PerAxis<AxisErrors> {
    std::array::from_fn(|axis| AxisErrors::new(&predicted[axis], &measured[axis]))
}

pub fn merge(all: &mut PerAxis<AxisErrors>, other: &PerAxis<AxisErrors>) {
    all.iter_mut().zip(other).for_each(|(all, other)| all.merge(other));
}

/// Formats a value for each axis between its name and its unit: `Fx 0.12 N, Fy 0.1 N`.
pub fn in_units(axes: impl IntoIterator<Item = Axis>, value: impl Fn(usize) -> String) -> String {
    let of = |axis: Axis| format!("{} {} {}", axis.name(), value(axis.index()), axis.unit());
    axes.into_iter().map(of).collect::<Vec<_>>().join(", ")
}

/// Formats `value` with the given number of significant digits, with an exponent if that is shorter.
pub fn significant(value: f64, digits: usize) -> String {
    let magnitude = if value == 0.0 { 0 } else { value.abs().log10().floor() as i32 };
    if !value.is_finite() || !(-4..6).contains(&magnitude) {
        return format!("{value:.*e}", digits.saturating_sub(1));
    }
    let decimals = (digits as i32 - 1 - magnitude).max(0) as usize;
    fixed(value, decimals)
}

/// Formats `value` with the given number of decimals, without a sign if it rounds to zero.
pub fn fixed(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    match text.strip_prefix('-') {
        Some(digits) if !digits.contains(|c: char| ('1'..='9').contains(&c)) => digits.to_owned(),
        _ => text,
    }
}

vectorised! {
    fn axis_errors(predicted: &[f64], measured: &[f64]) -> AxisErrors {
        let errors: Vec<f64> = predicted.iter().zip(measured).map(|(p, m)| p - m).collect();
        let mut largest = [0.0; LANES];
        for chunk in errors.chunks(LANES) {
            for (largest, error) in largest.iter_mut().zip(chunk) {
                *largest = if error.abs() > *largest { error.abs() } else { *largest };
            }
        }
        AxisErrors {
            error: RunningVariance::from_inlined(&errors),
            measured: RunningVariance::from_inlined(measured),
            max: largest.into_iter().fold(0.0, f64::max),
        }
    }
}

const LANES: usize = 16;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_keep_their_significant_digits() {
        let cases = [
            (0.118_234, "0.1182"),
            (12.345_67, "12.35"),
            (123_456.7, "123457"),
            (1.234_56e-5, "1.235e-5"),
            (0.0, "0.000"),
            (2.345e11, "2.345e11"),
        ];
        for (value, expected) in cases {
            assert_eq!(significant(value, 4), expected);
        }
    }

    #[test]
    fn figures_of_a_small_example_computed_from_the_definition() {
        // Errors 1, −1, 3, 1; measured 0, 2, 4, 6 with Σ(m − 3)² = 20.
        let errors = AxisErrors::new(&[1.0, 1.0, 7.0, 7.0], &[0.0, 2.0, 4.0, 6.0]);
        let quality = errors.quality().unwrap();
        assert_eq!(quality.bias, 1.0);
        assert_eq!(quality.max, Some(3.0));
        assert_eq!(quality.rms, 3f64.sqrt());
        assert_eq!(quality.r_squared, Some(1.0 - 12.0 / 20.0));
    }

    #[test]
    fn a_wrench_that_never_changes_has_no_r_squared_and_no_rows_have_no_figures() {
        let quality = AxisErrors::new(&[1.0, 2.0], &[5.0, 5.0]).quality().unwrap();
        assert_eq!(quality.r_squared, None);
        assert_eq!(AxisErrors::default().quality(), None);
    }
}
