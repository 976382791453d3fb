//! A sample of the rows of a log.

use std::io::{Read, Seek, SeekFrom};

use memchr::{memchr, memrchr};

use super::all::ReadOptions;
use crate::error::LogError;
use crate::format::columns::Wanted;
use crate::format::mapping::LogFormat;
use crate::log::Log;
use crate::parse::number::parse_field;
use crate::parse::plan::{BlockBuffer, ReadPlan};
use crate::stream::bytes::ReadMeter;
use crate::stream::piece::LogPiece;
use shell_data::block::Block;

const PIECES: u64 = 16;
const PIECE_BYTES: u64 = 1 << 12;

impl Log {
    /// Returns rows spread over a plain text, or the first rows of another file: enough to choose centres and scales.
    /// Invalid rows are left out.
    ///
    /// # Errors
    /// [`LogError`] if wanted columns are missing or the file cannot be read.
    pub fn sample(&self, wanted: &Wanted) -> Result<Block, LogError> {
        self.require(wanted)?;
        let plan = ReadPlan::new(&self.layout, wanted);
        let mut buffer = BlockBuffer::default();
        let is_whole = self.source.is_plain() && !self.layout.header.ends_at_blank();
        if !is_whole || self.bytes_of_rows() <= PIECES * PIECE_BYTES {
            let bytes = (PIECES * PIECE_BYTES) as usize;
            let mut pieces =
                self.pieces(&plan.wanted_columns(), bytes, 1, &ReadMeter::default())?;
            let mut piece = LogPiece::default();
            if pieces.next(self, &mut piece)? {
                let filled = buffer.fill(&plan, &mut piece, true);
                filled.map_err(|(line, problem)| self.source.error_at(line, problem))?;
            }
        } else {
            plan.parse(&self.spread_lines()?, true, &mut buffer.parsed)
                .map_err(|error| self.source.error_at(0, error.problem))?;
            plan.fill(&mut buffer.block, &mut buffer.parsed, 0);
            plan.fill_times(&mut buffer.block);
        }
        Ok(buffer.block)
    }

    /// Returns true for each column that has text in a [sample](Self::sample) of rows, or an empty field in any row: no
    /// number represents an empty field.
    ///
    /// # Errors
    /// [`LogError`] if the file cannot be read.
    pub fn are_texts(
        &self,
        positions: &[usize],
        options: &ReadOptions<'_>,
    ) -> Result<Vec<bool>, LogError> {
        // A console log has only numbers.
        if positions.is_empty() || self.format() == LogFormat::Console {
            return Ok(vec![false; positions.len()]);
        }
        let wanted = Wanted { texts: positions.to_vec(), ..Wanted::default() };
        let has = |is: fn(&str) -> bool| {
            move |runs: &Vec<(String, usize)>| runs.iter().any(|(text, _)| is(text))
        };
        let is_text = has(|text| parse_field(text.as_bytes()).is_err());
        let mut texts: Vec<bool> = self.sample(&wanted)?.texts.iter().map(is_text).collect();
        let are_empty = |block: &mut Block| -> Vec<bool> {
            block.texts.iter().map(has(str::is_empty)).collect()
        };
        self.read(&wanted, options, are_empty, |of_block| {
            texts.iter_mut().zip(of_block).for_each(|(all, of_block)| *all |= of_block);
            Ok::<_, LogError>(())
        })?;
        Ok(texts)
    }

    fn bytes_of_rows(&self) -> u64 {
        self.source.bytes.saturating_sub(self.layout.header.rows_start as u64)
    }

    fn spread_lines(&self) -> Result<Vec<u8>, LogError> {
        let io = |error| self.source.error(error);
        let (mut lines, mut bytes) = (Vec::new(), Vec::new());
        let mut file = self.source.open_file()?;
        let distance = (self.bytes_of_rows() - PIECE_BYTES) / (PIECES - 1);
        for piece in 0..PIECES {
            let offset = self.layout.header.rows_start as u64 + distance * piece;
            file.seek(SeekFrom::Start(offset)).map_err(io)?;
            bytes.clear();
            Read::take(&mut file, PIECE_BYTES).read_to_end(&mut bytes).map_err(io)?;
            // The first part starts with a row; the others usually start within one.
            let end = memrchr(b'\n', &bytes).map_or(0, |at| at + 1);
            let start = match piece {
                0 => 0,
                _ => memchr(b'\n', &bytes).map_or(end, |at| at + 1),
            };
            lines.extend_from_slice(&bytes[start..end]);
        }
        Ok(lines)
    }
}
