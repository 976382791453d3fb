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
use shell_data::BlockLines;

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
        let RowProblem::Field { field, found, .. } = problem else { return };
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

    /// The lines, from 1, of rows that were read as `wanted`: each is the row so-and-so-many, from 0, of the block
    /// that starts at an offset. The file is read again unless the lines of all these blocks are `known`.
    ///
    /// # Errors
    /// [`LogError`] if the file cannot be read, or ends before such a row.
    pub fn lines_of_rows(
        &self,
        wanted: &Wanted,
        rows: &[(u64, usize)],
        known: &BlockLines,
    ) -> Result<Vec<u64>, LogError> {
        let before = rows.iter().map(|&(offset, row)| known.line(offset, row));
        if let Some(before) = before.collect::<Option<Vec<u64>>>() {
            let first = self.line_number(self.layout.rows_start)?;
            return Ok(before.into_iter().map(|before| first + before).collect());
        }
        let plan = ReadPlan::new(&self.layout, wanted);
        let mut order: Vec<usize> = (0..rows.len()).collect();
        order.sort_unstable_by_key(|&of| rows[of]);
        let (mut lines, mut order) = (vec![0; rows.len()], order.into_iter().peekable());
        let mut chunks = self.chunks(self.source.open()?, 0, self.chunk_bytes);
        let (mut chunk, mut parsed) = (Chunk::default(), ParsedRows::default());
        let mut line = 1;
        // The block that the rows before `line` are counted from, and how many there are.
        let mut counted = None;
        while order.peek().is_some() {
            if !chunks.next(&mut chunk).map_err(|error| self.chunk_error(error))? {
                return Err(LogError::NoRows { path: self.source.path.clone() });
            }
            let mut rest = chunk.lines();
            let end = chunk.offset + rest.len() as u64;
            while let Some(&of) = order.peek() {
                let (offset, row) = rows[of];
                let mut before = match counted {
                    Some((block, before)) if block == offset => before,
                    _ if offset >= end => break,
                    _ => {
                        let skipped = rest.len().saturating_sub((end - offset) as usize);
                        line += line_count(&rest[..skipped]);
                        rest = &rest[skipped..];
                        0
                    }
                };
                // Wrong lines are no rows: as many more lines are read as rows are missing.
                while before <= row && !rest.is_empty() {
                    let mut ends = memchr::memchr_iter(b'\n', rest).map(|at| at + 1);
                    let (text, later) = rest.split_at(ends.nth(row - before).unwrap_or(rest.len()));
                    plan.parse(text, true, &mut parsed)
                        .map_err(|error| self.row_error(end - rest.len() as u64, error))?;
                    (before, line) = (before + parsed.rows, line + line_count(text));
                    rest = later;
                }
                counted = Some((offset, before));
                if before <= row {
                    break;
                }
                lines[of] = line - 1;
                order.next();
            }
            line += line_count(rest);
        }
        Ok(lines)
    }

    /// The number of the line at `offset`, counted by reading up to there again.
    fn line_number(&self, offset: u64) -> Result<u64, LogError> {
        let mut before = self.source.open()?.take(offset);
        let mut buffer = vec![0; 1 << 16];
        let mut line = 1;
        loop {
            match before.read(&mut buffer) {
                Ok(0) => return Ok(line),
                Ok(read) => line += line_ends(&buffer[..read]),
                Err(error) => return Err(self.source.error(error)),
            }
        }
    }
}

fn line_ends(text: &[u8]) -> u64 {
    memchr::memchr_iter(b'\n', text).count() as u64
}

/// The number of lines; that a file ends with may have no end.
pub(super) fn line_count(text: &[u8]) -> u64 {
    line_ends(text) + u64::from(text.last().is_some_and(|&byte| byte != b'\n'))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::mapping::Mapping;
    use crate::read::dataset::read_dataset;
    use crate::read::request::ReadOptions;

    fn check_lines(between: [&str; 2], wanted_of_lines: &Wanted) {
        let mut text = "time,s0,s1\n".to_owned();
        let (mut line, mut lines_of_times) = (1, Vec::new());
        for row in 0..4000_u32 {
            let between = match row % 7 {
                0 => between[0],
                3 => between[1],
                _ => "",
            };
            text += between;
            line += u64::from(!between.is_empty()) + 1;
            lines_of_times.push(line);
            text += &format!("{row},{},{}\n", row % 100, row % 90);
        }
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log.csv");
        // The last line has no end.
        std::fs::write(&path, text.trim_end()).unwrap();
        let mut log = Log::open(&path, &Mapping::default()).unwrap();
        log.chunk_bytes = 4096;
        let wanted = Wanted { time: true, readings: true, ..Wanted::default() };
        let options = ReadOptions { skip_bad_rows: true, ..ReadOptions::default() };
        let (mut rows, mut expected) = (Vec::new(), Vec::new());
        let times = |block: &mut shell_data::block::Block| (block.offset, block.time_s.clone());
        log.read(&wanted, &options, times, |(offset, times)| {
            for (row, time) in times.into_iter().enumerate() {
                rows.push((offset, row));
                expected.push(lines_of_times[time as usize]);
            }
            Ok::<_, LogError>(())
        })
        .unwrap();
        assert_eq!(rows.len(), 4000);
        let unknown = BlockLines::default();
        let lines = |rows: &[(u64, usize)]| log.lines_of_rows(wanted_of_lines, rows, &unknown);
        assert_eq!(lines(&rows).unwrap(), expected);
        let data = read_dataset(&[(&log, wanted)], &options).unwrap();
        let known = &data.logs[0].lines;
        assert_eq!(known.line(rows[0].0, 0).is_some(), between == ["", ""]);
        assert_eq!(log.lines_of_rows(wanted_of_lines, &rows, known).unwrap(), expected);
        // A few of them, the later first and one twice.
        let some = [3999, 2500, 2500, 17];
        assert_eq!(lines(&some.map(|of| rows[of])).unwrap(), some.map(|of| expected[of]));
        assert!(lines(&[(rows[3999].0, 4000)]).is_err());
    }

    #[test]
    fn rows_are_found_at_their_lines_whatever_is_between_them() {
        let all = Wanted { time: true, readings: true, ..Wanted::default() };
        check_lines(["\n", "oops,1,2\n"], &all);
        // Where no row is wrong it takes nothing of what is in them.
        check_lines(["\n", " \t\n"], &Wanted::default());
        check_lines(["", ""], &Wanted::default());
    }
}
