//! Decimal commas, as spreadsheets of many languages write them where `;` stands between fields.

use memchr::memchr_iter;

/// Makes points of the commas between two digits. The text keeps its length, so that positions in it
/// stay what they are.
pub(crate) fn to_points(lines: &mut [u8]) {
    let is_digit = |byte: Option<&u8>| byte.is_some_and(u8::is_ascii_digit);
    let between_digits = |&at: &usize| {
        is_digit(at.checked_sub(1).and_then(|before| lines.get(before)))
            && is_digit(lines.get(at + 1))
    };
    let commas: Vec<usize> = memchr_iter(b',', lines).filter(between_digits).collect();
    commas.into_iter().for_each(|at| lines[at] = b'.');
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_commas_between_digits_are_decimal() {
        let mut text = b"1,5;-2,25e3;a,b;1,;,5;7".to_vec();
        to_points(&mut text);
        assert_eq!(text, b"1.5;-2.25e3;a,b;1,;,5;7");
    }
}
