//! Converts the frames of a block.

use super::options::ConvertOptions;
use crate::workflow::selection::RowFilter;
use calibration::Calibration;
use calibration::dynamics::ReferenceLag;
use forces::ForcePipeline;
use shell_data::Converter;
use shell_data::block::Block;
use shell_data::wrench::PerAxis;

/// Consecutive frames, column by column. Columns that were not requested are empty.
#[derive(Debug, Default)]
pub(super) struct ConvertedFrames {
    pub(super) time_s: Vec<f64>,
    pub(super) wrench: PerAxis<Vec<f64>>,
    pub(super) standard_errors: PerAxis<Vec<f64>>,
    /// One column for each channel.
    pub(super) readings: Vec<Vec<f64>>,
    /// Numeric log columns that are kept.
    pub(super) kept: Vec<Vec<f64>>,
    /// Text columns of the log that are kept.
    pub(super) texts: Vec<Vec<String>>,
    /// Flags of channels outside the range of the training data, of channels at an end of the converter or
    /// on a plateau of their curve, and of channels that the model left out (empty if it leaves none out).
    /// Bit `i` is for channel `i` from 0; all channels from 63 up share the last bit.
    pub(super) flags: [Vec<u64>; 3],
}

/// Consecutive rows of a log, and the frames to write from them.
#[derive(Debug, Default)]
pub(super) struct ConvertedRows {
    /// Time of each row, s.
    pub(super) time_s: Vec<f64>,
    /// Wrench of each row, tared.
    pub(super) wrench: PerAxis<Vec<f64>>,
    /// True for each row that is written.
    pub(super) written: Vec<bool>,
    /// Frames to write; without wrenches if these are still to be filtered.
    pub(super) frames: ConvertedFrames,
    /// Number of rows whose load is unknown.
    pub(super) without_motion: u64,
    /// Times (s) and readings of fresh frames, if zero drift is monitored.
    pub(super) watched: Option<WatchedFrames>,
}

type WatchedFrames = (Vec<f64>, Vec<Vec<f64>>);

/// Converts readings to frames.
pub(super) struct FrameConverter<'a> {
    pub(super) calibration: &'a Calibration,
    pub(super) pipeline: &'a ForcePipeline,
    /// Offset to subtract from each row, in addition to the load.
    pub(super) zero: PerAxis<f64>,
    pub(super) options: &'a ConvertOptions,
    /// Lag of the reference, if the time stamps of forces correct for it.
    pub(super) stamp_lag: Option<ReferenceLag>,
    /// True to keep the readings in the frames.
    pub(super) keeps_readings: bool,
    /// True if rows that repeat a frame count as frames; `None` if zero drift is not monitored.
    pub(super) watch: Option<bool>,
}

impl ConvertedFrames {
    /// Number of frames.
    pub(super) fn len(&self) -> usize {
        self.flags[0].len()
    }
}

impl FrameConverter<'_> {
    pub(super) fn convert(&self, block: &mut Block) -> ConvertedRows {
        match self.pipeline.looks_around() {
            false => self.convert_used(block),
            true => self.convert_all(block),
        }
    }

    /// Converts the selected rows.
    fn convert_used(&self, block: &mut Block) -> ConvertedRows {
        // Even if all rows are used, repeats of a frame may not count as frames.
        let is_fresh = (self.options.rows == RowFilter::All && self.watch == Some(false))
            .then(|| block.fresh_rows());
        self.options.rows.select(block);
        let watched = self.watched(block, is_fresh.as_deref());
        let mut wrench = self.pipeline.wrench(self.calibration, &block.time_s, &block.readings);
        let without_motion = self.take_off_load(&block.time_s, &mut wrench);
        self.options.frame.iter().for_each(|change| change.apply(&mut wrench));
        let frames = ConvertedFrames { wrench, ..self.frames(block) };
        ConvertedRows { frames, without_motion, watched, ..ConvertedRows::default() }
    }

    /// Converts every row, because the filter needs all of them, but converts each frame only once.
    fn convert_all(&self, block: &mut Block) -> ConvertedRows {
        let fresh = block.fresh_rows();
        let time_s = block.time_s.clone();
        let mut is_new = fresh.clone();
        is_new.first_mut().into_iter().for_each(|first| *first = true);
        let mut frames = 0;
        let number = |is_new: &bool| {
            frames += usize::from(*is_new);
            frames - 1
        };
        let frame_of_row: Vec<usize> = is_new.iter().map(number).collect();
        let frames = (&*block.kept(&is_new).readings, &*frame_of_row);
        let mut wrench = self.pipeline.wrench_of_rows(self.calibration, &time_s, frames);
        let without_motion = self.take_off_load(&time_s, &mut wrench);
        self.options.frame.iter().for_each(|change| change.apply(&mut wrench));
        let watched = self.watched(block, (self.watch == Some(false)).then_some(&fresh));
        self.options.rows.select(block);
        let frames = self.frames(block);
        let written = match self.options.rows {
            RowFilter::Fresh => fresh,
            RowFilter::All => vec![true; fresh.len()],
        };
        ConvertedRows { time_s, wrench, written, frames, without_motion, watched }
    }

    /// Rows of a block for the zero monitor, if there is one: rows with `is_fresh`, or all.
    fn watched(&self, block: &Block, is_fresh: Option<&[bool]>) -> Option<WatchedFrames> {
        self.watch?;
        let fresh = is_fresh.map(|fresh| block.kept(fresh));
        let rows = fresh.as_ref().unwrap_or(block);
        Some((rows.time_s.clone(), rows.channels().to_vec()))
    }

    /// Subtracts the carried load; returns the number of rows with an unknown load.
    fn take_off_load(&self, times_s: &[f64], wrench: &mut PerAxis<Vec<f64>>) -> u64 {
        let load = self.options.load.as_ref();
        load.map_or(0, |load| load.subtract(times_s, &self.zero, wrench))
    }

    /// Times of forces from the times of their rows, s.
    fn moved(&self, mut times_s: Vec<f64>) -> Vec<f64> {
        if let Some(lag) = self.stamp_lag {
            times_s.iter_mut().for_each(|time_s| *time_s = lag.moved_s(*time_s));
        }
        times_s
    }

    /// Builds frames without wrenches.
    fn frames(&self, block: &mut Block) -> ConvertedFrames {
        let Self { calibration, pipeline, options, .. } = self;
        let repeated = |(text, rows): &(String, usize)| std::iter::repeat_n(text.clone(), *rows);
        let spelled_out = |runs: &Vec<_>| runs.iter().flat_map(repeated).collect();
        let mut frames = ConvertedFrames {
            time_s: self.moved(std::mem::take(&mut block.time_s)),
            kept: std::mem::take(&mut block.others),
            texts: block.texts.iter().map(spelled_out).collect(),
            ..ConvertedFrames::default()
        };
        let errors = options.columns.need_errors();
        let trust = calibration.trust(&block.readings, pipeline.tare.as_ref(), errors);
        frames.standard_errors = trust.standard_errors;
        if !frames.standard_errors[0].is_empty() {
            let errors = &mut frames.standard_errors;
            options.frame.iter().for_each(|change| change.apply_to_errors(errors));
        }
        // Flagged frames are counted even if flags are not written.
        let mut saturated = match options.converter {
            Some(converter) => saturated_at(block.channels(), converter),
            None => vec![0; block.rows],
        };
        saturated.iter_mut().zip(trust.saturated).for_each(|(flags, plateau)| *flags |= plateau);
        frames.flags = [calibration.out_of_range(&block.readings), saturated, trust.left_out];
        if self.keeps_readings {
            block.drop_memory();
            frames.readings = std::mem::take(&mut block.readings);
        }
        frames
    }
}

/// For each row, the channels at either end of the converter's range.
fn saturated_at(readings: &[Vec<f64>], converter: Converter) -> Vec<u64> {
    let mut flags = vec![0; readings.first().map_or(0, Vec::len)];
    for (channel, column) in readings.iter().enumerate() {
        let bit = 1 << channel.min(63);
        for (flags, &reading) in flags.iter_mut().zip(column) {
            *flags |= if converter.is_at_end(reading) { bit } else { 0 };
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
        assert_eq!(saturated_at(&readings, Converter::new(4095.0)), [0b01, 0, 0b11, 0b01]);
    }
}
