//! Last field of a document: the 128-bit XXH3 of all bytes before it. It detects damage and edits,
//! not forgery: anyone can write a new checksum.

use std::borrow::Cow;

use memchr::memmem;
use twox_hash::XxHash3_128;

pub(super) const END: &str = "\n}\n";

/// The text between content and checksum; the checksum covers all bytes before it.
const FIELD: &str = ",\n  \"checksum\": \"xxh128:";

pub(super) fn add(document: &str) -> String {
    let content = document.strip_suffix(END).unwrap_or(document);
    format!("{content}{}", seal(content.as_bytes()))
}

/// Checks the checksum. Windows line ends, as from version control, are read as line feeds.
///
/// # Errors
/// The reason, if the document is not as written.
pub(super) fn check(document: &[u8]) -> Result<(), &'static str> {
    let document = with_line_feeds(document);
    let at =
        memmem::rfind(&document, FIELD.as_bytes()).ok_or("its last line but one is no checksum")?;
    let (content, end) = document.split_at(at);
    match seal(content).as_bytes() == end {
        true => Ok(()),
        false => Err("its checksum does not match"),
    }
}

/// The checksum field and the end of a document, for this content.
fn seal(content: &[u8]) -> String {
    format!("{FIELD}{:032x}\"{END}", XxHash3_128::oneshot(content))
}

fn with_line_feeds(document: &[u8]) -> Cow<'_, [u8]> {
    if memmem::find(document, b"\r\n").is_none() {
        return document.into();
    }
    let is_part = |&at: &usize| document[at] != b'\r' || document.get(at + 1) != Some(&b'\n');
    (0..document.len()).filter(is_part).map(|at| document[at]).collect::<Vec<u8>>().into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_changed_byte_except_line_ends_is_detected() {
        let document = add("{\n  \"a\": 1,\n  \"b\": [\n    2\n  ]\n}\n");
        assert_eq!(check(document.as_bytes()), Ok(()));
        assert_eq!(check(document.replace('\n', "\r\n").as_bytes()), Ok(()));
        for at in 0..document.len() {
            for bit in 0..8 {
                let mut bytes = document.clone().into_bytes();
                bytes[at] ^= 1 << bit;
                assert!(check(&bytes).is_err(), "{}", String::from_utf8_lossy(&bytes));
            }
            assert!(check(&document.as_bytes()[..at]).is_err());
        }
        assert_eq!(check(b"{\n  \"a\": 1\n}\n"), Err("its last line but one is no checksum"));
        assert!(check(format!("{document} ").as_bytes()).is_err());
    }
}
