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
//! This holds for errors that are independent from row to row. Rows of one pose are not: they share
//! place, creep and angle, and a hundred of them tell little more than ten. Where rows come in
//! groups, each axis `a` has a covariance of its own, `T·Tᵀ`, from how the groups scatter (see
//! [`ByGroup`](super::exact::ByGroup)), and
//!
//! ```text
//! untared   se² = S[a][a] + ‖Tᵀx‖²
//! tared     se² = S[a][a]·(1 + 1/n) + ‖Tᵀ(x − x₀)‖²
//! ```
//!
//! with G − 1 degrees of freedom for G groups (Bester, Conley & Hansen, J. Econometrics 165, 2011;
//! Cameron & Miller, J. Human Resources 50, 2015, §VI). With a ridge, `F` and `T` include it, which
//! leaves out the bias that the ridge brings.

mod interval;

use faer::Mat;
use pulp::{Arch, NullaryFnOnce};
use serde::{Deserialize, Serialize};

use super::conversion::Calibration;
use super::exact::{GroupsError, Parts, SolveError};
use super::features::{Features, LANES, Lanes};
use super::model::Model;
use super::solver::Solution;
use super::validation::ValidationError;
use super::validation::grouped::GroupedMoments;
use shell_data::wrench::PerAxis;

pub use self::interval::{HIGHEST_LEVEL, Shape, student_quantile};

/// How sure predictions are.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Covariance {
    /// `S`, the covariance of the errors of a row, in products of N and N·m.
    pub residual: PerAxis<PerAxis<f64>>,
    /// Rows less coefficients, or groups less one.
    pub degrees_of_freedom: u64,
    /// That of the coefficients.
    pub coefficients: CoefficientCovariance,
    /// How the training errors are distributed, where that is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shape: Option<Shape>,
}

/// The columns of an upper triangular matrix, of lengths 1, 2, …, one per feature.
pub type Triangle = Vec<Vec<f64>>;

/// The covariance of the coefficients, in factors.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum CoefficientCovariance {
    /// For errors that are independent from row to row.
    Rows {
        /// `F`, to be multiplied by `S[a][b]`.
        factor: Triangle,
    },
    /// For errors that are alike within groups of rows.
    Groups {
        /// Their number.
        groups: u64,
        /// `T` of each axis.
        factors: PerAxis<Triangle>,
    },
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
    /// The covariance of a solution, errors of rows being independent; `None` if there are no more
    /// rows than coefficients.
    pub fn of_rows(solution: &Solution) -> Option<Self> {
        let factor = solution.factor.matrix();
        let degrees_of_freedom =
            solution.rows.checked_sub(factor.nrows() as u64).filter(|&n| n > 0)?;
        let products = &solution.residual_products;
        Some(Self {
            residual: std::array::from_fn(|a| {
                std::array::from_fn(|b| products[(a, b)] / degrees_of_freedom as f64)
            }),
            degrees_of_freedom,
            coefficients: CoefficientCovariance::Rows { factor: columns(&factor) },
            shape: None,
        })
    }

    /// The covariance of the fit of `model` to all rows of `sums`, errors being alike within its
    /// groups. `ridge` is as in [`Moments::solve`](super::exact::Moments::solve).
    ///
    /// # Errors
    /// [`ValidationError`] if there are too few groups, or without one of them the model cannot be
    /// fitted.
    pub fn of_groups(
        sums: &GroupedMoments,
        model: &Model,
        ridge: f64,
    ) -> Result<Self, ValidationError> {
        let total = sums.total().filter(|_| sums.groups.len() > 1);
        let total = total.ok_or(ValidationError::TooFewGroups { found: sums.groups.len() })?;
        let groups: Vec<_> = sums.groups.iter().map(|(_, moments)| moments).collect();
        let found =
            Parts::new(total, model)?.by_group(&groups, ridge).map_err(|error| match error {
                GroupsError::Solve(error) => ValidationError::Solve(error),
                GroupsError::NearlyDependent => ValidationError::Solve(SolveError::NearlyDependent),
                GroupsError::Alone(places) => ValidationError::Alone {
                    groups: places.into_iter().map(|place| sums.groups[place].0.clone()).collect(),
                },
            })?;
        let rows = total.rows() as f64;
        Ok(Self {
            residual: found.residual_products.map(|row| row.map(|product| product / rows)),
            degrees_of_freedom: found.groups as u64 - 1,
            coefficients: CoefficientCovariance::Groups {
                groups: found.groups as u64,
                factors: found.factors.each_ref().map(columns),
            },
            shape: None,
        })
    }

    /// Standard deviation of the residuals, per axis, N and N·m.
    pub fn residual_sd(&self) -> PerAxis<f64> {
        std::array::from_fn(|axis| self.residual[axis][axis].sqrt())
    }
}

fn columns(factor: &Mat<f64>) -> Triangle {
    (0..factor.ncols()).map(|j| (0..=j).map(|i| factor[(i, j)]).collect()).collect()
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
        let variances: PerAxis<f64> = std::array::from_fn(|axis| covariance.residual[axis][axis]);
        for start in (0..rows).step_by(LANES) {
            features.lanes(readings, start, &mut lanes);
            if let Some(tare) = tare {
                for (x, &mean) in lanes.iter_mut().zip(&tare.features) {
                    for x in x {
                        *x -= mean;
                    }
                }
            }
            let filled = LANES.min(rows - start);
            match &covariance.coefficients {
                CoefficientCovariance::Rows { factor } => {
                    let spread = spread(factor, &lanes);
                    for (errors, variance) in errors.iter_mut().zip(variances) {
                        let error = |&spread: &f64| (variance * (own + spread)).sqrt();
                        errors.extend(spread[..filled].iter().map(error));
                    }
                }
                CoefficientCovariance::Groups { factors, .. } => {
                    let axes = errors.iter_mut().zip(factors).zip(variances);
                    for ((errors, factor), variance) in axes {
                        let spread = spread(factor, &lanes);
                        let error = |&spread: &f64| (variance * own + spread).sqrt();
                        errors.extend(spread[..filled].iter().map(error));
                    }
                }
            }
        }
    }
}

/// `‖factorᵀ·x‖²` of each lane.
#[inline(always)]
fn spread(factor: &Triangle, lanes: &[Lanes]) -> Lanes {
    let mut spread = [0.0; LANES];
    for column in factor {
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
    spread
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
        calibration.covariance = Some(Covariance {
            residual,
            degrees_of_freedom: readings.len() as u64 - 2,
            coefficients: CoefficientCovariance::Rows { factor: f },
            shape: None,
        });
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
    fn each_axis_has_a_spread_of_its_own_where_rows_come_in_groups() {
        let (mut calibration, ..) = line(&[1.0, 2.0, 4.0, 9.0, 12.0]);
        let factor = |axis: usize| vec![vec![axis as f64], vec![0.0, 2.0]];
        if let Some(covariance) = &mut calibration.covariance {
            let factors = std::array::from_fn(factor);
            covariance.coefficients = CoefficientCovariance::Groups { groups: 5, factors };
        }
        let mut errors = PerAxis::default();
        assert!(calibration.standard_errors(&[vec![3.0]], None, &mut errors));
        // The row [3, 1]: 0.25 of its own, (3·axis)² and 2² of the coefficients.
        let expected = |axis: usize| (0.25 + 9.0 * (axis * axis) as f64 + 4.0).sqrt();
        (0..6).for_each(|axis| assert!((errors[axis][0] - expected(axis)).abs() < 1e-14));
    }

    #[test]
    fn without_a_covariance_there_are_no_standard_errors_and_without_frames_no_tare() {
        let (mut calibration, ..) = line(&[1.0, 2.0, 4.0]);
        calibration.covariance = None;
        assert!(!calibration.standard_errors(&[vec![1.0]], None, &mut PerAxis::default()));
        assert_eq!(calibration.tare(&[vec![]]), None);
    }
}
