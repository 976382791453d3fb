//! Conversion of readings to a wrench by inverting the sensors' response curves.
//!
//! ```text
//! minimise  Σ (yᵢ − fᵢ(x))²/vᵢ + xᵀPx      vᵢ = σ² + τ²·(dfᵢ/dq)² + |Lᵢᵀgᵢ|²
//! ```
//!
//! by at most [`STEPS`] Gauss–Newton steps in single precision, with `v` from the previous step, as
//! on the host (`crates/sensor-physics/src/inversion`). A sensor on a plateau has no influence,
//! since its slope is zero; a saturated one is left out. Frames are independent. Only the host
//! computes standard errors and leaves out sensors that no wrench explains.
//!
//! If the numbers of a calibration are in the ranges of [`Physics`], no computation overflows: a
//! step that is not finite, or leads beyond [`FARTHEST`], is not taken.

mod curve;
mod equations;

use self::curve::{CurveValue, displacement};
use self::equations::{Equations, X, product, row, unrolled};
use shared_proto::{AXES, CHANNELS, FACTOR, Physics, PhysicsSensor};

/// Maximum number of steps, including halved ones; three or four are usual.
const STEPS: usize = 4;

/// Convergence limit of the squared step length: a hundredth of a standard error. The last step is
/// taken, so the remaining error is smaller.
const SETTLED: f32 = 1e-4;

/// Squared step length in standard errors below which the variances are not recomputed: they are
/// half of the work, and the weights hardly change.
const NEAR: f32 = 0.1;

/// Number of halvings after which a step that does not lower the sum is given up.
const HALVINGS: u32 = 4;

/// Factor by which rounding may raise the sum near its minimum.
const ROUNDING: f32 = 1.0 + 1e-5;

/// Bound on a wrench, in units of the training wrenches' scale; real ones are smaller.
const FARTHEST: f32 = 1e3;

/// Noise of readings for the start, in units of h.
const START_NOISE: f32 = 0.02;

/// Returns the wrench in N and N·m of readings in counts, without channels in `saturated`; the
/// unloaded wrench if none is found.
pub(super) fn invert(model: &Physics, readings: &[u16; CHANNELS], saturated: u8) -> [f32; AXES] {
    let frame = ScaledFrame::new(model, readings, saturated);
    let x = frame.descend(frame.start().unwrap_or_default());
    core::array::from_fn(|axis| x[axis] * model.wrench_scale[axis])
}

struct ScaledFrame<'a> {
    model: &'a Physics,
    y: [Option<f32>; CHANNELS],
}

struct State {
    x: X,
    points: [Point; CHANNELS],
    /// `P·x`.
    held: X,
    /// `xᵀPx`.
    held_back: f32,
}

/// One curve at a wrench; zeros for a sensor that is left out.
#[derive(Clone, Copy, Default)]
struct Point {
    residual: f32,
    slope: f32,
    weight: f32,
    /// The part of the variance from the parameters.
    from_parameters: f32,
}

impl<'a> ScaledFrame<'a> {
    fn new(model: &'a Physics, readings: &[u16; CHANNELS], saturated: u8) -> Self {
        let scaled = |channel: usize| {
            let PhysicsSensor { least, per_count, .. } = model.sensors[channel];
            let is_used = per_count > 0.0 && saturated >> channel & 1 == 0;
            is_used.then(|| (f32::from(readings[channel]) - least) * per_count)
        };
        Self { model, y: core::array::from_fn(scaled) }
    }

    /// Returns the wrench of the displacements given by the readings alone.
    fn start(&self) -> Option<X> {
        let Physics { prior, reading_variance, displacement_variance, .. } = self.model;
        let mut equations = Equations::new(prior, [0.0; AXES]);
        for (sensor, y) in self.model.sensors.iter().zip(&self.y) {
            let Some(y) = *y else { continue };
            let (q, slope) = displacement(sensor, y);
            let noise = START_NOISE * sensor.height;
            let square = slope * slope;
            let variance = reading_variance + displacement_variance * square + noise * noise;
            let weight = square / variance;
            equations.add(&sensor.gains, weight, weight * (q - sensor.offset));
        }
        equations.solve().filter(is_near)
    }

    fn descend(&self, start: X) -> X {
        let mut state = self.state(start, None);
        let mut sum = state.sum(&state.points);
        let mut halvings = 0;
        let (mut step, mut length) = match self.step(&state) {
            Some((step, length)) if length >= SETTLED => (step, length),
            other => return moved(&state.x, &other.unwrap_or_default().0),
        };
        for left in (0..STEPS).rev() {
            // If the last step is this long, there is no convergence, and new variances would not be used.
            let is_far = length >= NEAR;
            let known = (!is_far || left == 0).then_some(&state.points);
            let next = self.state(moved(&state.x, &step), known);
            // Both sums are for the previous variances; the next comparison uses the new ones.
            if next.sum(&state.points) <= sum * ROUNDING {
                state = next;
                if is_far && left == 0 {
                    break;
                }
                sum = state.sum(&state.points);
                halvings = 0;
                match self.step(&state) {
                    Some(next) if next.1 >= SETTLED => (step, length) = next,
                    other => return moved(&state.x, &other.unwrap_or_default().0),
                }
            } else {
                halvings += 1;
                if halvings == HALVINGS {
                    break;
                }
                (step, length) = (step.map(|value| value / 2.0), length / 4.0);
            }
        }
        state.x
    }

    /// Evaluates the curves at `x`, with `known` variances of the parameters, or new ones.
    fn state(&self, x: X, known: Option<&[Point; CHANNELS]>) -> State {
        let mut points = known.copied().unwrap_or_default();
        for ((sensor, y), point) in self.model.sensors.iter().zip(&self.y).zip(&mut points) {
            let Some(y) = *y else { continue };
            let response = CurveValue::at(sensor, inner(&sensor.gains, &x) + sensor.offset);
            let noise = self.model.reading_variance
                + self.model.displacement_variance * response.slope * response.slope;
            if known.is_none() {
                point.from_parameters = parameter_variance(&sensor.factor, &response, &x);
            }
            point.residual = y - sensor.low - response.height;
            point.slope = response.slope;
            point.weight = 1.0 / (noise + point.from_parameters);
        }
        let held = product(&self.model.prior, &x);
        State { x, points, held, held_back: inner(&held, &x) }
    }

    /// Returns a usable step, and its squared length in standard errors.
    fn step(&self, state: &State) -> Option<(X, f32)> {
        let mut equations = Equations::new(&self.model.prior, state.held.map(|value| -value));
        for (sensor, point) in self.model.sensors.iter().zip(&state.points) {
            let weighted = point.weight * point.slope;
            equations.add(&sensor.gains, weighted * point.slope, weighted * point.residual);
        }
        let step = equations.solve()?;
        is_near(&moved(&state.x, &step)).then(|| (step, inner(&step, &equations.b)))
    }
}

impl State {
    fn sum(&self, weights: &[Point; CHANNELS]) -> f32 {
        let squares = self.points.iter().zip(weights);
        let squares = squares.map(|(point, at)| at.weight * point.residual * point.residual);
        squares.sum::<f32>() + self.held_back
    }
}

fn moved(x: &X, step: &X) -> X {
    core::array::from_fn(|axis| x[axis] + step[axis])
}

fn is_near(x: &X) -> bool {
    x.iter().all(|value| value.abs() < FARTHEST)
}

#[inline(always)]
fn inner(a: &X, b: &X) -> f32 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Returns `|Lᵀg|²`, the part of a response's variance from the parameters.
#[inline(always)]
fn parameter_variance(factor: &[f32; FACTOR], response: &CurveValue, x: &X) -> f32 {
    let CurveValue { height, slope, by_shape } = *response;
    let [fx, fy, fz, mx, my, mz] = x.map(|value| slope * value);
    let gradient = [slope, fx, fy, fz, mx, my, mz, 1.0, height, by_shape];
    let mut variance = 0.0;
    unrolled!(J in 0 1 2 3 4 5 6 7 8 9 => {
        let product: f32 = (J..10).map(|i| factor[row(i) + J] * gradient[i]).sum();
        variance += product * product;
    });
    variance
}

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;
    use proptest::prelude::*;
    use shared_proto::{Calibration, PRIOR};
    use std::vec::Vec;

    /// A model with hardly any noise or prior, so that a wrench is recovered.
    fn model() -> Physics {
        let mut prior = [0.0; PRIOR];
        (0..AXES).for_each(|i| prior[row(i) + i] = 1e-4);
        let sensor = |sensor: usize| PhysicsSensor {
            least: 3_200.0,
            per_count: 1.0 / 44_800.0,
            offset: 0.2 * sensor as f32 - 0.8,
            gains: core::array::from_fn(|axis| match (sensor + 3 * axis) % 7 {
                0 => 1.5,
                position => 0.4 * (position as f32 - 3.5),
            }),
            low: 0.05,
            height: 0.9,
            shape: 1.2,
            factor: [0.0; FACTOR],
        };
        Physics {
            wrench_scale: [2.0, 3.0, 4.0, 0.1, 0.2, 0.3],
            prior,
            reading_variance: 1e-6,
            displacement_variance: 0.0,
            sensors: core::array::from_fn(sensor),
        }
    }

    /// Computes readings at a wrench in units of the scales, in double precision.
    fn readings(model: &Physics, x: &[f64; AXES]) -> [u16; CHANNELS] {
        core::array::from_fn(|channel| {
            let sensor = &model.sensors[channel];
            let pull: f64 = sensor.gains.iter().zip(x).map(|(&gain, x)| f64::from(gain) * x).sum();
            let sigma = 1.0 / (1.0 + (-f64::from(sensor.offset) - pull).exp());
            let response = f64::from(sensor.height) * sigma.powf(f64::from(sensor.shape));
            let y = f64::from(sensor.low) + response;
            (f64::from(sensor.least) + y / f64::from(sensor.per_count)).round() as u16
        })
    }

    fn poses() -> impl Iterator<Item = [f64; AXES]> {
        let value = |row: usize, axis: usize| ((row * 31 + axis * 17) % 23) as f64 / 15.0 - 0.75;
        (0..100).map(move |row| core::array::from_fn(|axis| value(row, axis)))
    }

    fn error(model: &Physics, readings: &[u16; CHANNELS], saturated: u8, x: &[f64; AXES]) -> f64 {
        let wrench = invert(model, readings, saturated);
        let errors = wrench.iter().zip(&model.wrench_scale).zip(x);
        errors.map(|((&w, &scale), x)| (f64::from(w / scale) - x).abs()).fold(0.0, f64::max)
    }

    #[test]
    fn readings_of_known_wrenches_give_them_back() {
        let model = model();
        for x in poses() {
            let error = error(&model, &readings(&model, &x), 0, &x);
            // Rounding to half a count of 44,800, amplified about a hundredfold by slopes from 0.2
            // on and oblique gains; the prior pulls by as much.
            assert!(error < 2e-3, "{x:?}: {error}");
        }
    }

    #[test]
    fn a_saturated_channel_is_left_out() {
        let model = model();
        for x in poses().take(20) {
            let mut frame = readings(&model, &x);
            frame[3] = 65_520;
            assert!(error(&model, &frame, 0, &x) > 0.02);
            let error = error(&model, &frame, 1 << 3, &x);
            assert!(error < 5e-3, "{x:?}: {error}");
        }
    }

    #[test]
    fn a_sensor_on_its_plateau_has_no_weight() {
        let mut model = model();
        // All loads are on the plateau of this curve.
        model.sensors[2].offset = 40.0;
        for x in poses().take(20) {
            let frame = readings(&model, &x);
            let mut without = model.clone();
            without.sensors[2].per_count = 0.0;
            let (with, without) = (invert(&model, &frame, 0), invert(&without, &frame, 0));
            for (with, without) in with.into_iter().zip(without) {
                // They start apart, and converge to within rounding.
                assert!((with - without).abs() < 1e-5, "{with} {without}");
            }
            assert!(error(&model, &frame, 0, &x) < 5e-3);
        }
    }

    #[test]
    fn without_a_sensor_there_is_no_load() {
        let model = model();
        assert_eq!(invert(&model, &[30_000; CHANNELS], 0xFF), [0.0; AXES]);
    }

    fn numbers() -> impl Strategy<Value = f32> {
        prop_oneof![
            any::<u32>().prop_map(f32::from_bits),
            (-38_i32..38, any::<bool>(), 1.0..10.0_f32).prop_map(|(power, negative, digits)| {
                let value = digits * libm::powf(10.0, power as f32);
                if negative { -value } else { value }
            }),
            Just(0.0),
        ]
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(4_096))]

        #[test]
        fn accepted_calibrations_give_finite_wrenches(
            changes in prop::collection::vec((0..565_usize, numbers()), 1..40),
            readings: [u16; CHANNELS],
            saturated: u8,
        ) {
            let bytes = Calibration::Physics(model()).to_bytes();
            let mut changed: Vec<u8> = bytes.to_vec();
            for (position, number) in changes {
                let at = 4 + 4 * position;
                changed[at..at + 4].copy_from_slice(&number.to_le_bytes());
                if Calibration::from_bytes(&changed).is_none() {
                    changed[at..at + 4].copy_from_slice(&bytes[at..at + 4]);
                }
            }
            let Some(Calibration::Physics(model)) = Calibration::from_bytes(&changed) else {
                panic!("refused")
            };
            for saturated in [0, saturated] {
                let wrench = invert(&model, &readings, saturated);
                prop_assert!(wrench.iter().all(|value| value.is_finite()), "{wrench:?}");
            }
        }
    }
}
