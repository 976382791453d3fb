//! The low-pass kernel: a sinc under a Kaiser window, optionally averaged over an exposure.
//!
//! ```text
//! h(x) = 2 f_c sinc(2 f_c x) · I₀(β √(1 − (x/L)²)) / I₀(β)      |x| ≤ L
//! ```
//!
//! β and L follow from the stopband attenuation and the width of the transition (Kaiser 1974;
//! Oppenheim & Schafer, Discrete-Time Signal Processing, 3rd ed., eqs 7.75 and 7.76). The kernel is
//! symmetric, so it delays nothing.

use std::f64::consts::PI;

/// Attenuation from the end of the transition on, dB.
pub(crate) const STOPBAND_DB: f64 = 80.0;
/// Half of the transition, as a fraction of the rate that the output is sampled at.
const HALF_TRANSITION: f64 = 0.1;
/// Table entries per unit of 1/(2 f_c): linear interpolation errs by (π/512)²/8 = 5e-6, −106 dB.
const PER_LOBE: f64 = 512.0;

/// A symmetric low-pass kernel, in 1/s, tabulated.
#[derive(Clone, Debug)]
pub struct Kernel {
    /// The kernel is zero beyond this distance, s.
    pub(crate) half_width_s: f64,
    per_s: f64,
    table: Vec<f64>,
}

impl Kernel {
    /// For an output sampled `rate_hz` times per second: passes frequencies up to 0.3 times the
    /// rate unchanged, halves those at 0.4, and stops those above half of it by `stopband_db`, of
    /// at least 50; the passband is as flat. `exposure_s` > 0 averages over that time on top.
    pub fn new(rate_hz: f64, exposure_s: f64, stopband_db: f64) -> Self {
        let cutoff_hz = (0.5 - HALF_TRANSITION) * rate_hz;
        let transition_hz = 2.0 * HALF_TRANSITION * rate_hz;
        let beta = 0.1102 * (stopband_db - 8.7);
        let width_s = (stopband_db - 7.95) / (2.285 * 2.0 * PI * transition_hz);
        let half_s = 0.5 * width_s;
        let sinc = |x_s: f64| {
            let within = 1.0 - (x_s / half_s) * (x_s / half_s);
            if within < 0.0 {
                return 0.0;
            }
            let phase = 2.0 * PI * cutoff_hz * x_s;
            let sinc = if phase.abs() < 1e-8 { 1.0 } else { phase.sin() / phase };
            2.0 * cutoff_hz * sinc * bessel_i0(beta * within.sqrt()) / bessel_i0(beta)
        };
        let half_width_s = half_s + 0.5 * exposure_s;
        let per_s = PER_LOBE * 2.0 * cutoff_hz;
        let entries = (half_width_s * per_s).ceil() as usize + 2;
        // The exposure is averaged by the midpoint rule, fine against the lobes of the kernel.
        let parts = (exposure_s * 2.0 * cutoff_hz * 64.0).ceil().clamp(1.0, 4096.0) as usize;
        let value = |x_s: f64| {
            let part = |i: usize| x_s + exposure_s * ((i as f64 + 0.5) / parts as f64 - 0.5);
            (0..parts).map(|i| sinc(part(i))).sum::<f64>() / parts as f64
        };
        let table = (0..entries).map(|i| value(i as f64 / per_s)).collect();
        Self { half_width_s, per_s, table }
    }

    /// The kernel at a distance of at most `half_width_s` either way, 1/s.
    #[inline]
    pub fn at(&self, distance_s: f64) -> f64 {
        let position = distance_s.abs() * self.per_s;
        let index = (position as usize).min(self.table.len() - 2);
        let (a, b) = (self.table[index], self.table[index + 1]);
        a + (b - a) * (position - index as f64)
    }
}

/// The modified Bessel function of order 0, by its power series (all terms positive).
fn bessel_i0(x: f64) -> f64 {
    let quarter = 0.25 * x * x;
    let (mut term, mut sum) = (1.0, 1.0);
    for k in 1..200 {
        term *= quarter / f64::from(k * k);
        sum += term;
        if term < 1e-17 * sum {
            break;
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The kernel's gain at a frequency, by the trapezoidal rule over fine steps.
    fn gain(kernel: &Kernel, frequency_hz: f64) -> f64 {
        let steps = 200_000;
        let step_s = 2.0 * kernel.half_width_s / f64::from(steps);
        let x = |i: i32| f64::from(i) * step_s - kernel.half_width_s;
        let term = |i| kernel.at(x(i)) * (2.0 * PI * frequency_hz * x(i)).cos() * step_s;
        (0..=steps).map(term).sum()
    }

    #[test]
    fn bessel_function_has_its_tabulated_values() {
        // Abramowitz & Stegun, table 9.8: e⁻ˣ I₀(x) at 1, 5 and 10.
        for (x, scaled) in [(1.0, 0.465_759_6), (5.0, 0.183_540_8), (10.0, 0.127_833_3_f64)] {
            assert!((bessel_i0(x) * (-x).exp() - scaled).abs() < 1e-7, "{x}");
        }
    }

    #[test]
    fn passes_the_band_halves_the_cutoff_and_stops_the_rest() {
        for db in [50.0, 80.0] {
            let kernel = Kernel::new(100.0, 0.0, db);
            // The table's own error is 5e-6.
            let ripple = 1.3 * 10.0_f64.powf(-db / 20.0) + 5e-6;
            for frequency_hz in [0.0, 3.0, 11.0, 20.0, 29.9] {
                assert!((gain(&kernel, frequency_hz) - 1.0).abs() < ripple, "{frequency_hz}");
            }
            assert!((gain(&kernel, 40.0) - 0.5).abs() < 1e-3);
            for frequency_hz in [50.1, 55.0, 73.0, 120.0, 400.0] {
                assert!(gain(&kernel, frequency_hz).abs() < ripple, "{frequency_hz}");
            }
        }
    }

    #[test]
    fn an_exposure_averages_on_top() {
        let (plain, averaged) = (Kernel::new(100.0, 0.0, 80.0), Kernel::new(100.0, 8e-3, 80.0));
        for frequency_hz in [0.0, 10.0, 25.0] {
            let phase = PI * frequency_hz * 8e-3;
            let sinc = if phase == 0.0 { 1.0 } else { phase.sin() / phase };
            let expected = gain(&plain, frequency_hz) * sinc;
            assert!((gain(&averaged, frequency_hz) - expected).abs() < 2e-4, "{frequency_hz}");
        }
    }
}
