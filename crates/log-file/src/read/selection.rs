//! Reading only the parts of a log that are of interest.

use std::sync::atomic::Ordering;

use super::all::ReadOptions;
use crate::error::LogError;
use crate::format::columns::Wanted;
use crate::log::Log;
use crate::parse::plan::{BlockBuffer, ReadPlan};
use crate::stream::chunk::Chunk;
use crate::stream::source::ReadMeter;
use shell_data::ReadSummary;
use shell_data::block::Block;

/// A choice of the rows that are read, see [`Log::read_where`].
pub trait RowSelection {
    /// The errors that end the reading.
    type Error: From<LogError>;

    /// Whether the next rows, at these times in s, are of interest; there is one row or more.
    ///
    /// # Errors
    /// An error that ends the reading.
    fn is_of_interest(&mut self, times_s: &[f64]) -> Result<bool, Self::Error>;

    /// Processes those rows.
    ///
    /// # Errors
    /// An error that ends the reading.
    fn take(&mut self, block: &mut Block) -> Result<(), Self::Error>;
}

/// Bytes of the parts that [`Log::read_where`] selects or skips: some 300 rows of telemetry.
const SELECTED_BYTES: usize = 1 << 15;

impl Log {
    /// Streams the log once on this thread, and parses all that is `wanted` only of pieces whose
    /// times are of interest. What is not parsed is not checked either.
    ///
    /// # Errors
    /// As [`Log::read`]; and what `selection` returns, which ends the reading.
    pub fn read_where<S: RowSelection>(
        &self,
        wanted: &Wanted,
        options: &ReadOptions<'_>,
        selection: &mut S,
    ) -> Result<ReadSummary, S::Error> {
        self.require(&Wanted { time: true, ..wanted.clone() })?;
        let time_only = ReadPlan::new(&self.layout, &Wanted { time: true, ..Wanted::default() });
        let plan = ReadPlan::new(&self.layout, wanted);
        let mut meter = ReadMeter::default();
        meter.begin(options.checksum);
        let stream = self.source.open_counting(1, &meter)?;
        let chunk_bytes = self.chunk_bytes.min(SELECTED_BYTES);
        let mut chunks = self.chunks(stream, chunk_bytes);
        let mut chunk = Chunk::default();
        let (mut clock, mut rows) = (BlockBuffer::default(), BlockBuffer::default());
        let mut summary = ReadSummary::default();
        while chunks.next(&mut chunk).map_err(|error| self.chunk_error(error))? {
            let fill = |plan: &ReadPlan, buffer: &mut BlockBuffer| {
                buffer
                    .fill(plan, &chunk, options.skip_bad_rows)
                    .map_err(|(line, problem)| self.source.error_at(line, problem))?;
                Ok::<_, LogError>(buffer.parsed.skipped)
            };
            let mut skipped = fill(&time_only, &mut clock)?;
            summary.rows += clock.block.rows as u64;
            if clock.block.rows > 0 && selection.is_of_interest(&clock.block.time_s)? {
                skipped = fill(&plan, &mut rows)?;
                if rows.block.rows > 0 {
                    summary.repeated_rows += rows.block.repeated_rows() as u64;
                    selection.take(&mut rows.block)?;
                }
            }
            summary.skipped_rows += skipped;
            if let Some(progress) = options.progress {
                progress(meter.bytes.load(Ordering::Relaxed));
            }
        }
        if summary.rows == 0 && summary.skipped_rows == 0 {
            return Err(LogError::NoRows(self.source.path.clone()).into());
        }
        summary.checksum = meter.checksum();
        Ok(summary)
    }
}
