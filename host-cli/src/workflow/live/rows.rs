//! Frames as rows to show, with forces where there is a calibration.

use board_link::recording::{
    BoardFrame, LiveForces, Measured, RunningForces, UnsuitableCalibration,
};
use forces::ForceError;
use live_view::LiveRow;

/// Turns frames into rows, by the [pipeline](forces) of all commands that show forces.
#[derive(Clone, Debug)]
pub struct LiveRows {
    forces: Option<RunningForces>,
}

impl LiveRows {
    /// With forces, if there is a calibration.
    ///
    /// # Errors
    /// [`UnsuitableCalibration`] if it is for another number of channels.
    pub fn new(forces: Option<LiveForces>) -> Result<Self, UnsuitableCalibration> {
        Ok(Self { forces: forces.map(RunningForces::new).transpose()? })
    }

    /// The rows of some frames. A board that converts itself needs no calibration.
    ///
    /// # Errors
    /// [`ForceError`] if the low-pass that was asked for is impossible at the rate of the frames.
    pub fn of(&mut self, frames: &[BoardFrame]) -> Result<Vec<LiveRow>, ForceError> {
        let has_readings = |frame: &BoardFrame| matches!(frame.measured, Measured::Readings(_));
        let mut rows: Vec<LiveRow> = frames.iter().map(row).collect();
        if let Some(running) = &mut self.forces
            && !frames.is_empty()
            && frames.iter().all(has_readings)
        {
            for (row, force) in rows.iter_mut().zip(running.of(frames)?) {
                row.wrench = Some(force.wrench);
                row.out_of_range = force.out_of_range as u8;
            }
        }
        Ok(rows)
    }
}

fn row(frame: &BoardFrame) -> LiveRow {
    let (readings, wrench) = match frame.measured {
        Measured::Readings(readings) => (Some(readings), None),
        Measured::Wrench(wrench) => (None, Some(wrench)),
    };
    LiveRow {
        time_s: frame.time_us as f64 / 1e6,
        index: frame.index,
        readings,
        wrench,
        saturated: frame.saturated,
        out_of_range: 0,
    }
}
