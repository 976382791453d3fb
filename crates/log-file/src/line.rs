//! Ends of lines.

use memchr::memchr_iter;

/// Counts the line ends of a text.
pub(crate) fn line_ends(text: &[u8]) -> u64 {
    memchr_iter(b'\n', text).count() as u64
}

/// Returns a line without the carriage returns at its end: a terminal may add one to that of a board.
pub(crate) fn without_returns(mut line: &[u8]) -> &[u8] {
    while let Some(shorter) = line.strip_suffix(b"\r") {
        line = shorter;
    }
    line
}
