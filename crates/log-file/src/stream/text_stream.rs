//! A byte stream of text that is generated piece by piece.

use std::io::{self, Read};

pub(crate) struct TextStream<F> {
    append: F,
    text: Vec<u8>,
    at: usize,
    ended: bool,
}

impl<F: FnMut(&mut Vec<u8>) -> io::Result<bool>> TextStream<F> {
    /// Streams `text`, then the pieces that `append` appends. `append` returns `false` with or after the last piece.
    /// The stream ends after an error.
    pub(crate) fn new(text: Vec<u8>, append: F) -> Self {
        Self { append, text, at: 0, ended: false }
    }
}

impl<F: FnMut(&mut Vec<u8>) -> io::Result<bool>> Read for TextStream<F> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        while self.at == self.text.len() && !self.ended {
            self.text.clear();
            self.at = 0;
            // Set until the next piece is complete, so that the stream ends after an error.
            self.ended = true;
            self.ended = !(self.append)(&mut self.text)?;
        }
        let count = buffer.len().min(self.text.len() - self.at);
        buffer[..count].copy_from_slice(&self.text[self.at..][..count]);
        self.at += count;
        Ok(count)
    }
}
