//! Where in a log an error is: offsets as line numbers.

use std::io::{BufRead, BufReader, Read};

use crate::error::{LogError, PlacedProblem, RowProblem};
use crate::log::Log;
use crate::parse::parsed_rows::ParsedRows;
use crate::parse::plan::ReadPlan;
use crate::parse::rows::RowError;
use crate::read::request::Wanted;
use crate::stream::chunk::{Chunk, ChunkError, LINE_LIMIT};
use crate::stream::decimal_comma;

impl Log {
    pub(crate) fn chunk_error(&self, error: ChunkError) -> LogError {
        match error {
            ChunkError::Io(error) => self.source.error(error),
            ChunkError::LineTooLong(offset) => match self.line_number(offset) {
                Ok(line) => {
                    self.source.error_at(line, PlacedProblem::LineTooLong { limit: LINE_LIMIT })
                }
                Err(error) => error,
            },
        }
    }

    pub(crate) fn row_error(&self, chunk_offset: u64, error: RowError) -> LogError {
        match self.line_number(chunk_offset + error.offset as u64) {
            Ok(line) => {
                let mut problem = error.problem;
                if self.layout.has_decimal_commas {
                    self.show_as_written(chunk_offset + error.offset as u64, &mut problem);
                }
                self.source.error_at(line, problem)
            }
            Err(error) => error,
        }
    }

    /// Rows of decimal commas are parsed with points; what is wrong is shown as the file has it.
    fn show_as_written(&self, offset: u64, problem: &mut RowProblem) {
        let (RowProblem::NotANumber { field, found }
        | RowProblem::NotADate { field, found }
        | RowProblem::NotFinite { field, found }
        | RowProblem::Unbelievable { field, found, .. }) = problem
        else {
            return;
        };
        let Ok(line) = self.line_at(offset) else { return };
        let written = line.split(|&byte| byte == self.layout.separator).nth(field.column);
        let Some(written) = written.map(<[u8]>::trim_ascii) else { return };
        let mut parsed = written.to_vec();
        decimal_comma::to_points(&mut parsed);
        if parsed == found.as_bytes() {
            *found = String::from_utf8_lossy(written).into_owned();
        }
    }

    /// The bytes of the line that begins at `offset`.
    fn line_at(&self, offset: u64) -> Result<Vec<u8>, LogError> {
        let io = |error| self.source.error(error);
        let mut text = self.source.open()?;
        std::io::copy(&mut Read::take(&mut text, offset), &mut std::io::sink()).map_err(io)?;
        let mut line = Vec::new();
        let mut rest = BufReader::new(text.take(LINE_LIMIT as u64));
        rest.read_until(b'\n', &mut line).map_err(io)?;
        Ok(line)
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
