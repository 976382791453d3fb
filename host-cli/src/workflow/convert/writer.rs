//! Converted frames through the low-pass to the output.

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

/// A clock that goes back by more than this has been set back; by less, a frame is late, s.
const LATE_S: f64 = 1.0;

/// Writes frames in order, as soon as their forces are known.
pub(super) struct Writer<'a> {
    pub(super) path: &'a Path,
    pub(super) encoder: &'a Encoder<'a>,
    pub(super) output: EncodedOutput<'a>,
    pub(super) trace: Option<&'a mut WrenchTrace>,
    pub(super) stream: ForceStream,
    /// Frames whose forces are not known yet.
    pub(super) waiting: ConvertedFrames,
    /// Of every row whose force is not known yet, whether it is written.
    pub(super) waiting_rows: Vec<bool>,
    pub(super) sampling: Sampling,
    pub(super) latest_s: f64,
    /// The axes that there are.
    pub(super) axes: Axes,
    pub(super) totals: Totals,
}

impl Writer<'_> {
    /// Writes frames, as `encoded`.
    pub(super) fn write(
        &mut self,
        frames: &ConvertedFrames,
        encoded: EncodedFrames,
    ) -> Result<(), WorkflowError> {
        let path = || self.path.display().to_string();
        let added = self.totals.add(frames);
        added.map_err(|frame| WorkflowError::NotFinite { path: path(), frame })?;
        if let Some(trace) = &mut self.trace {
            // Columns of axes that there are not are empty in a trace.
            let column = |axis: Axis| match self.axes.contains(axis) {
                true => &frames.wrench[axis.index()][..],
                false => &[],
            };
            trace.add(&frames.time_s, &Axis::ALL.map(column));
        }
        Ok(self.output.write(encoded)?)
    }

    /// Filters the next rows, and writes those whose forces are known by now.
    pub(super) fn filter(&mut self, rows: ConvertedRows) -> Result<(), WorkflowError> {
        self.check_clock(&rows.time_s)?;
        self.sampling.add(&rows.frames.time_s);
        self.waiting.append(rows.frames);
        self.waiting_rows.extend(rows.written);
        let answers = self.stream.push(&rows.time_s, rows.wrench);
        let answers = answers.map_err(|error| self.unfiltered(error))?;
        self.write_answers(&answers)
    }

    fn unfiltered(&self, error: FilterError) -> WorkflowError {
        WorkflowError::Forces { path: self.path.display().to_string(), error: error.into() }
    }

    fn check_clock(&mut self, times_s: &[f64]) -> Result<(), WorkflowError> {
        for &after in times_s {
            let before = self.latest_s;
            if after < before - LATE_S {
                let path = self.path.display().to_string();
                return Err(WorkflowError::Backward { path, before, after });
            }
            self.latest_s = before.max(after);
        }
        Ok(())
    }

    /// Writes those of the oldest waiting rows that are to be written, with their forces.
    fn write_answers(&mut self, answers: &PerAxis<Vec<f64>>) -> Result<(), WorkflowError> {
        let rows: Vec<bool> = self.waiting_rows.drain(..answers[0].len()).collect();
        let written = |column: &Vec<f64>| {
            let rows = column.iter().zip(&rows).filter(|(_, written)| **written);
            rows.map(|(value, _)| *value).collect::<Vec<f64>>()
        };
        let wrench = answers.each_ref().map(written);
        let frames = self.waiting.take_first(wrench[0].len(), wrench);
        let encoded = self.encoder.encode(&frames)?;
        self.write(&frames, encoded)
    }

    /// Writes what waits.
    pub(super) fn finish(mut self) -> Result<(Totals, Option<Rate>), WorkflowError> {
        let answers = self.stream.finish().map_err(|error| self.unfiltered(error))?;
        self.write_answers(&answers)?;
        self.output.finish()?;
        Ok((self.totals, self.sampling.rate()))
    }
}
