//! Parsing of decimal numbers to doubles, with the same bits as [`str::parse`].
//!
//! Digits are read eight at a time in a 64-bit word. For an integer `mantissa` of at most 2⁵³ and k ≤ 22 decimals,
//! `mantissa / 10ᵏ` is correctly rounded, because both are exact doubles (W. D. Clinger, "How to read floating point
//! numbers accurately", PLDI 1990). Mantissas of up to 64 bits, with or without an exponent, are rounded by
//! [`nearest`]. The standard library parses all other texts (longer mantissas, spaces, plus signs) and decides if they
//! are numbers.

use memchr::memchr;

use super::field_problem::FieldProblem;
use super::nearest::nearest;

/// Parses a decimal, with or without an exponent, in `bytes[at..end]` whose digits fit 64 bits
/// (`-0.30432148234712341`, `9.6e-05`).
#[inline(always)]
pub(crate) fn parse_long(bytes: &[u8], at: usize, end: usize) -> Option<f64> {
    let negative = *bytes.get(at)? == b'-';
    let start = at + usize::from(negative);
    let (mut mantissa, mut number_end) = digits_on(bytes, start, 0)?;
    let mut decimals = 0;
    if *bytes.get(number_end)? == b'.' {
        let first = number_end + 1;
        (mantissa, number_end) = digits_on(bytes, first, mantissa)?;
        decimals = (number_end - first) as i32;
    }
    let mut exponent = 0;
    if number_end != end {
        exponent = parse_exponent(bytes.get(number_end..end)?)?;
    }
    signed(negative, mantissa, exponent - decimals)
}

/// Returns `±mantissa · 10^exponent`, correctly rounded; `None` for powers that no recording needs.
#[inline(always)]
pub(crate) fn signed(negative: bool, mantissa: u64, exponent: i32) -> Option<f64> {
    let magnitude = match EXACT_POWERS_OF_TEN.get(exponent.wrapping_neg() as usize) {
        Some(power) if mantissa <= 1 << 53 => mantissa as i64 as f64 / power,
        _ => nearest(mantissa, exponent)?,
    };
    Some(f64::from_bits(magnitude.to_bits() | u64::from(negative) << 63))
}

/// Appends the digits from `bytes[at]` on to `before`; returns the value and the end of the digits. `None` without
/// digits, for more than 23, or if the value exceeds 64 bits.
#[inline(always)]
fn digits_on(bytes: &[u8], at: usize, before: u64) -> Option<(u64, usize)> {
    let (mut value, mut end) = (before, at);
    for _ in 0..3 {
        let (more, digits) = leading_digits(bytes, end)?;
        value = value.checked_mul(POWERS_OF_TEN[digits])?.checked_add(more)?;
        end += digits;
        if digits < 8 {
            return (end > at).then_some((value, end));
        }
    }
    None
}

/// Parses an exponent such as `e-05` or `E+3`: an optional sign, and one or two digits.
fn parse_exponent(field: &[u8]) -> Option<i32> {
    let (sign, digits) = match field {
        [b'e' | b'E', b'-', digits @ ..] => (-1, digits),
        [b'e' | b'E', b'+', digits @ ..] | [b'e' | b'E', digits @ ..] => (1, digits),
        _ => return None,
    };
    let is_right = matches!(digits.len(), 1 | 2) && digits.iter().all(u8::is_ascii_digit);
    let add = |value, digit: &u8| 10 * value + i32::from(digit - b'0');
    is_right.then(|| sign * digits.iter().fold(0, add))
}

/// Parses `bytes[at..end]` if it is one to eight digits and enough bytes precede it.
#[inline(always)]
pub(crate) fn parse_digits(bytes: &[u8], at: usize, end: usize) -> Option<u64> {
    let word = u64::from_le_bytes(*bytes.get(..end)?.last_chunk()?);
    let length = end.wrapping_sub(at);
    if length.wrapping_sub(1) >= 8 {
        return None;
    }
    // Sets the bytes before the number to zero.
    let before = 64 - 8 * length;
    let values = (word ^ 0x3030_3030_3030_3030) >> before << before;
    (others(values) == 0).then(|| eight_digits(values))
}

/// Parses the finite number in `field`, which may have spaces around it.
pub(crate) fn parse_field(field: &[u8]) -> Result<f64, FieldProblem> {
    let field = field.trim_ascii();
    if field.is_empty() {
        return Err(FieldProblem::Empty);
    }
    let text = std::str::from_utf8(field).map_err(|_| FieldProblem::NotANumber)?;
    text.parse().map_err(|_| FieldProblem::NotANumber).and_then(finite)
}

pub(crate) fn finite(value: f64) -> Result<f64, FieldProblem> {
    if value.is_finite() { Ok(value) } else { Err(FieldProblem::NotFinite) }
}

/// Replaces the comma between two digits, a decimal comma in files with the separator `;`, by a point. The text keeps
/// its length, so that positions stay valid.
pub(crate) fn with_points(lines: &[u8]) -> Vec<u8> {
    let mut text = lines.to_vec();
    set_points(&mut text);
    text
}

/// Replaces commas in place, like [`with_points`].
pub(super) fn set_points(lines: &mut [u8]) {
    let is_digit = |byte: Option<&u8>| byte.is_some_and(u8::is_ascii_digit);
    let mut from = 0;
    while let Some(found) = memchr(b',', &lines[from..]) {
        let at = from + found;
        if is_digit(at.checked_sub(1).and_then(|before| lines.get(before)))
            && is_digit(lines.get(at + 1))
        {
            lines[at] = b'.';
        }
        from = at + 1;
    }
}

/// Returns the value and number of the digits at `bytes[at]`, up to eight; `None` if fewer bytes are left.
#[inline(always)]
fn leading_digits(bytes: &[u8], at: usize) -> Option<(u64, usize)> {
    let word = u64::from_le_bytes(*bytes.get(at..)?.first_chunk()?);
    let values = word ^ 0x3030_3030_3030_3030;
    let digits = others(values).trailing_zeros() / 8;
    // Moves the digits to the end of the word. Two shifts, because one by 64 bits (no digit) is undefined.
    let half = 32 - 4 * digits;
    Some((eight_digits(values << half << half), digits as usize))
}

/// Returns a word with the top bit set in each byte that is not 0 to 9: adding 0x76 to any other value sets it. A carry
/// may affect later bytes, but cannot hide the first such byte.
#[inline(always)]
fn others(values: u64) -> u64 {
    (values.wrapping_add(0x7676_7676_7676_7676) | values) & 0x8080_8080_8080_8080
}

/// Returns the number of eight digit values, the first in the lowest byte, combined into pairs, fours and eight.
#[inline(always)]
fn eight_digits(values: u64) -> u64 {
    const PAIRS: u64 = 0x0000_00ff_0000_00ff;
    let pairs = values.wrapping_mul(10).wrapping_add(values >> 8);
    let high = (pairs & PAIRS).wrapping_mul(100 + (1_000_000 << 32));
    let low = (pairs >> 16 & PAIRS).wrapping_mul(1 + (10_000 << 32));
    high.wrapping_add(low) >> 32
}

const POWERS_OF_TEN: [u64; 9] =
    [1, 10, 100, 1_000, 10_000, 100_000, 1_000_000, 10_000_000, 100_000_000];

const EXACT_POWERS_OF_TEN: [f64; 16] =
    [1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15];

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Parses like a reader of rows: the fast path if possible.
    fn parse(text: &str) -> Result<f64, FieldProblem> {
        let mut bytes = [BEFORE, text.as_bytes()].concat();
        // Text after a field, so that whole words can be loaded.
        bytes.extend_from_slice(b",12345678901234567890\n");
        let (start, end) = (BEFORE.len(), BEFORE.len() + text.len());
        parse_long(&bytes, start, end).map_or_else(|| parse_field(text.as_bytes()), Ok)
    }

    const BEFORE: &[u8] = b"1425168310.852012,-99,";

    fn assert_as_std(text: &str) -> Result<(), TestCaseError> {
        match (parse(text), text.trim_ascii().parse::<f64>()) {
            (Ok(value), Ok(expected)) => {
                prop_assert_eq!(value.to_bits(), expected.to_bits(), "{:?}", text);
            }
            (Err(FieldProblem::NotFinite), Ok(expected)) => {
                prop_assert!(!expected.is_finite(), "{:?}", text);
            }
            (Err(_), Err(_)) => {}
            (ours, theirs) => prop_assert!(false, "{text:?}: {ours:?}, but std {theirs:?}"),
        }
        Ok(())
    }

    #[test]
    fn only_commas_between_digits_are_decimal() {
        assert_eq!(with_points(b"1,5;-2,25e3;a,b;1,;,5;7"), b"1.5;-2.25e3;a,b;1,;,5;7");
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(20_000))]

    #[test]
        fn plain_decimals_have_the_bits_of_the_standard_library(
            text in "-?[0-9]{0,18}(\\.[0-9]{0,19})?"
        ) {
            assert_as_std(&text)?;
        }

        #[test]
        fn numbers_with_exponents_have_the_bits_of_the_standard_library(
            text in "[-+]?[0-9]{1,25}(\\.[0-9]{0,25})?([eE][-+]?[0-9]{1,3})?"
        ) {
            assert_as_std(&text)?;
        }

        #[test]
        fn every_double_survives_its_shortest_decimal(bits in any::<u64>()) {
            assert_as_std(&f64::from_bits(bits).to_string())?;
            assert_as_std(&format!("{:e}", f64::from_bits(bits)))?;
        }

        #[test]
        fn garbage_is_refused_where_the_standard_library_refuses_it(
            text in "[-+.eE0-9a-zA-Z_ ]{0,20}"
        ) {
            assert_as_std(&text)?;
        }

        #[test]
        fn any_bytes_are_read_without_a_panic(bytes in proptest::collection::vec(any::<u8>(), 0..80)) {
            for at in 0..bytes.len() + 2 {
                for end in 0..bytes.len() + 2 {
                    let _ = parse_long(&bytes, at, end);
                }
            }
            let _ = parse_field(&bytes);
        }
    }

    #[test]
    fn boundaries_of_the_short_way_have_the_bits_of_the_standard_library() {
        for text in [
            "0",
            "-0",
            "0.0",
            "-0.0",
            "5.",
            ".5",
            "-.5",
            "-",
            "+5",
            "",
            ".",
            "-.",
            "00012",
            "1e5",
            "1E-5",
            "99999999",
            "999999999",
            "12345678.12345678",
            "9007199254740992",
            "9007199254740993",
            "900719925474099.2",
            "0.9007199254740993",
            "123456789012345.1234567890123456",
            "0.000000000000001",
            "0.0000000000000001",
            "1425168310.852012",
            "-0.0630686291217",
            "1 2",
            "1_000",
            "١",
            "0x10",
            "1e400",
            "nan",
            "inf",
            "-infinity",
            "1e-400",
        ] {
            assert_as_std(text).unwrap();
        }
    }

    #[test]
    fn what_is_no_finite_number_is_told_apart() {
        assert_eq!(parse("  "), Err(FieldProblem::Empty));
        assert_eq!(parse("1,5"), Err(FieldProblem::NotANumber));
        assert_eq!(parse("NaN"), Err(FieldProblem::NotFinite));
        assert_eq!(parse("1e999"), Err(FieldProblem::NotFinite));
        assert_eq!(parse(" 1.5 "), Ok(1.5));
    }
}
