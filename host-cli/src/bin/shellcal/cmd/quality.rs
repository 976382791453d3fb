//! How the errors of a calibration are printed, by `fit` and `eval` alike.

use calibration::quality::AxisQuality;
use shell_data::wrench::{Axis, PerAxis};

/// One row of the table: RMS, max and R² of every set side by side, and the unit.
pub(super) fn table_row(axis: Axis, sets: &[&PerAxis<AxisQuality>]) -> Vec<String> {
    let figures: [fn(&AxisQuality) -> String; 3] = [
        |quality| significant(quality.rms, 4),
        |quality| quality.max.map_or("–".to_owned(), |max| significant(max, 4)),
        |quality| quality.r_squared.map_or("–".to_owned(), r_squared),
    ];
    let mut row = vec![axis.name().to_owned()];
    for figure in figures {
        row.extend(sets.iter().map(|set| figure(&set[axis.index()])));
    }
    row.push(axis.unit().to_owned());
    row
}

/// `value` with so many significant digits, with an exponent where that is shorter to read.
pub(super) fn significant(value: f64, digits: usize) -> String {
    let magnitude = if value == 0.0 { 0 } else { value.abs().log10().floor() as i32 };
    if !value.is_finite() || !(-4..6).contains(&magnitude) {
        return format!("{value:.*e}", digits.saturating_sub(1));
    }
    let decimals = (digits as i32 - 1 - magnitude).max(0) as usize;
    format!("{value:.decimals$}")
}

/// R² down to the digit that tells it from 1.
fn r_squared(value: f64) -> String {
    if value < 0.9999 { format!("{value:.4}") } else { format!("{value:.7}") }
}

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
}
