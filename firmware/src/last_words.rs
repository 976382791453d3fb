//! The firmware's last words before a fatal reset, which the host can request.

use core::fmt;

use heapless::Vec;
use shared_proto::{Answer, MAX_PIECE, Piece};

/// UTF-8 text of limited length; the excess is cut off.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct LastWords(Vec<u8, { Self::LEN }>);

impl LastWords {
    /// In bytes.
    pub const LEN: usize = 200;

    pub const fn new() -> Self {
        Self(Vec::new())
    }

    pub fn from_bytes(bytes: &[u8]) -> Self {
        let mut words = Self::new();
        words.push(bytes);
        words
    }

    pub fn as_bytes(&self) -> &[u8] {
        &self.0
    }

    pub fn as_str(&self) -> &str {
        self.0.utf8_chunks().next().map_or("", |chunk| chunk.valid())
    }

    fn push(&mut self, bytes: &[u8]) {
        _ = bytes.iter().try_for_each(|&byte| self.0.push(byte));
    }

    pub(crate) fn answer(&self, offset: u16) -> Answer {
        let rest = self.0.get(usize::from(offset)..).unwrap_or_default();
        let text = rest.get(..rest.len().min(MAX_PIECE)).and_then(Piece::copy_of);
        Answer::LastWords { len: self.0.len() as u16, text: text.unwrap_or_default() }
    }
}

impl fmt::Write for LastWords {
    fn write_str(&mut self, part: &str) -> fmt::Result {
        self.push(part.as_bytes());
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;
    use std::fmt::Write;
    use std::string::String;

    #[test]
    fn the_answers_hold_the_text_piece_by_piece() {
        let mut words = LastWords::new();
        (0..60).for_each(|i| write!(words, "{i} ").unwrap());
        let mut text = std::vec::Vec::new();
        while let Answer::LastWords { len, text: piece } = words.answer(text.len() as u16) {
            assert_eq!(usize::from(len), words.as_bytes().len());
            if piece.is_empty() {
                break;
            }
            text.extend_from_slice(&piece);
        }
        assert_eq!(String::from_utf8(text).unwrap(), words.as_str());
        let none = Answer::LastWords { len: 170, text: Piece::new() };
        assert_eq!(words.answer(u16::MAX), none);
    }

    #[test]
    fn text_that_does_not_fit_is_cut_and_stays_text() {
        let long = "\u{e9}".repeat(150);
        let mut words = LastWords::new();
        words.write_str("x").unwrap();
        words.write_str(&long).unwrap();
        assert_eq!(words.as_bytes().len(), LastWords::LEN);
        // The last character was cut in half, so it is left out.
        assert_eq!(words.as_str(), &(String::from("x") + &long)[..LastWords::LEN - 1]);
        assert_eq!(LastWords::from_bytes(words.as_bytes()), words);
    }
}
