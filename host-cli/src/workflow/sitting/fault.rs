//! Faults of a sitting, each reported at the load that shows it.

use std::fmt;

use calibration::quality::significant;
use shell_data::wrench::{Axis, PerAxis};

use super::estimate::Estimate;

/// Maximum difference between a load and the model's prediction, in errors of the prediction.
const FAR: f64 = 5.0;

/// A channel is at fault alone if it has more than this share of the squared residuals of all readings.
const ONE_CHANNEL: f64 = 0.9;

/// A fault of a load. Channels count from 0.
#[derive(Clone, Debug, PartialEq)]
pub enum SittingFault {
    /// The channel has no scatter, but had some at other loads.
    Silent(usize),
    Saturated(usize),
    /// The reading of one channel does not fit this load; the readings of all others do.
    Channel {
        channel: usize,
        /// Its reading, counts.
        reading: f64,
        /// The reading that belongs to the load, counts.
        expected: f64,
    },
    /// The readings do not fit the stated load, and no single channel is at fault.
    Load {
        /// The axis with the largest difference relative to its error.
        axis: Axis,
        /// Load as stated or as measured by the reference.
        stated: f64,
        /// Load by the readings.
        found: f64,
    },
    /// The reference moved while the readings stood still: during a load, or without a load between two loads.
    Reference {
        axis: Axis,
        by: f64,
    },
}

impl SittingFault {
    pub(super) fn of_load(
        before: &Estimate,
        stated: &PerAxis<f64>,
        readings: &[f64],
    ) -> Option<Self> {
        let (found, standard_errors) = before.wrench(readings);
        let excess = |axis: &Axis| {
            let axis = axis.index();
            (found[axis] - stated[axis]).abs() / standard_errors[axis].max(before.error[axis])
        };
        let axis = Axis::ALL.into_iter().max_by(|a, b| excess(a).total_cmp(&excess(b)))?;
        if excess(&axis) <= FAR {
            return None;
        }
        let model = before.calibration.model();
        let x = std::array::from_fn(|axis| stated[axis] / model.wrench_scale[axis]);
        let residuals: Vec<(usize, f64, f64)> = model
            .sensors
            .iter()
            .map(|sensor| {
                let (response, variance) = sensor.response(&x, &model.noise);
                let expected = sensor.range.mul_add(response.value, sensor.least);
                let residual = (readings[sensor.channel] - expected) / sensor.range;
                (sensor.channel, residual * residual / variance, expected)
            })
            .collect();
        let all: f64 = residuals.iter().map(|(_, square, _)| square).sum();
        let worst = residuals.into_iter().max_by(|a, b| a.1.total_cmp(&b.1));
        Some(match worst {
            Some((channel, square, expected)) if square > ONE_CHANNEL * all => {
                Self::Channel { channel, reading: readings[channel], expected }
            }
            _ => Self::Load { axis, stated: stated[axis.index()], found: found[axis.index()] },
        })
    }
}

impl fmt::Display for SittingFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Silent(channel) => write!(f, "s{} does not answer", channel + 1),
            Self::Saturated(channel) => {
                write!(f, "s{} is at an end of the converter", channel + 1)
            }
            Self::Channel { channel, reading, expected } => write!(
                f,
                "s{} reads {reading:.0} where the other channels and the load mean {expected:.0}",
                channel + 1
            ),
            Self::Load { axis, stated, found } => {
                let [stated, found] = [*stated, *found].map(|value| significant(value, 3));
                let (name, unit) = (axis.name(), axis.unit());
                write!(
                    f,
                    "contradicts the other loads: {name} is {stated} {unit}, the readings mean {found} {unit}"
                )
            }
            Self::Reference { axis, by } => {
                let (name, by, unit) = (axis.name(), significant(*by, 2), axis.unit());
                write!(f, "the reference moved by {by} {unit} in {name} and the sensor did not")
            }
        }
    }
}
