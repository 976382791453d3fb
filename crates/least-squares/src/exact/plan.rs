//! Plan of a summation (centre, limbs, columns to multiply), and the sums in progress.

use std::ops::Range;
use std::sync::Arc;

use num_bigint::BigInt;

use super::integers::{ScaledIntegers, join};
use super::layout::{SumLayout, pair};
use super::limbs::{FeatureLimbs, Limbs, SQUARE_WIDTH};
use super::product_sums::ExactSums;
use crate::model::Basis;

/// Centre, limbs, and columns for a block of rows. Columns of features are the right operands (ones, then the
/// features), then, group by group, the left operands that are not right operands too. Columns of the wrench are the
/// limbs to multiply with each other, axis by axis, then the limbs to multiply with features only, then ones.
#[derive(Debug, PartialEq)]
pub(crate) struct SummationPlan {
    pub(crate) centre: Vec<i64>,
    pub(crate) features: FeatureLimbs,
    /// Position of the first right operand of each feature, then the end of the last one.
    pub(crate) firsts: Vec<usize>,
    /// Ones, then the limbs of the features.
    pub(crate) rights: Vec<LimbColumn>,
    /// Left operands that are not right operands, and the columns to multiply, for each group of the layout.
    pub(crate) groups: Vec<(Vec<LimbColumn>, Operands)>,
    /// Limbs of each axis that are multiplied with limbs of other axes.
    pub(crate) squares: Vec<Limbs>,
    /// Limbs of each axis that are multiplied with features, if they differ from `squares`.
    pub(crate) cross: Option<Vec<Limbs>>,
}

/// Column of ones, or limb of a feature. A feature is the sum of its limbs, each times 2^`shift`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct LimbColumn {
    /// The position in the layout of the sums: 0 for ones, then the features.
    pub(crate) position: usize,
    pub(crate) shift: u32,
}

#[derive(Debug, PartialEq)]
pub(crate) struct Operands {
    pub(crate) left: Vec<usize>,
    pub(crate) right: Range<usize>,
}

impl SummationPlan {
    pub(crate) fn new(
        layout: &SumLayout,
        centre: Vec<i64>,
        features: FeatureLimbs,
        squares: Vec<Limbs>,
        cross: Vec<Limbs>,
    ) -> Self {
        let FeatureLimbs { left, right, .. } = features;
        let parts = |feature: usize, count: usize, width: u32| {
            (0..count)
                .map(move |limb| LimbColumn { position: 1 + feature, shift: limb as u32 * width })
        };
        let degree = |feature: usize| layout.features[feature].factors().len();
        let (mut firsts, mut rights) = (vec![1], vec![LimbColumn { position: 0, shift: 0 }]);
        for feature in 0..layout.features.len() {
            rights.extend(parts(feature, right.counts[degree(feature)], right.width));
            firsts.push(rights.len());
        }
        let groups = layout.groups.iter().map(|group| {
            let (mut lefts, mut columns) = (Vec::new(), Vec::new());
            for &feature in &group.left {
                if features.is_shared(degree(feature)) {
                    columns.extend(firsts[feature]..firsts[feature + 1]);
                } else {
                    let start = rights.len() + lefts.len();
                    lefts.extend(parts(feature, left.counts[degree(feature)], left.width));
                    columns.extend(start..rights.len() + lefts.len());
                }
            }
            let right = firsts[group.right.start]..firsts[group.right.end];
            (lefts, Operands { left: columns, right })
        });
        let groups = groups.collect();
        let cross = (cross != squares).then_some(cross);
        Self { centre, features, firsts, rights, groups, squares, cross }
    }

    pub(crate) fn square_columns(&self) -> usize {
        self.squares.iter().map(|limbs| limbs.count).sum()
    }

    /// Columns multiplied with features: limbs axis by axis, then ones.
    pub(crate) fn cross_columns(&self) -> Range<usize> {
        let squares = self.square_columns();
        let others = self.cross.iter().flatten().map(|limbs| limbs.count).sum::<usize>();
        let start = if self.cross.is_some() { squares } else { 0 };
        start..squares + others + 1
    }

    pub(crate) fn cross_limbs(&self) -> &[Limbs] {
        self.cross.as_ref().unwrap_or(&self.squares)
    }

    /// Columns that each axis's limbs are multiplied with: its own and those of later axes.
    pub(crate) fn square_operands(&self) -> Vec<Operands> {
        let (mut start, end) = (0, self.square_columns());
        let of_axis = |limbs: &Limbs| {
            let own = start..start + limbs.count;
            start = own.end;
            Operands { right: own.start..end, left: own.collect() }
        };
        self.squares.iter().map(of_axis).collect()
    }

    pub(crate) fn sums(&self) -> usize {
        let count = |operands: &Operands| operands.left.len() * operands.right.len();
        let gram: usize = self.groups.iter().map(|(_, operands)| count(operands)).sum();
        let squares: usize = self.square_operands().iter().map(count).sum();
        gram + self.cross_columns().len() * self.rights.len() + squares
    }
}

/// Maximum number of blocks with exact sums: `low` stays below `2^25·2^26 < 2^53`, `high` below `2^53·2^26`.
pub(crate) const MOST_BLOCKS: u64 = 1 << 26;

/// Sums in progress: a pair of numbers for each product of columns.
#[derive(Clone, Debug)]
pub(crate) struct OpenSums {
    pub(crate) plan: Arc<SummationPlan>,
    pub(crate) rows: u64,
    pub(crate) blocks: u64,
    /// Multiples of 2²⁶. Order: products of features by group, products of wrench limbs and ones with ones and
    /// features, products of wrench limbs with each other.
    pub(crate) high: Vec<f64>,
    pub(crate) low: Vec<f64>,
}

impl OpenSums {
    pub(crate) fn new(plan: Arc<SummationPlan>) -> Self {
        let sums = plan.sums();
        Self { plan, rows: 0, blocks: 0, high: vec![0.0; sums], low: vec![0.0; sums] }
    }

    pub(crate) fn moments(&self, layout: &Arc<SumLayout>, basis: Basis) -> ExactSums {
        let mut moments = ExactSums::with_layout(basis, layout.clone());
        moments.rows = self.rows;
        let sums = self.high.iter().zip(&self.low);
        let mut sums = sums.map(|(&high, &low)| high as i128 + low as i128);
        self.add_products_of_features(layout, &mut moments, &mut sums);
        let mut add_rights = |to: &mut [i128]| {
            for right in &self.plan.rights {
                to[right.position] += next(&mut sums) << right.shift;
            }
        };
        let back: Vec<i64> = self.plan.centre.iter().map(|c| -c).collect();
        // Limb by limb. 128 bits hold each sum for any origin: at most 2³⁰ rows, features below 2⁴⁸
        // and limbs below 2²³.
        let planes = |limbs: &Limbs| {
            let mut planes = vec![vec![0; 1 + layout.features.len()]; limbs.count];
            for plane in &mut planes {
                add_rights(plane);
                layout.move_features(plane, &back);
            }
            planes
        };
        let limbs = self.plan.cross_limbs();
        let wrench: Vec<_> = limbs.iter().map(planes).collect();
        add_rights(&mut moments.readings);
        self.add_squares(&mut moments, &mut sums);
        layout.move_origin(&mut moments.readings, &back);
        for ((scaled, planes), limbs) in moments.wrench.iter_mut().zip(wrench).zip(limbs) {
            let parts = |place: usize| planes.iter().map(move |plane| plane[place]);
            let sum = |place| join(parts(place), limbs.width);
            let sums = (0..=layout.features.len()).map(sum).collect();
            *scaled = ScaledIntegers::new(limbs.unit, sums);
        }
        moments
    }

    fn add_products_of_features(
        &self,
        layout: &SumLayout,
        moments: &mut ExactSums,
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

    fn add_squares(&self, moments: &mut ExactSums, sums: &mut impl Iterator<Item = i128>) {
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

fn next(sums: &mut impl Iterator<Item = i128>) -> i128 {
    sums.next().expect("one sum for every product")
}
