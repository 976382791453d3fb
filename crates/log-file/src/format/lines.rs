//! The lines of a text, and the fields of a line.

use crate::line::{is_comment, quoted_fields, without_returns};
use memchr::memchr;

#[derive(Clone, Copy)]
pub(super) struct LayoutLine<'a> {
    pub(super) text: &'a [u8],
    pub(super) start: usize,
    pub(super) next: usize,
    pub(super) number: u64,
}

fn trimmed(text: &[u8]) -> &[u8] {
    let is_other = |byte: &u8| *byte != b' ';
    let start = text.iter().position(is_other).unwrap_or(text.len());
    let end = text.iter().rposition(is_other).map_or(start, |at| at + 1);
    &text[start..end]
}

/// Iterates over the lines from `start` that are not blank, including comments, numbered from `number`.
pub(super) fn all_lines(
    head: &[u8],
    start: usize,
    number: u64,
) -> impl Iterator<Item = LayoutLine<'_>> {
    let mut next = start;
    let line = move |number| {
        let start = next;
        let rest = head.get(start..).filter(|rest| !rest.is_empty())?;
        let end = memchr(b'\n', rest).map_or(head.len(), |at| start + at);
        next = (end + 1).min(head.len());
        let text = without_returns(&head[start..end]);
        Some(LayoutLine { text, start, next, number })
    };
    (number..).map_while(line).filter(|line| !line.text.trim_ascii().is_empty())
}

/// Iterates over lines like [`all_lines`], without comments and trailing blanks. Tabs stay: they may separate fields.
pub(super) fn lines(
    head: &[u8],
    start: usize,
    number: u64,
) -> impl Iterator<Item = LayoutLine<'_>> {
    let lines = all_lines(head, start, number);
    let lines = lines.map(|line| LayoutLine { text: trimmed(line.text), ..line });
    lines.filter(|line| !is_comment(line.text))
}

/// Splits a line into fields without quotes.
pub(super) fn fields(line: &[u8], separator: u8) -> Vec<Vec<u8>> {
    if !line.contains(&b'"') {
        return line.split(|&b| b == separator).map(<[u8]>::to_vec).collect();
    }
    quoted_fields(line, separator).iter().map(<[u8]>::to_vec).collect()
}

pub(super) fn texts(fields: &[Vec<u8>]) -> Vec<String> {
    // Text that is not UTF-8 is usually in Windows' western code page: `µ`, `°`, `·`.
    let text = |field: &Vec<u8>| match str::from_utf8(field) {
        Ok(text) => text.trim().to_owned(),
        Err(_) => field.iter().map(|&byte| char::from(byte)).collect::<String>().trim().to_owned(),
    };
    fields.iter().map(text).collect()
}
