//! Changes of a sensor, and the calibration of the changed sensor.
//!
//! ```text
//! s' = s + γ·(s − s₀) + ζ       F' = R·F       M' = R·M + o × F'
//! ```
//!
//! Primed symbols belong to the changed sensor. Its changes are absorbed into the numbers of the calibration, which
//! converts as fast as before.

use crate::conversion::{Calibration, Kind};
use least_squares::model::Term;
use least_squares::polynomial::Polynomial;
use least_squares::reading_ranges::ReadingRange;
use sensor_physics::response::{PARAMETERS, Parameters};
use sensor_physics::{PhysicsCalibration, PhysicsModel, Sensor};
use shell_data::wrench::{PerAxis, cross, force_at};

#[derive(Clone, Debug, PartialEq)]
pub struct Change {
    pub channels: Vec<ChannelChange>,
    /// `o`: position of the calibrated frame's origin in the frame of the new wrench, m.
    pub lever_m: [f64; 3],
    /// `R` as a rotation vector: rotation of the calibrated frame in the frame of the new wrench, rad.
    pub turn_rad: [f64; 3],
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ChannelChange {
    /// `γ`: relative increase of the sensitivity.
    pub gain: f64,
    /// `ζ`: increase of the reading at `s₀`, counts.
    pub zero: f64,
    /// `s₀`: reading that a gain does not change, counts.
    pub pivot: f64,
}

impl ChannelChange {
    fn reading(&self, calibrated: f64) -> f64 {
        self.gain.mul_add(calibrated - self.pivot, calibrated + self.zero)
    }
}

impl Change {
    /// Applies the change to a calibration. The result has no intervals, as these belong to the unchanged sensor.
    pub fn apply(&self, calibration: &Calibration) -> Calibration {
        let kind = match &calibration.kind {
            Kind::Polynomial(polynomial) => Kind::Polynomial(self.polynomial(polynomial)),
            Kind::Physics(physics) => {
                let model = self.model(physics.model());
                Kind::Physics(Box::new(PhysicsCalibration::new(model, physics.error_scale)))
            }
        };
        let range = |(of, range): (&ChannelChange, &ReadingRange)| ReadingRange {
            min: of.reading(range.min),
            max: of.reading(range.max),
        };
        let ranges = calibration.valid_range.as_ref();
        let mut changed = Calibration::from_kind(kind);
        changed.axes = calibration.axes;
        changed.valid_range = ranges.map(|all| self.channels.iter().zip(all).map(range).collect());
        changed.memory.clone_from(&calibration.memory);
        changed.lag = calibration.lag;
        changed
    }

    /// Keeps scales, which are powers of two: coefficients absorb the gains. Memory terms change with the gain alone.
    pub(super) fn polynomial(&self, polynomial: &Polynomial) -> Polynomial {
        let (model, mut scaling) = (polynomial.model(), polynomial.scaling().clone());
        let of_column = |column: usize| self.channels[column % model.channels];
        for (column, centre) in scaling.centre.iter_mut().enumerate() {
            let of = of_column(column);
            *centre = match column < model.channels {
                true => of.reading(*centre),
                false => *centre * (1.0 + of.gain),
            };
        }
        let coefficient = |(term, c): (Term, &PerAxis<f64>)| {
            let gains = term.factors().iter().map(|&column| 1.0 + of_column(column.into()).gain);
            let gain = gains.product::<f64>();
            self.wrench(&c.map(|c| c / gain))
        };
        let terms = model.terms().into_iter().zip(&polynomial.coefficients);
        Polynomial::new(model, scaling, terms.map(coefficient).collect())
    }

    pub(super) fn model(&self, model: &PhysicsModel) -> PhysicsModel {
        let s = &model.wrench_scale;
        // x = M·x', in the scales of the model.
        let columns: PerAxis<PerAxis<f64>> = std::array::from_fn(|axis| {
            let mut unit = [0.0; 6];
            unit[axis] = s[axis];
            let calibrated = self.calibrated_wrench(&unit);
            std::array::from_fn(|of| calibrated[of] / s[of])
        });
        let across = |v: &[f64; 6]| columns.map(|column| dot(&column, v));
        let sensor = |sensor: &Sensor| {
            let of = self.channels[sensor.channel];
            let parameters = |p: &Parameters| -> Parameters {
                let gains = across(&std::array::from_fn(|axis| p[1 + axis]));
                std::array::from_fn(|at| if (1..7).contains(&at) { gains[at - 1] } else { p[at] })
            };
            let half = sensor.covariance.map(|row| parameters(&row));
            let transposed: [Parameters; PARAMETERS] =
                std::array::from_fn(|i| std::array::from_fn(|j| half[j][i]));
            Sensor {
                least: of.reading(sensor.least),
                range: (1.0 + of.gain) * sensor.range,
                parameters: parameters(&sensor.parameters),
                covariance: transposed.map(|row| parameters(&row)),
                ..sensor.clone()
            }
        };
        let half = model.load_precision.map(|row| across(&row));
        let load_precision = columns
            .map(|column| std::array::from_fn(|j| (0..6).map(|of| column[of] * half[of][j]).sum()));
        PhysicsModel {
            sensors: model.sensors.iter().map(sensor).collect(),
            load_precision,
            ..model.clone()
        }
    }

    fn wrench(&self, calibrated: &PerAxis<f64>) -> PerAxis<f64> {
        let [fx, fy, fz, mx, my, mz] = *calibrated;
        let mut wrench = force_at(rotated([fx, fy, fz], self.turn_rad), self.lever_m);
        let moment = rotated([mx, my, mz], self.turn_rad);
        wrench[3..].iter_mut().zip(moment).for_each(|(sum, moment)| *sum += moment);
        wrench
    }

    fn calibrated_wrench(&self, wrench: &PerAxis<f64>) -> PerAxis<f64> {
        let [fx, fy, fz, mx, my, mz] = *wrench;
        let more = cross(self.lever_m, [fx, fy, fz]);
        let back = self.turn_rad.map(|angle| -angle);
        let ([fx, fy, fz], [mx, my, mz]) = (
            rotated([fx, fy, fz], back),
            rotated([mx - more[0], my - more[1], mz - more[2]], back),
        );
        [fx, fy, fz, mx, my, mz]
    }
}

fn dot(a: &[f64; 6], b: &[f64; 6]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Turns `v` by a rotation vector (Rodrigues).
fn rotated(v: [f64; 3], by: [f64; 3]) -> [f64; 3] {
    let angle = by.iter().map(|x| x * x).sum::<f64>().sqrt();
    // sin θ/θ and (1 − cos θ)/θ², which tend to 1 and 1/2.
    let half = libm::sin(0.5 * angle);
    let (first, second) = match angle > 1e-9 {
        true => (libm::sin(angle) / angle, 2.0 * (half / angle).powi(2)),
        false => (1.0, 0.5),
    };
    let (once, twice) = (cross(by, v), cross(by, cross(by, v)));
    std::array::from_fn(|i| v[i] + first * once[i] + second * twice[i])
}

#[cfg(test)]
mod tests {
    use super::*;
    use least_squares::model::{Basis, Model};
    use least_squares::scaling::Scaling;

    fn change() -> Change {
        let channel = |at: usize| ChannelChange {
            gain: 0.05 - 0.02 * at as f64,
            zero: 3.0 * at as f64 - 7.0,
            pivot: 40.0,
        };
        Change {
            channels: (0..3).map(channel).collect(),
            lever_m: [2e-3, -1e-3, 3e-3],
            turn_rad: [0.02, 0.03, -0.04],
        }
    }

    #[test]
    fn a_wrench_goes_there_and_back() {
        let wrench = [1.0, -2.0, 3.0, 0.1, 0.2, -0.3];
        let back = change().calibrated_wrench(&change().wrench(&wrench));
        // Some roundings of numbers of order 1.
        assert!(back.iter().zip(wrench).all(|(a, b)| (a - b).abs() < 1e-14), "{back:?}");
        let moved =
            Change { turn_rad: [0.0; 3], ..change() }.wrench(&[0.0, 0.0, 10.0, 0.0, 0.0, 0.0]);
        // 10 N at −1 mm along y and 2 mm along x.
        assert_eq!(moved, [0.0, 0.0, 10.0, -0.01, -0.02, 0.0]);
    }

    #[test]
    fn changed_readings_are_converted_to_the_turned_wrench() {
        let model = Model { basis: Basis::Cubic, intercept: true, channels: 3, memory: 0 };
        let scaling = Scaling { centre: vec![50.0; 3], scale: vec![64.0; 3] };
        let coefficient =
            |j: usize| std::array::from_fn(|axis| (1 + j * 7 % 5 + axis) as f64 / 8.0);
        let before = Calibration::new(model, scaling, (0..10).map(coefficient).collect());
        let change = change();
        let after = change.apply(&before);
        let readings = [vec![30.0], vec![55.0], vec![71.0]];
        let changed: Vec<Vec<f64>> = (readings.iter().zip(&change.channels))
            .map(|(column, of)| vec![of.reading(column[0])])
            .collect();
        let (mut expected, mut found) = (PerAxis::default(), PerAxis::default());
        before.wrench(&readings, &mut expected);
        after.wrench(&changed, &mut found);
        let expected = change.wrench(&expected.map(|column| column[0]));
        // Roundings of sums of ten terms of order 1.
        assert!(found.iter().zip(expected).all(|(a, b)| (a[0] - b).abs() < 1e-13));
    }
}
