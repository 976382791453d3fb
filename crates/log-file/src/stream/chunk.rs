//! Cuts a stream of lines into chunks of whole lines and similar size.
//!
//! Cuts depend only on the bytes of the file, so that results are the same for any number of threads.

use std::io::{self, Read};

use memchr::{memchr, memrchr};

use crate::line::line_ends;

use super::clock_turns::ClockTurns;

/// Number of bytes read at a time: so few that they and the columns parsed from them stay in a core's cache
/// until parsing ends.
pub(crate) const CHUNK_BYTES: usize = 96 << 10;

/// The first chunk is smaller by this factor, because it is parsed by one thread alone.
const FIRST_CHUNK_SHARE: usize = 8;

/// The longest line in bytes; limits the memory for a file without line ends.
pub(crate) const LINE_LIMIT: usize = 1 << 20;

/// Number of bytes of preceding lines that accompany a chunk.
const CONTEXT_BYTES: usize = 1 << 12;

#[derive(Debug, Default)]
pub(crate) struct Chunk {
    pub(crate) offset: u64,
    /// Number of the first line in the file, from 1.
    pub(crate) line: u64,
    /// The lines just before the chunk, up to a few kilobytes.
    pub(crate) context: Vec<u8>,
    /// Number of times that the clock has wrapped around before the chunk.
    pub(crate) turns: u32,
    buffer: Vec<u8>,
    length: usize,
}

impl Chunk {
    /// Returns the lines. Each ends with `\n`, except for the last line of the file.
    pub(crate) fn lines(&self) -> &[u8] {
        &self.buffer[..self.length]
    }
}

/// A line longer than [`LINE_LIMIT`], with its number.
#[derive(Debug, thiserror::Error)]
#[error("line {0} is too long")]
pub(crate) struct LongLine(pub(crate) u64);

pub(crate) struct ChunkStream<R> {
    stream: R,
    chunk_bytes: usize,
    line: u64,
    position: u64,
    skip: u64,
    carry: Vec<u8>,
    context: Vec<u8>,
    /// Present if the clock may wrap.
    pub(crate) clock: Option<ClockTurns>,
    pub(crate) ends_at_blank: bool,
    has_begun: bool,
    ended: bool,
}

impl<R: Read> ChunkStream<R> {
    /// Skips the first `skip` bytes of `stream`, and cuts the rest into chunks. The rest starts
    /// with line number `line`.
    pub(crate) fn new(stream: R, skip: u64, line: u64, chunk_bytes: usize) -> Self {
        Self {
            stream,
            chunk_bytes,
            line,
            position: skip,
            skip,
            carry: Vec::new(),
            context: Vec::new(),
            clock: None,
            ends_at_blank: false,
            has_begun: false,
            ended: false,
        }
    }

    pub(crate) fn ended(&self) -> bool {
        self.ended
    }

    /// Reads the next chunk into `chunk`; `false` if there are no more.
    pub(crate) fn next(&mut self, chunk: &mut Chunk) -> io::Result<bool> {
        if self.ended {
            return Ok(false);
        }
        // Stays set if reading fails: there is no chunk after an error.
        self.ended = true;
        if self.skip > 0 {
            io::copy(&mut Read::take(&mut self.stream, self.skip), &mut io::sink())?;
            self.skip = 0;
        }
        let buffer = &mut chunk.buffer;
        let mut filled = self.carry.len();
        if buffer.len() < filled {
            buffer.resize(filled, 0);
        }
        buffer[..filled].copy_from_slice(&self.carry);
        let chunk_bytes = match self.has_begun {
            true => self.chunk_bytes,
            false => self.chunk_bytes.div_ceil(FIRST_CHUNK_SHARE),
        } as u64;
        self.has_begun = true;
        chunk.offset = self.position - filled as u64;
        let length = loop {
            // Reads up to the next multiple of the chunk size in the file, so that whole pages are
            // copied.
            let target = filled + (chunk_bytes - self.position % chunk_bytes) as usize;
            if buffer.len() < target {
                buffer.resize(target, 0);
            }
            let read = read_full(&mut self.stream, &mut buffer[filled..target])?;
            self.position += read as u64;
            self.ended = filled + read < target;
            let line_end = memrchr(b'\n', &buffer[filled..filled + read]).map(|at| filled + at + 1);
            filled += read;
            if self.ended {
                break filled;
            }
            if let Some(length) = line_end {
                break length;
            }
            if filled > LINE_LIMIT {
                self.ended = true;
                return Err(io::Error::other(LongLine(self.line)));
            }
        };
        let blank = self.ends_at_blank.then(|| blank_line(&buffer[..length])).flatten();
        if blank.is_some() {
            // The rest is read for the checksum of the file.
            self.ended = true;
            io::copy(&mut self.stream, &mut io::sink())?;
        }
        self.carry.clear();
        self.carry.extend_from_slice(&buffer[length..filled]);
        let length = blank.unwrap_or(length);
        chunk.length = length;
        chunk.line = self.line;
        std::mem::swap(&mut chunk.context, &mut self.context);
        self.keep_context(&chunk.buffer[..length]);
        chunk.turns = self.clock.as_mut().map_or(0, |clock| clock.before(&chunk.buffer[..length]));
        self.line += line_ends(chunk.lines());
        Ok(length > 0)
    }

    /// Keeps the last lines of a chunk as context for the next: as many as fit, at least one.
    fn keep_context(&mut self, lines: &[u8]) {
        self.context.clear();
        let Some((_, before)) = lines.split_last() else { return };
        let start = lines.len().saturating_sub(CONTEXT_BYTES);
        let start = match memchr(b'\n', &before[start..]) {
            _ if start == 0 => 0,
            Some(at) => start + at + 1,
            None => memrchr(b'\n', before).map_or(0, |at| at + 1),
        };
        self.context.extend_from_slice(&lines[start..]);
    }
}

fn blank_line(lines: &[u8]) -> Option<usize> {
    let mut at = 0;
    lines.split_inclusive(|&byte| byte == b'\n').find_map(|line| {
        let start = at;
        at += line.len();
        line.trim_ascii().is_empty().then_some(start)
    })
}

/// Reads until `buffer` is full or the stream ends: cuts do not depend on what a single read returns.
fn read_full(stream: &mut impl Read, buffer: &mut [u8]) -> io::Result<usize> {
    let mut filled = 0;
    while filled < buffer.len() {
        match stream.read(&mut buffer[filled..]) {
            Ok(0) => break,
            Ok(read) => filled += read,
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    Ok(filled)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn pieces(text: &[u8], chunk_bytes: usize) -> Vec<(u64, Vec<u8>, Vec<u8>)> {
        let mut chunks = ChunkStream::new(text, 0, 1, chunk_bytes);
        let mut chunk = Chunk::default();
        let mut pieces = Vec::new();
        while chunks.next(&mut chunk).unwrap() {
            pieces.push((chunk.offset, chunk.lines().to_vec(), chunk.context.clone()));
        }
        pieces
    }

    proptest! {
        #[test]
        fn pieces_are_whole_lines_that_add_up_to_the_file(
            text in "[a\n]{0,200}", chunk_bytes in 1_usize..64
        ) {
            let mut whole = Vec::new();
            for (offset, lines, context) in pieces(text.as_bytes(), chunk_bytes) {
                prop_assert_eq!(offset, whole.len() as u64);
                prop_assert!(whole.ends_with(&context));
                prop_assert_eq!(context.is_empty(), whole.is_empty());
                whole.extend_from_slice(&lines);
                prop_assert!(lines.ends_with(b"\n") || whole.len() == text.len());
            }
            prop_assert_eq!(whole, text.as_bytes());
        }
    }

    #[test]
    fn rows_end_at_a_blank_line_where_sections_do() {
        let text = "1,2\r\n3,4\r\n\r\nTrajectories\r\n5,6\r\n".repeat(2);
        for chunk_bytes in [4, 7, 64] {
            let mut chunks = ChunkStream::new(text.as_bytes(), 0, 1, chunk_bytes);
            chunks.ends_at_blank = true;
            let (mut chunk, mut found) = (Chunk::default(), Vec::new());
            while chunks.next(&mut chunk).unwrap() {
                found.extend_from_slice(chunk.lines());
            }
            assert_eq!(found, b"1,2\r\n3,4\r\n", "{chunk_bytes}");
        }
    }

    #[test]
    fn context_starts_at_a_line_and_is_short() {
        let text = "0123456789\n".repeat(2000);
        // The first piece is shorter than the context may be.
        for (offset, _, context) in pieces(text.as_bytes(), 8000).into_iter().skip(2) {
            assert_eq!((offset as usize - context.len()) % 11, 0);
            assert!((CONTEXT_BYTES - 11..=CONTEXT_BYTES).contains(&context.len()));
        }
    }

    #[test]
    fn a_line_without_end_is_refused_before_it_fills_the_memory() {
        let mut chunks = ChunkStream::new(io::repeat(b'7'), 0, 3, CHUNK_BYTES);
        let result = chunks.next(&mut Chunk::default());
        let long = result.unwrap_err().downcast::<LongLine>();
        assert!(matches!(long, Ok(LongLine(3))));
    }
}
