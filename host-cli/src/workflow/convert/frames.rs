//! Conversion of frames of a log.

use super::options::ConvertOptions;
use crate::workflow::selection::RowFilter;
use calibration::dynamics::ReferenceLag;
use calibration::memory::TimeBase;
use calibration::{Calibration, ReadingSpans};
use forces::ForcePipeline;
use shell_data::Converter;
use shell_data::block::Block;
use shell_data::statistics::RunningVariance;
use shell_data::wrench::PerAxis;

/// Consecutive frames, column by column. Columns that were not requested are empty.
#[derive(Debug, Default)]
pub(super) struct ConvertedFrames {
    pub(super) time_s: Vec<f64>,
    pub(super) wrench: PerAxis<Vec<f64>>,
    pub(super) standard_errors: PerAxis<Vec<f64>>,
    pub(super) readings: Vec<Vec<f64>>,
    pub(super) kept: Vec<Vec<f64>>,
    pub(super) texts: Vec<Vec<String>>,
    /// Four kinds of flags for the channels of a frame: outside the range of the training data; at an end of the
    /// converter's range; on a plateau of their curve; left out by the model (empty if it leaves none out). Bit
    /// `i` is channel `i` from 0; channels from 63 up share the last bit.
    pub(super) flags: [Vec<u64>; 4],
}

#[derive(Debug, Default)]
pub(super) struct ConvertedRows {
    pub(super) time_s: Vec<f64>,
    /// Wrench of each row, tared.
    pub(super) wrench: PerAxis<Vec<f64>>,
    pub(super) written: Vec<bool>,
    /// The frames to be written, without wrenches if they are still to be filtered.
    pub(super) frames: ConvertedFrames,
    pub(super) taken_off: TakenOff,
    /// Times (s) and readings of the fresh frames in which the zero is watched, if it is.
    pub(super) watched: Option<WatchedFrames>,
    pub(super) spans: ReadingSpans,
}

/// Rows from which a load was subtracted.
#[derive(Debug, Default)]
pub(super) struct TakenOff {
    pub(super) rows_without_motion: u64,
    /// Scatter of the wrench with the load.
    pub(super) before: PerAxis<RunningVariance>,
}

impl TakenOff {
    pub(super) fn merge(&mut self, other: &Self) {
        self.rows_without_motion += other.rows_without_motion;
        self.before.iter_mut().zip(&other.before).for_each(|(all, one)| all.merge(one));
    }
}

type WatchedFrames = (Vec<f64>, Vec<Vec<f64>>);

pub(super) struct FrameConverter<'a> {
    pub(super) calibration: &'a Calibration,
    pub(super) pipeline: &'a ForcePipeline,
    /// The wrench to subtract at each row besides the load.
    pub(super) zero: PerAxis<f64>,
    pub(super) options: &'a ConvertOptions,
    /// The lag of the reference, if the time stamps of forces compensate for it.
    pub(super) stamp_lag: Option<ReferenceLag>,
    pub(super) keeps_readings: bool,
    /// `Some` if the zero is watched; true if repeated rows count as frames for it.
    pub(super) watch: Option<bool>,
}

impl ConvertedFrames {
    pub(super) fn len(&self) -> usize {
        self.flags[0].len()
    }
}

impl FrameConverter<'_> {
    pub(super) fn convert(&self, block: &mut Block) -> ConvertedRows {
        let spans = ReadingSpans::new(block.channels());
        let rows = match self.pipeline.looks_around() {
            false => self.convert_used(block),
            true => self.convert_all(block),
        };
        ConvertedRows { spans, ..rows }
    }

    fn convert_used(&self, block: &mut Block) -> ConvertedRows {
        // If all rows are used, duplicates of the previous frame may still have to be skipped for the zero.
        let is_fresh = (self.options.rows == RowFilter::All && self.watch == Some(false))
            .then(|| block.fresh_rows());
        self.options.rows.select(block);
        let watched = self.watched(block, is_fresh.as_deref());
        let mut wrench = self.pipeline.wrench(self.calibration, &block.time_s, &block.readings);
        let taken_off = self.take_off_load(&block.time_s, &mut wrench);
        self.options.frame.iter().for_each(|change| change.apply(&mut wrench));
        let frames = ConvertedFrames { wrench, ..self.frames(block) };
        ConvertedRows { frames, taken_off, watched, ..ConvertedRows::default() }
    }

    /// Passes every row to the filter, but converts each frame only once.
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
        let taken_off = self.take_off_load(&time_s, &mut wrench);
        self.options.frame.iter().for_each(|change| change.apply(&mut wrench));
        let watched = self.watched(block, (self.watch == Some(false)).then_some(&fresh));
        self.options.rows.select(block);
        let frames = self.frames(block);
        let written = match self.options.rows {
            RowFilter::Fresh => fresh,
            RowFilter::All => vec![true; fresh.len()],
        };
        let spans = ReadingSpans::default();
        ConvertedRows { time_s, wrench, written, frames, taken_off, watched, spans }
    }

    /// The rows of a block in which the zero is watched, if it is: those for which `is_fresh` is true, or all.
    fn watched(&self, block: &Block, is_fresh: Option<&[bool]>) -> Option<WatchedFrames> {
        self.watch?;
        let fresh = is_fresh.map(|fresh| block.kept(fresh));
        let rows = fresh.as_ref().unwrap_or(block);
        Some((rows.time_s.clone(), rows.channels().to_vec()))
    }

    /// Subtracts the carried load, if there is one.
    fn take_off_load(&self, times_s: &[f64], wrench: &mut PerAxis<Vec<f64>>) -> TakenOff {
        let Some(load) = &self.options.load else { return TakenOff::default() };
        let before = wrench.each_ref().map(|column| RunningVariance::new(column));
        let rows_without_motion = load.subtract(times_s, &self.zero, wrench);
        TakenOff { rows_without_motion, before }
    }

    /// Converts the times of rows (s), or their numbers, to the time stamps of their forces.
    fn moved(&self, mut times: Vec<f64>) -> Vec<f64> {
        if let Some(lag) = self.stamp_lag {
            times.iter_mut().for_each(|time| {
                *time = match lag.time_base {
                    TimeBase::Seconds => lag.moved_s(*time),
                    TimeBase::Rows => *time + lag.by,
                };
            });
        }
        times
    }

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
        // Flagged frames are counted even if the flags are not written.
        let saturated = match options.converter {
            Some(converter) => saturated_at(block.channels(), converter),
            None => vec![0; block.rows],
        };
        let out_of_range = calibration.out_of_range(&block.readings);
        frames.flags = [out_of_range, saturated, trust.insensitive, trust.left_out];
        if self.keeps_readings {
            block.drop_memory();
            frames.readings = std::mem::take(&mut block.readings);
        }
        frames
    }
}

/// The channels at either end of the converter's range, for every row.
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
