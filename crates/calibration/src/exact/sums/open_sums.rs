//! Sums under way, and what they amount to.

use std::sync::Arc;

use num_bigint::BigInt;

use super::limbs::{Limbs, SQUARE_WIDTH};
use super::plan::SummationPlan;
use crate::exact::moments::layout::{MomentLayout, pair};
use crate::exact::moments::product_sums::Moments;
use crate::exact::moments::scaled_integers::{ScaledIntegers, join};
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
    /// The multiples of 2²⁶ of the sums: those of the groups, then of the limbs of the wrench and ones
    /// with ones and features, then of the limbs of the wrench with each other.
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
        // Of each axis, limb by limb.
        let planes = |limbs: &Limbs| {
            let mut planes = vec![vec![0; 1 + layout.features.len()]; limbs.count];
            planes.iter_mut().for_each(|plane| add_rights(plane));
            planes
        };
        let limbs = self.plan.cross_limbs();
        let wrench: Vec<_> = limbs.iter().map(planes).collect();
        add_rights(&mut moments.readings);
        self.add_squares(&mut moments, &mut sums);
        let back: Vec<i64> = self.plan.centre.iter().map(|c| -c).collect();
        layout.move_origin(&mut moments.readings, &back);
        for ((scaled, planes), limbs) in moments.wrench.iter_mut().zip(wrench).zip(limbs) {
            let parts = |place: usize| planes.iter().map(move |plane| plane[place]);
            let sum = |place| join(parts(place), limbs.width);
            let mut sums: Vec<BigInt> = (0..=layout.features.len()).map(sum).collect();
            layout.move_origin_of_features(&mut sums, &back);
            *scaled = ScaledIntegers::new(limbs.unit, sums);
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
        for (left, of_left) in squares.iter().enumerate() {
            let mut joined = [(); 6].map(|()| BigInt::ZERO);
            for i in 0..of_left.count {
                for (right, of_right) in squares.iter().enumerate().skip(left) {
                    for j in 0..of_right.count {
                        joined[right] +=
                            BigInt::from(next(sums)) << (SQUARE_WIDTH as usize * (i + j));
                    }
                }
            }
            for (right, sum) in joined.into_iter().enumerate().skip(left) {
                let exponent = of_left.unit + squares[right].unit;
                moments.squares[pair(left, right)] = ScaledIntegers::new(exponent, vec![sum]);
            }
        }
    }
}

/// The next of as many sums as the plan says.
fn next(sums: &mut impl Iterator<Item = i128>) -> i128 {
    sums.next().expect("one sum for every product")
}
