//! The distinct sums of products that a basis needs.
//!
//! The Gram matrix of products of readings contains sums several times: `s1·(s2·s3)` and `s2·(s1·s3)` are the same
//! monomial. Sort the factors of a monomial `s_a·s_b·…` of up to twice the largest degree d, pad them in front with
//! ones to 2d factors, and split them in the middle: the left part ends with some channel k, the right begins with k
//! or later, and the split is unique. So the distinct sums are a few dense blocks of products
//!
//! ```text
//! {features whose last factor is k} × {features of degree d whose first factor is k or later}
//! ```
//!
//! and the sums of the features: 3003 for eight channels and degree three, where one triangle of
//! the Gram matrix has 13,695. The powers of the cubic basis split in a similar way.

use std::collections::HashMap;
use std::ops::Range;

use num_bigint::BigInt;

use super::integers::{DigitPlanes, digit_planes};
use crate::features::{Recipe, recipe};
use crate::model::{Basis, Model, Term};

/// Largest degree of a product of two features.
const MAX_DEGREE: usize = 6;

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Monomial {
    /// Channels in ascending order, counted from 1. Zeros in front of them stand for factors of one.
    factors: [u8; MAX_DEGREE],
}

impl Monomial {
    const ONE: Self = Self { factors: [0; MAX_DEGREE] };

    pub(crate) fn product(left: Term, right: Term) -> Self {
        let mut factors = [0; MAX_DEGREE];
        let both = left.factors().iter().chain(right.factors());
        for (slot, &channel) in factors.iter_mut().zip(both) {
            *slot = channel + 1;
        }
        factors.sort_unstable();
        Self { factors }
    }

    fn exponent(&self, channel: usize) -> usize {
        self.factors.iter().filter(|&&f| usize::from(f) == channel + 1).count()
    }

    fn without(&self, channel: usize) -> Self {
        let mut factors = self.factors;
        if let Some(slot) = factors.iter_mut().find(|f| usize::from(**f) == channel + 1) {
            *slot = 0;
        }
        factors.sort_unstable();
        Self { factors }
    }
}

#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ProductGroup {
    pub(crate) left: Vec<usize>,
    pub(crate) right: Range<usize>,
}

/// The update `value[of] −= shift·value[from]` for the origin of a channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ShiftStep {
    of: usize,
    from: usize,
    exponent: usize,
}

/// Order of the sums: ones (the number of rows), features, then the products of each group by left operand.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct SumLayout {
    /// Features without the constant, in the order of the model.
    pub(crate) features: Vec<Term>,
    pub(crate) recipe: Vec<Recipe>,
    pub(crate) groups: Vec<ProductGroup>,
    monomials: Vec<Monomial>,
    index: HashMap<Monomial, usize>,
    /// Steps of each channel: first for all sums, then for the sums of ones and features alone.
    steps: Vec<(Vec<ShiftStep>, Vec<ShiftStep>)>,
}

impl SumLayout {
    pub(crate) fn new(basis: Basis, channels: usize) -> Self {
        let model = Model { basis, intercept: false, channels, memory: 0 };
        let features = model.terms();
        let groups = match basis {
            Basis::Cubic => powers(channels),
            Basis::CubicProducts => powers_and_products(channels),
            _ => mixed(&features, channels, basis.degree()),
        };
        let mut monomials = vec![Monomial::ONE];
        monomials.extend(features.iter().map(|&f| Monomial::product(f, Term::INTERCEPT)));
        for group in &groups {
            monomials.extend(group.left.iter().flat_map(|&l| {
                let (features, right) = (&features, group.right.clone());
                right.map(move |r| Monomial::product(features[l], features[r]))
            }));
        }
        let index: HashMap<_, _> = monomials.iter().enumerate().map(|(i, &m)| (m, i)).collect();
        debug_assert_eq!(index.len(), monomials.len(), "every monomial once");
        let steps = (0..channels)
            .map(|channel| {
                let of_features = &monomials[..=features.len()];
                (steps(&monomials, &index, channel), steps(of_features, &index, channel))
            })
            .collect();
        Self { recipe: recipe(&features), features, groups, monomials, index, steps }
    }

    /// Number of sums, including the number of rows.
    pub(crate) fn sums(&self) -> usize {
        self.monomials.len()
    }

    pub(crate) fn channels(&self) -> usize {
        self.steps.len()
    }

    /// The position of the sum of the product of two features.
    ///
    /// # Panics
    /// If a feature is not in this basis.
    pub(crate) fn position(&self, left: Term, right: Term) -> usize {
        self.index[&Monomial::product(left, right)]
    }

    pub(crate) fn exponents(&self, channel: usize) -> impl Iterator<Item = usize> {
        self.monomials.iter().map(move |m| m.exponent(channel))
    }

    /// Moves the origin of every channel by `by` in all sums, modulo 2¹²⁸.
    pub(crate) fn move_origin(&self, sums: &mut [i128], by: &[i64]) {
        for ((steps, _), &by) in self.steps.iter().zip(by) {
            shift(sums, steps, by);
        }
    }

    /// Moves the origin of every channel by `by` in sums of an axis, or of a digit of it, with one and each feature.
    pub(crate) fn move_features(&self, sums: &mut [i128], by: &[i64]) {
        for ((_, steps), &by) in self.steps.iter().zip(by) {
            shift(sums, steps, by);
        }
    }

    /// Moves the origin of every channel by `by`, below 2¹⁶, in the sums of some quantity with one and each feature.
    /// Each digit moves by itself and grows by a factor below `(1 + 2¹⁶)³`, so no carry is needed.
    pub(crate) fn moved_features(&self, sums: &[BigInt], by: &[i64]) -> DigitPlanes {
        let mut planes = digit_planes(sums);
        planes.iter_mut().for_each(|plane| self.move_features(plane, by));
        DigitPlanes(planes)
    }
}

/// The position of the sum of products of two axes, `left ≤ right`.
pub(crate) const fn pair(left: usize, right: usize) -> usize {
    left * (13 - left) / 2 + right - left
}

fn steps(
    monomials: &[Monomial],
    index: &HashMap<Monomial, usize>,
    channel: usize,
) -> Vec<ShiftStep> {
    let step = |(of, m): (usize, &Monomial)| {
        let exponent = m.exponent(channel);
        (exponent > 0).then(|| ShiftStep { of, from: index[&m.without(channel)], exponent })
    };
    let mut steps: Vec<ShiftStep> = monomials.iter().enumerate().filter_map(step).collect();
    steps.sort_unstable_by_key(|step| (std::cmp::Reverse(step.exponent), step.of));
    steps
}

/// Converts sums with powers of a reading `s` to powers of `s − by`, by repeated synthetic division: the n-th pass
/// turns `sᵃ⁻ⁿ⁺¹·(s − by)ⁿ⁻¹` into `sᵃ⁻ⁿ·(s − by)ⁿ`, highest powers first.
fn shift(values: &mut [i128], steps: &[ShiftStep], by: i64) {
    let highest = if by == 0 { 0 } else { steps.first().map_or(0, |step| step.exponent) };
    for pass in 1..=highest {
        for step in steps.iter().take_while(|step| step.exponent >= pass) {
            let from = values[step.from].wrapping_mul(i128::from(by));
            values[step.of] = values[step.of].wrapping_sub(from);
        }
    }
}

/// Blocks for powers up to the third: products of powers of one channel, and of powers of two channels.
fn powers(channels: usize) -> Vec<ProductGroup> {
    (0..channels)
        .flat_map(|i| {
            let own = ProductGroup { left: vec![3 * i + 2], right: 3 * i..3 * i + 3 };
            let others =
                ProductGroup { left: (3 * i..3 * i + 3).collect(), right: 3 * i + 3..3 * channels };
            [own, others]
        })
        .filter(|group| !group.right.is_empty())
        .collect()
}

/// Blocks for features that are powers up to the third and products of two channels. They are the blocks of [`powers`]
/// without the products that are features here, and the products of these with powers and with each other.
fn powers_and_products(channels: usize) -> Vec<ProductGroup> {
    let n = channels;
    let power = |channel: usize, exponent: usize| 3 * channel + exponent - 1;
    // Position of the product of channels j < k: after the powers, in lexicographic order. The products that begin with
    // channel j are at `pair(j, j + 1)..pair(j + 1, j + 2)`.
    let pair = |j: usize, k: usize| 3 * n + j * (2 * n - j - 1) / 2 + k - j - 1;
    let end = pair(n, n + 1);
    let mut groups = Vec::new();
    let mut add = |left: Vec<usize>, right: Range<usize>| {
        if !left.is_empty() && !right.is_empty() {
            groups.push(ProductGroup { left, right });
        }
    };
    for i in 0..n {
        let (first, square, cube) = (power(i, 1), power(i, 2), power(i, 3));
        let later_pairs = pair(i + 1, i + 2)..end;
        add(vec![cube], first..cube + 1);
        add(vec![square, cube], cube + 1..3 * n);
        (i + 1..n).for_each(|j| add(vec![first], power(j, 2)..power(j, 3) + 1));
        // Pairs that begin with this channel, then later pairs, then pairs that begin earlier.
        add(vec![cube], pair(i, i + 1)..later_pairs.start);
        add(vec![first, square, cube], later_pairs.clone());
        for j in 0..i {
            add(vec![square, cube], pair(j, j + 1)..pair(j, i));
            add(vec![cube], pair(j, i)..pair(j, i) + 1);
            add(vec![square, cube], pair(j, i) + 1..pair(j + 1, j + 2));
        }
        add((0..i).map(|j| pair(j, i)).collect(), later_pairs);
    }
    groups
}

/// The blocks for all products up to `degree`; see the module.
fn mixed(features: &[Term], channels: usize, degree: usize) -> Vec<ProductGroup> {
    let whole = |term: &Term| term.factors().len() == degree;
    (0..channels)
        .map(|k| {
            let ends_here = |term: &Term| term.factors().last().map(|&f| usize::from(f)) == Some(k);
            let begins_later = |term: &Term| whole(term) && usize::from(term.factors()[0]) >= k;
            let left = (0..features.len()).filter(|&f| ends_here(&features[f])).collect();
            // In lexicographic order, the features that begin at k or later come last.
            let first = features.iter().position(begins_later).unwrap_or(features.len());
            ProductGroup { left, right: first..features.len() }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn every_product_of_two_features_has_a_place_and_no_place_is_idle() {
        for basis in Basis::ALL {
            for channels in 1..=8 {
                let layout = SumLayout::new(basis, channels);
                let mut used = vec![false; layout.sums()];
                let terms = Model { basis, intercept: true, channels, memory: 0 }.terms();
                for &a in &terms {
                    for &b in &terms {
                        used[layout.position(a, b)] = true;
                    }
                }
                assert!(used.iter().all(|&u| u), "{basis:?} of {channels}");
            }
        }
    }

    #[test]
    fn eight_channels_need_as_many_sums_as_there_are_monomials() {
        // There are C(8 + 2d, 8) monomials of degree up to 2d. Powers need 28 pairs × 9 + 8 ×
        // 6 + 1. Products add 56 of a fourth power and another channel, 56 of three channels, 168 ×
        // 2 with a square or cube, and 70 of four channels.
        let sums = Basis::ALL.map(|basis| SumLayout::new(basis, 8).sums());
        assert_eq!(sums, [45, 301, 495, 819, 3003]);
    }

    #[test]
    fn shifting_the_origin_of_one_row_gives_the_products_of_the_shifted_readings() {
        let layout = SumLayout::new(Basis::Poly3, 3);
        let values = |readings: [i128; 3]| -> Vec<i128> {
            let power = |m: &Monomial, i: usize| readings[i].pow(m.exponent(i) as u32);
            layout.monomials.iter().map(|m| (0..3).map(|i| power(m, i)).product()).collect()
        };
        let mut shifted = values([5, -3, 7]);
        layout.move_origin(&mut shifted, &[2, -4, 11]);
        assert_eq!(shifted, values([3, 1, -4]));
    }

    proptest! {
        #[test]
        fn sums_move_as_if_each_were_one_integer(
            bits in 1_u32..400,
            seeds in prop::collection::vec(any::<i64>(), 20),
            by in prop::collection::vec(-65_535_i64..=65_535, 3),
        ) {
            // Poly3 of three channels has one and 19 features.
            let layout = SumLayout::new(Basis::Poly3, 3);
            let values: Vec<BigInt> = (seeds.iter())
                .map(|&seed| BigInt::from(seed).pow(7) % (BigInt::from(1) << bits))
                .collect();
            let mut expected = values.clone();
            for ((_, steps), &by) in layout.steps.iter().zip(&by) {
                for pass in 1..=steps[0].exponent {
                    for step in steps.iter().filter(|step| step.exponent >= pass) {
                        let from = &expected[step.from] * by;
                        expected[step.of] -= from;
                    }
                }
            }
            let moved = layout.moved_features(&values, &by);
            let moved: Vec<BigInt> = (0..values.len()).map(|position| moved.value(position)).collect();
            prop_assert_eq!(moved, expected);
        }
    }
}
