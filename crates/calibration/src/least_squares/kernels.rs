//! Inner loops in double-double arithmetic, heads and tails in columns of their own.
//!
//! Compiled for the widest vectors that the machine has, as those of
//! [`vectors`](crate::vectors).

use pulp::{Simd, WithSimd};

use crate::double_double::{DoubleDouble, two_product, two_sum};
use shell_data::instructions::arch;

/// Sums carried side by side: enough to hide how long one addition takes.
pub(super) const LANES: usize = 16;

/// A column in double-double. No tails stand for zeros.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wide<'a> {
    pub(super) heads: &'a [f64],
    pub(super) tails: &'a [f64],
}

/// `xᵀy` as if computed in double-double and rounded last: compensated summation (Ogita, Rump and
/// Oishi, SIAM J. Sci. Comput. 26, 2005, algorithm Dot2) in [`LANES`] sums.
pub(super) fn dot(x: Wide<'_>, y: Wide<'_>) -> DoubleDouble {
    arch().dispatch(CompensatedDot { x, y })
}

struct CompensatedDot<'a> {
    x: Wide<'a>,
    y: Wide<'a>,
}

impl WithSimd for CompensatedDot<'_> {
    type Output = DoubleDouble;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> DoubleDouble {
        let Self { x, y } = self;
        match (x.tails.is_empty(), y.tails.is_empty()) {
            (true, true) => lanes::<false, false>(x, y),
            (false, true) => lanes::<true, false>(x, y),
            (true, false) => lanes::<true, false>(y, x),
            (false, false) => lanes::<true, true>(x, y),
        }
    }
}

#[inline(always)]
fn lanes<const X: bool, const Y: bool>(x: Wide<'_>, y: Wide<'_>) -> DoubleDouble {
    let (mut heads, mut tails) = ([0.0; LANES], [0.0; LANES]);
    let n = x.heads.len();
    let term = |i: usize, head: &mut f64, tail: &mut f64| {
        let (product, mut error) = two_product(x.heads[i], y.heads[i]);
        if X {
            error += x.tails[i] * y.heads[i];
        }
        if Y {
            error += x.heads[i] * y.tails[i];
        }
        let (sum, lost) = two_sum(*head, product);
        *head = sum;
        *tail += lost + error;
    };
    // Equal lengths, said once, spare the checks inside.
    assert!(y.heads.len() == n && (!X || x.tails.len() == n) && (!Y || y.tails.len() == n));
    let whole = n - n % LANES;
    for start in (0..whole).step_by(LANES) {
        for lane in 0..LANES {
            term(start + lane, &mut heads[lane], &mut tails[lane]);
        }
    }
    for i in whole..n {
        term(i, &mut heads[i - whole], &mut tails[i - whole]);
    }
    let mut count = LANES / 2;
    while count > 0 {
        for lane in 0..count {
            let (sum, lost) = two_sum(heads[lane], heads[lane + count]);
            heads[lane] = sum;
            tails[lane] += tails[lane + count] + lost;
        }
        count /= 2;
    }
    DoubleDouble::from_sum(heads[0], tails[0])
}

/// `y += c·x`, each element with a relative error of a few 2⁻¹⁰⁵ of `|y| + |c·x|`.
pub(super) fn add_multiple(heads: &mut [f64], tails: &mut [f64], c: DoubleDouble, x: Wide<'_>) {
    arch().dispatch(CompensatedAdd { heads, tails, c, x });
}

struct CompensatedAdd<'a> {
    heads: &'a mut [f64],
    tails: &'a mut [f64],
    c: DoubleDouble,
    x: Wide<'a>,
}

impl WithSimd for CompensatedAdd<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { heads, tails, c, x } = self;
        let y = heads.iter_mut().zip(tails).zip(x.heads);
        if x.tails.is_empty() {
            y.for_each(|((head, tail), &x)| add(head, tail, c, x, 0.0));
        } else {
            y.zip(x.tails).for_each(|(((head, tail), &x), &rest)| add(head, tail, c, x, rest));
        }
    }
}

#[inline(always)]
fn add(head: &mut f64, tail: &mut f64, c: DoubleDouble, x: f64, x_tail: f64) {
    let (product, error) = two_product(x, c.to_f64());
    let cross = x.mul_add(c.tail(), x_tail * c.to_f64());
    let (sum, lost) = two_sum(*head, product);
    let rest = lost + (error + cross + *tail);
    *head = sum + rest;
    *tail = rest - (*head - sum);
}
