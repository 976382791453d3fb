//! Sums under way, and what they amount to.

use std::sync::Arc;

use super::digits::Digits;
use super::plan::SummationPlan;
use crate::exact::moments::layout::{MomentLayout, pair};
use crate::exact::moments::product_sums::Moments;
use crate::exact::moments::scaled_integers::ScaledIntegers;
use crate::model::Basis;

/// Blocks after which the pairs of sums could lose their exactness: `2^25·2^26 < 2^53`, and
/// multiples of 2²⁶ below `2^53·2^26`.
pub(crate) const MOST_BLOCKS: u64 = 1 << 26;

/// Sums under way: for each product of columns a pair of numbers.
#[derive(Clone, Debug)]
pub(crate) struct OpenSums {
    pub(crate) plan: Arc<SummationPlan>,
    pub(crate) rows: u64,
    pub(crate) blocks: u64,
    /// The multiples of 2²⁶ of the sums: those of the groups, then of the digits of the wrench and ones
    /// with ones and features, then of the digits of the wrench with each other.
    pub(crate) high: Vec<f64>,
    /// What is not a multiple of 2²⁶ in each.
    pub(crate) low: Vec<f64>,
}

impl OpenSums {
    pub(crate) fn new(plan: Arc<SummationPlan>) -> Self {
        let sums = plan.sums();
        Self { plan, rows: 0, blocks: 0, high: vec![0.0; sums], low: vec![0.0; sums] }
    }

    /// The sums about the origin of the readings.
    pub(crate) fn moments(&self, layout: &Arc<MomentLayout>, basis: Basis) -> Moments {
        let mut moments = Moments::with_layout(basis, layout.clone());
        moments.rows = self.rows;
        let sums = self.high.iter().zip(&self.low);
        let mut sums = sums.map(|(&high, &low)| high as i128 + low as i128);
        self.add_products_of_features(layout, &mut moments, &mut sums);
        let mut add_rights = |to: &mut [i128]| {
            for right in &self.plan.rights {
                to[right.position] += next(&mut sums) << right.shift;
            }
        };
        // Of each axis, digit by digit.
        let digits = self.plan.cross_digits();
        let planes = |digits: &Digits| {
            let mut planes = vec![vec![0; 1 + layout.features.len()]; digits.count()];
            planes.iter_mut().for_each(|plane| add_rights(plane));
            planes
        };
        let wrench: Vec<_> = digits.iter().map(planes).collect();
        add_rights(&mut moments.readings);
        self.add_squares(&mut moments, &mut sums);
        let back: Vec<i64> = self.plan.centre.iter().map(|c| -c).collect();
        layout.move_origin(&mut moments.readings, &back);
        for ((scaled, mut planes), digits) in moments.wrench.iter_mut().zip(wrench).zip(digits) {
            planes.iter_mut().for_each(|plane| layout.move_origin_of_features(plane, &back));
            let sum = |place| digits.join(planes.iter().map(|plane: &Vec<i128>| plane[place]));
            let sums = (0..=layout.features.len()).map(sum);
            *scaled = ScaledIntegers::new(digits.unit(), sums.collect());
        }
        moments
    }

    fn add_products_of_features(
        &self,
        layout: &MomentLayout,
        moments: &mut Moments,
        sums: &mut impl Iterator<Item = i128>,
    ) {
        let plan = &*self.plan;
        let mut first = 1 + layout.features.len();
        for (group, (lefts, operands)) in layout.groups.iter().zip(&plan.groups) {
            let part = |column: usize| match column.checked_sub(plan.rights.len()) {
                Some(left) => lefts[left],
                None => plan.rights[column],
            };
            for lefts in operands.left.chunk_by(|&a, &b| part(a).position == part(b).position) {
                for &left in lefts {
                    for right in &plan.rights[operands.right.clone()] {
                        let place = first + right.position - (1 + group.right.start);
                        let sum = &mut moments.readings[place];
                        let shift = part(left).shift + right.shift;
                        *sum = sum.wrapping_add(next(sums) << shift);
                    }
                }
                first += group.right.len();
            }
        }
    }

    /// Adds the sums of products of axes.
    fn add_squares(&self, moments: &mut Moments, sums: &mut impl Iterator<Item = i128>) {
        let squares = &self.plan.squares;
        for (left, operands) in self.plan.square_operands().into_iter().enumerate() {
            // Sums by digit on the left, then by axis and digit on the right.
            let rows: Vec<Vec<i128>> = (0..squares[left].count())
                .map(|_| operands.right.clone().map(|_| next(sums)).collect())
                .collect();
            let mut columns = 0..operands.right.len();
            for right in left..6 {
                let of_digits = (columns.by_ref().take(squares[right].count()))
                    .map(|column| squares[left].join(rows.iter().map(|row| row[column])));
                let sum = squares[right].join_joined(of_digits);
                let exponent = squares[left].unit() + squares[right].unit();
                moments.squares[pair(left, right)] = ScaledIntegers::new(exponent, vec![sum]);
            }
        }
    }
}

/// The next of as many sums as the plan says.
fn next(sums: &mut impl Iterator<Item = i128>) -> i128 {
    sums.next().expect("one sum for every product")
}
