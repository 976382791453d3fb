//! Some frames of a log, converted.

use super::ConvertOptions;
use calibration::Calibration;
use calibration::uncertainty::Tare;
use shell_data::block::Block;
use shell_data::wrench::PerAxis;

/// Consecutive frames, column by column. Columns that were not asked for are empty.
#[derive(Debug, Default)]
pub(super) struct Frames {
    pub(super) time_s: Vec<f64>,
    pub(super) wrench: PerAxis<Vec<f64>>,
    pub(super) standard_errors: PerAxis<Vec<f64>>,
    /// The channels outside the range of the training data: bit `i` for channel `i` from 0, all from
    /// 63 up sharing the last bit.
    pub(super) out_of_range: Vec<u64>,
    /// The saturated channels, likewise.
    pub(super) saturated: Vec<u64>,
}

/// What turns readings into frames.
pub(super) struct Converter<'a> {
    pub(super) calibration: &'a Calibration,
    pub(super) tare: Option<&'a Tare>,
    pub(super) options: &'a ConvertOptions,
}

impl Frames {
    pub(super) fn len(&self) -> usize {
        self.wrench[0].len()
    }

    /// Adds the frames that follow.
    pub(super) fn append(&mut self, mut next: Self) {
        self.time_s.append(&mut next.time_s);
        self.out_of_range.append(&mut next.out_of_range);
        self.saturated.append(&mut next.saturated);
        for (column, next) in self.wrench.iter_mut().zip(&mut next.wrench) {
            column.append(next);
        }
        for (column, next) in self.standard_errors.iter_mut().zip(&mut next.standard_errors) {
            column.append(next);
        }
    }
}

impl Converter<'_> {
    pub(super) fn convert(&self, block: &mut Block) -> Frames {
        let Self { calibration, tare, options } = self;
        let mut frames = Frames { time_s: std::mem::take(&mut block.time_s), ..Frames::default() };
        calibration.wrench(&block.readings, &mut frames.wrench);
        if let Some(tare) = tare {
            for (column, tare) in frames.wrench.iter_mut().zip(tare.wrench) {
                column.iter_mut().for_each(|value| *value -= tare);
            }
        }
        if options.columns.need_errors() {
            let errors = &mut frames.standard_errors;
            let known = calibration.standard_errors(&block.readings, *tare, errors);
            debug_assert!(known, "checked before the work");
        }
        // Flagged frames are counted, whether or not the flags are written.
        frames.out_of_range = calibration.out_of_range(&block.readings);
        frames.saturated = match options.full_scale {
            Some(full_scale) => saturated(&block.readings, full_scale),
            None => vec![0; frames.len()],
        };
        frames
    }
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
