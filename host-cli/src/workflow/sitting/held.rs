//! A load while it was held: means, and faults that its rows show without a model.

use live_view::{LiveRow, UnloadedValues};
use shared_proto::CHANNELS;
use shell_data::statistics::RunningVariance;
use shell_data::wrench::{Axis, PerAxis};

use super::fault::SittingFault;

/// A channel is saturated if more than this share of its rows is at an end of the converter.
const SATURATED: f64 = 0.5;

/// A channel without scatter is silent if its scatter at other loads exceeds this, counts: with less than a third
/// of a count, a converter may give one value for seconds.
const LIVELY: f64 = 0.3;

/// Maximum movement of the reference between both halves of a load, in standard errors of their difference.
const MOVED: f64 = 6.0;

/// Movement of the reference below which it is not reported, as a share of the largest load of the axis.
const LEAST_MOVED: f64 = 0.03;

#[derive(Clone, Debug, Default)]
pub struct HeldLoad {
    readings: [Vec<f64>; CHANNELS],
    saturated: [usize; CHANNELS],
    /// Wrench of the reference by axis, N and N·m; empty without a reference.
    wrench: PerAxis<Vec<f64>>,
}

impl HeldLoad {
    pub fn push(&mut self, row: &LiveRow) {
        let Some(readings) = row.readings else { return };
        for (channel, reading) in readings.into_iter().enumerate() {
            self.readings[channel].push(reading);
            self.saturated[channel] += usize::from(row.saturated >> channel & 1 == 1);
        }
        if let Some(wrench) = row.wrench {
            self.wrench.iter_mut().zip(wrench).for_each(|(column, value)| column.push(value));
        }
    }

    pub fn rows(&self) -> usize {
        self.readings[0].len()
    }

    /// Returns the mean readings, counts.
    pub(super) fn means(&self) -> Vec<f64> {
        self.readings.iter().map(|column| RunningVariance::new(column).mean).collect()
    }

    /// Returns the mean wrench of the reference, N and N·m.
    pub(super) fn wrench(&self) -> Option<PerAxis<f64>> {
        let is_measured = !self.wrench[0].is_empty();
        is_measured.then(|| self.wrench.each_ref().map(|column| RunningVariance::new(column).mean))
    }

    /// Returns the scatter of each channel, counts.
    pub(super) fn scatter(&self) -> [f64; CHANNELS] {
        self.readings.each_ref().map(|column| RunningVariance::new(column).rms_about_mean())
    }

    /// Returns the fault that the rows show, compared with the `usual` scatter of each channel and the
    /// `largest` loads.
    pub(super) fn fault(
        &self,
        usual: &[f64; CHANNELS],
        largest: &PerAxis<f64>,
    ) -> Option<SittingFault> {
        let scatter = self.scatter();
        let is_silent = |&channel: &usize| scatter[channel] == 0.0 && usual[channel] > LIVELY;
        let is_saturated =
            |&channel: &usize| self.saturated[channel] as f64 > SATURATED * self.rows() as f64;
        let silent = (0..CHANNELS).find(is_silent).map(SittingFault::Silent);
        let saturated = || (0..CHANNELS).find(is_saturated).map(SittingFault::Saturated);
        silent.or_else(saturated).or_else(|| self.moved(largest))
    }

    fn moved(&self, largest: &PerAxis<f64>) -> Option<SittingFault> {
        let by = |axis: Axis| {
            let (first, second) = self.wrench[axis.index()].split_at(self.rows_of_wrench() / 2);
            let [first, second] = [first, second].map(RunningVariance::new);
            let error = (first.rms_about_mean().powi(2) + second.rms_about_mean().powi(2)).sqrt()
                / (self.rows_of_wrench() as f64 / 2.0).sqrt();
            let by = second.mean - first.mean;
            let least = (MOVED * error).max(LEAST_MOVED * largest[axis.index()]);
            (by.abs() > least).then_some(SittingFault::Reference { axis, by })
        };
        let is_measured = self.rows_of_wrench() >= 4;
        Axis::ALL.into_iter().filter(|_| is_measured).find_map(by)
    }

    fn rows_of_wrench(&self) -> usize {
        self.wrench[0].len()
    }
}

/// Maximum ratio of the movement of the unloaded reference (as a share of the largest load) to that of the sensor's
/// readings (as a share of their largest excursion). A load that is left on both moves them by similar shares.
const EXPLAINED: f64 = 2.0;

/// Returns the movement of the unloaded reference between two times, if the sensor's readings do not explain it.
pub(super) fn moved_unloaded(
    before: &UnloadedValues,
    now: &UnloadedValues,
    largest: &PerAxis<f64>,
) -> Option<SittingFault> {
    let allowed = EXPLAINED.mul_add(now.distance(before), LEAST_MOVED);
    let by = |axis: &Axis| now.wrench[axis.index()] - before.wrench[axis.index()];
    let is_off = |axis: &Axis| by(axis).abs() > allowed * largest[axis.index()];
    let axis = Axis::ALL.into_iter().filter(|axis| largest[axis.index()] > 0.0).find(is_off)?;
    Some(SittingFault::Reference { axis, by: by(&axis) })
}
