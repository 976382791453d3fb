//! How sure a converted sample is.
//!
//! With residual covariance `S` over the axes and `F·Fᵀ = (XᵀX)⁻¹`, the covariance of the
//! coefficients of axes `a` and `b` is `S[a][b]·F·Fᵀ`. A new sample with features `x` is off by its
//! own noise and by the error of the coefficients; a tare subtracts the mean of `n` frames with
//! mean features `x₀`, which adds their noise and removes what both share (Draper & Smith, Applied
//! Regression Analysis, 3rd ed., §1.4, §8.1):
//!
//! ```text
//! untared   se² = S[a][a]·(1 + ‖Fᵀx‖²)
//! tared     se² = S[a][a]·(1 + 1/n + ‖Fᵀ(x − x₀)‖²)
//! ```
//!
//! This holds for errors that are independent from row to row. Rows recorded in quick succession
//! are not, and then the second term is too small. With a ridge, `F` includes it, which leaves out
//! the bias that the ridge brings.

use pulp::{Arch, NullaryFnOnce};
use serde::{Deserialize, Serialize};

use super::conversion::Calibration;
use super::features::{Features, LANES, Lanes};
use super::solver::Solution;
use crate::wrench::PerAxis;

/// The covariance of the coefficients, in factors.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Covariance {
    /// The columns of the upper triangular `F`, of lengths 1, 2, …, one per feature.
    pub factor: Vec<Vec<f64>>,
    /// `S`: sums of products of residuals over the degrees of freedom, in products of N and N·m.
    pub residual: PerAxis<PerAxis<f64>>,
    /// Rows less coefficients.
    pub degrees_of_freedom: u64,
}

/// The unloaded state that later samples are measured from.
#[derive(Clone, Debug, PartialEq)]
pub struct Tare {
    /// Number of frames.
    pub frames: usize,
    /// Their mean features.
    pub features: Vec<f64>,
    /// Their mean wrench, N and N·m, to be subtracted.
    pub wrench: PerAxis<f64>,
}

impl Covariance {
    /// The covariance of a solution; `None` if there are no more rows than coefficients.
    pub fn of_solution(solution: &Solution) -> Option<Self> {
        let p = solution.factor.nrows();
        let degrees_of_freedom = solution.rows.checked_sub(p as u64).filter(|&n| n > 0)?;
        let products = &solution.residual_products;
        Some(Self {
            factor: (0..p).map(|j| (0..=j).map(|i| solution.factor[(i, j)]).collect()).collect(),
            residual: std::array::from_fn(|a| {
                std::array::from_fn(|b| products[(a, b)] / degrees_of_freedom as f64)
            }),
            degrees_of_freedom,
        })
    }

    /// Standard deviation of the residuals, per axis, N and N·m.
    pub fn residual_sd(&self) -> PerAxis<f64> {
        std::array::from_fn(|axis| self.residual[axis][axis].sqrt())
    }
}

impl Calibration {
    /// The mean state of some frames; `None` of no frames.
    ///
    /// # Panics
    /// If `readings` are not the model's channels, or of different lengths.
    pub fn tare(&self, readings: &[Vec<f64>]) -> Option<Tare> {
        let frames = self.rows_of(readings);
        if frames == 0 {
            return None;
        }
        let mut columns = vec![0.0; frames * self.features().len()];
        self.features().fill(readings, 0..frames, &mut columns, frames);
        let mean = |column: &[f64]| column.iter().sum::<f64>() / frames as f64;
        let mut wrench = PerAxis::default();
        self.wrench(readings, &mut wrench);
        Some(Tare {
            frames,
            features: columns.chunks_exact(frames).map(mean).collect(),
            wrench: wrench.map(|axis| mean(&axis)),
        })
    }

    /// The standard error of every row and axis, N and N·m; see the module for the formulas.
    ///
    /// `readings` has one column per channel, in counts; `errors` is made as long as they are.
    /// Returns false, and leaves `errors` empty, if the calibration carries no covariance.
    ///
    /// # Panics
    /// If `readings` are not the model's channels, or of different lengths.
    pub fn standard_errors(
        &self,
        readings: &[Vec<f64>],
        tare: Option<&Tare>,
        errors: &mut PerAxis<Vec<f64>>,
    ) -> bool {
        let rows = self.rows_of(readings);
        errors.iter_mut().for_each(Vec::clear);
        let Some(covariance) = &self.covariance else { return false };
        let features = vec![[0.0; LANES]; self.features().len()];
        Arch::new().dispatch(Errors {
            features: self.features(),
            covariance,
            readings,
            rows,
            tare,
            lanes: features,
            errors,
        });
        true
    }
}

/// The loop over rows, inlined whole into code for the widest vectors of the machine.
struct Errors<'a> {
    features: &'a Features,
    covariance: &'a Covariance,
    readings: &'a [Vec<f64>],
    rows: usize,
    tare: Option<&'a Tare>,
    lanes: Vec<Lanes>,
    errors: &'a mut PerAxis<Vec<f64>>,
}

impl NullaryFnOnce for Errors<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Errors { features, covariance, readings, rows, tare, mut lanes, errors } = self;
        let own = 1.0 + tare.map_or(0.0, |tare| (tare.frames as f64).recip());
        let sd = covariance.residual_sd();
        for start in (0..rows).step_by(LANES) {
            features.lanes(readings, start, &mut lanes);
            if let Some(tare) = tare {
                for (x, &mean) in lanes.iter_mut().zip(&tare.features) {
                    for x in x {
                        *x -= mean;
                    }
                }
            }
            let mut spread = [own; LANES];
            for column in &covariance.factor {
                let mut product = [0.0; LANES];
                for (x, &f) in lanes.iter().zip(column) {
                    for lane in 0..LANES {
                        product[lane] = x[lane].mul_add(f, product[lane]);
                    }
                }
                for lane in 0..LANES {
                    spread[lane] = product[lane].mul_add(product[lane], spread[lane]);
                }
            }
            for spread in &mut spread {
                *spread = spread.sqrt();
            }
            let filled = &spread[..LANES.min(rows - start)];
            for (errors, sd) in errors.iter_mut().zip(sd) {
                errors.extend(filled.iter().map(|spread| sd * spread));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::model::{Basis, Model};
    use super::super::scaling::Scaling;
    use super::*;

    /// A straight line through one channel: the textbook case, with closed formulas.
    fn line(readings: &[f64]) -> (Calibration, f64, f64) {
        let n = readings.len() as f64;
        let mean = readings.iter().sum::<f64>() / n;
        let squares: f64 = readings.iter().map(|s| (s - mean) * (s - mean)).sum();
        // (XᵀX)⁻¹ of [s, 1] is [[1, −m], [−m, m² + Q/n]]/Q = F·Fᵀ with F upper triangular.
        let corner = mean * mean / squares + 1.0 / n;
        let f = vec![
            vec![(1.0 / squares - (mean / squares) * (mean / squares) / corner).sqrt()],
            vec![-mean / squares / corner.sqrt(), corner.sqrt()],
        ];
        let model = Model { basis: Basis::Linear, intercept: true, channels: 1 };
        let mut calibration =
            Calibration::new(model, Scaling::identity(1), vec![[2.0; 6], [1.0; 6]]);
        let mut residual = PerAxis::<PerAxis<f64>>::default();
        (0..6).for_each(|axis| residual[axis][axis] = 0.25);
        calibration.covariance =
            Some(Covariance { factor: f, residual, degrees_of_freedom: readings.len() as u64 - 2 });
        (calibration, mean, squares)
    }

    #[test]
    fn standard_errors_of_a_straight_line_are_those_of_the_textbook() {
        let (calibration, mean, squares) = line(&[1.0, 2.0, 4.0, 9.0, 12.0]);
        let new = [vec![0.0, 5.6, 20.0]];
        let mut errors = PerAxis::default();
        assert!(calibration.standard_errors(&new, None, &mut errors));
        for (&s, &error) in new[0].iter().zip(&errors[2]) {
            let variance = 1.0 + 1.0 / 5.0 + (s - mean) * (s - mean) / squares;
            // A handful of roundings.
            assert!((error - 0.5 * f64::sqrt(variance)).abs() < 1e-14);
        }
    }

    #[test]
    fn a_tare_adds_its_noise_and_takes_away_what_it_shares() {
        let (calibration, _, squares) = line(&[1.0, 2.0, 4.0, 9.0, 12.0]);
        let tare = calibration.tare(&[vec![3.0, 5.0]]).unwrap();
        assert_eq!(tare.features, [4.0, 1.0]);
        assert_eq!(tare.wrench, [9.0; 6]);
        let mut errors = PerAxis::default();
        assert!(calibration.standard_errors(&[vec![10.0]], Some(&tare), &mut errors));
        let variance = 1.0 + 1.0 / 2.0 + 36.0 / squares;
        assert!((errors[5][0] - 0.5 * f64::sqrt(variance)).abs() < 1e-14);
    }

    #[test]
    fn without_a_covariance_there_are_no_standard_errors_and_without_frames_no_tare() {
        let (mut calibration, ..) = line(&[1.0, 2.0, 4.0]);
        calibration.covariance = None;
        assert!(!calibration.standard_errors(&[vec![1.0]], None, &mut PerAxis::default()));
        assert_eq!(calibration.tare(&[vec![]]), None);
    }
}
