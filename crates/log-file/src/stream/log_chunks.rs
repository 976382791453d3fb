//! The chunks of several logs as one sequence, so that no thread waits at the end of a log.

use super::chunk::{Chunk, ChunkStream};
use super::pipeline::Pieces;
use super::source::{ByteStream, ReadMeter};
use crate::error::LogError;
use crate::log::Log;

/// The chunks of one log after another.
pub(crate) struct LogChunks<'a> {
    logs: &'a [&'a Log],
    checksum: bool,
    /// How many threads read a table.
    threads: usize,
    /// The log that is being read, or read next.
    current: usize,
    chunks: Option<ChunkStream<ByteStream>>,
    pub(crate) meter: ReadMeter,
    /// Checksums of the logs that have been read.
    pub(crate) checksums: Vec<Option<String>>,
}

/// A chunk of one of the logs.
#[derive(Default)]
pub(crate) struct LogChunk {
    pub(crate) log: usize,
    pub(crate) chunk: Chunk,
}

impl<'a> LogChunks<'a> {
    pub(crate) fn new(logs: &'a [&'a Log], checksum: bool, threads: usize) -> Self {
        let (meter, checksums) = (ReadMeter::default(), Vec::new());
        Self { logs, checksum, threads, current: 0, chunks: None, meter, checksums }
    }
}

impl Pieces for LogChunks<'_> {
    type Piece = LogChunk;
    type Error = LogError;

    fn ended(&self) -> bool {
        self.current >= self.logs.len()
    }

    fn next(&mut self, piece: &mut LogChunk) -> Result<bool, Self::Error> {
        while let Some(log) = self.logs.get(self.current) {
            piece.log = self.current;
            let chunks = match &mut self.chunks {
                Some(chunks) => chunks,
                none => {
                    self.meter.begin(self.checksum);
                    let stream = log.source.open_counting(self.threads, &self.meter)?;
                    none.insert(log.chunks(stream, log.chunk_bytes))
                }
            };
            let any = chunks.next(&mut piece.chunk).map_err(|error| log.chunk_error(error))?;
            if chunks.ended() {
                self.checksums.push(self.meter.checksum());
                self.chunks = None;
                self.current += 1;
            }
            if any {
                return Ok(true);
            }
        }
        Ok(false)
    }
}
