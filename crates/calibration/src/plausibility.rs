//! Plausibility of a calibration: the centre lies near the training readings, and forces over their
//! range are finite and physically possible. This finds damaged files and mistyped numbers, not
//! poor fits.

use shell_data::wrench::{Axis, PerAxis};

use crate::conversion::Calibration;
use least_squares::reading_ranges::ReadingRange;

/// Largest plausible force, in N or N·m, unless the training loads imply a larger one.
const LARGEST_FORCE: f64 = 1e15;

/// Largest plausible ratio of a force at a corner of the training range to the largest training
/// load. Channels that move together give coefficients that cancel only near the training data.
const TIMES_LOAD: f64 = 1e12;

/// Largest plausible distance of the centre from the training range, in widths of that range:
/// dropped outliers move the centre.
const WIDTHS: f64 = 1e3;

/// Most channels for which all corners are checked; with more, only corners where at most one channel differs.
const CORNER_CHANNELS: usize = 8;

#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Implausible {
    #[error(
        "the centre of channel {channel} is `{centre:e}`, its training data reached from `{min}` to `{max}`"
    )]
    Centre {
        /// Number of the channel, from 1.
        channel: usize,
        /// Counts.
        centre: f64,
        min: f64,
        max: f64,
    },
    #[error("within the range of its training data `{}` reaches `{force:e}` {}", axis.name(), axis.unit())]
    Force {
        axis: Axis,
        /// N or N·m.
        force: f64,
    },
}

impl Calibration {
    /// Checks centres and forces over the known training range. `largest_load`: magnitude of the
    /// training loads, N or N·m.
    ///
    /// # Errors
    /// The first [`Implausible`].
    pub fn check_plausible(&self, largest_load: Option<f64>) -> Result<(), Implausible> {
        let Some(ranges) = &self.valid_range else { return Ok(()) };
        if let Some(polynomial) = self.polynomial().filter(|it| it.model().intercept) {
            for (at, (&centre, range)) in polynomial.scaling().centre.iter().zip(ranges).enumerate()
            {
                let ReadingRange { min, max } = *range;
                // The width is at least one count.
                let reach = WIDTHS * (max - min).max(1.0);
                if !(min - reach..=max + reach).contains(&centre) {
                    return Err(Implausible::Centre { channel: at + 1, centre, min, max });
                }
            }
        }
        let limit = largest_load.map_or(LARGEST_FORCE, |it| LARGEST_FORCE.max(TIMES_LOAD * it));
        let mut wrench = PerAxis::default();
        self.wrench(&corners(ranges), &mut wrench);
        for axis in self.axes.iter() {
            let is_force = |force: &f64| force.abs() <= limit;
            if let Some(&force) = wrench[axis.index()].iter().find(|force| !is_force(force)) {
                return Err(Implausible::Force { axis, force });
            }
        }
        Ok(())
    }
}

/// Corners of the box of training readings, one column for each channel.
fn corners(ranges: &[ReadingRange]) -> Vec<Vec<f64>> {
    let channels = ranges.len();
    let has_all = channels <= CORNER_CHANNELS;
    let rows = if has_all { 1 << channels } else { 2 * (channels + 1) };
    let is_high = |row: usize, channel: usize| match has_all {
        true => row >> channel & 1 == 1,
        // Each odd row mirrors the even row before it.
        false => (row / 2 == channel) != (row % 2 == 1),
    };
    let column = |(channel, range): (usize, &ReadingRange)| {
        (0..rows).map(|row| if is_high(row, channel) { range.max } else { range.min }).collect()
    };
    ranges.iter().enumerate().map(column).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use least_squares::model::{Basis, Model};
    use least_squares::scaling::Scaling;

    fn calibration(channels: usize, centre: f64, coefficient: f64) -> Calibration {
        let model = Model { basis: Basis::Linear, intercept: true, channels, memory: 0 };
        let scaling = Scaling { centre: vec![centre; channels], scale: vec![512.0; channels] };
        let mut coefficients = vec![[1.0; 6]; channels + 1];
        coefficients[channels][2] = coefficient;
        let mut calibration = Calibration::new(model, scaling, coefficients);
        calibration.valid_range = Some(vec![ReadingRange { min: 100.0, max: 900.0 }; channels]);
        calibration
    }

    #[test]
    fn a_calibration_beyond_belief_is_told_by_what_is_wrong() {
        for channels in [1, 8, 9] {
            let check = |centre, coefficient, load| {
                calibration(channels, centre, coefficient).check_plausible(load)
            };
            assert_eq!(check(500.0, 1e6, Some(1.0)), Ok(()));
            assert!(matches!(
                check(1e300, 1.0, None),
                Err(Implausible::Centre { channel: 1, centre: 1e300, .. })
            ));
            for coefficient in [1e99, f64::NAN, f64::INFINITY] {
                let found = check(500.0, coefficient, Some(1.0));
                assert!(
                    matches!(found, Err(Implausible::Force { axis: Axis::Fz, .. })),
                    "{found:?}"
                );
            }
            // Training loads of 1e50 allow forces of that size.
            assert_eq!(check(500.0, 1e50, Some(1e50)), Ok(()));
        }
    }

    #[test]
    fn corners_are_all_of_few_channels_and_each_once() {
        for channels in 1..=10 {
            let columns = corners(&vec![ReadingRange { min: 0.0, max: 1.0 }; channels]);
            let rows = columns[0].len();
            let row = |at: usize| columns.iter().map(|c| c[at] as u8).collect::<Vec<_>>();
            let all: std::collections::HashSet<_> = (0..rows).map(row).collect();
            assert_eq!(all.len(), rows);
            assert!(all.contains(&vec![0; channels]) && all.contains(&vec![1; channels]));
        }
    }
}
