//! Cutting numbers into small integers, so that sums of their products are exact.
//!
//! A number is a sum of limbs, `Σ limb_i·2^(unit + width·i)`, each an integer of at most
//! `2^(width−1)` in magnitude. A sum over a block of rows of products of two integers is exact in
//! `f64` if its terms add up to at most 2⁵³:
//!
//! ```text
//! 2^(width−1) · largest right operand · ROWS ≤ 2⁵³
//! ```
//!
//! Only the left operands are cut as long as the right ones, the features, leave room for that.

use super::kernel::ROWS;

/// Bits of an exact sum, less those that a block of rows takes.
const BITS: u32 = f64::MANTISSA_DIGITS - ROWS.ilog2();

/// Limbs of the wrench that are multiplied with each other: `2·(WIDTH − 1) ≤ BITS`.
pub(super) const SQUARE_WIDTH: u32 = BITS / 2 + 1;

/// The largest distance between a reading and its centre: half the range of 16 bits.
pub(super) const MAX_DISTANCE: u32 = 1 << 15;

/// How the features of readings within some distance of their centres are multiplied.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct FeatureLimbs {
    /// The largest distance between a reading and its centre that this is good for.
    pub(super) largest: u32,
    /// Width of the limbs on the left.
    pub(super) width: u32,
    /// Limbs on the left for features of degree 0 to 3.
    pub(super) left: [usize; 4],
    /// Width of the two limbs on the right, if features are cut there too.
    pub(super) right: Option<u32>,
}

impl FeatureLimbs {
    /// The cheapest way for distances up to `distance`, with room for a quarter more where that
    /// costs nothing.
    pub(super) fn new(distance: u32, degree: u32) -> Self {
        let distance = distance.clamp(1, MAX_DISTANCE);
        let exact = Self::for_distance(distance, degree);
        let roomy = Self::for_distance((distance + distance / 4 + 1).min(MAX_DISTANCE), degree);
        if roomy.cost(degree) == exact.cost(degree) { roomy } else { exact }
    }

    fn for_distance(largest: u32, degree: u32) -> Self {
        let bits = |exponent: u32| bits_of(u64::from(largest).pow(exponent));
        let limbs = |width: u32| {
            std::array::from_fn(|e| (bits(e as u32) + 1).div_ceil(width).max(1) as usize)
        };
        // A right operand is at most 2^bits, so that a limb may be 2^(BITS − bits).
        if let Some(width) = BITS.checked_sub(bits(degree)).map(|spare| spare + 1) {
            let whole = Self { largest, width, left: limbs(width), right: None };
            if whole.cost(degree) <= 4 {
                return whole;
            }
        }
        let right = (bits(degree) + 1).div_ceil(2);
        let width = BITS - (right - 1) + 1;
        Self { largest, width, left: limbs(width), right: Some(right) }
    }

    /// Products for one sum of features of the highest degree.
    fn cost(&self, degree: u32) -> usize {
        self.left[degree as usize] * self.rights()
    }

    /// Number of parts of the features on the right.
    pub(super) fn rights(&self) -> usize {
        if self.right.is_some() { 2 } else { 1 }
    }
}

/// The smallest b with `value ≤ 2^b`.
fn bits_of(value: u64) -> u32 {
    value.next_power_of_two().ilog2()
}

/// The binary places that a set of numbers covers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Places {
    /// All are multiples of `2^low`.
    low: i32,
    /// All are below `2^high` in magnitude.
    high: i32,
}

impl Places {
    /// No places: zero only.
    pub(super) const NONE: Self = Self { low: i32::MAX, high: i32::MIN };

    /// The places of numbers; what is not finite has none.
    pub(super) fn of(values: &[f64]) -> Self {
        let mut places = Self::NONE;
        for &value in values.iter().filter(|&&v| v != 0.0 && v.is_finite()) {
            let bits = value.to_bits();
            let (exponent, fraction) = ((bits >> 52) as i32 & 0x7ff, bits & ((1 << 52) - 1));
            let (significand, unit) = match exponent {
                0 => (fraction, -1074),
                _ => (fraction | 1 << 52, exponent - 1075),
            };
            places.low = places.low.min(unit + significand.trailing_zeros() as i32);
            places.high = places.high.max(unit + 64 - significand.leading_zeros() as i32);
        }
        places
    }

    /// The places of both.
    pub(super) fn and(self, other: Self) -> Self {
        Self { low: self.low.min(other.low), high: self.high.max(other.high) }
    }

    /// Limbs of the given width that cover these places, with a few places to spare at either end
    /// where that takes no further limb. `None` if the places are too many.
    pub(super) fn limbs(self, width: u32) -> Option<Limbs> {
        /// More would be slower than other solvers and need more exponents than `f64` has.
        const MOST_PLACES: i32 = 256;
        const LOWEST_UNIT: i32 = -960;
        if self.low > self.high {
            return Some(Limbs { unit: 0, width, count: 0 });
        }
        let places = self.high - self.low + 1;
        let count = (places as u32).div_ceil(width);
        let spare = (count * width) as i32 - places;
        let unit = self.low - spare / 2;
        (places <= MOST_PLACES && unit >= LOWEST_UNIT).then_some(Limbs {
            unit,
            width,
            count: count as usize,
        })
    }
}

/// A way to cut numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Limbs {
    /// Exponent of the unit of the lowest limb.
    pub(super) unit: i32,
    /// Distance between limbs in places.
    pub(super) width: u32,
    /// Number of limbs.
    pub(super) count: usize,
}

impl Limbs {
    /// Integers in `count` limbs.
    pub(super) fn of_integers(width: u32, count: usize) -> Self {
        Self { unit: 0, width, count }
    }

    /// Cuts a column into `count` columns, lowest first. Says whether the limbs add up to the
    /// numbers.
    #[inline(always)]
    pub(super) fn cut(self, column: &[f64], out: &mut [f64]) -> bool {
        let Limbs { unit, width, count } = self;
        let top = power_of_two(i32::try_from(count).expect("few limbs") * width as i32 - 1);
        let scale = power_of_two(-unit);
        let mut exact = true;
        // Enough rows at once to hide the latency of one chain of additions.
        const TOGETHER: usize = 32;
        let (column, _) = column.as_chunks::<TOGETHER>();
        for (block, numbers) in column.iter().enumerate() {
            let mut rest: [f64; TOGETHER] = std::array::from_fn(|i| numbers[i] * scale);
            let mut largest: f64 = 0.0;
            for x in rest {
                largest = if x.abs() > largest { x.abs() } else { largest };
            }
            for limb in (0..count).rev() {
                // Adding and taking away 1.5·2^(52 + e) rounds to a multiple of 2^e, exactly.
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
            let left: f64 = rest.iter().map(|x| x.abs()).sum();
            exact &= largest <= top && left == 0.0;
        }
        exact
    }
}

/// `2^exponent` for the exponents of normal numbers.
#[inline(always)]
pub(super) fn power_of_two(exponent: i32) -> f64 {
    debug_assert!((-1022..=1023).contains(&exponent));
    f64::from_bits(((exponent + 1023) as u64) << 52)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn sums_of_a_block_never_exceed_what_is_exact() {
        for degree in 1..=3 {
            for distance in 1..=MAX_DISTANCE {
                let limbs = FeatureLimbs::new(distance, degree);
                assert!(limbs.largest >= distance && limbs.largest <= MAX_DISTANCE);
                let feature = u128::from(limbs.largest).pow(degree);
                let right = limbs.right.map_or(feature, |width| 1 << (width - 1));
                assert!(right * (1 << (limbs.width - 1)) * ROWS as u128 <= 1 << 53);
                // All features fit into their limbs.
                for exponent in 0..=degree {
                    let places = limbs.left[exponent as usize] as u32 * limbs.width;
                    assert!(u128::from(limbs.largest).pow(exponent) <= 1 << (places - 1));
                }
                assert!(limbs.right.is_none_or(|width| feature <= 1 << (2 * width - 1)));
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
            let limbs = Places::of(&numbers).limbs(width).unwrap();
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
        let limbs = Places::of(&[1.0, 7.0]).limbs(4).unwrap();
        let mut out = vec![0.0; limbs.count * ROWS];
        let cut = |x: f64, out: &mut [f64]| limbs.cut(&[x; ROWS], out);
        assert!(cut(-5.0, &mut out));
        assert!(!cut(0.01, &mut out));
        assert!(!cut(100.0, &mut out));
        assert!(!cut(f64::MAX, &mut out));
    }

    #[test]
    fn places_of_subnormal_and_of_no_numbers() {
        assert_eq!(Places::of(&[0.0, -0.0]), Places::NONE);
        assert_eq!(Places::of(&[5e-324]), Places { low: -1074, high: -1073 });
        assert_eq!(Places::of(&[-6.0, 0.5]), Places { low: -1, high: 3 });
        assert_eq!(Places::NONE.limbs(20), Some(Limbs { unit: 0, width: 20, count: 0 }));
        assert_eq!(Places::of(&[1.0, 1e-200]).limbs(20), None);
    }
}
