//! The curve of a sensor, several rows at a time.
//!
//! Additions, multiplications, divisions and square roots alone: these are
//! rounded alike on every machine, so a row has the same bits in vectors of any width.
//!
//! Loops and not `fold`: its closure may stay a function of its own, without wide vectors, as in
//! [`vectors`](crate::vectors).

use pulp::Simd;

use super::response::{PARAMETERS, SHAPE};

/// Beyond this, `e⁻ˣ` is below a tenth of the last bit of one.
const FAR: f64 = 40.0;

/// Squarings in `e⁻ˣ = (e^(−x/256))^256`, with which a short series does.
const SQUARINGS: usize = 8;

/// `1/k!` for `k` from 10 to 0. For `|r| ≤ 40/256` the next term is below 4e-17.
const EXP: [f64; 11] = [
    1.0 / 3_628_800.0,
    1.0 / 362_880.0,
    1.0 / 40_320.0,
    1.0 / 5_040.0,
    1.0 / 720.0,
    1.0 / 120.0,
    1.0 / 24.0,
    1.0 / 6.0,
    0.5,
    1.0,
    1.0,
];

/// `2/(2k + 1)` for `k` from 13 to 0, the series of `2·artanh(z)/z` in `z²`. For `z ≤ 1/3` the next
/// term is below 1e-14.
const ARTANH: [f64; 14] = [
    2.0 / 27.0,
    2.0 / 25.0,
    2.0 / 23.0,
    2.0 / 21.0,
    2.0 / 19.0,
    2.0 / 17.0,
    2.0 / 15.0,
    2.0 / 13.0,
    2.0 / 11.0,
    2.0 / 9.0,
    2.0 / 7.0,
    2.0 / 5.0,
    2.0 / 3.0,
    2.0,
];

/// The most rows in a vector.
pub(super) const MOST_LANES: usize = 8;

/// The values of a vector, and then zeros.
#[inline(always)]
pub(super) fn store<S: Simd>(vector: S::f64s) -> [f64; MOST_LANES] {
    let mut values = [0.0; MOST_LANES];
    store_rows::<S>(&mut values, 0, vector);
    values
}

/// The rows of a column from `first` on, as many as a vector holds.
#[inline(always)]
pub(super) fn load_rows<S: Simd>(column: &[f64], first: usize) -> S::f64s {
    S::as_simd_f64s(&column[first..first + S::F64_LANES]).0[0]
}

/// Writes a vector to the rows of a column from `first` on.
#[inline(always)]
pub(super) fn store_rows<S: Simd>(column: &mut [f64], first: usize, rows: S::f64s) {
    S::as_mut_simd_f64s(&mut column[first..first + S::F64_LANES]).0[0] = rows;
}

/// Adds the products of rows from `first` on to the lanes of a sum that those rows belong to.
#[inline(always)]
pub(super) fn add_product<S: Simd>(
    simd: S,
    sums: &mut [f64; MOST_LANES],
    first: usize,
    (a, b): (S::f64s, S::f64s),
) {
    let lane = first % MOST_LANES;
    let sum = load_rows::<S>(sums, lane);
    store_rows::<S>(sums, lane, simd.add_f64s(simd.mul_f64s(a, b), sum));
}

/// `start + aᵀx`, of as many numbers as the shorter has.
#[inline(always)]
pub(super) fn linear<S: Simd>(simd: S, start: f64, a: &[f64], x: &[S::f64s]) -> S::f64s {
    let mut sum = simd.splat_f64s(start);
    for (&a, &x) in a.iter().zip(x) {
        sum = simd.add_f64s(simd.mul_f64s(simd.splat_f64s(a), x), sum);
    }
    sum
}

/// [`Answer`](crate::physics::response::Answer) in lanes: the answer less `lo`, and its derivatives.
#[derive(Clone, Copy, Debug)]
pub(super) struct Answers<S: Simd> {
    /// `y − lo`, also the derivative by ln h.
    pub(super) height: S::f64s,
    /// `dy/dq`.
    pub(super) slope: S::f64s,
    /// The derivative by ln ν.
    pub(super) by_shape: S::f64s,
}

impl<S: Simd> Answers<S> {
    /// At the displacements `q`, to some 1e-13 of `h`.
    #[inline(always)]
    pub(super) fn at(simd: S, q: S::f64s, h: f64, nu: f64) -> Self {
        let (zero, one) = (simd.splat_f64s(0.0), simd.splat_f64s(1.0));
        let e = exp_of_negative(simd, simd.abs_f64s(q));
        let below = simd.div_f64s(one, simd.add_f64s(one, e));
        // 1 − σ(q).
        let is_negative = simd.less_than_f64s(q, zero);
        let rest = simd.select_f64s(is_negative, below, simd.mul_f64s(e, below));
        let minus_ln_sigma = simd.sub_f64s(ln_of_one_and(simd, e), simd.min_f64s(q, zero));
        let nu = simd.splat_f64s(nu);
        let power = exp_of_negative(simd, simd.mul_f64s(nu, minus_ln_sigma));
        let height = simd.mul_f64s(simd.splat_f64s(h), power);
        let by_nu = simd.mul_f64s(nu, height);
        Self {
            height,
            slope: simd.mul_f64s(by_nu, rest),
            by_shape: simd.neg_f64s(simd.mul_f64s(by_nu, minus_ln_sigma)),
        }
    }

    /// `dy/dp` for every parameter, at the wrench that `x` begins with.
    #[inline(always)]
    pub(super) fn gradient(&self, simd: S, x: &[S::f64s]) -> [S::f64s; PARAMETERS] {
        let mut gradient = [self.slope; PARAMETERS];
        for (g, &x) in gradient[1..SHAPE].iter_mut().zip(x) {
            *g = simd.mul_f64s(self.slope, x);
        }
        gradient[SHAPE..].copy_from_slice(&[simd.splat_f64s(1.0), self.height, self.by_shape]);
        gradient
    }
}

/// `e⁻ˣ` for `x ≥ 0`.
#[inline(always)]
fn exp_of_negative<S: Simd>(simd: S, x: S::f64s) -> S::f64s {
    let share = simd.splat_f64s(-1.0 / (1_u32 << SQUARINGS) as f64);
    let r = simd.mul_f64s(simd.min_f64s(x, simd.splat_f64s(FAR)), share);
    let mut power = polynomial(simd, r, &EXP);
    for _ in 0..SQUARINGS {
        power = simd.mul_f64s(power, power);
    }
    power
}

/// `ln(1 + e)` for `0 ≤ e ≤ 1`.
#[inline(always)]
fn ln_of_one_and<S: Simd>(simd: S, e: S::f64s) -> S::f64s {
    let z = simd.div_f64s(e, simd.add_f64s(simd.splat_f64s(2.0), e));
    simd.mul_f64s(z, polynomial(simd, simd.mul_f64s(z, z), &ARTANH))
}

/// The polynomial with these coefficients, that of the highest power first.
#[inline(always)]
fn polynomial<S: Simd, const N: usize>(simd: S, x: S::f64s, coefficients: &[f64; N]) -> S::f64s {
    let mut sum = simd.splat_f64s(coefficients[0]);
    for &c in &coefficients[1..] {
        sum = simd.add_f64s(simd.mul_f64s(sum, x), simd.splat_f64s(c));
    }
    sum
}

#[cfg(test)]
mod tests {
    use pulp::WithSimd;
    use shell_data::instructions::arch;

    use super::*;
    use crate::physics::response::Answer;

    struct At {
        q: f64,
        h: f64,
        nu: f64,
    }

    impl WithSimd for At {
        type Output = [f64; 3];

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) -> [f64; 3] {
            let found = Answers::<S>::at(simd, simd.splat_f64s(self.q), self.h, self.nu);
            [found.height, found.slope, found.by_shape].map(|lanes| store::<S>(lanes)[0])
        }
    }

    #[test]
    fn lanes_agree_with_the_library_s_functions_and_with_any_width() {
        for position in -400..=400 {
            let q = f64::from(position) / 8.0;
            for nu in [0.3, 1.0, 2.7] {
                let found = arch().dispatch(At { q, h: 1.3, nu });
                let expected = Answer::at_displacement(q, 0.0, 1.3, nu);
                // The derivative by ln ν is the last of the gradient.
                let by_shape = expected.gradient(&[0.0; 6])[9];
                let expected = [expected.value, expected.slope, by_shape];
                for (found, expected) in found.iter().zip(expected) {
                    // 256 roundings of the squarings, and series that end at 1e-14.
                    assert!((found - expected).abs() < 1e-12, "{q} {nu}: {found:e} {expected:e}");
                }
                assert_eq!(found, At { q, h: 1.3, nu }.with_simd(pulp::Scalar));
            }
        }
    }
}
