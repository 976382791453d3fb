//! How rows are summed: about which centre, in which limbs, and which columns are multiplied.

use std::ops::Range;

use super::limbs::{FeatureLimbs, Limbs};
use crate::exact::moments::layout::MomentLayout;

/// A plan of centre and limbs, with what follows from it for the work on a block of rows.
///
/// Columns of features stand side by side: first the right operands, ones before all features, then,
/// for one group of products after the other, those left operands that are not among them. Columns of
/// the wrench, likewise: limbs to be multiplied with each other, axis by axis, then limbs for the
/// features only, then ones.
#[derive(Debug, PartialEq)]
pub(crate) struct SummationPlan {
    /// What is subtracted from the readings of each channel.
    pub(crate) centre: Vec<i64>,
    pub(crate) features: FeatureLimbs,
    /// The column where the right operands of each feature begin, and where all of them end.
    pub(crate) firsts: Vec<usize>,
    /// The right operands: ones, then those of the features.
    pub(crate) rights: Vec<LimbColumn>,
    /// The products of features, group by group of the layout, each with its left operands that
    /// are not among the right ones.
    pub(crate) groups: Vec<(Vec<LimbColumn>, Operands)>,
    /// Limbs of each axis that are multiplied with those of other axes.
    pub(crate) squares: Vec<Limbs>,
    /// Limbs of each axis that are multiplied with features, if not the same.
    pub(crate) cross: Option<Vec<Limbs>>,
}

/// Ones, or a limb of a feature: the feature is the sum of its limbs, each times two to its shift.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct LimbColumn {
    /// The place in the layout of the sums: 0 for ones, then the features.
    pub(crate) position: usize,
    pub(crate) shift: u32,
}

/// Columns that are multiplied, each on the left with each on the right.
#[derive(Debug, PartialEq)]
pub(crate) struct Operands {
    pub(crate) left: Vec<usize>,
    pub(crate) right: Range<usize>,
}

impl SummationPlan {
    pub(crate) fn new(
        layout: &MomentLayout,
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

    /// Columns of limbs that are multiplied with each other.
    pub(crate) fn square_columns(&self) -> usize {
        self.squares.iter().map(|limbs| limbs.count).sum()
    }

    /// The columns of the wrench that are multiplied with features: limbs axis by axis and ones, the
    /// last column of all.
    pub(crate) fn cross_columns(&self) -> Range<usize> {
        let squares = self.square_columns();
        let others = self.cross.iter().flatten().map(|limbs| limbs.count).sum::<usize>();
        let start = if self.cross.is_some() { squares } else { 0 };
        start..squares + others + 1
    }

    /// The limbs of each axis that are multiplied with features.
    pub(crate) fn cross_limbs(&self) -> &[Limbs] {
        self.cross.as_ref().unwrap_or(&self.squares)
    }

    /// For every axis the columns that its limbs are multiplied with: its own and those of later axes.
    pub(crate) fn square_operands(&self) -> Vec<Operands> {
        let (mut start, end) = (0, self.square_columns());
        let of_axis = |limbs: &Limbs| {
            let own = start..start + limbs.count;
            start = own.end;
            Operands { right: own.start..end, left: own.collect() }
        };
        self.squares.iter().map(of_axis).collect()
    }

    /// Number of sums.
    pub(crate) fn sums(&self) -> usize {
        let count = |operands: &Operands| operands.left.len() * operands.right.len();
        let gram: usize = self.groups.iter().map(|(_, operands)| count(operands)).sum();
        let squares: usize = self.square_operands().iter().map(count).sum();
        gram + self.cross_columns().len() * self.rights.len() + squares
    }
}
