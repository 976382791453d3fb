//! Inner loops in double-double arithmetic, heads and tails in columns of their own.
//!
//! Compiled for the widest vectors that the machine has, as those of
//! [`vectors`](crate::vectors).

use pulp::Simd;

use crate::double_double::{DoubleDouble, two_product, two_sum};
use shell_data::vectorised;

/// Sums carried side by side: a vector of them, so that the operations of one term hide how long each takes.
pub(super) const LANES: usize = 8;

/// A column in double-double. No tails stand for zeros.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wide<'a> {
    pub(super) heads: &'a [f64],
    pub(super) tails: &'a [f64],
}

/// A sum in double-double while terms are added, in lanes.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct LaneSums {
    heads: [f64; LANES],
    tails: [f64; LANES],
}

impl LaneSums {
    /// The sum.
    pub(super) fn total(mut self) -> DoubleDouble {
        let mut count = LANES / 2;
        while count > 0 {
            for lane in 0..count {
                self.add(lane, self.heads[lane + count], self.tails[lane + count]);
            }
            count /= 2;
        }
        DoubleDouble::from_sum(self.heads[0], self.tails[0])
    }

    /// Adds other sums.
    pub(super) fn merge(&mut self, other: &Self) {
        (0..LANES).for_each(|lane| self.add(lane, other.heads[lane], other.tails[lane]));
    }

    #[inline(always)]
    fn add(&mut self, lane: usize, head: f64, tail: f64) {
        let (sum, lost) = two_sum(self.heads[lane], head);
        self.heads[lane] = sum;
        self.tails[lane] += lost + tail;
    }

    /// Adds `xᵀy`.
    #[inline(always)]
    fn add_product<S: Simd>(&mut self, simd: S, x: Wide<'_>, y: Wide<'_>) {
        match (x.tails.is_empty(), y.tails.is_empty()) {
            (true, true) => self.add_terms::<S, false, false>(simd, x, y),
            (false, true) => self.add_terms::<S, true, false>(simd, x, y),
            (true, false) => self.add_terms::<S, true, false>(simd, y, x),
            (false, false) => self.add_terms::<S, true, true>(simd, x, y),
        }
    }

    #[inline(always)]
    fn add_terms<S: Simd, const X: bool, const Y: bool>(
        &mut self,
        simd: S,
        x: Wide<'_>,
        y: Wide<'_>,
    ) {
        let n = x.heads.len();
        // Equal lengths, said once, spare the checks inside.
        assert!(y.heads.len() == n && (!X || x.tails.len() == n) && (!Y || y.tails.len() == n));
        let whole = n - n % LANES;
        let [x_heads, y_heads] = [x.heads, y.heads].map(|heads| S::as_simd_f64s(&heads[..whole]).0);
        let [x_tails, y_tails] = [(x.tails, X), (y.tails, Y)]
            .map(|(tails, is_there)| S::as_simd_f64s(&tails[..if is_there { whole } else { 0 }]).0);
        let heads = S::as_mut_simd_f64s(&mut self.heads).0;
        let tails = S::as_mut_simd_f64s(&mut self.tails).0;
        let of_lanes = heads.len();
        for (lanes, (head, tail)) in heads.iter_mut().zip(tails).enumerate() {
            let (mut sum, mut rest) = (*head, *tail);
            for i in (lanes..x_heads.len()).step_by(of_lanes) {
                let (a, b) = (x_heads[i], y_heads[i]);
                let product = simd.mul_f64s(a, b);
                let mut error = simd.mul_add_f64s(a, b, simd.neg_f64s(product));
                if X {
                    error = simd.mul_add_f64s(x_tails[i], b, error);
                }
                if Y {
                    error = simd.mul_add_f64s(a, y_tails[i], error);
                }
                // The sum of two numbers, and what rounding it loses.
                let next = simd.add_f64s(sum, product);
                let added = simd.sub_f64s(next, sum);
                let of_sum = simd.sub_f64s(sum, simd.sub_f64s(next, added));
                let lost = simd.add_f64s(of_sum, simd.sub_f64s(product, added));
                rest = simd.add_f64s(rest, simd.add_f64s(lost, error));
                sum = next;
            }
            (*head, *tail) = (sum, rest);
        }
        for i in whole..n {
            let (product, mut error) = two_product(x.heads[i], y.heads[i]);
            if X {
                error = x.tails[i].mul_add(y.heads[i], error);
            }
            if Y {
                error = x.heads[i].mul_add(y.tails[i], error);
            }
            self.add(i - whole, product, error);
        }
    }
}

/// `xᵀy` as if computed in double-double and rounded last: compensated summation (Ogita, Rump and
/// Oishi, SIAM J. Sci. Comput. 26, 2005, algorithm Dot2) in [`LANES`] sums.
pub(super) fn dot(x: Wide<'_>, y: Wide<'_>) -> DoubleDouble {
    let mut sum = LaneSums::default();
    add_products(std::slice::from_mut(&mut sum), &[x], y);
    sum.total()
}

vectorised! {
    /// Adds `xᵀy` to the sum of each `x`.
    pub(super) fn add_products<S: Simd>(simd: S, sums: &mut [LaneSums], x: &[Wide<'_>], y: Wide<'_>) {
        sums.iter_mut().zip(x).for_each(|(sum, &x)| sum.add_product(simd, x, y));
    }
}

vectorised! {
    /// `y += c·x`, each element with a relative error of a few 2⁻¹⁰⁵ of `|y| + |c·x|`.
    pub(super) fn add_multiple(
        heads: &mut [f64],
        tails: &mut [f64],
        c: DoubleDouble,
        x: Wide<'_>,
    ) {
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
