//! Numbers that are multiples of a step, as digital sensors give them and loggers print them.
//!
//! A sensor that resolves 1/160 N reports 0.00625, −0.0125, 1.1 and so on: decimals in a log, each
//! rounded to a double where it is read. Such numbers can be kept and calculated with as the small
//! integers that they are.

use pulp::NullaryFnOnce;
use shell_data::instructions::arch;

/// A decimal step: `times / over`. Its multiples are those rounded to doubles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DecimalStep {
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
    pub const NONE: Self = Self { times: 0, over: 1 };

    /// The largest step that all `values` are multiples of; `None` if there is none.
    pub fn of(values: &[f64]) -> Option<Self> {
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
    pub fn and(self, other: Self) -> Option<Self> {
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
    pub fn size(self) -> Option<f64> {
        (self.times > 0).then_some(self.times as f64 / self.over as f64)
    }

    /// Writes the values to `out`, which is as long, as words; `None` if not all of them are such
    /// multiples, or are too far apart.
    pub fn count(self, values: &[f64], out: &mut [u16]) -> Option<WordEncoding> {
        let first = values.first().copied().unwrap_or(0.0);
        let base = (first * self.per_value()).round() - f64::from(1 << 15);
        let words = WordEncoding { times: self.times as f64, over: self.over as f64, base };
        let per_value = self.per_value();
        arch().dispatch(Count { words, per_value, values, out }).then_some(words)
    }

    fn per_value(self) -> f64 {
        if self.times > 0 { self.over as f64 / self.times as f64 } else { 0.0 }
    }
}

/// How a column is kept as words: each value is `(base + word) · times / over`, rounded.
#[derive(Clone, Copy, Debug)]
pub struct WordEncoding {
    times: f64,
    over: f64,
    base: f64,
}

impl WordEncoding {
    /// Writes the values of `words` to `out`, which is as long.
    pub fn values(self, words: &[u16], out: &mut [f64]) {
        arch().dispatch(Values { words: self, counts: words, out });
    }

    #[inline(always)]
    fn value(self, word: f64) -> f64 {
        (self.base + word) * self.times / self.over
    }

    /// Whether values are whole numbers, which need no division: readings, as a rule.
    fn is_whole(self) -> bool {
        self.over == 1.0
    }

    /// [`value`](Self::value) where they are.
    #[inline(always)]
    fn whole_value(self, word: f64) -> f64 {
        (self.base + word) * self.times
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

/// [`DecimalStep::count`], inlined whole into code for the widest vectors of the machine.
struct Count<'a> {
    words: WordEncoding,
    per_value: f64,
    values: &'a [f64],
    out: &'a mut [u16],
}

impl NullaryFnOnce for Count<'_> {
    type Output = bool;

    #[inline(always)]
    fn call(self) -> bool {
        match self.words.is_whole() {
            true => self.count(WordEncoding::whole_value),
            false => self.count(WordEncoding::value),
        }
    }
}

impl Count<'_> {
    #[inline(always)]
    fn count(self, value_of: impl Fn(WordEncoding, f64) -> f64) -> bool {
        let Self { words, per_value, values, out } = self;
        // Without a way out of the loop: it is all or nothing, and nearly always all.
        let mut all = true;
        for (out, &value) in out.iter_mut().zip(values) {
            let raised = (value * per_value - words.base) + TO_LOWEST_BITS;
            let word = raised - TO_LOWEST_BITS;
            let fits = (word >= 0.0) & (word <= f64::from(u16::MAX));
            all &= fits & (value_of(words, word) == value);
            *out = raised.to_bits() as u16;
        }
        all
    }
}

/// [`WordEncoding::values`], inlined in the same way.
struct Values<'a> {
    words: WordEncoding,
    counts: &'a [u16],
    out: &'a mut [f64],
}

impl NullaryFnOnce for Values<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { words, counts, out } = self;
        if words.is_whole() {
            for (out, &count) in out.iter_mut().zip(counts) {
                *out = words.whole_value(f64::from(count));
            }
            return;
        }
        for (out, &count) in out.iter_mut().zip(counts) {
            *out = words.value(f64::from(count));
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn the_step_is_the_largest_that_suits_all() {
        let of = |values: &[f64]| DecimalStep::of(values).map(|step| (step.times, step.over));
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
        assert_eq!(DecimalStep::of(&[1e12]).unwrap().and(DecimalStep::of(&[1e-9]).unwrap()), None);
    }

    #[test]
    fn steps_of_parts_are_those_of_the_whole() {
        let values = [0.0, 12.5, -0.04, 7.0, 0.002];
        for cut in 0..=values.len() {
            let [a, b] =
                [&values[..cut], &values[cut..]].map(|part| DecimalStep::of(part).unwrap());
            assert_eq!(a.and(b).unwrap().size(), DecimalStep::of(&values).unwrap().size());
        }
    }

    #[test]
    fn what_is_no_multiple_or_too_far_from_the_first_is_not_counted() {
        let step = DecimalStep::of(&[0.00625]).unwrap();
        let mut out = [0; 2];
        for value in [0.003, 40000.0 * 0.00625, 0.1 + 0.2, f64::NAN, f64::INFINITY] {
            assert!(step.count(&[0.00625, value], &mut out).is_none(), "{value}");
        }
        assert!(step.count(&[f64::NAN], &mut out[..1]).is_none());
        assert!(DecimalStep::NONE.count(&[0.0, 1.0], &mut out).is_none());
        assert!(DecimalStep::NONE.count(&[0.0, 0.0], &mut out).is_some());
    }

    proptest! {
        #[test]
        fn words_give_the_same_numbers_back(
            lowest in -1_000_000..1_000_000_i32,
            counts in prop::collection::vec(0..32767_i32, 1..100),
            times in 1..1000_u32,
            decimals in 0..=8,
        ) {
            // As a logger prints them and a parser reads them.
            let print = |count: &i32| {
                let digits = i64::from(lowest + count) * i64::from(times);
                format!("{digits}e-{decimals}").parse::<f64>().unwrap()
            };
            let values: Vec<f64> = counts.iter().map(print).collect();
            let step = DecimalStep::of(&values).unwrap();
            let (mut words, mut back) = (vec![0; values.len()], vec![0.0; values.len()]);
            step.count(&values, &mut words).unwrap().values(&words, &mut back);
            prop_assert_eq!(back, values);
        }
    }
}
