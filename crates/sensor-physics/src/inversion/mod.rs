//! Conversion of frames of readings to wrenches.
//!
//! ```text
//! minimise  Σ (yᵢ − fᵢ(x, u))²/vᵢ + λ·xᵀΣ_w⁻¹x + uᵀu      vᵢ = σ² + τ²·(dfᵢ/dq)² + gᵢᵀCᵢgᵢ
//! ```
//!
//! The unknowns are the wrench `x` and the [factors](crate::factors) `u` that the sensors share: `q = b + aᵀx + cᵀu`.
//! To first order this integrates `u` out: `D·C·Cᵀ·D` is added to the variance `v`. Gauss-Newton steps find the
//! minimum, with `v` from the previous step. `gᵀCg` is the variance from the uncertain parameters, so a sensor counts
//! little where it was not trained. A saturated sensor drops out, because `df/dx` vanishes. The start inverts each
//! curve for its displacement and solves the remaining linear problem. Frames are independent of each other and of
//! the width of vectors.
//!
//! **A sensor that has died** gives readings that no wrench explains. If a reading is [`FAR`](newton::FAR) from its
//! curve and eight sensors or more are in use, the row is solved without each sensor in turn. The sensor whose removal
//! leaves the smallest sum is left out and flagged, if all others then fit.
//!
//! Standard errors come from the curvature at the minimum (Laplace's approximation; MacKay, Neural Comput. 4, 1992).

mod newton;

use self::newton::Invert;
use super::fit::Observation;
use super::model::{PhysicsModel, Sensor};
use super::noise::Noise;
use super::response::{FACTORS, PARAMETERS, Parameters, SHAPE, displacement};
use shell_data::instructions::arch;
use shell_data::wrench::PerAxis;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// N and N·m.
    pub wrench: PerAxis<f64>,
    /// N and N·m.
    pub standard_errors: PerAxis<f64>,
    pub flags: Flags,
}

/// State of the channels in a frame. Masks have bit `i` for channel `i`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Flags {
    /// Channels on a flat end of their curve, which carry no information about this wrench.
    pub saturated: u16,
    /// Channels left out: constant in training, not a number here, or inconsistent with all others.
    pub left_out: u16,
    /// Channels whose reading is far from the value that the others imply.
    pub misfit: u16,
    pub converged: bool,
}

#[derive(Clone, Debug, Default, PartialEq)]
pub struct Estimates {
    /// N and N·m.
    pub wrench: PerAxis<Vec<f64>>,
    /// N and N·m.
    pub standard_errors: PerAxis<Vec<f64>>,
    pub flags: Vec<Flags>,
}

/// Fewest sensors for one to be left out: more sensors than axes must remain, to test their agreement.
const LEAVE_OUT_OF: u32 = 8;

const MOST_UNKNOWNS: usize = 6 + FACTORS;

#[derive(Clone, Debug, PartialEq)]
pub struct Inversion {
    pub(super) model: PhysicsModel,
    sensors: Vec<Ready>,
    /// `λ·Σ_w⁻¹`, and 1 for each factor.
    prior: [[f64; MOST_UNKNOWNS]; MOST_UNKNOWNS],
    dead: u16,
}

impl Inversion {
    pub fn new(model: &PhysicsModel) -> Self {
        let all = ((1_u32 << model.channels) - 1) as u16;
        let known = model.sensors.iter().fold(0, |mask, sensor| mask | 1 << sensor.channel);
        let mut inversion = Self {
            model: model.clone(),
            sensors: model.sensors.iter().map(|s| Ready::new(s, &model.noise)).collect(),
            prior: [[0.0; MOST_UNKNOWNS]; MOST_UNKNOWNS],
            dead: all & !known,
        };
        inversion.set_lambda(model.lambda);
        inversion
    }

    pub(super) fn set_lambda(&mut self, lambda: f64) {
        self.model.lambda = lambda;
        for (i, row) in self.prior.iter_mut().enumerate() {
            row[i] = 1.0;
            if let Some(loads) = self.model.load_precision.get(i) {
                row.iter_mut().zip(loads).for_each(|(p, x)| *p = lambda * x);
            }
        }
    }

    /// Wrenches of all rows. `readings` has one column per channel, in counts.
    ///
    /// # Panics
    /// If `readings` does not have one column per channel of the model, or the columns differ in length.
    pub fn estimates(&self, readings: &[Vec<f64>]) -> Estimates {
        assert_eq!(readings.len(), self.model.channels, "one column per channel");
        let rows = readings.first().map_or(0, Vec::len);
        assert!(readings.iter().all(|column| column.len() == rows), "columns of one length");
        let (mut out, _) = self.solve(readings);
        self.leave_out_dead(readings, &mut out);
        out
    }

    /// Squared error of each wrench in units of `scale`, summed over the axes.
    pub fn squared_errors(&self, observations: &[&Observation], scale: &PerAxis<f64>) -> Vec<f64> {
        let column = |channel: usize| observations.iter().map(|o| o.readings[channel]).collect();
        let readings: Vec<Vec<f64>> = (0..self.model.channels).map(column).collect();
        let estimates = self.estimates(&readings);
        let of_row = |(row, o): (usize, &&Observation)| {
            let relative =
                |axis: usize| (estimates.wrench[axis][row] - o.wrench[axis]) / scale[axis];
            (0..6).map(|axis| relative(axis).powi(2)).sum()
        };
        observations.iter().enumerate().map(of_row).collect()
    }

    /// Solves with all sensors that have a reading. Also returns the minimised sum of each row.
    fn solve(&self, readings: &[Vec<f64>]) -> (Estimates, Vec<f64>) {
        match self.model.factor_count() {
            0 => arch().dispatch(Invert::<'_, 6> { inversion: self, readings }),
            1 => arch().dispatch(Invert::<'_, 7> { inversion: self, readings }),
            _ => arch().dispatch(Invert::<'_, MOST_UNKNOWNS> { inversion: self, readings }),
        }
    }

    /// Solves misfitting rows again without the sensor whose removal leaves the smallest sum, if all others then fit.
    fn leave_out_dead(&self, readings: &[Vec<f64>], out: &mut Estimates) {
        let is_wanted = |row: &usize| {
            let flags = out.flags[*row];
            let in_use = self.model.channels as u32 - flags.left_out.count_ones();
            flags.misfit != 0 && in_use >= LEAVE_OUT_OF
        };
        let rows: Vec<usize> = (0..out.flags.len()).filter(is_wanted).collect();
        if rows.is_empty() {
            return;
        }
        let pick = |column: &Vec<f64>| rows.iter().map(|&row| column[row]).collect();
        let mut some: Vec<Vec<f64>> = readings.iter().map(pick).collect();
        let mut best: Vec<Option<(f64, Estimate)>> = vec![None; rows.len()];
        for sensor in &self.sensors {
            let nothing = vec![f64::NAN; rows.len()];
            let kept = std::mem::replace(&mut some[sensor.channel], nothing);
            let (found, sums) = self.solve(&some);
            for (position, (best, sum)) in best.iter_mut().zip(sums).enumerate() {
                if best.is_none_or(|(least, _)| sum < least) {
                    *best = Some((sum, found.row(position)));
                }
            }
            some[sensor.channel] = kept;
        }
        for (&row, best) in rows.iter().zip(&best) {
            if let Some((_, estimate)) = best.filter(|(_, estimate)| estimate.flags.misfit == 0) {
                out.set(row, &estimate);
            }
        }
    }
}

impl Estimates {
    fn set(&mut self, row: usize, estimate: &Estimate) {
        for axis in 0..6 {
            self.wrench[axis][row] = estimate.wrench[axis];
            self.standard_errors[axis][row] = estimate.standard_errors[axis];
        }
        self.flags[row] = estimate.flags;
    }

    pub fn row(&self, row: usize) -> Estimate {
        let of = |columns: &PerAxis<Vec<f64>>| std::array::from_fn(|axis| columns[axis][row]);
        Estimate {
            wrench: of(&self.wrench),
            standard_errors: of(&self.standard_errors),
            flags: self.flags[row],
        }
    }
}

/// Least distance of a reading from lo and lo + h in the start, in shares of h.
const MARGIN: f64 = 0.01;

const START_NOISE: f64 = 0.02;

/// A sensor is saturated where its curve is flatter than this share of its steepest slope.
const FLAT: f64 = 0.05;

/// Number of steps of the tables for the start, which then is off by less than 0.01 in q.
const TABLE_STEPS: usize = 128;

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Ready {
    pub(super) channel: usize,
    pub(super) least: f64,
    pub(super) per_count: f64,
    pub(super) offset: f64,
    /// a, then c.
    pub(super) gains: [f64; MOST_UNKNOWNS],
    pub(super) lo: f64,
    pub(super) h: f64,
    pub(super) nu: f64,
    /// Lower triangle of the parameters' covariance; off-diagonal elements are doubled.
    pub(super) covariance: [Parameters; PARAMETERS],
    /// `dy/dq` below which the curve is flat.
    pub(super) flat: f64,
    /// `q − b` and its weight in the start, at equal steps over the curve.
    table: Vec<(f64, f64)>,
}

impl Ready {
    pub(super) fn new(sensor: &Sensor, noise: &Noise) -> Self {
        let p = &sensor.parameters;
        let (lo, h, nu) = (p[SHAPE], libm::exp(p[SHAPE + 1]), libm::exp(p[SHAPE + 2]));
        // dy/dq = h·ν·σ^ν·(1 − σ) is steepest where σ = ν/(1 + ν).
        let steepest = h * nu * libm::pow(nu / (1.0 + nu), nu) / (1.0 + nu);
        let entry = |step: usize| {
            let share = step as f64 / TABLE_STEPS as f64;
            let (q, slope) = displacement(h.mul_add(share, lo), lo, h, nu, MARGIN);
            let variance = noise.variance(slope) + (START_NOISE * h).powi(2);
            (q - p[0], slope * slope / variance)
        };
        let mut covariance = sensor.covariance;
        for (i, row) in covariance.iter_mut().enumerate() {
            row[..i].iter_mut().for_each(|c| *c *= 2.0);
        }
        Self {
            channel: sensor.channel,
            least: sensor.least,
            per_count: sensor.range.recip(),
            offset: p[0],
            gains: std::array::from_fn(|i| if i < 6 { p[1 + i] } else { sensor.loadings[i - 6] }),
            lo,
            h,
            nu,
            covariance,
            flat: FLAT * steepest,
            table: (0..=TABLE_STEPS).map(entry).collect(),
        }
    }

    #[inline]
    pub(super) fn scaled(&self, reading: f64) -> f64 {
        (reading - self.least) * self.per_count
    }

    /// Displacement minus b according to this scaled reading alone, and the weight of this value.
    #[inline]
    pub(super) fn start(&self, y: f64) -> (f64, f64) {
        let position = ((y - self.lo) / self.h).clamp(0.0, 1.0) * TABLE_STEPS as f64;
        let step = (position as usize).min(TABLE_STEPS - 1);
        let (share, (q0, w0), (q1, w1)) =
            (position - step as f64, self.table[step], self.table[step + 1]);
        (share.mul_add(q1 - q0, q0), share.mul_add(w1 - w0, w0))
    }
}

#[cfg(test)]
mod tests {
    use super::super::Sensor;
    use super::super::response::{PARAMETERS, Parameters, Response};
    use super::*;

    impl Inversion {
        /// The wrench of one frame of readings, in counts.
        ///
        /// # Panics
        /// If there are not as many readings as the model has channels.
        pub fn invert(&self, readings: &[f64]) -> Estimate {
            let columns: Vec<Vec<f64>> = readings.iter().map(|&reading| vec![reading]).collect();
            self.estimates(&columns).row(0)
        }
    }

    fn parameters(sensor: usize) -> Parameters {
        let gain = |axis: usize| match (sensor + 3 * axis) % 7 {
            0 => 1.5,
            position => 0.4 * (position as f64 - 3.5),
        };
        let [fx, fy, fz, mx, my, mz] = std::array::from_fn(gain);
        [0.2 * sensor as f64 - 0.8, fx, fy, fz, mx, my, mz, 0.05, -0.1, 0.2]
    }

    /// Eight sensors with very little noise and a very weak prior; the second channel is dead.
    fn model() -> PhysicsModel {
        let sensor = |position: usize| Sensor {
            channel: if position == 0 { 0 } else { position + 1 },
            least: 200.0,
            range: 700.0,
            parameters: parameters(position),
            covariance: [[0.0; PARAMETERS]; PARAMETERS],
            loadings: [0.0; FACTORS],
        };
        PhysicsModel {
            channels: 9,
            wrench_scale: [2.0, 3.0, 4.0, 0.1, 0.2, 0.3],
            load_precision: std::array::from_fn(|i| {
                std::array::from_fn(|j| if i == j { 1.0 } else { 0.0 })
            }),
            lambda: 1e-9,
            prior_width: 1.0,
            noise: Noise { reading: 1e-8, displacement: 0.0 },
            sensors: (0..8).map(sensor).collect(),
        }
    }

    fn readings(wrenches: &[PerAxis<f64>]) -> Vec<Vec<f64>> {
        let of = |position: usize| -> Vec<f64> {
            let response = |x: &PerAxis<f64>| Response::at(&parameters(position), x).value;
            wrenches.iter().map(|x| 700.0f64.mul_add(response(x), 200.0)).collect()
        };
        let mut columns: Vec<Vec<f64>> = (0..8).map(of).collect();
        columns.insert(1, vec![1234.0; wrenches.len()]);
        columns
    }

    fn wrenches(rows: usize) -> Vec<PerAxis<f64>> {
        let value = |row: usize, axis: usize| ((row * 31 + axis * 17) % 23) as f64 / 15.0 - 0.75;
        (0..rows).map(|row| std::array::from_fn(|axis| value(row, axis))).collect()
    }

    #[test]
    fn readings_of_known_wrenches_give_them_back() {
        let (model, wrenches) = (model(), wrenches(100));
        let found = Inversion::new(&model).estimates(&readings(&wrenches));
        for (row, x) in wrenches.iter().enumerate() {
            let estimate = found.row(row);
            assert!(estimate.flags.converged, "{row}");
            assert_eq!(estimate.flags.left_out, 0b10);
            for (axis, x) in x.iter().enumerate() {
                let error = estimate.wrench[axis] / model.wrench_scale[axis] - x;
                // Steps end within a thousandth of a standard error, which is 1e-4 over the slopes.
                let size = estimate.standard_errors[axis] / model.wrench_scale[axis];
                assert!(error.abs() < 0.01 * size, "{row} {axis}: {error:e} {size:e}");
            }
        }
    }

    #[test]
    fn a_row_has_the_same_bits_next_to_any_rows() {
        let readings = readings(&wrenches(53));
        let inversion = Inversion::new(&model());
        let all = inversion.estimates(&readings);
        for row in 0..53 {
            let frame: Vec<f64> = readings.iter().map(|column| column[row]).collect();
            assert_eq!(inversion.invert(&frame), all.row(row));
        }
    }

    #[test]
    fn a_sensor_on_its_plateau_is_flagged_and_the_others_suffice() {
        let (model, mut wrench) = (model(), [0.1; 6]);
        // Along the gains of one sensor, up its curve.
        let gains: PerAxis<f64> = std::array::from_fn(|axis| parameters(4)[1 + axis]);
        let square: f64 = gains.iter().map(|gain| gain * gain).sum();
        (0..6).for_each(|axis| wrench[axis] += 7.0 * gains[axis] / square);
        let mut frame: Vec<f64> = readings(&[wrench]).iter().map(|column| column[0]).collect();
        let inversion = Inversion::new(&model);
        assert!(inversion.invert(&frame).flags.saturated & 1 << 5 != 0);
        frame = readings(&[[0.1; 6]]).iter().map(|column| column[0]).collect();
        frame[5] = f64::NAN;
        let estimate = inversion.invert(&frame);
        assert_eq!(estimate.flags.left_out, 0b10_0010);
        for axis in 0..6 {
            assert!((estimate.wrench[axis] / model.wrench_scale[axis] - 0.1).abs() < 1e-3);
        }
    }

    #[test]
    fn a_sensor_with_inexplicable_readings_is_left_out_and_flagged() {
        let model = model();
        let wrench = [0.1, -0.2, 0.3, 0.2, -0.1, 0.05];
        let mut columns = readings(&[wrench, wrench]);
        columns[6][1] = 260.0;
        let found = Inversion::new(&model).estimates(&columns);
        assert_eq!(found.row(0).flags.left_out, 0b10);
        assert_eq!(found.row(1).flags.left_out, 0b100_0010);
        for (axis, expected) in wrench.iter().enumerate() {
            let x = found.row(1).wrench[axis] / model.wrench_scale[axis];
            assert!((x - expected).abs() < 1e-3, "{axis}: {x}");
        }
    }
}
