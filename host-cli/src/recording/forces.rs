//! Forces beside the readings, with a zero of their own.

use super::reception::{Frame, Measured};
use calibration::Calibration;
use shared_proto::CHANNELS;
use shell_data::wrench::PerAxis;

/// How forces are made of readings.
#[derive(Clone, Debug)]
pub struct ForceOptions {
    /// The model.
    pub calibration: Calibration,
    /// The mean wrench of so many frames, the first of the recording, is subtracted from all after
    /// them; 0 keeps the zero of the calibration.
    pub tare: usize,
}

/// Wrenches of frames as they come.
#[derive(Clone, Debug)]
pub(super) struct Forces {
    options: ForceOptions,
    /// Frames that are in the mean.
    taken: usize,
    mean: PerAxis<f64>,
    newest: Option<PerAxis<f64>>,
}

/// What a frame gives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Force {
    /// Wrench in N and N·m.
    pub(super) wrench: PerAxis<f64>,
    /// Bit i is set if channel i was outside the calibrated range.
    pub(super) out_of_range: u64,
    /// The zero was not known yet.
    pub(super) untared: bool,
}

impl Forces {
    pub(super) fn new(options: ForceOptions) -> Self {
        Self { options, taken: 0, mean: PerAxis::default(), newest: None }
    }

    /// Forces of frames that hold readings.
    pub(super) fn of(&mut self, frames: &[Frame]) -> Vec<Force> {
        let column = |channel: usize| {
            let reading = |frame: &Frame| match &frame.measured {
                Measured::Readings(readings) => readings[channel],
                Measured::Wrench(_) => f64::NAN,
            };
            frames.iter().map(reading).collect()
        };
        let readings: Vec<Vec<f64>> = (0..CHANNELS).map(column).collect();
        let mut wrenches = PerAxis::default();
        self.options.calibration.wrench(&readings, &mut wrenches);
        let out_of_range = self.options.calibration.out_of_range(&readings);
        let rows = out_of_range.into_iter().enumerate();
        let forces = rows.map(|(row, out_of_range)| {
            let wrench = wrenches.each_ref().map(|axis| axis[row]);
            let (wrench, untared) = self.tare(wrench);
            Force { wrench, out_of_range, untared }
        });
        let forces: Vec<Force> = forces.collect();
        self.newest = forces.last().map(|force| force.wrench).or(self.newest);
        forces
    }

    /// The wrench of the newest frame.
    pub(super) fn newest(&self) -> Option<PerAxis<f64>> {
        self.newest
    }

    /// The wrench from zero, and whether that was not known yet. A frame of those that make the
    /// zero goes into the mean.
    fn tare(&mut self, wrench: PerAxis<f64>) -> (PerAxis<f64>, bool) {
        if self.taken < self.options.tare {
            self.taken += 1;
            for (mean, value) in self.mean.iter_mut().zip(wrench) {
                *mean += (value - *mean) / self.taken as f64;
            }
            return (wrench, true);
        }
        (std::array::from_fn(|axis| wrench[axis] - self.mean[axis]), false)
    }
}
