//! Text that is made piece by piece, as a stream.

use std::io::{self, Read};

/// What makes text.
pub trait TextSource {
    /// Appends the next piece; `false` once there is none behind it.
    ///
    /// # Errors
    /// Those of what the text is made of; there is none after an error.
    fn append(&mut self, text: &mut Vec<u8>) -> io::Result<bool>;
}

/// The text of a source.
#[derive(Debug)]
pub struct TextStream<S> {
    source: S,
    text: Vec<u8>,
    at: usize,
    ended: bool,
}

impl<S: TextSource> TextStream<S> {
    /// The text of `source`, after `text`.
    pub fn new(text: Vec<u8>, source: S) -> Self {
        Self { source, text, at: 0, ended: false }
    }
}

impl<S: TextSource> Read for TextStream<S> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        while self.at == self.text.len() && !self.ended {
            self.text.clear();
            self.at = 0;
            // Set until the next piece is there: there is none after an error.
            self.ended = true;
            self.ended = !self.source.append(&mut self.text)?;
        }
        let count = buffer.len().min(self.text.len() - self.at);
        buffer[..count].copy_from_slice(&self.text[self.at..][..count]);
        self.at += count;
        Ok(count)
    }
}
