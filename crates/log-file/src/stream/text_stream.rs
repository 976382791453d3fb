//! Text that is made piece by piece, as a stream.

use std::io::{self, Read};

/// What makes text.
pub(crate) trait TextSource {
    /// Appends the next piece; `false` once there is none behind it.
    fn append(&mut self, text: &mut Vec<u8>) -> io::Result<bool>;
}

/// The text of a source.
#[derive(Debug)]
pub(crate) struct TextStream<S> {
    source: S,
    text: Vec<u8>,
    at: usize,
    ended: bool,
}

impl<S: TextSource> TextStream<S> {
    pub(crate) fn new(source: S) -> Self {
        Self { source, text: Vec::new(), at: 0, ended: false }
    }

    pub(crate) fn source(&self) -> &S {
        &self.source
    }
}

impl<S: TextSource> Read for TextStream<S> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        while self.at == self.text.len() && !self.ended {
            self.text.clear();
            self.at = 0;
            self.ended = !self.source.append(&mut self.text)?;
        }
        let count = buffer.len().min(self.text.len() - self.at);
        buffer[..count].copy_from_slice(&self.text[self.at..][..count]);
        self.at += count;
        Ok(count)
    }
}
