//! The log of one board during a recording.

use std::path::PathBuf;

use serde::Serialize;

use super::LogSink;
use super::record_options::{RecordError, RecordOptions};
use crate::recording::{
    Annotations, BoardFrame, BoardSource, LiveForces, Losses, ReferenceBeside, RowWriter,
};

/// Maximum number of frames that wait for a label: 82 s at 100 Hz.
pub(super) const MOST_WAITING: usize = 8192;

#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RecordedBoard {
    /// Address of the radio module, or the board's name in its packets.
    pub address: String,
    pub log: Option<PathBuf>,
    pub frames: u64,
    /// Losses without damaged API frames, which cannot be attributed to a board.
    #[serde(flatten)]
    pub losses: Losses,
}

#[derive(Debug, Default)]
pub(super) struct BoardLog {
    pub(super) sender: BoardSource,
    pub(super) log: Option<Box<dyn LogSink>>,
    /// Writer that is created for the first frame, which determines the columns.
    pub(super) rows: Option<RowWriter>,
    pub(super) annotations: Annotations,
    pub(super) waiting: Vec<BoardFrame>,
    /// Frames that wait for the reference to reach their time.
    pub(super) behind: Vec<BoardFrame>,
    pub(super) waits: bool,
    pub(super) other_content: u64,
    pub(super) frames: u64,
    pub(super) extent_us: Option<(i64, i64)>,
}

impl BoardLog {
    /// Writes frames and empties the list. Frames that may still be labelled wait, and so do frames
    /// that the reference has not reached at `now_s`.
    pub(super) fn write(
        &mut self,
        frames: &mut Vec<BoardFrame>,
        numbered: bool,
        (forces, options): (Option<&LiveForces>, &RecordOptions),
        (reference, now_s): (Option<&mut ReferenceBeside>, f64),
    ) -> Result<(), RecordError> {
        self.count(frames);
        let (Some(log), Some(first)) = (&mut self.log, frames.first()) else {
            frames.clear();
            // Without a log, marks only appear on the screen.
            self.forget_annotations();
            return Ok(());
        };
        if self.rows.is_none() {
            let (forces, as_sampled) = (forces.cloned(), options.as_sampled);
            let axes = reference.as_ref().map(|reference| reference.axes());
            if axes.is_some() && first.measured.readings().is_none() {
                return Err(RecordError::ReferenceBesideWrenches);
            }
            let rows = RowWriter::new(first, numbered, forces, as_sampled, options.labels, axes)?;
            log.append(rows.header().as_bytes())?;
            self.rows = Some(rows);
        }
        if self.waits {
            self.waiting.append(frames);
            // Search for the index instead of comparing: the indices of a restarted board begin again.
            let is_first = |frame: &BoardFrame| Some(frame.index) == self.annotations.settled;
            let settled = self.waiting.iter().rposition(is_first).unwrap_or(0);
            let due = settled.max(self.waiting.len().saturating_sub(MOST_WAITING));
            frames.extend(self.waiting.drain(..due));
        }
        if let Some(reference) = &reference {
            self.behind.append(frames);
            let due = reference.due(&self.behind, now_s);
            frames.extend(self.behind.drain(..due));
        }
        self.write_rows(frames, false, reference)
    }

    fn write_rows(
        &mut self,
        frames: &mut Vec<BoardFrame>,
        ended: bool,
        reference: Option<&mut ReferenceBeside>,
    ) -> Result<(), RecordError> {
        let (Some(rows), Some(log)) = (&mut self.rows, &mut self.log) else { return Ok(()) };
        let mut text = Vec::new();
        let annotations = &mut self.annotations;
        self.other_content += rows.write(frames, ended, annotations, reference, &mut text)?;
        Ok(log.append(&text)?)
    }

    /// Writes all waiting frames and closes the log; a new log may follow.
    pub(super) fn close(
        &mut self,
        reference: Option<&mut ReferenceBeside>,
    ) -> Result<(), RecordError> {
        self.finish(reference)?;
        if self.rows.take().is_some() {
            self.forget_annotations();
        }
        self.log.take().map_or(Ok(()), |log| log.close())?;
        Ok(())
    }

    pub(super) fn finish(
        &mut self,
        reference: Option<&mut ReferenceBeside>,
    ) -> Result<(), RecordError> {
        let mut waiting = std::mem::take(&mut self.behind);
        waiting.append(&mut self.waiting);
        self.write_rows(&mut waiting, true, reference)
    }

    fn forget_annotations(&mut self) {
        self.annotations.marks.clear();
        self.annotations.labels.clear();
    }

    fn count(&mut self, frames: &[BoardFrame]) {
        for frame in frames {
            self.frames += 1;
            let (first, last) = self.extent_us.unwrap_or((frame.time_us, frame.time_us));
            self.extent_us = Some((first.min(frame.time_us), last.max(frame.time_us)));
        }
    }

    pub(super) fn board_time_us(&self) -> i64 {
        self.extent_us.map_or(0, |(first, last)| last - first)
    }

    pub(super) fn recorded(&self, losses: Losses) -> RecordedBoard {
        let log = self.log.as_ref().map(|log| log.path().to_path_buf());
        RecordedBoard { address: self.sender.text(), log, frames: self.frames, losses }
    }
}
