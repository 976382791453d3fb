//! Numbers that are multiples of a step, as digital sensors give them and loggers print them.
//!
//! A sensor that resolves 1/160 N reports 0.00625, −0.0125, 1.1 and so on: decimals in a log, each
//! rounded to a double where it is read. Such numbers can be calculated with as the small integers that
//! they are.

/// A decimal step: `times / over`. Its multiples are those rounded to doubles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct DecimalStep {
    /// A whole number; zero if all that is known are zeros.
    times: u64,
    /// A power of ten.
    over: u64,
}

/// More decimals are not those of a sensor.
const FINEST: u64 = 1_000_000_000;

/// Numbers of more steps of the finest kind are not worth the trouble: the products that are
/// calculated with are exact below.
const MOST: f64 = (1_u64 << 40) as f64;

/// Whole numbers up to here are doubles.
const EXACT: u64 = 1 << f64::MANTISSA_DIGITS;

impl DecimalStep {
    /// The step of zeros.
    pub(crate) const NONE: Self = Self { times: 0, over: 1 };

    /// The largest step that all `values` are multiples of; `None` if there is none.
    pub(crate) fn new(values: &[f64]) -> Option<Self> {
        values.iter().try_fold(Self::NONE, |known, &value| {
            if known.has_multiple(value) {
                return Some(known);
            }
            let mut over = known.over;
            while !is_decimal(value, over as f64) {
                over = Some(10 * over).filter(|&over| over <= FINEST)?;
            }
            let times = (value * over as f64).round().abs() as u64;
            Self { times, over }.and(known)
        })
    }

    /// The largest step that the multiples of both are multiples of; `None` if it is too fine for
    /// the larger of them.
    pub(crate) fn and(self, other: Self) -> Option<Self> {
        let over = self.over.max(other.over);
        let times = |step: Self| step.times.checked_mul(over / step.over);
        let times = gcd(times(self)?, times(other)?);
        (times <= EXACT).then_some(Self { times, over })
    }

    /// Whether a value is the double nearest to a multiple, so that it says nothing new. Multiples
    /// of more than so many of the finest steps do not count, see [`is_decimal`].
    fn has_multiple(self, value: f64) -> bool {
        let count = nearest_integer(value * self.per_value()) * self.times as f64;
        count.abs() < MOST && count / self.over as f64 == value
    }

    /// The step itself, as a double; `None` of zeros.
    pub(crate) fn size(self) -> Option<f64> {
        (self.times > 0).then_some(self.times as f64 / self.over as f64)
    }

    fn per_value(self) -> f64 {
        if self.times > 0 { self.over as f64 / self.times as f64 } else { 0.0 }
    }
}

/// Added to it, an integer stands in the lowest bits.
const TO_LOWEST_BITS: f64 = 1.5 * (1_u64 << 52) as f64;

/// An integer next to a number below 2⁵¹; of others, whatever.
fn nearest_integer(value: f64) -> f64 {
    (value + TO_LOWEST_BITS) - TO_LOWEST_BITS
}

/// Whether `value` is the double nearest to a multiple of `1/over`.
fn is_decimal(value: f64, over: f64) -> bool {
    let count = (value * over).round();
    count.abs() < MOST && count / over == value
}

fn gcd(mut a: u64, mut b: u64) -> u64 {
    while b > 0 {
        (a, b) = (b, a % b);
    }
    a
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_step_is_the_largest_that_suits_all() {
        let of = |values: &[f64]| DecimalStep::new(values).map(|step| (step.times, step.over));
        assert_eq!(of(&[0.0125, -0.00625, 1.1, 0.0]), Some((625, 100_000)));
        assert_eq!(of(&[6.0, -9.0]), Some((3, 1)));
        assert_eq!(of(&[0.0, -0.0]), Some((0, 1)));
        assert_eq!(of(&[0.1 + 0.2]), None);
        assert_eq!(of(&[1.0 / 3.0]), None);
        assert_eq!(of(&[f64::NAN]), None);
        assert_eq!(of(&[f64::INFINITY]), None);
        assert_eq!(of(&[1e300]), None);
        // 10²¹ of the finest steps, which no 64 bits hold.
        assert_eq!(of(&[1e12, 1e-9]), None);
        assert_eq!(
            DecimalStep::new(&[1e12]).unwrap().and(DecimalStep::new(&[1e-9]).unwrap()),
            None
        );
    }

    #[test]
    fn steps_of_parts_are_those_of_the_whole() {
        let values = [0.0, 12.5, -0.04, 7.0, 0.002];
        for cut in 0..=values.len() {
            let [a, b] =
                [&values[..cut], &values[cut..]].map(|part| DecimalStep::new(part).unwrap());
            assert_eq!(a.and(b).unwrap().size(), DecimalStep::new(&values).unwrap().size());
        }
    }
}
