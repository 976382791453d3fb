//! Noise of the readings and the wrench of an unloaded sensor: RMS about the mean, so that no tare is needed; the
//! mean is the offset that a tare would remove. The forces come from the [pipeline](forces) without a low-pass,
//! which would hide the noise.

use super::selection::{RowFilter, TimeWindow, read_with_memory};
use super::{WorkflowError, check_channels, error::TIMES};
use calibration::Calibration;
use forces::stationary::{ZeroMove, ZeroWatch};
use forces::{ForcePipeline, by_column};
use log_file::{Log, ReadOptions, Wanted};
use shell_data::statistics::RunningVariance;
use shell_data::wrench::{AxisValues, PerAxis};

#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct NoiseSummary {
    pub rows: u64,
    /// Duplicates: rows whose readings equal the previous row's.
    pub repeated_rows: u64,
    pub skipped_rows: u64,
    pub frames: u64,
    pub rows_used: RowFilter,
    /// Noise of the wrench, N and N·m.
    #[serde(serialize_with = "by_column")]
    pub axes: AxisValues<Scatter>,
    /// Noise of the readings of each channel, counts.
    pub channels: Vec<Scatter>,
    /// Change of the zero between the first stationary interval and the last; only for a log with time and two of them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub zero: Option<ZeroMove>,
}

/// Scatter of a quantity, in its own unit.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Scatter {
    pub mean: f64,
    /// RMS deviation from the mean.
    pub rms: f64,
    pub peak_to_peak: f64,
}

/// Measures the scatter of the frames of a log, in one pass and constant memory. `window` is the unloaded
/// block of time; `None` for the whole log.
pub fn noise(
    log: &Log,
    calibration: &Calibration,
    rows: RowFilter,
    window: Option<TimeWindow>,
    read: &ReadOptions<'_>,
) -> Result<NoiseSummary, WorkflowError> {
    let time = window.is_some() || log.has_time() || calibration.needs_time();
    let wanted = Wanted { readings: true, time, ..Wanted::default() };
    log.require(&wanted)?;
    check_channels(log, calibration.channels())?;
    let pipeline = ForcePipeline::default();
    let mut axes: PerAxis<_> = [ColumnStatistics::new(&[]); 6];
    let mut channels = vec![ColumnStatistics::new(&[]); log.channels()];
    let mut watch = ZeroWatch::default();
    let summary = read_with_memory(
        log,
        (&wanted, read),
        (calibration, false),
        |block| {
            rows.select(block);
            if let Some(window) = window {
                let keep: Vec<_> = block.time_s.iter().map(|&t| window.contains(t)).collect();
                *block = block.kept(&keep);
            }
            let wrench = pipeline.wrench(calibration, &block.time_s, &block.readings);
            block.drop_memory();
            let channels: Vec<_> =
                block.readings.iter().map(|c| ColumnStatistics::new(c)).collect();
            let frames = (std::mem::take(&mut block.time_s), std::mem::take(&mut block.readings));
            (wrench.map(|column| ColumnStatistics::new(&column)), channels, frames)
        },
        |(block_axes, block_channels, (times_s, readings))| {
            watch.look_at(&times_s, &readings);
            axes.iter_mut().zip(&block_axes).for_each(|(all, block)| all.merge(block));
            channels.iter_mut().zip(&block_channels).for_each(|(all, block)| all.merge(block));
            Ok::<(), WorkflowError>(())
        },
    )?;
    let frames = axes[0].variance.count;
    if frames < 2 {
        let path = log.path().display();
        let message =
            format!("`{path}` has `{frames}` frames to tell the noise from, at least 2 are needed");
        return Err(WorkflowError::refused(message, TIMES));
    }
    Ok(NoiseSummary {
        rows: summary.rows,
        repeated_rows: summary.repeated_rows,
        skipped_rows: summary.skipped_rows,
        frames,
        rows_used: rows,
        axes: calibration.axes.values(&axes.map(|moments| moments.scatter())),
        channels: channels.iter().map(ColumnStatistics::scatter).collect(),
        zero: watch.finish(calibration),
    })
}

#[derive(Clone, Copy, Debug)]
struct ColumnStatistics {
    variance: RunningVariance,
    min: f64,
    max: f64,
}

impl ColumnStatistics {
    fn new(values: &[f64]) -> Self {
        Self {
            variance: RunningVariance::new(values),
            min: values.iter().copied().fold(f64::INFINITY, f64::min),
            max: values.iter().copied().fold(f64::NEG_INFINITY, f64::max),
        }
    }

    fn merge(&mut self, other: &Self) {
        self.variance.merge(&other.variance);
        self.min = self.min.min(other.min);
        self.max = self.max.max(other.max);
    }

    fn scatter(&self) -> Scatter {
        Scatter {
            mean: self.variance.mean,
            rms: self.variance.rms_about_mean(),
            peak_to_peak: self.max - self.min,
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn scatter_of_known_numbers() {
        let Scatter { mean, rms, peak_to_peak } =
            ColumnStatistics::new(&[2.0, 4.0, 4.0, 4.0, 5.0, 5.0, 7.0, 9.0]).scatter();
        assert_eq!((mean, rms, peak_to_peak), (5.0, 2.0, 7.0));
    }

    proptest! {
        #[test]
        fn parts_merge_to_the_whole(
            values in prop::collection::vec(-1e3..1e3_f64, 2..80), at in 0usize..80,
        ) {
            let (a, b) = values.split_at(at.min(values.len()));
            let mut merged = ColumnStatistics::new(a);
            merged.merge(&ColumnStatistics::new(b));
            let (merged, whole) = (merged.scatter(), ColumnStatistics::new(&values).scatter());
            // 80 sums of 1e3, each rounded by less than 80 · 80 · 1e3 · 1e-16.
            prop_assert!((merged.mean - whole.mean).abs() < 1e-9);
            prop_assert!((merged.rms - whole.rms).abs() < 1e-9);
            prop_assert_eq!(merged.peak_to_peak, whole.peak_to_peak);
        }
    }
}
