//! Logs as blocks that a solver can pass over.

use super::WorkflowError;
use crate::block::Block;
use crate::calibration::FitError;
use crate::calibration::solver::{Blocks, Pass};
use crate::log_file::{Log, ReadOptions, Wanted};

/// Training logs, read anew on every pass.
pub(super) struct LogBlocks<'a> {
    pub(super) logs: &'a [Log],
    /// Use only rows whose readings differ from those of the row before.
    pub(super) fresh: bool,
    /// Progress is that of the first pass: how many there will be is not known beforehand.
    pub(super) read: ReadOptions<'a>,
    /// Told of every log that has been read for the first time.
    pub(super) finished: &'a dyn Fn(&Log),
    pub(super) passes: usize,
}

impl Blocks for LogBlocks<'_> {
    type Error = WorkflowError;

    fn pass<P: Pass>(&mut self, pass: &P) -> Result<P::Partial, WorkflowError> {
        let wanted = Wanted { readings: true, wrench: true, ..Wanted::default() };
        let is_first = self.passes == 0;
        self.passes += 1;
        let progress = self.read.progress.filter(|_| is_first);
        let read = ReadOptions { progress, ..self.read };
        let fresh = self.fresh;
        let map = |mut block: Block| -> Result<P::Partial, FitError> {
            if fresh {
                let fresh = block.fresh_rows();
                block.retain_rows(&fresh);
            }
            pass.reduce(&block)
        };
        let mut all = pass.empty();
        for log in self.logs {
            log.read(&wanted, &read, map, |partial| -> Result<(), WorkflowError> {
                pass.merge(&mut all, partial?);
                Ok(())
            })?;
            if is_first {
                (self.finished)(log);
            }
        }
        Ok(all)
    }
}
