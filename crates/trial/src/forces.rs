//! The forces of the rows of a trial, by the [force pipeline](forces).

use super::error::TrialError;
use super::input::TrialRows;
use calibration::Calibration;
use forces::{ForceError, ForcePipeline};
use shell_data::wrench::{Axis, PerAxis};

/// The forces of the rows of a trial.
#[derive(Clone, Debug, Default)]
pub(super) struct TrialForces {
    /// Tared and filtered, one value a row, N and N·m; axes that were not asked for are empty.
    pub(super) wrench: PerAxis<Vec<f64>>,
    /// The number of the frame that each row shows.
    pub(super) frame_of_row: Vec<usize>,
    /// Readings of each frame, counts, one column a channel.
    pub(super) frames: Vec<Vec<f64>>,
}

impl TrialForces {
    /// The forces along `axes`.
    pub(super) fn new(
        rows: &TrialRows,
        calibration: &Calibration,
        pipeline: &ForcePipeline,
        axes: &[Axis],
    ) -> Result<Self, TrialError> {
        let (frames, frame_of_row) = frames(rows);
        let mut by_frame = PerAxis::default();
        calibration.wrench(&frames, &mut by_frame);
        let mut wrench = PerAxis::<Vec<f64>>::default();
        for axis in axes.iter().map(|axis| axis.index()) {
            wrench[axis] = frame_of_row.iter().map(|&frame| by_frame[axis][frame]).collect();
        }
        pipeline.tare_off(&rows.times_s, &mut wrench);
        let mut stream = pipeline.stream(axes);
        let mut wrench = stream.push(&rows.times_s, wrench).map_err(ForceError::from)?;
        let rest = stream.finish().map_err(ForceError::from)?;
        wrench.iter_mut().zip(rest).for_each(|(wrench, rest)| wrench.extend(rest));
        Ok(Self { wrench, frame_of_row, frames })
    }
}

/// Each frame once: its readings, and for every row the number of its frame.
fn frames(rows: &TrialRows) -> (Vec<Vec<f64>>, Vec<usize>) {
    let is_new = |row: usize| row == 0 || rows.fresh[row];
    let new_rows: Vec<usize> = (0..rows.times_s.len()).filter(|&row| is_new(row)).collect();
    let pick = |column: &Vec<f64>| new_rows.iter().map(|&row| column[row]).collect();
    let mut frame = 0;
    let frame_of_row = (0..rows.times_s.len()).map(|row| {
        frame += usize::from(is_new(row));
        frame - 1
    });
    let frame_of_row = frame_of_row.collect();
    (rows.readings.iter().map(pick).collect(), frame_of_row)
}
