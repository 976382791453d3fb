//! Standard errors of converted samples, with or without a tare.

use crate::conversion::{Calibration, Kind};
use least_squares::features::{Features, LANES, RowLanes};
use least_squares::symmetric::TriangularColumns;
use least_squares::uncertainty::{CoefficientCovariance, Covariance};
use sensor_physics::Flags;
use shell_data::vectorised;
use shell_data::wrench::PerAxis;

/// Half-width of a 95 % interval of normal errors, in standard errors.
pub const HALF_WIDTH: f64 = 1.96;

/// The unloaded state that later samples are measured against.
#[derive(Clone, Debug, PartialEq)]
pub struct Tare {
    pub frames: usize,
    /// Mean features of the frames.
    pub features: Vec<f64>,
    /// Mean wrench, N and N·m, to be subtracted.
    pub wrench: PerAxis<f64>,
    /// Mean variance of a physics model's error at this pose, N² and (N·m)². More frames do not reduce it.
    /// Zero for a polynomial, where the features give this variance.
    pub variance: PerAxis<f64>,
}

impl Calibration {
    /// Mean state of some frames; `None` for zero frames.
    ///
    /// # Panics
    /// If `readings` does not have one column per channel of the model, or the columns differ in length.
    pub fn tare(&self, readings: &[Vec<f64>]) -> Option<Tare> {
        let readings = &*self.with_terms(readings);
        let frames = self.rows_of(readings);
        if frames == 0 {
            return None;
        }
        let mean = |column: &[f64]| column.iter().sum::<f64>() / frames as f64;
        let (features, wrench, variance) = match &self.kind {
            Kind::Polynomial(polynomial) => {
                let features = &polynomial.features;
                let mut columns = vec![0.0; frames * features.len()];
                features.fill(readings, 0..frames, &mut columns, frames);
                let mut wrench = PerAxis::default();
                self.wrench(readings, &mut wrench);
                (columns.chunks_exact(frames).map(mean).collect(), wrench, PerAxis::default())
            }
            Kind::Physics(physics) => {
                let estimates = physics.estimates(readings);
                let square = |errors: Vec<f64>| {
                    errors.iter().map(|error| error * error).sum::<f64>() / frames as f64
                };
                (Vec::new(), estimates.wrench, estimates.standard_errors.map(square))
            }
        };
        Some(Tare { frames, features, wrench: wrench.map(|axis| mean(&axis)), variance })
    }

    pub fn has_standard_errors(&self) -> bool {
        self.covariance.is_some() || matches!(self.kind, Kind::Physics(_))
    }

    /// Reliability of every row: standard errors, if requested and known, and channels without information.
    ///
    /// # Panics
    /// If `readings` does not have one column per channel of the model, or the columns differ in length.
    pub fn trust(&self, readings: &[Vec<f64>], tare: Option<&Tare>, errors: bool) -> Trust {
        let Kind::Physics(physics) = &self.kind else {
            let known = errors.then(|| self.standard_errors(readings, tare)).flatten();
            return Trust { standard_errors: known.unwrap_or_default(), ..Trust::default() };
        };
        let found = physics.estimates(readings);
        let mask = |of: fn(&Flags) -> u16| found.flags.iter().map(|f| u64::from(of(f))).collect();
        Trust {
            insensitive: mask(|flags| flags.saturated),
            left_out: mask(|flags| flags.left_out),
            standard_errors: tared(found.standard_errors, tare),
        }
    }

    /// Standard error of every row and axis, N and N·m; see [`least_squares::uncertainty`]. Outside the training
    /// range of a polynomial, the difference from the wrench at the end of the range counts as a further 95 % error.
    /// `readings` has one column per channel, in counts. `None` without a covariance.
    ///
    /// # Panics
    /// If `readings` does not have one column per channel of the model, or the columns differ in length.
    pub fn standard_errors(
        &self,
        readings: &[Vec<f64>],
        tare: Option<&Tare>,
    ) -> Option<PerAxis<Vec<f64>>> {
        let readings = &*self.with_terms(readings);
        let rows = self.rows_of(readings);
        match &self.kind {
            Kind::Polynomial(polynomial) => {
                let covariance = self.covariance.as_ref()?;
                let features = &polynomial.features;
                let mut errors = predict_errors(features, covariance, readings, rows, tare);
                self.widen_outside(readings, &mut errors);
                Some(errors)
            }
            Kind::Physics(physics) => {
                Some(tared(physics.estimates(readings).standard_errors, tare))
            }
        }
    }
}

impl Calibration {
    /// Widens the standard errors of rows outside the range of the training data.
    fn widen_outside(&self, readings: &[Vec<f64>], errors: &mut PerAxis<Vec<f64>>) {
        let flags = self.out_of_range(readings);
        let outside: Vec<usize> = (0..flags.len()).filter(|&row| flags[row] != 0).collect();
        if outside.is_empty() {
            return;
        }
        let rows = |column: &Vec<f64>| outside.iter().map(|&row| column[row]).collect();
        let own: Vec<Vec<f64>> = readings.iter().map(rows).collect();
        let mut within = own.clone();
        for (column, range) in within.iter_mut().zip(self.valid_range.iter().flatten()) {
            column.iter_mut().for_each(|reading| *reading = reading.max(range.min).min(range.max));
        }
        let [mut at_reading, mut at_end] = [PerAxis::default(), PerAxis::default()];
        self.wrench(&own, &mut at_reading);
        self.wrench(&within, &mut at_end);
        for (axis, errors) in errors.iter_mut().enumerate() {
            for ((&row, own), end) in outside.iter().zip(&at_reading[axis]).zip(&at_end[axis]) {
                let unconfirmed = (own - end) / HALF_WIDTH;
                // Not `hypot`, whose last bit depends on the system.
                errors[row] = (errors[row] * errors[row] + unconfirmed * unconfirmed).sqrt();
            }
        }
    }
}

/// Reliability of rows. Masks have bit `i` for channel `i`, and are empty if the model provides none.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Trust {
    /// Standard errors, N and N·m.
    pub standard_errors: PerAxis<Vec<f64>>,
    /// Channels on a flat end of their curve, which carry no information about the wrench.
    pub insensitive: Vec<u64>,
    /// Channels left out: constant in training, not a number, or inconsistent with all others.
    pub left_out: Vec<u64>,
}

/// Standard errors of differences from the tare: the errors of two poses are independent.
fn tared(mut errors: PerAxis<Vec<f64>>, tare: Option<&Tare>) -> PerAxis<Vec<f64>> {
    if let Some(tare) = tare {
        for (column, variance) in errors.iter_mut().zip(tare.variance) {
            column.iter_mut().for_each(|error| *error = (*error * *error + variance).sqrt());
        }
    }
    errors
}

vectorised! {
    fn predict_errors(
        features: &Features,
        covariance: &Covariance,
        readings: &[Vec<f64>],
        rows: usize,
        tare: Option<&Tare>,
    ) -> PerAxis<Vec<f64>> {
        let mut errors: PerAxis<Vec<f64>> = std::array::from_fn(|_| Vec::with_capacity(rows));
        let mut lanes = vec![[0.0; LANES]; features.len()];
        let own: PerAxis<f64> = std::array::from_fn(|axis| {
            let shared = covariance.shared.map_or(0.0, |shared| shared[axis]);
            let of_tare = |tare: &Tare| shared + (1.0 - shared) / tare.frames as f64;
            1.0 + tare.map_or(0.0, of_tare)
        });
        let variances: PerAxis<f64> = std::array::from_fn(|axis| covariance.residual[axis][axis]);
        let factors: Vec<&[Vec<f64>]> = match &covariance.coefficients {
            CoefficientCovariance::Rows { factor } => vec![factor],
            CoefficientCovariance::Groups { factors, .. } => {
                factors.iter().map(without_zeros).collect()
            }
        };
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
                CoefficientCovariance::Rows { .. } => {
                    let spread = spread(factors[0], &lanes);
                    let axes = errors.iter_mut().zip(variances).zip(own);
                    for ((errors, variance), own) in axes {
                        let error = |&spread: &f64| (variance * (own + spread)).sqrt();
                        errors.extend(spread[..filled].iter().map(error));
                    }
                }
                CoefficientCovariance::Groups { .. } => {
                    let axes = errors.iter_mut().zip(&factors).zip(variances).zip(own);
                    for (((errors, factor), variance), own) in axes {
                        let spread = spread(factor, &lanes);
                        let error = |&spread: &f64| (variance * own + spread).sqrt();
                        errors.extend(spread[..filled].iter().map(error));
                    }
                }
            }
        }
        errors
    }
}

/// Columns from the first nonzero one on. With fewer groups than features, there are as many as groups.
fn without_zeros(factor: &TriangularColumns) -> &[Vec<f64>] {
    let zeros = factor.iter().take_while(|column| column.iter().all(|&f| f == 0.0)).count();
    &factor[zeros..]
}

/// `‖factorᵀ·x‖²` of each lane.
#[inline(always)]
pub(crate) fn spread(factor: &[Vec<f64>], lanes: &[RowLanes]) -> RowLanes {
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
    use super::*;
    use least_squares::model::{Basis, Model};
    use least_squares::scaling::Scaling;

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
        let model = Model { basis: Basis::Linear, intercept: true, channels: 1, memory: 0 };
        let mut calibration =
            Calibration::new(model, Scaling::identity(1), vec![[2.0; 6], [1.0; 6]]);
        let mut residual = PerAxis::<PerAxis<f64>>::default();
        (0..6).for_each(|axis| residual[axis][axis] = 0.25);
        calibration.covariance = Some(Covariance {
            residual,
            degrees_of_freedom: readings.len() as u64 - 2,
            coefficients: CoefficientCovariance::Rows { factor: f },
            shape: None,
            shared: None,
            intervals: None,
        });
        (calibration, mean, squares)
    }

    #[test]
    fn standard_errors_of_a_straight_line_are_those_of_the_textbook() {
        let (calibration, mean, squares) = line(&[1.0, 2.0, 4.0, 9.0, 12.0]);
        let new = [vec![0.0, 5.6, 20.0]];
        let errors = calibration.standard_errors(&new, None).unwrap();
        for (&s, &error) in new[0].iter().zip(&errors[2]) {
            let variance = 1.0 + 1.0 / 5.0 + (s - mean) * (s - mean) / squares;
            // A few rounding errors.
            assert!((error - 0.5 * f64::sqrt(variance)).abs() < 1e-14);
        }
    }

    #[test]
    fn a_tare_adds_its_noise_and_takes_away_what_it_shares() {
        let (calibration, _, squares) = line(&[1.0, 2.0, 4.0, 9.0, 12.0]);
        let tare = calibration.tare(&[vec![3.0, 5.0]]).unwrap();
        assert_eq!(tare.features, [4.0, 1.0]);
        assert_eq!(tare.wrench, [9.0; 6]);
        let errors = calibration.standard_errors(&[vec![10.0]], Some(&tare)).unwrap();
        let variance = 1.0 + 1.0 / 2.0 + 36.0 / squares;
        assert!((errors[5][0] - 0.5 * f64::sqrt(variance)).abs() < 1e-14);
    }

    #[test]
    fn each_axis_has_a_spread_of_its_own_where_rows_come_in_groups() {
        let (mut calibration, ..) = line(&[1.0, 2.0, 4.0, 9.0, 12.0]);
        let factor = |axis: usize| vec![vec![axis as f64], vec![0.0, 2.0]];
        if let Some(covariance) = &mut calibration.covariance {
            let factors = std::array::from_fn(factor);
            covariance.coefficients =
                CoefficientCovariance::Groups { groups: 5, factors, degrees_of_freedom: None };
        }
        let errors = calibration.standard_errors(&[vec![3.0]], None).unwrap();
        // The row [3, 1]: the variance 0.25 of the row, and (3·axis)² and 2² from the coefficients.
        let expected = |axis: usize| (0.25 + 9.0 * (axis * axis) as f64 + 4.0).sqrt();
        (0..6).for_each(|axis| assert!((errors[axis][0] - expected(axis)).abs() < 1e-14));
    }

    #[test]
    fn the_error_of_the_pose_of_a_tare_does_not_fall_with_more_frames() {
        let (mut calibration, ..) = line(&[1.0, 2.0, 4.0, 9.0, 12.0]);
        if let Some(covariance) = &mut calibration.covariance {
            let factors = std::array::from_fn(|_| vec![vec![0.0], vec![0.0, 0.0]]);
            covariance.coefficients =
                CoefficientCovariance::Groups { groups: 5, factors, degrees_of_freedom: None };
            covariance.shared = Some([0.75; 6]);
        }
        for (frames, expected) in [(1, 2.0), (1000, 1.75 + 0.25e-3)] {
            let tare = calibration.tare(&[vec![3.0; frames]]).unwrap();
            let errors = calibration.standard_errors(&[vec![10.0]], Some(&tare)).unwrap();
            assert!((errors[1][0] - 0.5 * f64::sqrt(expected)).abs() < 1e-14, "{frames}");
        }
    }

    #[test]
    fn without_a_covariance_there_are_no_standard_errors_and_without_frames_no_tare() {
        let (mut calibration, ..) = line(&[1.0, 2.0, 4.0]);
        calibration.covariance = None;
        assert_eq!(calibration.standard_errors(&[vec![1.0]], None), None);
        assert_eq!(calibration.tare(&[vec![]]), None);
    }
}
