//! Evaluation of a sensor's curve for several rows at a time.
//!
//! Additions, multiplications, divisions and square roots are rounded alike on every machine: a row has the same bits
//! in vectors of any width. Loops replace `fold`, whose closure may remain a function without wide vectors.

use std::ops::{Add, Div, Mul, Sub};

use pulp::Simd;

use super::response::{PARAMETERS, SHAPE};

/// Beyond this, `e⁻ˣ` is below a tenth of the last bit of one.
const FAR: f64 = 40.0;

/// Number of squarings in `e⁻ˣ = (e^(−x/256))^256`, for which a short series suffices.
const SQUARINGS: usize = 8;

/// `1/k!` for `k` from 10 to 0. For `|r| ≤ 40/256` the next term is below 4e-17.
const EXP: [f64; 11] =
    shares(1.0, [3628800.0, 362880.0, 40320.0, 5040.0, 720.0, 120.0, 24.0, 6.0, 2.0, 1.0, 1.0]);

/// Series of `2·artanh(z)/z` in `z²`: `2/(2k + 1)`, `k` from 13 to 0. For `z ≤ 1/3` the next term is below 1e-14.
const ARTANH: [f64; 14] =
    shares(2.0, [27.0, 25.0, 23.0, 21.0, 19.0, 17.0, 15.0, 13.0, 11.0, 9.0, 7.0, 5.0, 3.0, 1.0]);

const fn shares<const N: usize>(of: f64, mut by: [f64; N]) -> [f64; N] {
    let mut position = 0;
    while position < N {
        by[position] = of / by[position];
        position += 1;
    }
    by
}

pub(super) const MOST_LANES: usize = 8;

/// One number per row. Every operation is inlined into code for the vectors in use.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lanes<S: Simd>(pub(super) S, pub(super) S::f64s);

impl<S: Simd> Lanes<S> {
    #[inline(always)]
    pub(super) fn splat(simd: S, value: f64) -> Self {
        Self(simd, simd.splat_f64s(value))
    }

    /// Loads the rows of a column from `first` on, as many as a vector holds.
    #[inline(always)]
    pub(super) fn load(simd: S, column: &[f64], first: usize) -> Self {
        Self(simd, S::as_simd_f64s(&column[first..first + S::F64_LANES]).0[0])
    }

    #[inline(always)]
    pub(super) fn store(self, column: &mut [f64], first: usize) {
        S::as_mut_simd_f64s(&mut column[first..first + S::F64_LANES]).0[0] = self.1;
    }

    #[inline(always)]
    pub(super) fn values(self) -> [f64; MOST_LANES] {
        let mut values = [0.0; MOST_LANES];
        self.store(&mut values, 0);
        values
    }

    #[inline(always)]
    pub(super) fn sqrt(self) -> Self {
        Self(self.0, self.0.sqrt_f64s(self.1))
    }

    #[inline(always)]
    pub(super) fn min(self, most: f64) -> Self {
        Self(self.0, self.0.min_f64s(self.1, self.0.splat_f64s(most)))
    }

    #[inline(always)]
    pub(super) fn max(self, least: f64) -> Self {
        Self(self.0, self.0.max_f64s(self.1, self.0.splat_f64s(least)))
    }

    #[inline(always)]
    pub(super) fn is_below(self, limit: f64) -> S::m64s {
        self.0.less_than_f64s(self.1, self.0.splat_f64s(limit))
    }

    #[inline(always)]
    pub(super) fn is_positive(self) -> S::m64s {
        self.0.greater_than_f64s(self.1, self.0.splat_f64s(0.0))
    }

    #[inline(always)]
    pub(super) fn replaced(self, mask: S::m64s, other: Self) -> Self {
        Self(self.0, self.0.select_f64s(mask, other.1, self.1))
    }
}

/// Operators with other lanes, and with one number for all rows.
macro_rules! operators {
    ($($Operator:ident $method:ident $vectors:ident)*) => {$(
        impl<S: Simd> $Operator for Lanes<S> {
            type Output = Self;

            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self(self.0, self.0.$vectors(self.1, other.1))
            }
        }

        impl<S: Simd> $Operator<f64> for Lanes<S> {
            type Output = Self;

            #[inline(always)]
            fn $method(self, other: f64) -> Self {
                self.$method(Self::splat(self.0, other))
            }
        }
    )*};
}

operators!(Add add add_f64s Sub sub sub_f64s Mul mul mul_f64s Div div div_f64s);

/// Adds the rows from `first` on to their lanes of a sum.
#[inline(always)]
pub(super) fn add_rows<S: Simd>(sums: &mut [f64; MOST_LANES], first: usize, rows: Lanes<S>) {
    let lane = first % MOST_LANES;
    (rows + Lanes::load(rows.0, sums, lane)).store(sums, lane);
}

/// `start + aᵀx`, over the length of the shorter slice.
#[inline(always)]
pub(super) fn linear<S: Simd>(start: f64, a: &[f64], x: &[Lanes<S>]) -> Lanes<S> {
    let mut sum = Lanes::splat(x[0].0, start);
    for (&a, &x) in a.iter().zip(x) {
        sum = x * a + sum;
    }
    sum
}

/// `gᵀCg`, at least zero. `rows` are the rows of `C`, which may end early.
#[inline(always)]
pub(super) fn quadratic_form<'a, S: Simd>(
    g: &[Lanes<S>; PARAMETERS],
    rows: impl Iterator<Item = &'a [f64]>,
) -> Lanes<S> {
    let mut sum = Lanes::splat(g[0].0, 0.0);
    for (&gi, row) in g.iter().zip(rows) {
        sum = gi * linear(0.0, row, g) + sum;
    }
    sum.max(0.0)
}

/// [`Response`](crate::response::Response) in lanes: the response minus `lo`, and its derivatives.
#[derive(Clone, Copy, Debug)]
pub(super) struct LaneResponse<S: Simd> {
    /// `y − lo`, which is also the derivative with respect to ln h.
    pub(super) height: Lanes<S>,
    /// `dy/dq`.
    pub(super) slope: Lanes<S>,
    pub(super) by_shape: Lanes<S>,
}

impl<S: Simd> LaneResponse<S> {
    /// Evaluates the curves at the displacements `q`, to some 1e-13 of `h`.
    #[inline(always)]
    pub(super) fn at(q: Lanes<S>, h: f64, nu: f64) -> Self {
        let simd = q.0;
        let e = exp_of_negative(Lanes(simd, simd.abs_f64s(q.1)));
        let below = Lanes::splat(simd, 1.0) / (e + 1.0);
        // 1 − σ(q).
        let rest = (e * below).replaced(q.is_below(0.0), below);
        let minus_ln_sigma = ln_of_one_and(e) - q.min(0.0);
        let height = exp_of_negative(minus_ln_sigma * nu) * h;
        let by_nu = height * nu;
        let by_shape = by_nu * minus_ln_sigma;
        Self { height, slope: by_nu * rest, by_shape: Lanes(simd, simd.neg_f64s(by_shape.1)) }
    }

    /// `dy/dp` for every parameter, at the wrench that `x` begins with.
    #[inline(always)]
    pub(super) fn gradient(&self, x: &[Lanes<S>]) -> [Lanes<S>; PARAMETERS] {
        let mut gradient = [self.slope; PARAMETERS];
        for (g, &x) in gradient[1..SHAPE].iter_mut().zip(x) {
            *g = self.slope * x;
        }
        let one = Lanes::splat(self.slope.0, 1.0);
        gradient[SHAPE..].copy_from_slice(&[one, self.height, self.by_shape]);
        gradient
    }
}

/// `e⁻ˣ` for `x ≥ 0`.
#[inline(always)]
fn exp_of_negative<S: Simd>(x: Lanes<S>) -> Lanes<S> {
    let share = -1.0 / (1_u32 << SQUARINGS) as f64;
    let mut power = polynomial(x.min(FAR) * share, &EXP);
    for _ in 0..SQUARINGS {
        power = power * power;
    }
    power
}

/// `ln(1 + e)` for `0 ≤ e ≤ 1`.
#[inline(always)]
fn ln_of_one_and<S: Simd>(e: Lanes<S>) -> Lanes<S> {
    let z = e / (e + 2.0);
    z * polynomial(z * z, &ARTANH)
}

/// Polynomial with these coefficients, highest power first.
#[inline(always)]
fn polynomial<S: Simd, const N: usize>(x: Lanes<S>, coefficients: &[f64; N]) -> Lanes<S> {
    let mut sum = Lanes::splat(x.0, coefficients[0]);
    for &c in &coefficients[1..] {
        sum = sum * x + c;
    }
    sum
}

#[cfg(test)]
mod tests {
    use pulp::WithSimd;
    use shell_data::instructions::arch;

    use super::*;
    use crate::response::Response;

    struct At {
        q: f64,
        h: f64,
        nu: f64,
    }

    impl WithSimd for At {
        type Output = [f64; 3];

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) -> [f64; 3] {
            let found = LaneResponse::at(Lanes::splat(simd, self.q), self.h, self.nu);
            [found.height, found.slope, found.by_shape].map(|lanes| lanes.values()[0])
        }
    }

    #[test]
    fn lanes_agree_with_the_library_s_functions_and_with_any_width() {
        for position in -400..=400 {
            let q = f64::from(position) / 8.0;
            for nu in [0.3, 1.0, 2.7] {
                let found = arch().dispatch(At { q, h: 1.3, nu });
                let expected = Response::at_displacement(q, 0.0, 1.3, nu);
                // The derivative with respect to ln ν is the last of the gradient.
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
