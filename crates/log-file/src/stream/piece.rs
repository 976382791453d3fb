//! Pieces of a log: chunks of its text, or parts of its table.

use table_file::WantedColumn;

use super::bytes::{ByteStream, ReadMeter};
use super::chunk::{Chunk, ChunkStream};
use super::table_rows::{RowPart, TableRows};
use crate::error::LogError;
use crate::log::Log;

#[derive(Debug)]
pub(crate) enum LogPiece {
    Text(Chunk),
    Rows(RowPart),
}

impl Default for LogPiece {
    fn default() -> Self {
        Self::Text(Chunk::default())
    }
}

pub(crate) enum LogPieces<'a> {
    Text(ChunkStream<ByteStream>),
    Rows(TableRows<'a>),
}

impl Log {
    /// Cuts the rows into pieces of about `piece_bytes` bytes; for a table, only the requested columns, which
    /// `threads` threads may unpack.
    pub(crate) fn pieces(
        &self,
        wanted: &[WantedColumn],
        piece_bytes: usize,
        threads: usize,
        meter: &ReadMeter,
    ) -> Result<LogPieces<'_>, LogError> {
        let (source, line) = (&self.source, self.layout.rows_line);
        if !source.is_text() {
            source.read_for_checksum(meter)?;
            let meter = meter.clone();
            let mut rows = TableRows::new(source, wanted, line, piece_bytes, threads, meter)?;
            let is_time = |of: &WantedColumn| Some(of.at) == self.layout.roles.time && !of.is_text;
            rows.clock = self.layout.clock().zip(wanted.iter().position(is_time));
            return Ok(LogPieces::Rows(rows));
        }
        let start = self.layout.header.rows_start as u64;
        let mut chunks = ChunkStream::new(source.open_counting(meter)?, start, line, piece_bytes);
        chunks.clock = self.layout.clock();
        chunks.ends_at_blank = self.layout.header.ends_at_blank();
        Ok(LogPieces::Text(chunks))
    }
}

impl LogPieces<'_> {
    pub(crate) fn ended(&self) -> bool {
        match self {
            Self::Text(chunks) => chunks.ended(),
            Self::Rows(rows) => rows.ended(),
        }
    }

    /// Reads the next piece into `piece`; `false` if there are no more.
    pub(crate) fn next(&mut self, log: &Log, piece: &mut LogPiece) -> Result<bool, LogError> {
        match self {
            Self::Text(chunks) => {
                if let LogPiece::Rows(_) = piece {
                    *piece = LogPiece::default();
                }
                let LogPiece::Text(chunk) = piece else { return Ok(false) };
                chunks.next(chunk).map_err(|error| log.source.error(error))
            }
            Self::Rows(rows) => {
                if let LogPiece::Text(_) = piece {
                    *piece = LogPiece::Rows(RowPart::default());
                }
                let LogPiece::Rows(part) = piece else { return Ok(false) };
                rows.next(part)
            }
        }
    }
}
