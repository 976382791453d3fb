//! Sums over one block of rows. Columns hold [`ROWS`] small integers: a sum of their products is
//! exact in any order as long as no partial sum exceeds 2⁵³, which callers ensure (see `limbs`).

use pulp::Simd;

use super::integers::power_of_two;
use super::layout::SumLayout;
use super::limbs::Limbs;
use super::limbs::ROWS;
use super::plan::{LimbColumn, OpenSums, SummationPlan};
use crate::features::fill_columns;
use shell_data::vectorised;

#[derive(Clone, Debug, Default)]
pub(crate) struct Scratch {
    features: Vec<f64>,
    wrench: Vec<f64>,
    sums: Vec<f64>,
}

impl Scratch {
    fn resize(&mut self, open: &OpenSums) {
        let plan = &open.plan;
        let lefts = plan.groups.iter().map(|(lefts, _)| lefts.len()).max().unwrap_or(0);
        self.features.resize((plan.rights.len() + lefts) * ROWS, 0.0);
        self.wrench.resize(plan.cross_columns().end * ROWS, 0.0);
        self.sums.resize(open.high.len(), 0.0);
    }
}

vectorised! {
    /// Adds the first `rows` rows of a block to open sums. If the limbs do not cover the wrench, returns false and adds
    /// nothing. `readings` has a column of [`ROWS`] integers per channel; those after the first `rows` are the
    /// channel's centre. `axes` has a column of [`ROWS`] numbers per axis; those after the first `rows` are zero.
    pub(crate) fn sum_block<S: Simd>(
        simd: S,
        layout: &SumLayout,
        open: &mut OpenSums,
        rows: usize,
        readings: &[f64],
        axes: &[f64],
        scratch: &mut Scratch,
    ) -> bool {
        scratch.resize(open);
        let plan = &*open.plan;
        let Scratch { features, wrench, sums } = scratch;
        if !cut_wrench(plan, axes, wrench) {
            return false;
        }
        let last = plan.cross_columns().end - 1;
        for ones in [&mut wrench[last * ROWS..][..ROWS], &mut features[..ROWS]] {
            ones[..rows].fill(1.0);
            ones[rows..].fill(0.0);
        }
        // Each feature starts at the column of its first right operand.
        let place = |f: usize| plan.firsts[f] * ROWS;
        let reading = |c: usize| (&readings[c * ROWS..][..ROWS], plan.centre[c] as f64, 1.0);
        fill_columns(&layout.recipe, features, ROWS, place, reading);
        cut_rights(plan, features);

        let mut rest = &mut sums[..];
        for (lefts, group) in &plan.groups {
            cut_lefts(plan, lefts, features);
            let right = &features[group.right.start * ROWS..group.right.end * ROWS];
            products(simd, features, group.left.iter().copied(), right, &mut rest);
        }
        let rights = &features[..plan.rights.len() * ROWS];
        products(simd, wrench, plan.cross_columns(), rights, &mut rest);
        for axis in plan.square_operands() {
            let right = &wrench[axis.right.start * ROWS..axis.right.end * ROWS];
            products(simd, wrench, axis.left.iter().copied(), right, &mut rest);
        }
        let round = 1.5 * power_of_two(52 + 26);
        for ((&sum, high), low) in sums.iter().zip(&mut open.high).zip(&mut open.low) {
            let rounded = (sum + round) - round;
            *high += rounded;
            *low += sum - rounded;
        }
        open.rows += rows as u64;
        open.blocks += 1;
        true
    }
}

#[inline(always)]
fn cut_wrench(plan: &SummationPlan, axes: &[f64], wrench: &mut [f64]) -> bool {
    let (squares, cross) = wrench.split_at_mut(plan.square_columns() * ROWS);
    for (limbs, mut columns) in [(Some(&plan.squares), squares), (plan.cross.as_ref(), cross)] {
        for (limbs, axis) in limbs.into_iter().flatten().zip(axes.as_chunks::<ROWS>().0) {
            let now;
            (now, columns) = columns.split_at_mut(limbs.count * ROWS);
            if !limbs.cut(axis, now) {
                return false;
            }
        }
    }
    true
}

#[inline(always)]
fn cut_rights(plan: &SummationPlan, features: &mut [f64]) {
    for columns in plan.firsts.windows(2).filter(|columns| columns[1] - columns[0] > 1) {
        let parts = &mut features[columns[0] * ROWS..columns[1] * ROWS];
        let whole: [f64; ROWS] = *parts.first_chunk().expect("a column at least");
        Limbs::from_integers(plan.features.right.width, columns[1] - columns[0]).cut(&whole, parts);
    }
}

#[inline(always)]
fn cut_lefts(plan: &SummationPlan, lefts: &[LimbColumn], features: &mut [f64]) {
    let (rights, mut columns) = features.split_at_mut(plan.rights.len() * ROWS);
    for parts in lefts.chunk_by(|a, b| a.position == b.position) {
        let now;
        (now, columns) = columns.split_at_mut(parts.len() * ROWS);
        let whole = &rights[plan.firsts[parts[0].position - 1] * ROWS..][..ROWS];
        Limbs::from_integers(plan.features.left.width, parts.len()).cut(whole, now);
    }
}

/// Computes `out[l·n + r] = Σ left_l·right_r` over a block. `right` holds n columns, and `left` gives the positions of
/// the left operands in `columns`. Advances `out` past the filled part.
#[inline(always)]
pub(crate) fn products<S: Simd>(
    simd: S,
    columns: &[f64],
    mut left: impl ExactSizeIterator<Item = usize>,
    right: &[f64],
    out: &mut &mut [f64],
) {
    let rights = right.len() / ROWS;
    let mut out = out.split_off_mut(..left.len() * rights).expect("room for all sums");
    let mut next = || column(columns, left.next().unwrap_or(0));
    while !out.is_empty() {
        // Five columns take less time as three and two than as four and one.
        let height = match out.len() / rights {
            5 => 3,
            n => n.min(4),
        };
        let now;
        (now, out) = out.split_at_mut(height * rights);
        match height {
            4 => strip::<S, 4>(simd, [next(), next(), next(), next()], right, now),
            3 => strip::<S, 3>(simd, [next(), next(), next()], right, now),
            2 => strip::<S, 2>(simd, [next(), next()], right, now),
            _ => strip::<S, 1>(simd, [next()], right, now),
        }
    }
}

#[inline(always)]
fn strip<S: Simd, const L: usize>(
    simd: S,
    left: [&ColumnBlock; L],
    right: &[f64],
    out: &mut [f64],
) {
    let rights = right.len() / ROWS;
    let mut r = 0;
    while r < rights {
        match rights - r {
            1 => {
                tile::<S, L, 1>(simd, left, right, r, out);
                r += 1;
            }
            // Four columns take less time as two and two than as three and one.
            2 | 4 => {
                tile::<S, L, 2>(simd, left, right, r, out);
                r += 2;
            }
            _ => {
                tile::<S, L, 3>(simd, left, right, r, out);
                r += 3;
            }
        }
    }
}

/// Computes at most 4 × 3 sums: as many as fit with their operands in the 16 registers of AVX2.
#[inline(always)]
fn tile<S: Simd, const L: usize, const R: usize>(
    simd: S,
    left: [&ColumnBlock; L],
    right: &[f64],
    first: usize,
    out: &mut [f64],
) {
    let rights = right.len() / ROWS;
    let left: [&[S::f64s]; L] = left.map(|column| S::as_simd_f64s(column).0);
    let mut rights_now: [&[S::f64s]; R] = [&[]; R];
    // This is a loop, because a closure passed to an array method may not be inlined.
    for (r, now) in rights_now.iter_mut().enumerate() {
        *now = S::as_simd_f64s(column(right, first + r)).0;
    }
    let right = rights_now;
    let mut sums = [[simd.splat_f64s(0.0); R]; L];
    for step in 0..ROWS / S::F64_LANES {
        for l in 0..L {
            for r in 0..R {
                sums[l][r] = simd.mul_add_e_f64s(left[l][step], right[r][step], sums[l][r]);
            }
        }
    }
    for l in 0..L {
        for r in 0..R {
            out[l * rights + first + r] = simd.reduce_sum_f64s(sums[l][r]);
        }
    }
}

/// One column. The length is part of the type, which removes bounds checks from loops over columns.
type ColumnBlock = [f64; ROWS];

#[inline(always)]
fn column(columns: &[f64], index: usize) -> &ColumnBlock {
    columns[index * ROWS..].first_chunk().expect("as many columns as are asked for")
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Products<'a>(&'a [f64], &'a [f64], &'a mut [f64]);

    impl pulp::WithSimd for Products<'_> {
        type Output = ();
        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) {
            products(simd, self.0, 0..self.0.len() / ROWS, self.1, &mut &mut *self.2);
        }
    }

    #[test]
    fn every_shape_of_tile_gives_the_sums_of_integers() {
        let number = |i: usize| (i * 7919 % 2003) as f64 - 1001.0;
        for lefts in 1..=9 {
            for rights in 1..=7 {
                let left: Vec<f64> = (0..lefts * ROWS).map(number).collect();
                let right: Vec<f64> = (0..rights * ROWS).map(|i| number(i + 5)).collect();
                let dot =
                    |a: &[f64], b: &[f64]| -> f64 { a.iter().zip(b).map(|(a, b)| a * b).sum() };
                let expected: Vec<f64> = left
                    .chunks(ROWS)
                    .flat_map(|a| right.chunks(ROWS).map(move |b| dot(a, b)))
                    .collect();
                let mut out = vec![f64::NAN; lefts * rights];
                shell_data::instructions::arch().dispatch(Products(&left, &right, &mut out));
                assert_eq!(out, expected);
                out.fill(f64::NAN);
                products(pulp::Scalar::new(), &left, 0..lefts, &right, &mut &mut out[..]);
                assert_eq!(out, expected);
            }
        }
    }
}
