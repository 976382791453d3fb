//! Numbers cut into small integers, so that sums of their products are exact.
//!
//! A number is `Σ limb_i·2^(unit + width·i)`, each limb an integer of at most `2^(width−1)` in
//! magnitude. A sum of products of two integers over a block of rows is exact in `f64` if
//!
//! ```text
//! 2^(width−1) · largest right operand · ROWS ≤ 2⁵³
//! ```
//!
//! Two ways satisfy this, and the cheaper is used: whole right operands with left limbs narrow enough for them, or
//! limbs of one width for all operands and the wrench.

use num_traits::Float;

use super::integers::power_of_two;
use super::layout::SumLayout;

/// Rows in a block: enough that adding up vector lanes costs little, few enough that the 164
/// features of degree three fit in a cache of 512 kB.
pub(crate) const ROWS: usize = 256;

/// Bits available to a product: the bits of an exact sum, less those that adding up a block of rows needs.
const BITS: u32 = f64::MANTISSA_DIGITS - ROWS.ilog2();

/// Width of the wrench limbs that are multiplied with each other: `2·(WIDTH − 1) ≤ BITS`.
pub(crate) const SQUARE_WIDTH: u32 = BITS / 2 + 1;

/// Largest distance between a reading and its centre: half the range of 16 bits.
pub(crate) const MAX_DISTANCE: u32 = 1 << 15;

/// Division of features into limbs: the width of the limbs, and their number for each degree from 0 to 3.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Cut {
    pub(crate) width: u32,
    pub(crate) counts: [usize; 4],
}

/// A way to multiply the features of readings within some distance of their centres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct FeatureLimbs {
    /// Largest supported distance between a reading and its centre.
    pub(crate) largest: u32,
    pub(crate) left: Cut,
    pub(crate) right: Cut,
    /// Right operands are at most two to this power.
    right_bits: u32,
}

impl FeatureLimbs {
    /// Chooses the cheapest way for distances up to `distance` and these places of the wrench. Allows a quarter more
    /// distance if that costs nothing.
    pub(crate) fn new(distance: u32, layout: &SumLayout, wrench: &[BinaryPlaces]) -> Self {
        let cheapest = |distance: u32| {
            let distance = distance.clamp(1, MAX_DISTANCE);
            let degrees = layout.features.iter().map(|term| term.factors().len() as u32);
            let degree = degrees.max().unwrap_or(1);
            let ways = [Self::whole_on_the_right(distance, degree), Some(Self::even(distance))];
            let ways = ways.into_iter().flatten();
            let costs = ways.map(|way| (way.cost(layout, wrench), way));
            costs.min_by_key(|&(cost, _)| cost).expect("one way is always possible")
        };
        let (cost, exact) = cheapest(distance);
        let (roomy_cost, roomy) = cheapest((distance + distance / 4 + 1).min(MAX_DISTANCE));
        if roomy_cost == cost { roomy } else { exact }
    }

    /// Keeps right operands whole, up to the highest degree, with left limbs narrow enough for them.
    fn whole_on_the_right(largest: u32, degree: u32) -> Option<Self> {
        let right_bits = bits_of_power(largest, degree);
        let width = BITS.checked_sub(right_bits)? + 1;
        Some(Self {
            largest,
            left: Cut::new(width, largest),
            right: Cut::new(right_bits + 1, largest),
            right_bits,
        })
    }

    fn even(largest: u32) -> Self {
        let cut = Cut::new(SQUARE_WIDTH, largest);
        Self { largest, left: cut, right: cut, right_bits: SQUARE_WIDTH - 1 }
    }

    /// Returns true if a feature of this degree has the same columns on the left and on the right.
    pub(crate) fn is_shared(&self, degree: usize) -> bool {
        let (left, right) = (self.left, self.right);
        left.counts[degree] == right.counts[degree]
            && (left.counts[degree] == 1 || left.width == right.width)
    }

    /// Width of the wrench limbs for products with features: [`SQUARE_WIDTH`] if narrow enough.
    pub(crate) fn cross_width(&self) -> u32 {
        (BITS - self.right_bits + 1).min(SQUARE_WIDTH)
    }

    /// Cost of a row, counted in products: products of features and wrench, and the cutting of the wrench.
    fn cost(&self, layout: &SumLayout, wrench: &[BinaryPlaces]) -> usize {
        const CUT: usize = 5;
        let count = |cut: &Cut, f: usize| cut.counts[layout.features[f].factors().len()];
        let products = layout.groups.iter().map(|group| {
            let left: usize = group.left.iter().map(|&f| count(&self.left, f)).sum();
            let right: usize = group.right.clone().map(|f| count(&self.right, f)).sum();
            left * right
        });
        let rights: usize = (0..layout.features.len()).map(|f| count(&self.right, f)).sum();
        let width = self.cross_width();
        let limbs: usize =
            wrench.iter().filter_map(|axis| axis.limbs(width)).map(|limbs| limbs.count).sum();
        // Limbs of `SQUARE_WIDTH` are needed for the squares of the wrench anyway.
        let cut = if width == SQUARE_WIDTH { 0 } else { limbs };
        products.sum::<usize>() + (limbs + 1) * rights + CUT * cut
    }
}

impl Cut {
    fn new(width: u32, largest: u32) -> Self {
        let limbs = |degree: u32| (bits_of_power(largest, degree) + 1).div_ceil(width) as usize;
        Self { width, counts: std::array::from_fn(|degree| limbs(degree as u32)) }
    }
}

/// The smallest b with `valueᵉ ≤ 2^b`.
fn bits_of_power(value: u32, exponent: u32) -> u32 {
    bits_of(u64::from(value).pow(exponent))
}

/// The smallest b with `value ≤ 2^b`.
fn bits_of(value: u64) -> u32 {
    value.next_power_of_two().ilog2()
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct BinaryPlaces {
    /// All numbers are multiples of `2^low`.
    low: i32,
    /// All numbers are below `2^high` in magnitude.
    high: i32,
}

impl BinaryPlaces {
    pub(crate) const NONE: Self = Self { low: i32::MAX, high: i32::MIN };

    pub(crate) fn new(values: &[f64]) -> Self {
        let mut places = Self::NONE;
        for &value in values.iter().filter(|&&v| v != 0.0 && v.is_finite()) {
            let (significand, exponent, _) = value.integer_decode();
            let unit = i32::from(exponent);
            places.low = places.low.min(unit + significand.trailing_zeros() as i32);
            places.high = places.high.max(unit + 64 - significand.leading_zeros() as i32);
        }
        places
    }

    pub(crate) fn and(self, other: Self) -> Self {
        Self { low: self.low.min(other.low), high: self.high.max(other.high) }
    }

    /// Limbs of the given width that cover these places; `None` for too many places. Up to two spare places go above,
    /// for larger loads. The others go below: the last place of a number near zero is far down.
    pub(crate) fn limbs(self, width: u32) -> Option<Limbs> {
        /// Maximum number of places. More are slower than other solvers, and need more exponents than `f64` has.
        const MOST_PLACES: i32 = 256;
        const LOWEST_UNIT: i32 = -960;
        if self.low > self.high {
            return Some(Limbs { unit: 0, width, count: 0 });
        }
        let places = self.high - self.low + 1;
        let count = (places as u32).div_ceil(width);
        let spare = (count * width) as i32 - places;
        let unit = self.low - (spare - spare.min(2));
        (places <= MOST_PLACES && unit >= LOWEST_UNIT).then_some(Limbs {
            unit,
            width,
            count: count as usize,
        })
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Limbs {
    /// Exponent of the unit of the lowest limb.
    pub(crate) unit: i32,
    /// Places from one limb to the next.
    pub(crate) width: u32,
    pub(crate) count: usize,
}

impl Limbs {
    pub(crate) fn from_integers(width: u32, count: usize) -> Self {
        Self { unit: 0, width, count }
    }

    /// Cuts a column into `count` columns, lowest limb first. Returns true if the limbs add up to the column.
    #[inline(always)]
    pub(crate) fn cut(self, column: &[f64], out: &mut [f64]) -> bool {
        let Limbs { unit, width, count } = self;
        let top = power_of_two(i32::try_from(count).expect("few limbs") * width as i32 - 1);
        let scale = power_of_two(-unit);
        // Rows processed together, enough to hide the latency of a chain of additions.
        const TOGETHER: usize = 32;
        let (mut largest, mut left) = ([0.0_f64; TOGETHER], [0.0; TOGETHER]);
        let (column, _) = column.as_chunks::<TOGETHER>();
        for (block, numbers) in column.iter().enumerate() {
            // Loops over lanes: closures may not be inlined.
            let mut rest = *numbers;
            for i in 0..TOGETHER {
                rest[i] *= scale;
                largest[i] = if rest[i].abs() > largest[i] { rest[i].abs() } else { largest[i] };
            }
            for limb in (0..count).rev() {
                // Adding and subtracting 1.5·2^(52 + e) rounds to a multiple of 2^e, exactly.
                let places = width as i32 * limb as i32;
                let (round, down) = (1.5 * power_of_two(52 + places), power_of_two(-places));
                let start = limb * ROWS + block * TOGETHER;
                let out = &mut out[start..start + TOGETHER];
                for i in 0..TOGETHER {
                    let rounded = (rest[i] + round) - round;
                    rest[i] -= rounded;
                    out[i] = rounded * down;
                }
            }
            for i in 0..TOGETHER {
                left[i] += rest[i].abs();
            }
        }
        largest.iter().all(|&largest| largest <= top) && left.iter().all(|&left| left == 0.0)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::model::Basis;

    #[test]
    fn sums_of_a_block_stay_exact() {
        let wrench = [BinaryPlaces::new(&[1e-3, 500.0 / 3.0]); 6];
        for basis in Basis::ALL {
            let layout = SumLayout::new(basis, 2);
            for distance in 1..=MAX_DISTANCE {
                let limbs = FeatureLimbs::new(distance, &layout, &wrench);
                assert!(limbs.largest >= distance && limbs.largest <= MAX_DISTANCE);
                let largest = |cut: &Cut, degree: usize| {
                    let feature = u128::from(limbs.largest).pow(degree as u32);
                    let places = cut.counts[degree] as u32 * cut.width;
                    assert!(feature <= 1 << (places - 1), "the limbs hold the feature");
                    if cut.counts[degree] == 1 { feature } else { 1 << (cut.width - 1) }
                };
                let cross = limbs.cross_width();
                for right in 1..=basis.degree() {
                    let right = largest(&limbs.right, right);
                    for left in 1..=basis.degree() {
                        let left = largest(&limbs.left, left);
                        assert!(left * right * ROWS as u128 <= 1 << 53);
                    }
                    assert!(right * (1 << (cross - 1)) * ROWS as u128 <= 1 << 53);
                }
            }
        }
        assert!((1u64 << (2 * (SQUARE_WIDTH - 1))) * ROWS as u64 <= 1 << 53);
    }

    proptest! {
        #[test]
        fn limbs_are_small_integers_that_add_up(
            numbers in prop::collection::vec(-1e6..1e6_f64, ROWS),
            width in 8u32..30,
        ) {
            let limbs = BinaryPlaces::new(&numbers).limbs(width).unwrap();
            let mut out = vec![0.0; limbs.count * ROWS];
            prop_assert!(limbs.cut(&numbers, &mut out));
            for (row, &number) in numbers.iter().enumerate() {
                let mut rest = number;
                for i in (0..limbs.count).rev() {
                    let limb = out[i * ROWS + row];
                    prop_assert!(limb == limb.round() && limb.abs() <= power_of_two(width as i32 - 1));
                    rest -= limb * power_of_two(limbs.unit + (width as usize * i) as i32);
                }
                prop_assert_eq!(rest, 0.0);
            }
        }
    }

    #[test]
    fn numbers_that_do_not_fit_are_noticed() {
        let limbs = BinaryPlaces::new(&[1.0, 7.0]).limbs(4).unwrap();
        let mut out = vec![0.0; limbs.count * ROWS];
        let cut = |x: f64, out: &mut [f64]| limbs.cut(&[x; ROWS], out);
        assert!(cut(-5.0, &mut out));
        assert!(!cut(0.01, &mut out));
        assert!(!cut(100.0, &mut out));
        assert!(!cut(f64::MAX, &mut out));
    }

    #[test]
    fn subnormal_numbers_have_places_and_a_column_of_zeros_has_none() {
        assert_eq!(BinaryPlaces::new(&[0.0, -0.0]), BinaryPlaces::NONE);
        assert_eq!(BinaryPlaces::new(&[5e-324]), BinaryPlaces { low: -1074, high: -1073 });
        assert_eq!(BinaryPlaces::new(&[-6.0, 0.5]), BinaryPlaces { low: -1, high: 3 });
        assert_eq!(BinaryPlaces::NONE.limbs(20), Some(Limbs { unit: 0, width: 20, count: 0 }));
        assert_eq!(BinaryPlaces::new(&[1.0, 1e-200]).limbs(20), None);
    }
}
