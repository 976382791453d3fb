//! Wrenches as sums of features of the readings.

use super::features::{Features, LANES};
use super::model::Model;
use super::scaling::Scaling;
use shell_data::vectorised;
use shell_data::wrench::PerAxis;

/// `W = X(s)·C`: the features of standardised readings, and their coefficients.
#[derive(Clone, Debug, PartialEq)]
pub struct Polynomial {
    features: Features,
    coefficients: Vec<PerAxis<f64>>,
}

impl Polynomial {
    /// From coefficients for standardised readings, one entry per [term](Model::terms), in N and N·m
    /// per unit of the feature.
    ///
    /// # Panics
    /// If there are not as many coefficients as terms, or as many scalings as channels.
    pub fn new(model: Model, scaling: Scaling, coefficients: Vec<PerAxis<f64>>) -> Self {
        let features = Features::new(model, scaling);
        assert_eq!(coefficients.len(), features.len(), "one row of coefficients per term");
        Self { features, coefficients }
    }

    /// The model.
    pub fn model(&self) -> Model {
        self.features.model()
    }

    /// The scaling of the readings.
    pub fn scaling(&self) -> &Scaling {
        self.features.scaling()
    }

    /// The features that the coefficients are for.
    pub fn features(&self) -> &Features {
        &self.features
    }

    /// One row per [term](Model::terms), in N and N·m per unit of the feature of standardised
    /// readings.
    pub fn coefficients(&self) -> &[PerAxis<f64>] {
        &self.coefficients
    }

    /// The wrench of the first `rows` rows. The sum over features is one fused multiply-add each, so
    /// the bits are the same on any machine.
    pub(super) fn wrench(
        &self,
        readings: &[Vec<f64>],
        rows: usize,
        wrench: &mut PerAxis<Vec<f64>>,
    ) {
        wrench.iter_mut().for_each(|axis| axis.resize(rows, 0.0));
        convert(self, readings, rows, wrench);
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
            // Two vectors of rows at a time: their twelve sums stay in registers, and are as many as
            // it takes for none to wait for its last addition.
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
