//! Ends of lines.

use memchr::memchr_iter;

pub(crate) fn line_ends(text: &[u8]) -> u64 {
    memchr_iter(b'\n', text).count() as u64
}

/// Removes all carriage returns at a line's end, because a terminal may add one to that of the board.
pub(crate) fn without_returns(mut line: &[u8]) -> &[u8] {
    while let Some(shorter) = line.strip_suffix(b"\r") {
        line = shorter;
    }
    line
}

/// Splits a line with quotes into fields without quotes.
pub(crate) fn quoted_fields(line: &[u8], separator: u8) -> csv::ByteRecord {
    let mut reader = csv::ReaderBuilder::new();
    reader.has_headers(false).flexible(true).delimiter(separator);
    // A carriage return within a line does not end the row.
    reader.terminator(csv::Terminator::Any(b'\n'));
    let mut record = csv::ByteRecord::new();
    // Reading from memory cannot fail, and any line is a valid record.
    let _ = reader.from_reader(line).read_byte_record(&mut record);
    record
}

pub(crate) fn is_comment(line: &[u8]) -> bool {
    let line = line.trim_ascii_start();
    // PuTTY begins each session with such a line.
    line.starts_with(b"#") || line.starts_with(b"//") || line.starts_with(b"=~=~")
}
