use std::collections::HashMap;

use crate::double_double::DoubleDouble;
use crate::features::{Features, LANES};
use crate::model::{Model, Term};
use crate::scaling::Scaling;
use crate::solution::Solution;
use shell_data::vectorised;
use shell_data::wrench::PerAxis;

#[derive(Clone, Debug, PartialEq)]
pub struct Polynomial {
    pub features: Features,
    /// One row per [term](Model::terms), in N and N·m per unit of the feature of standardised readings.
    pub coefficients: Vec<PerAxis<f64>>,
}

impl Polynomial {
    /// Takes coefficients for standardised readings, one row per [term](Model::terms), in N and N·m per feature.
    ///
    /// # Panics
    /// If the numbers of coefficients and terms, or of scalings and channels, differ.
    pub fn new(model: Model, scaling: Scaling, coefficients: Vec<PerAxis<f64>>) -> Self {
        let features = Features::new(model, scaling);
        assert_eq!(coefficients.len(), features.len(), "one row of coefficients per term");
        Self { features, coefficients }
    }

    pub fn model(&self) -> Model {
        self.features.model
    }

    pub fn scaling(&self) -> &Scaling {
        &self.features.scaling
    }

    /// Coefficients for powers of raw readings: one row per [term](Model::terms), in N and N·m per product of counts.
    /// Labs exchange calibrations in this form, without centre or scale; it can lose digits where terms cancel, so
    /// use the shifted form for prediction. Products `Π (sᵢ − cᵢ)/kᵢ` are expanded in double-double, so each
    /// coefficient is rounded only once.
    pub fn raw_coefficients(&self) -> Vec<PerAxis<f64>> {
        let terms = self.model().terms();
        let scaling = self.scaling();
        let position: HashMap<Term, usize> = terms.iter().copied().zip(0..).collect();
        let mut raw = vec![PerAxis::<DoubleDouble>::default(); terms.len()];
        for (term, coefficients) in terms.iter().zip(&self.coefficients) {
            let factors = term.factors();
            // Scales are powers of two, so the division is exact.
            let scale: f64 = factors.iter().map(|&c| scaling.scale[usize::from(c)]).product();
            for chosen in 0..1_u32 << factors.len() {
                let is_chosen = |i: &usize| chosen & (1 << i) != 0;
                let (kept, shifted): (Vec<usize>, Vec<usize>) =
                    (0..factors.len()).partition(is_chosen);
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

    /// Computes the wrench of the first `rows` rows, with fused multiply-adds: the bits are the same on any machine.
    pub fn wrench(&self, readings: &[Vec<f64>], rows: usize, wrench: &mut PerAxis<Vec<f64>>) {
        wrench.iter_mut().for_each(|axis| axis.resize(rows, 0.0));
        convert(self, readings, rows, wrench);
    }
}

impl From<&Solution> for Polynomial {
    fn from(solution: &Solution) -> Self {
        let c = &solution.coefficients;
        let rows = (0..c.nrows()).map(|j| std::array::from_fn(|axis| c[(j, axis)])).collect();
        Self::new(solution.model, solution.scaling.clone(), rows)
    }
}

vectorised! {
    fn convert<S: Simd>(
        simd: S,
        polynomial: &Polynomial,
        readings: &[Vec<f64>],
        rows: usize,
        wrench: &mut PerAxis<Vec<f64>>,
    ) {
        let mut features = vec![[0.0; LANES]; polynomial.features.len()];
        for start in (0..rows).step_by(LANES) {
            polynomial.features.lanes(readings, start, &mut features);
            let mut sums = [[0.0; LANES]; 6];
            // Two vectors of rows at a time: their twelve sums fit in registers and hide the latency of additions.
            for vector in (0..LANES / S::F64_LANES).step_by(2) {
                let mut vectors = [[simd.splat_f64s(0.0); 2]; 6];
                for (feature, coefficients) in features.iter().zip(&polynomial.coefficients) {
                    let feature = S::as_simd_f64s(feature).0;
                    let x = [feature[vector], feature[vector + 1]];
                    for (sums, &c) in vectors.iter_mut().zip(coefficients) {
                        let c = simd.splat_f64s(c);
                        *sums = [0, 1].map(|i| simd.mul_add_f64s(x[i], c, sums[i]));
                    }
                }
                for (lanes, sums) in sums.iter_mut().zip(vectors) {
                    S::as_mut_simd_f64s(lanes).0[vector..vector + 2].copy_from_slice(&sums);
                }
            }
            for (axis, sums) in wrench.iter_mut().zip(&sums) {
                match axis[start..].first_chunk_mut() {
                    Some(lanes) => *lanes = *sums,
                    None => axis[start..].copy_from_slice(&sums[..rows - start]),
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Basis;

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
            let polynomial = Polynomial::new(model, scaling, coefficients);
            let raw = polynomial.raw_coefficients();
            let readings: Vec<Vec<f64>> = (0..8)
                .map(|c| (0..50).map(|row| f64::from((row * 619 + c * 257) % 4096)).collect())
                .collect();
            let mut wrench = PerAxis::default();
            polynomial.wrench(&readings, 50, &mut wrench);
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
        assert_eq!(polynomial.raw_coefficients(), coefficients);
    }
}
