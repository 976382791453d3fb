//! Where in a log an error is: offsets as line numbers.

use std::io::Read;

use crate::error::LogError;
use crate::log::Log;
use crate::parse::plan::ReadPlan;
use crate::parse::rows::{ParsedRows, RowError};
use crate::read::request::Wanted;
use crate::stream::chunk::{Chunk, ChunkError, LINE_LIMIT};

impl Log {
    pub(crate) fn chunk_error(&self, error: ChunkError) -> LogError {
        match error {
            ChunkError::Io(error) => self.source.error(error),
            ChunkError::LineTooLong(offset) => match self.line_number(offset) {
                Ok(line) => LogError::LineTooLong {
                    path: self.source.path.clone(),
                    place: self.source.place(line),
                    limit: LINE_LIMIT,
                },
                Err(error) => error,
            },
        }
    }

    pub(crate) fn row_error(&self, chunk_offset: u64, error: RowError) -> LogError {
        match self.line_number(chunk_offset + error.offset as u64) {
            Ok(line) => {
                let place = self.source.place(line);
                LogError::Row { path: self.source.path.clone(), place, problem: error.problem }
            }
            Err(error) => error,
        }
    }

    /// The line, from 1, of a row of the block that starts at `place`: the row `row` from 0 of those that
    /// were read as `wanted`.
    ///
    /// # Errors
    /// [`LogError`] if the file cannot be read, or ends before that row.
    pub fn line_of_row(&self, wanted: &Wanted, place: u64, row: usize) -> Result<u64, LogError> {
        let plan = ReadPlan::new(&self.layout, wanted);
        let mut chunks = self.chunks(self.source.open()?, place, self.chunk_bytes);
        let (mut chunk, mut parsed) = (Chunk::default(), ParsedRows::default());
        let (mut line, mut rows) = (self.line_number(place)?, 0);
        while chunks.next(&mut chunk).map_err(|error| self.chunk_error(error))? {
            for text in chunk.lines().split_inclusive(|&byte| byte == b'\n') {
                // Wrong lines are no rows.
                if plan.parse(text, true, &mut parsed).is_ok() && parsed.rows > 0 {
                    if rows == row {
                        return Ok(line);
                    }
                    rows += 1;
                }
                line += 1;
            }
        }
        Err(LogError::NoRows { path: self.source.path.clone() })
    }

    /// The number of the line at `offset`, counted by reading up to there again: lines are not
    /// counted while all is well.
    fn line_number(&self, offset: u64) -> Result<u64, LogError> {
        let mut before = self.source.open()?.take(offset);
        let mut buffer = vec![0; 1 << 16];
        let mut line = 1;
        loop {
            match before.read(&mut buffer) {
                Ok(0) => return Ok(line),
                Ok(read) => line += memchr::memchr_iter(b'\n', &buffer[..read]).count() as u64,
                Err(error) => return Err(self.source.error(error)),
            }
        }
    }
}
