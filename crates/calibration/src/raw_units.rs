//! The coefficients of a calibration for the powers of raw readings.
//!
//! This is the form in which labs exchange calibrations: no centre, no scale, counts in. The
//! products of shifted readings are multiplied out in double-double arithmetic, so that only the
//! last rounding of each coefficient is left. For prediction the shifted form is the better one;
//! the raw form can lose digits where its terms cancel, which is why it is an export.

use std::collections::HashMap;

use super::model::Term;
use super::polynomial::Polynomial;
use crate::double_double::DoubleDouble;
use shell_data::wrench::PerAxis;

/// One row per [term](super::Model::terms), in N and N·m per product of counts.
///
/// A feature is `Π (sᵢ − cᵢ)/kᵢ` over its factors; choosing `sᵢ` or `−cᵢ` from each gives the raw
/// terms it contributes to.
pub fn coefficients(polynomial: &Polynomial) -> Vec<PerAxis<f64>> {
    let terms = polynomial.model().terms();
    let scaling = polynomial.scaling();
    let position: HashMap<Term, usize> = terms.iter().copied().zip(0..).collect();
    let mut raw = vec![PerAxis::<DoubleDouble>::default(); terms.len()];
    for (term, coefficients) in terms.iter().zip(polynomial.coefficients()) {
        let factors = term.factors();
        // Scales are powers of two: dividing by them is exact.
        let scale: f64 = factors.iter().map(|&c| scaling.scale[usize::from(c)]).product();
        for chosen in 0..1_u32 << factors.len() {
            let is_chosen = |i: &usize| chosen & (1 << i) != 0;
            let (kept, shifted): (Vec<usize>, Vec<usize>) = (0..factors.len()).partition(is_chosen);
            let weight = shifted
                .iter()
                .map(|&i| DoubleDouble::from(-scaling.centre[usize::from(factors[i])]))
                .fold(DoubleDouble::ONE, |product, shift| product * shift);
            if weight == DoubleDouble::ZERO {
                continue;
            }
            let kept: Vec<u8> = kept.into_iter().map(|i| factors[i]).collect();
            let target = position[&Term::product(&kept)];
            for (sum, &c) in raw[target].iter_mut().zip(coefficients) {
                *sum += weight * DoubleDouble::from(c / scale);
            }
        }
    }
    raw.into_iter().map(|row| row.map(DoubleDouble::to_f64)).collect()
}

#[cfg(test)]
mod tests {
    use super::super::conversion::Calibration;
    use super::super::model::{Basis, Model};
    use super::super::scaling::Scaling;
    use super::*;

    #[test]
    fn raw_coefficients_give_the_same_wrench_to_rounding_of_the_largest_term() {
        for basis in Basis::ALL {
            let model = Model { basis, intercept: true, channels: 8, memory: 0 };
            let terms = model.terms();
            let scaling = Scaling {
                centre: (0..8).map(|i| f64::from(1200 + 100 * i)).collect(),
                scale: vec![512.0; 8],
            };
            let coefficients = (0..terms.len())
                .map(|j| std::array::from_fn(|axis| ((j * 37 + axis * 11) as f64).sin()))
                .collect();
            let calibration = Calibration::new(model, scaling, coefficients);
            let raw = super::coefficients(calibration.polynomial().unwrap());
            let readings: Vec<Vec<f64>> = (0..8)
                .map(|c| (0..50).map(|row| f64::from((row * 619 + c * 257) % 4096)).collect())
                .collect();
            let mut wrench = PerAxis::default();
            calibration.wrench(&readings, &mut wrench);
            for row in 0..50 {
                for axis in 0..6 {
                    let value = |(term, c): (&Term, &PerAxis<f64>)| {
                        let s = |&c: &u8| readings[usize::from(c)][row];
                        c[axis] * term.factors().iter().map(s).product::<f64>()
                    };
                    let values: Vec<f64> = terms.iter().zip(&raw).map(value).collect();
                    let largest = values.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
                    // 165 terms, each rounded a few times at 2⁻⁵³ of the largest.
                    let difference = values.iter().sum::<f64>() - wrench[axis][row];
                    assert!(difference.abs() < 1e-13 * largest, "{basis:?} {difference} {largest}");
                }
            }
        }
    }

    #[test]
    fn a_calibration_that_is_raw_already_stays_as_it_is() {
        let model = Model { basis: Basis::Cubic, intercept: false, channels: 2, memory: 0 };
        let coefficients: Vec<PerAxis<f64>> = (1..=6).map(|j| [0.1 * f64::from(j); 6]).collect();
        let polynomial = Polynomial::new(model, Scaling::identity(2), coefficients.clone());
        assert_eq!(super::coefficients(&polynomial), coefficients);
    }
}
