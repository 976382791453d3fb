//! Sums over one block of rows: from readings and wrench to the sums of all products.

use super::kernel::{ROWS, products};
use super::limbs::Limbs;
use super::open_sums::OpenSums;
use super::plan::{LimbColumn, SummationPlan};
use crate::exact::moments::layout::MomentLayout;
use crate::exact::moments::rounding::power_of_two;
use crate::features::fill_columns;
use shell_data::vectorised;

/// Working memory.
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
    /// Adds the first `rows` rows of a block to open sums, unless the limbs do not cover the wrench:
    /// says whether.
    ///
    /// `readings` are columns of [`ROWS`] integers, one per channel, at their centre beyond the rows; `axes` are columns
    /// of [`ROWS`] numbers, one per axis of the wrench, zero beyond the rows.
    pub(crate) fn sum_block<S: Simd>(
        simd: S,
        layout: &MomentLayout,
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
        // Each where its right operands begin.
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

/// Cuts the wrench into its limbs; says whether they add up to it.
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

/// Cuts the features that are more than one right operand.
#[inline(always)]
fn cut_rights(plan: &SummationPlan, features: &mut [f64]) {
    for columns in plan.firsts.windows(2).filter(|columns| columns[1] - columns[0] > 1) {
        let parts = &mut features[columns[0] * ROWS..columns[1] * ROWS];
        let whole: [f64; ROWS] = *parts.first_chunk().expect("a column at least");
        Limbs::from_integers(plan.features.right.width, columns[1] - columns[0]).cut(&whole, parts);
    }
}

/// Cuts the features that are other operands on the left of a group. They are whole on the right.
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
