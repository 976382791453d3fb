//! What is known of the sensors before any reading: that their answers are smooth.
//!
//! Every answer is taken for a surface of second order in the wrench, 28 terms: 1, w and w·w. Loads that determine
//! these well determine other smooth answers, too. Terms of second order have a prior: they are small beside those of
//! first order, and until there are more loads than terms, those of first order come first.

use super::covariance::{CovarianceMatrix, dot};
use shell_data::wrench::PerAxis;

/// Terms: 1, w (6) and w·w (21).
const TERMS: usize = 28;

/// Prior variances of the terms of first and of second order, with loads in units of the largest of each axis, in
/// variances of one pose. Orders hardly differ with tenfold others.
const FIRST_ORDER: f64 = 1e4;
const SECOND_ORDER: f64 = 25.0;

/// The terms' covariance after some loads, readings unknown.
#[derive(Clone, Debug, PartialEq)]
pub struct Surface {
    covariance: CovarianceMatrix<TERMS>,
    largest: PerAxis<f64>,
}

impl Surface {
    /// After `loads`; `candidates` may be hung later. N and N·m.
    pub fn new(loads: &[PerAxis<f64>], candidates: &[PerAxis<f64>]) -> Self {
        let of = |axis: usize| {
            let sizes = loads.iter().chain(candidates).map(|load| load[axis].abs());
            Some(sizes.fold(0.0, f64::max)).filter(|&most| most > 0.0).unwrap_or(1.0)
        };
        let mut prior = [SECOND_ORDER; TERMS];
        prior[..7].fill(FIRST_ORDER);
        let largest = std::array::from_fn(of);
        let mut surface = Self { covariance: CovarianceMatrix::from_variances(&prior), largest };
        loads.iter().for_each(|load| surface.observe(load));
        surface
    }

    /// The covariance, row by row.
    #[cfg(test)]
    pub(super) fn covariance(&self) -> &[[f64; TERMS]; TERMS] {
        &self.covariance.0
    }

    fn terms(&self, load: &PerAxis<f64>) -> [f64; TERMS] {
        let w: PerAxis<f64> = std::array::from_fn(|axis| load[axis] / self.largest[axis]);
        let mut terms = [1.0; TERMS];
        terms[1..7].copy_from_slice(&w);
        let products = (0..6).flat_map(|i| (i..6).map(move |j| w[i] * w[j]));
        terms[7..].iter_mut().zip(products).for_each(|(term, product)| *term = product);
        terms
    }

    pub(super) fn observe(&mut self, load: &PerAxis<f64>) {
        let terms = self.terms(load);
        self.covariance.observe(&terms, 1.0);
    }

    pub(super) fn gain(&self, load: &PerAxis<f64>) -> f64 {
        self.covariance.variance(&self.terms(load)).ln_1p()
    }

    /// The root of the mean variance of an answer over some loads, in standard deviations of one pose.
    pub(super) fn error(&self, range: &[PerAxis<f64>]) -> f64 {
        let variances = range.iter().map(|load| self.covariance.variance(&self.terms(load)));
        (variances.sum::<f64>() / range.len().max(1) as f64).sqrt()
    }

    /// By how much a load lowers the mean variance of an answer over `range`.
    pub(super) fn variance_gain(&self, load: &PerAxis<f64>, range: &[PerAxis<f64>]) -> f64 {
        let of_load = self.terms(load);
        let known = self.covariance.times(&of_load);
        let divisor = 1.0 + dot(&known, &of_load).max(0.0);
        let squares = range.iter().map(|at| dot(&known, &self.terms(at)).powi(2));
        squares.sum::<f64>() / (divisor * range.len().max(1) as f64)
    }
}
