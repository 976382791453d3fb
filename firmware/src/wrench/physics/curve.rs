//! Response curve of one sensor (`crates/sensor-physics/src/response.rs`), in single precision.

use core::f32::consts::LOG2_E;
use libm::logf;
use shared_proto::PhysicsSensor;

/// The response above the lower plateau, and its derivatives.
#[derive(Clone, Copy, Debug)]
pub(super) struct CurveValue {
    /// `h·σ^ν`, also the derivative by ln h.
    pub(super) height: f32,
    /// Derivative by the displacement.
    pub(super) slope: f32,
    /// Derivative by ln ν.
    pub(super) by_shape: f32,
}

impl CurveValue {
    pub(super) fn at(sensor: &PhysicsSensor, q: f32) -> Self {
        // e^(−|q|) never overflows.
        let e = exp_of_negative(-q.abs());
        let share = 1.0 / (1.0 + e);
        // 1 − σ(q), and ln σ(q) = min(q, 0) − ln(1 + e).
        let (rest, least) = if q < 0.0 { (share, q) } else { (e * share, 0.0) };
        let ln_power = sensor.shape * (least - ln_of_one_and(e));
        let height = sensor.height * exp_of_negative(ln_power);
        Self { height, slope: sensor.shape * height * rest, by_shape: height * ln_power }
    }
}

/// Below this, `eˣ` is negligible relative to the last bit of one.
const FAR: f32 = -80.0;

/// ln 2 in two parts; the first is short enough that its products with small integers are exact.
const LN_2: [f32; 2] = [0.693_359_4, -2.121_944_4e-4];

/// Returns `eˣ` for `x ≤ 0`, with a relative error of about 2e-7, in half the time of `libm`.
#[inline(always)]
fn exp_of_negative(x: f32) -> f32 {
    let x = if x > FAR { x } else { FAR };
    // x = n·ln 2 + r with |r| ≤ ln 2/2; the series in r ends at r⁶/6!.
    let n = (x * LOG2_E - 0.5) as i32;
    let r = (x - n as f32 * LN_2[0]) - n as f32 * LN_2[1];
    let series = [1.0 / 720.0, 1.0 / 120.0, 1.0 / 24.0, 1.0 / 6.0, 0.5, 1.0, 1.0];
    let power = series.into_iter().fold(0.0, |sum, c| sum * r + c);
    f32::from_bits(power.to_bits().wrapping_add_signed(n << 23))
}

/// `ln(1 + e)` for `0 ≤ e ≤ 1`, to about 2e-7: the series of `2·artanh z`, `z = e/(2 + e) ≤ 1/3`.
#[inline(always)]
fn ln_of_one_and(e: f32) -> f32 {
    let z = e / (2.0 + e);
    let series = [2.0 / 13.0, 2.0 / 11.0, 2.0 / 9.0, 2.0 / 7.0, 2.0 / 5.0, 2.0 / 3.0, 2.0];
    z * series.into_iter().fold(0.0, |sum, c| sum * (z * z) + c)
}

/// Minimum distance of a reading from a plateau for the start, in units of h: at a plateau, the inverse is infinite.
const MARGIN: f32 = 0.01;

pub(super) fn displacement(sensor: &PhysicsSensor, y: f32) -> (f32, f32) {
    let share = ((y - sensor.low) / sensor.height).clamp(MARGIN, 1.0 - MARGIN);
    let ln_sigma = logf(share) / sensor.shape;
    let rest = 1.0 - exp_of_negative(ln_sigma);
    // `rest` may be zero for a curve that is almost a step.
    let q = ln_sigma - logf(rest.max(f32::MIN_POSITIVE));
    (q, sensor.height * sensor.shape * share * rest)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sensor(shape: f32) -> PhysicsSensor {
        PhysicsSensor { low: -0.2, height: 1.3, shape, ..PhysicsSensor::default() }
    }

    #[test]
    fn results_equal_double_precision() {
        for position in -400..=400 {
            let q = f64::from(position) / 8.0;
            for shape in [0.3, 1.0, 2.7] {
                let found = CurveValue::at(&sensor(shape), q as f32);
                let (h, nu) = (f64::from(1.3_f32), f64::from(shape));
                let ln_sigma = q.min(0.0) - libm::log1p(libm::exp(-q.abs()));
                let height = h * libm::exp(nu * ln_sigma);
                let slope = nu * height / (1.0 + libm::exp(q));
                let expected = [height, slope, nu * height * ln_sigma];
                let found = [found.height, found.slope, found.by_shape].map(f64::from);
                for (found, expected) in found.into_iter().zip(expected) {
                    // The power's logarithm has a relative rounding error of 2⁻²⁴, and the power
                    // vanishes beyond about 20; plus a few more roundings.
                    assert!((found - expected).abs() < 3e-6, "{q} {shape}: {found} {expected}");
                }
            }
        }
    }

    #[test]
    fn exponential_and_logarithm_equal_those_of_double_precision() {
        for step in 0..=8_000 {
            let x = -f64::from(step) / 100.0;
            let (found, expected) = (f64::from(exp_of_negative(x as f32)), libm::exp(x));
            // The argument's own rounding error is 2⁻²⁴ relative to it.
            let tolerance = 3e-7 - x * 6e-8;
            assert!((found / expected - 1.0).abs() < tolerance, "{x}: {found:e} {expected:e}");
            let e = f64::from(step) / 8_000.0;
            let (found, expected) = (f64::from(ln_of_one_and(e as f32)), libm::log1p(e));
            assert!((found - expected).abs() < 3e-7 * expected + 1e-12, "{e}: {found} {expected}");
        }
        assert!((0.0..1e-30).contains(&exp_of_negative(-1e30)));
    }

    #[test]
    fn displacement_inverts_the_curve() {
        for q in [-2.0, -0.1, 0.0, 1.3, 3.0] {
            let sensor = sensor(1.7);
            let response = CurveValue::at(&sensor, q);
            let (found, slope) = displacement(&sensor, sensor.low + response.height);
            // 2⁻²⁴ of the response over its slope, which is at least 0.07.
            assert!((found - q).abs() < 1e-5, "{q}: {found}");
            assert!((slope - response.slope).abs() < 1e-5, "{q}: {slope}");
        }
    }

    #[test]
    fn results_far_from_the_curve_are_finite() {
        for shape in [1e-3, 1.0, 1e3] {
            for q in [-1e8, -100.0, 0.0, 100.0, 1e8] {
                let CurveValue { height, slope, by_shape } = CurveValue::at(&sensor(shape), q);
                assert!([height, slope, by_shape].iter().all(|value| value.is_finite()));
            }
            for y in [-1e9, -0.2, 0.0, 1.1, 1e9] {
                let (q, slope) = displacement(&sensor(shape), y);
                assert!(q.is_finite() && slope.is_finite(), "{shape} {y}: {q} {slope}");
            }
        }
    }
}
