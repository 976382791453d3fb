//! Output of converted frames, after the low-pass.

use std::collections::VecDeque;
use std::path::Path;

use super::encode::{EncodedFrames, EncodedOutput, Encoder};
use super::frames::{ConvertedFrames, ConvertedRows};
use super::summary::Totals;
use crate::workflow::WorkflowError;
use figures::WrenchTrace;
use forces::ForceStream;
use forces::filter::FilterError;
use forces::sampling::{Rate, Sampling};
use shell_data::wrench::{Axes, Axis, PerAxis};

/// A backward time step of more than this, s, means that the clock was set back; a smaller one, a late frame.
const LATE_S: f64 = 1.0;

pub(super) struct Writer<'a> {
    pub(super) path: &'a Path,
    pub(super) encoder: &'a Encoder<'a>,
    pub(super) output: EncodedOutput<'a>,
    pub(super) trace: Option<&'a mut WrenchTrace>,
    pub(super) stream: ForceStream,
    /// Frames whose forces are not all known yet, block by block, and the forces known so far.
    pub(super) waiting: VecDeque<ConvertedFrames>,
    pub(super) known: PerAxis<Vec<f64>>,
    /// For every row whose force is not known yet: true if it is written.
    pub(super) waiting_rows: Vec<bool>,
    pub(super) sampling: Sampling,
    pub(super) latest_s: f64,
    pub(super) axes: Axes,
    pub(super) totals: Totals,
}

impl Writer<'_> {
    /// Writes frames without a low-pass; `encoded` is their encoded form.
    pub(super) fn write_at_once(
        &mut self,
        frames: &ConvertedFrames,
        encoded: EncodedFrames,
    ) -> Result<(), WorkflowError> {
        self.add(&frames.wrench)?;
        self.write(frames, encoded)
    }

    fn add(&mut self, wrench: &PerAxis<Vec<f64>>) -> Result<(), WorkflowError> {
        self.totals.add(wrench).map_err(|frame| {
            let path = self.path.display();
            let message = format!("`{path}`: the wrench of frame `{frame}` is not finite");
            WorkflowError::refused(message, None)
        })
    }

    fn write(
        &mut self,
        frames: &ConvertedFrames,
        encoded: EncodedFrames,
    ) -> Result<(), WorkflowError> {
        self.totals.count(frames);
        if let Some(trace) = &mut self.trace {
            // Axes without values have empty columns in a trace.
            let column = |axis: Axis| match self.axes.contains(axis) {
                true => &frames.wrench[axis.index()][..],
                false => &[],
            };
            trace.add(&frames.time_s, &Axis::ALL.map(column));
        }
        Ok(self.output.write(frames.len(), encoded)?)
    }

    /// Filters the next rows, and writes those whose forces are now known.
    pub(super) fn filter(&mut self, rows: ConvertedRows) -> Result<(), WorkflowError> {
        self.check_clock(&rows.time_s)?;
        self.sampling.add(&rows.frames.time_s);
        self.waiting.push_back(rows.frames);
        self.waiting_rows.extend(rows.written);
        let forces = self.stream.push(&rows.time_s, rows.wrench);
        let forces = forces.map_err(|error| self.unfiltered(error))?;
        self.write_forces(&forces)
    }

    fn unfiltered(&self, error: FilterError) -> WorkflowError {
        WorkflowError::Forces { path: self.path.display().to_string(), error: error.into() }
    }

    fn check_clock(&mut self, times_s: &[f64]) -> Result<(), WorkflowError> {
        for &after in times_s {
            let before = self.latest_s;
            if after < before - LATE_S {
                let path = self.path.display();
                return Err(WorkflowError::refused(
                    format!(
                        "`{path}`: the clock jumps back from `{before}` to `{after}` s, across which a low-pass \
                         cannot run"
                    ),
                    "recordings that were put together: convert each by itself, or leave the filter out with \
                     `--no-lowpass`",
                ));
            }
            self.latest_s = before.max(after);
        }
        Ok(())
    }

    /// Takes the forces of the oldest waiting rows, and writes the blocks whose forces are then all known.
    fn write_forces(&mut self, forces: &PerAxis<Vec<f64>>) -> Result<(), WorkflowError> {
        let rows: Vec<bool> = self.waiting_rows.drain(..forces[0].len()).collect();
        let written = |column: &Vec<f64>| {
            let rows = column.iter().zip(&rows).filter(|(_, written)| **written);
            rows.map(|(value, _)| *value).collect::<Vec<f64>>()
        };
        let wrench = forces.each_ref().map(written);
        self.add(&wrench)?;
        self.known.iter_mut().zip(wrench).for_each(|(known, next)| known.extend(next));
        while self.waiting.front().is_some_and(|next| next.len() <= self.known[0].len()) {
            let mut frames = self.waiting.pop_front().unwrap_or_default();
            frames.wrench =
                self.known.each_mut().map(|known| known.drain(..frames.len()).collect());
            let encoded = self.encoder.encode(&frames)?;
            self.write(&frames, encoded)?;
        }
        Ok(())
    }

    pub(super) fn finish(mut self) -> Result<(Totals, Option<Rate>), WorkflowError> {
        let forces = self.stream.finish().map_err(|error| self.unfiltered(error))?;
        self.write_forces(&forces)?;
        self.output.finish()?;
        Ok((self.totals, self.sampling.rate()))
    }
}
