//! Six linear equations in six unknowns.
#![expect(clippy::reversed_empty_ranges, reason = "at the ends of a triangle there is nothing")]
#![expect(clippy::needless_range_loop, reason = "indices as in the formulas")]

use shared_proto::{AXES, PRIOR};

pub(super) type X = [f32; AXES];

/// Repeats `$body` for each constant `$index`. The compiler does not unroll loops over triangles,
/// which take four times as long on this core.
macro_rules! unrolled {
    ($index:ident in $($value:literal)* => $body:block) => {
        $( {
            const $index: usize = $value;
            $body
        } )*
    };
}

pub(super) use unrolled;

/// The lower triangle of a symmetric matrix, row by row.
pub(super) type Triangle = [f32; PRIOR];

/// `P·x`.
#[inline(always)]
pub(super) fn product(p: &Triangle, x: &X) -> X {
    let mut product = [0.0; AXES];
    unrolled!(I in 0 1 2 3 4 5 => {
        for j in 0..I {
            product[I] += p[row(I) + j] * x[j];
            product[j] += p[row(I) + j] * x[I];
        }
        product[I] += p[row(I) + I] * x[I];
    });
    product
}

/// The equations `A·x = b` with a positive definite `A`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Equations {
    a: Triangle,
    pub(super) b: X,
}

impl Equations {
    /// Starts with the prior's precision as `A`, and `b`.
    #[inline(always)]
    pub(super) fn new(prior: &Triangle, b: X) -> Self {
        Self { a: *prior, b }
    }

    /// `A += weight·g·gᵀ`, `b += pull·g`.
    #[inline(always)]
    pub(super) fn add(&mut self, gains: &X, weight: f32, pull: f32) {
        unrolled!(I in 0 1 2 3 4 5 => {
            self.b[I] += pull * gains[I];
            let weighted = weight * gains[I];
            for j in 0..=I {
                self.a[row(I) + j] += weighted * gains[j];
            }
        });
    }

    /// Solves by `A = L·D·Lᵀ` (Golub & Van Loan, 4th ed., §4.1.2); `None` unless positive definite.
    #[inline(never)]
    pub(super) fn solve(&self) -> Option<X> {
        let mut a = self.a;
        let (mut x, mut inverse) = (self.b, [0.0; AXES]);
        unrolled!(J in 0 1 2 3 4 5 => {
            let pivot = a[row(J) + J];
            if !(pivot > 0.0 && pivot.is_finite()) {
                return None;
            }
            inverse[J] = 1.0 / pivot;
            // Column J holds L·D as long as the rows below need it.
            unrolled!(I in 1 2 3 4 5 => {
                if I > J {
                    let factor = a[row(I) + J] * inverse[J];
                    for k in J + 1..=I {
                        a[row(I) + k] -= factor * a[row(k) + J];
                    }
                    x[I] -= factor * x[J];
                }
            });
        });
        unrolled!(I in 5 4 3 2 1 0 => {
            for k in I + 1..AXES {
                // Uses L·D, since x is still D·x here.
                x[I] -= a[row(k) + I] * x[k];
            }
            x[I] *= inverse[I];
        });
        x.iter().all(|value| value.is_finite()).then_some(x)
    }
}

pub(super) const fn row(i: usize) -> usize {
    i * (i + 1) / 2
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_known_solution_is_recovered() {
        let mut equations = Equations::new(&[0.0; PRIOR], [0.0; AXES]);
        let truth = [1.0, -2.0, 0.5, 3.0, 0.25, -0.75];
        for sensor in 0..8 {
            let gains: X = core::array::from_fn(|axis| ((sensor * 5 + axis * 3) % 7) as f32 - 3.0);
            let dot: f32 = gains.iter().zip(truth).map(|(gain, x)| gain * x).sum();
            equations.add(&gains, 2.0, 2.0 * dot);
        }
        let solution = equations.solve().unwrap();
        for (found, truth) in solution.into_iter().zip(truth) {
            // 2⁻²⁴ times a condition number below 1000.
            assert!((found - truth).abs() < 1e-4, "{found} {truth}");
        }
    }

    #[test]
    fn singular_equations_have_no_solution() {
        assert_eq!(Equations::new(&[0.0; PRIOR], [1.0; AXES]).solve(), None);
        assert_eq!(Equations::new(&[f32::NAN; PRIOR], [1.0; AXES]).solve(), None);
        let mut tiny = [0.0; PRIOR];
        (0..AXES).for_each(|i| tiny[row(i) + i] = 1e-38);
        assert_eq!(Equations::new(&tiny, [1e30; AXES]).solve(), None);
    }
}
