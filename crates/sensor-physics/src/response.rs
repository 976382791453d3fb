//! Response of one sensor to a wrench, and its derivatives with respect to the parameters.
//!
//! ```text
//! y = lo + h·σ(q)^ν      q = b + aᵀx      σ(q) = 1/(1 + e⁻ᵠ)
//! ```
//!
//! The displacement `q` of the reflector is linear in the wrench. The response of a reflective
//! photointerrupter to it is monotone between two flat ends, which ν makes different (Richards, J.
//! Exp. Botany 10, 1959, with Q = 1). `h` and `ν` are positive and stored as logarithms. `y` and
//! `x` are dimensionless, in the scales of the model. `exp` and `ln` come from `libm`, which gives
//! the same bits on every machine.

use shell_data::wrench::PerAxis;

/// Parameters of a sensor: b, a (six), lo, ln h, ln ν.
pub const PARAMETERS: usize = 10;

pub type Parameters = [f64; PARAMETERS];

/// Index of b.
pub(super) const OFFSET: usize = 0;
/// Index of lo; ln h and ln ν follow.
pub(super) const SHAPE: usize = 7;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Response {
    /// `y`.
    pub value: f64,
    /// `dy/dq`.
    pub slope: f64,
    /// `y − lo`, which is also the derivative with respect to ln h.
    height: f64,
    by_shape: f64,
}

impl Response {
    /// Response of a sensor with parameters `p` to the wrench `x`.
    #[inline]
    pub fn at(p: &Parameters, x: &PerAxis<f64>) -> Self {
        let q = (0..6).fold(p[OFFSET], |q, axis| p[1 + axis].mul_add(x[axis], q));
        let (h, nu) = (libm::exp(p[SHAPE + 1]), libm::exp(p[SHAPE + 2]));
        Self::at_displacement(q, p[SHAPE], h, nu)
    }

    #[inline]
    pub(super) fn at_displacement(q: f64, lo: f64, h: f64, nu: f64) -> Self {
        // e^(−|q|) never overflows; beyond 40 the curve is flat to the last bit of its height.
        let e = libm::exp(-q.abs().min(700.0));
        let ln_sigma = q.min(0.0) - libm::log1p(e);
        // 1 − σ(q).
        let rest = if q >= 0.0 { e / (1.0 + e) } else { 1.0 / (1.0 + e) };
        let height = h * libm::exp(nu * ln_sigma);
        Self {
            value: lo + height,
            slope: nu * height * rest,
            height,
            by_shape: nu * height * ln_sigma,
        }
    }

    /// `dy/dp` for every parameter.
    #[inline]
    pub fn gradient(&self, x: &PerAxis<f64>) -> Parameters {
        let s = self.slope;
        let by = |axis: usize| s * x[axis];
        [s, by(0), by(1), by(2), by(3), by(4), by(5), 1.0, self.height, self.by_shape]
    }
}

/// Moves the parameters by one step. h and ν change at most by a factor of e: beyond, the linear
/// approximation fails.
pub(super) fn move_by<'a>(parameters: impl IntoIterator<Item = &'a mut Parameters>, step: &[f64]) {
    for (p, step) in parameters.into_iter().zip(step.as_chunks::<PARAMETERS>().0) {
        for (position, (p, step)) in p.iter_mut().zip(step).enumerate() {
            *p += if position > SHAPE { step.clamp(-1.0, 1.0) } else { *step };
        }
    }
}

/// Displacement at which the response is `y`, and the slope there. `y` is kept `margin·h` away from the flat ends,
/// where the inverse is infinite.
#[inline]
pub(super) fn displacement(y: f64, lo: f64, h: f64, nu: f64, margin: f64) -> (f64, f64) {
    let share = ((y - lo) / h).clamp(margin, 1.0 - margin);
    let ln_sigma = libm::log(share) / nu;
    let sigma = libm::exp(ln_sigma);
    // 1 − σ without cancellation where σ is nearly 1.
    let rest = -libm::expm1(ln_sigma);
    (ln_sigma - libm::log(rest), h * nu * share * (1.0 - sigma))
}

/// Largest number of factors: more than two did not improve held-out groups in any recording tried.
pub const FACTORS: usize = 2;

/// Displacement of a sensor per factor, each with variance 1.
pub type Loadings = [f64; FACTORS];

pub(super) fn factor_count<'a>(loadings: impl IntoIterator<Item = &'a Loadings> + Clone) -> usize {
    let is_used = |&factor: &usize| loadings.clone().into_iter().any(|c| c[factor] != 0.0);
    (0..FACTORS).rev().find(is_used).map_or(0, |last| last + 1)
}

/// Adds a sensor to `M = I + LᵀL/v` and `Lᵀr/v`, where `loading` is its row of `L = D·C`.
pub(super) fn add_factors(
    m: &mut [Loadings; FACTORS],
    pull: &mut Loadings,
    loading: Loadings,
    (residual, variance): (f64, f64),
) {
    for k in 0..FACTORS {
        let weighted = loading[k] / variance;
        pull[k] += weighted * residual;
        (0..FACTORS).for_each(|l| m[k][l] += weighted * loading[l]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const P: Parameters = [0.3, 0.5, -1.2, 0.7, 0.1, -0.4, 0.9, -0.05, 0.1, -0.3];

    #[test]
    fn gradient_equals_that_of_central_differences() {
        for x in [[0.0; 6], [0.3, -0.8, 1.1, 0.2, -0.5, 0.4], [-3.0, 2.0, 1.0, -1.0, 2.0, -2.0]] {
            let gradient = Response::at(&P, &x).gradient(&x);
            for position in 0..PARAMETERS {
                let step = 1e-5;
                let (mut up, mut down) = (P, P);
                up[position] += step;
                down[position] -= step;
                let rise = Response::at(&up, &x).value - Response::at(&down, &x).value;
                // Third derivatives of order 1 times step², and rounding 1e-16/step.
                let error = (rise / (2.0 * step) - gradient[position]).abs();
                assert!(error < 1e-9, "{position}: {error:e}");
            }
        }
    }

    #[test]
    fn the_plateaus_are_finite_and_flat() {
        for q in [-1e6, -800.0, 800.0, 1e6] {
            let response = Response::at_displacement(q, 0.1, 0.8, 0.7);
            let plateau = if q < 0.0 { 0.1 } else { 0.9 };
            assert!((response.value - plateau).abs() < 1e-12, "{q}: {response:?}");
            assert!(response.slope.abs() < 1e-12 && response.by_shape.is_finite());
        }
    }

    #[test]
    fn displacement_inverts_the_curve() {
        for q in [-2.0, -0.1, 0.0, 1.3, 4.0] {
            let response = Response::at_displacement(q, -0.2, 1.3, 1.7);
            let (found, slope) = displacement(response.value, -0.2, 1.3, 1.7, 1e-3);
            assert!((found - q).abs() < 1e-12 && (slope - response.slope).abs() < 1e-12, "{q}");
        }
    }
}
