//! Some frames of a log, converted.

use super::options::ConvertOptions;
use crate::workflow::selection::RowFilter;
use calibration::Calibration;
use forces::ForcePipeline;
use shell_data::block::Block;
use shell_data::wrench::PerAxis;

/// Consecutive frames, column by column. Columns that were not asked for are empty.
#[derive(Debug, Default)]
pub(super) struct ConvertedFrames {
    pub(super) time_s: Vec<f64>,
    pub(super) wrench: PerAxis<Vec<f64>>,
    pub(super) standard_errors: PerAxis<Vec<f64>>,
    /// One column for each channel.
    pub(super) readings: Vec<Vec<f64>>,
    /// The log's columns that are carried along.
    pub(super) kept: Vec<Vec<f64>>,
    /// Those of them that are text.
    pub(super) texts: Vec<Vec<String>>,
    /// The channels outside the range of the training data: bit `i` for channel `i` from 0, all from
    /// 63 up sharing the last bit.
    pub(super) out_of_range: Vec<u64>,
    /// The channels at an end of the converter or on a plateau of their curve, likewise.
    pub(super) saturated: Vec<u64>,
    /// The channels that the model left out, likewise; empty where it leaves none out.
    pub(super) left_out: Vec<u64>,
}

/// Consecutive rows of a log, and the frames that are written of them.
#[derive(Debug, Default)]
pub(super) struct ConvertedRows {
    /// Time of every row, s.
    pub(super) time_s: Vec<f64>,
    /// The wrench of every row, tared.
    pub(super) wrench: PerAxis<Vec<f64>>,
    /// Whether a row is written.
    pub(super) written: Vec<bool>,
    /// What is written; without wrenches if those are to be filtered.
    pub(super) frames: ConvertedFrames,
    /// Rows whose load is not known.
    pub(super) without_motion: u64,
    /// What the zero is watched in, if it is: the times (s) and readings of fresh frames.
    pub(super) watched: Option<WatchedFrames>,
}

type WatchedFrames = (Vec<f64>, Vec<Vec<f64>>);

/// What turns readings into frames.
pub(super) struct FrameConverter<'a> {
    pub(super) calibration: &'a Calibration,
    pub(super) pipeline: &'a ForcePipeline,
    /// What is taken off besides the load at each row.
    pub(super) zero: PerAxis<f64>,
    pub(super) options: &'a ConvertOptions,
    /// Whether frames keep their readings.
    pub(super) keeps_readings: bool,
    /// Whether rows that repeat a frame are frames, where the zero is watched; else `None`.
    pub(super) watch: Option<bool>,
}

/// Adds rows to columns, which there may be none of so far.
pub(super) fn append<T>(columns: &mut Vec<Vec<T>>, next: &mut [Vec<T>]) {
    columns.resize_with(next.len(), Vec::new);
    columns.iter_mut().zip(next).for_each(|(column, next)| column.append(next));
}

impl ConvertedFrames {
    /// Number of frames.
    pub(super) fn len(&self) -> usize {
        self.out_of_range.len()
    }

    /// Adds the frames that follow; their wrenches are added by whoever filters them.
    pub(super) fn append(&mut self, mut next: Self) {
        self.time_s.append(&mut next.time_s);
        self.out_of_range.append(&mut next.out_of_range);
        self.saturated.append(&mut next.saturated);
        self.left_out.append(&mut next.left_out);
        for (column, next) in self.standard_errors.iter_mut().zip(&mut next.standard_errors) {
            column.append(next);
        }
        append(&mut self.readings, &mut next.readings);
        append(&mut self.kept, &mut next.kept);
        append(&mut self.texts, &mut next.texts);
    }

    /// Takes the first `count` frames, whose wrenches are `wrench`.
    pub(super) fn take_first(&mut self, count: usize, wrench: PerAxis<Vec<f64>>) -> Self {
        fn first<T>(column: &mut Vec<T>, count: usize) -> Vec<T> {
            column.drain(..count.min(column.len())).collect()
        }
        Self {
            time_s: first(&mut self.time_s, count),
            wrench,
            standard_errors: self.standard_errors.each_mut().map(|column| first(column, count)),
            readings: self.readings.iter_mut().map(|column| first(column, count)).collect(),
            kept: self.kept.iter_mut().map(|column| first(column, count)).collect(),
            texts: self.texts.iter_mut().map(|column| first(column, count)).collect(),
            out_of_range: first(&mut self.out_of_range, count),
            saturated: first(&mut self.saturated, count),
            left_out: first(&mut self.left_out, count),
        }
    }
}

impl FrameConverter<'_> {
    pub(super) fn convert(&self, block: &mut Block) -> ConvertedRows {
        match self.pipeline.low_pass {
            None => self.convert_used(block),
            Some(_) => self.convert_all(block),
        }
    }

    /// Converts the rows that are used.
    fn convert_used(&self, block: &mut Block) -> ConvertedRows {
        // Of rows that are all used, those that repeat a frame may be none.
        let is_fresh = (self.options.rows == RowFilter::All && self.watch == Some(false))
            .then(|| block.fresh_rows());
        self.options.rows.select(block);
        let watched = self.watched(block, is_fresh.as_deref());
        let mut wrench = self.pipeline.wrench(self.calibration, &block.time_s, &block.readings);
        let without_motion = self.take_off_load(&block.time_s, &mut wrench);
        let frames = ConvertedFrames { wrench, ..self.frames(block) };
        ConvertedRows { frames, without_motion, watched, ..ConvertedRows::default() }
    }

    /// Converts every row, which the filter has to see, but each frame once.
    fn convert_all(&self, block: &mut Block) -> ConvertedRows {
        let fresh = block.fresh_rows();
        let time_s = block.time_s.clone();
        let is_new = |row: usize| row == 0 || fresh[row];
        let new_rows: Vec<usize> = (0..block.rows).filter(|&row| is_new(row)).collect();
        let pick = |column: &Vec<f64>| new_rows.iter().map(|&row| column[row]).collect();
        let readings: Vec<Vec<f64>> = block.readings.iter().map(pick).collect();
        let mut by_frame = PerAxis::default();
        self.calibration.wrench(&readings, &mut by_frame);
        let mut frame = 0;
        let of_row = |row: usize| {
            frame += usize::from(is_new(row));
            frame - 1
        };
        let frame_of_row: Vec<usize> = (0..block.rows).map(of_row).collect();
        let spread = |frames: Vec<f64>| frame_of_row.iter().map(|&frame| frames[frame]).collect();
        let mut wrench = by_frame.map(spread);
        self.pipeline.tare_off(&time_s, &mut wrench);
        let without_motion = self.take_off_load(&time_s, &mut wrench);
        let watched = self.watched(block, (self.watch == Some(false)).then_some(&fresh));
        self.options.rows.select(block);
        let frames = self.frames(block);
        let written = match self.options.rows {
            RowFilter::Fresh => fresh,
            RowFilter::All => vec![true; time_s.len()],
        };
        ConvertedRows { time_s, wrench, written, frames, without_motion, watched }
    }

    /// The rows of a block that the zero is watched in, if it is: those for which `is_fresh` is true, or all.
    fn watched(&self, block: &Block, is_fresh: Option<&[bool]>) -> Option<WatchedFrames> {
        self.watch?;
        let rows = |column: &Vec<f64>| match is_fresh {
            None => column.clone(),
            Some(fresh) => {
                let rows = column.iter().zip(fresh).filter(|(_, fresh)| **fresh);
                rows.map(|(value, _)| *value).collect()
            }
        };
        Some((rows(&block.time_s), block.channels().iter().map(rows).collect()))
    }

    /// Takes off what the sensor carries; returns the number of rows where that is not known.
    fn take_off_load(&self, times_s: &[f64], wrench: &mut PerAxis<Vec<f64>>) -> u64 {
        let load = self.options.load.as_ref();
        load.map_or(0, |load| load.subtract(times_s, &self.zero, wrench))
    }

    /// All but the wrenches.
    fn frames(&self, block: &mut Block) -> ConvertedFrames {
        let Self { calibration, pipeline, options, .. } = self;
        let mut frames = ConvertedFrames {
            time_s: std::mem::take(&mut block.time_s),
            kept: std::mem::take(&mut block.others),
            texts: block.texts.iter().map(|runs| spelled_out(runs)).collect(),
            ..ConvertedFrames::default()
        };
        let errors = options.columns.need_errors();
        let trust = calibration.trust(&block.readings, pipeline.tare.as_ref(), errors);
        (frames.standard_errors, frames.left_out) = (trust.standard_errors, trust.left_out);
        // Flagged frames are counted, whether or not the flags are written.
        frames.out_of_range = calibration.out_of_range(&block.readings);
        frames.saturated = match options.full_scale {
            Some(full_scale) => saturated(block.channels(), full_scale),
            None => vec![0; block.rows],
        };
        for (flags, plateau) in frames.saturated.iter_mut().zip(trust.saturated) {
            *flags |= plateau;
        }
        if self.keeps_readings {
            block.drop_memory();
            frames.readings = std::mem::take(&mut block.readings);
        }
        frames
    }
}

/// The text of every row, from runs of equal ones.
fn spelled_out(runs: &[(String, usize)]) -> Vec<String> {
    runs.iter().flat_map(|(text, rows)| std::iter::repeat_n(text.clone(), *rows)).collect()
}

/// For every row, the channels at either end of what the converter can give.
fn saturated(readings: &[Vec<f64>], full_scale: f64) -> Vec<u64> {
    let mut flags = vec![0; readings.first().map_or(0, Vec::len)];
    for (channel, column) in readings.iter().enumerate() {
        let bit = 1 << channel.min(63);
        for (flags, &reading) in flags.iter_mut().zip(column) {
            *flags |= if reading > 0.0 && reading < full_scale { 0 } else { bit };
        }
    }
    flags
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reading_at_either_end_of_the_converter_is_saturated() {
        let readings = [vec![0.0, 1.0, 4095.0, 5000.0], vec![7.0, 7.0, 0.0, 7.0]];
        assert_eq!(saturated(&readings, 4095.0), [0b01, 0, 0b11, 0b01]);
    }
}
