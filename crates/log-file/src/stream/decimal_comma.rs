//! Decimal commas, as spreadsheets of many languages write them where `;` stands between fields.

use memchr::memchr_iter;

/// The text with points for the commas between two digits. It keeps its length, so that positions in it
/// stay what they are.
pub(crate) fn with_points(lines: &[u8]) -> Vec<u8> {
    let mut text = lines.to_vec();
    let is_digit = |byte: Option<&u8>| byte.is_some_and(u8::is_ascii_digit);
    let between_digits = |&at: &usize| {
        is_digit(at.checked_sub(1).and_then(|before| lines.get(before)))
            && is_digit(lines.get(at + 1))
    };
    memchr_iter(b',', lines).filter(between_digits).for_each(|at| text[at] = b'.');
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_commas_between_digits_are_decimal() {
        assert_eq!(with_points(b"1,5;-2,25e3;a,b;1,;,5;7"), b"1.5;-2.25e3;a,b;1,;,5;7");
    }
}
