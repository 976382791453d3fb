//! Frames as rows, with forces where there is a calibration.

use board_link::RecordError;
use board_link::recording::{
    BoardFrame, LiveForces, Measured, RunningForces, Simultaneous, UnsuitableCalibration, row_flags,
};
use forces::RunningTare;
use shared_proto::CHANNELS;
use shell_data::wrench::{Axes, PerAxis};

/// A frame as it is passed on.
#[derive(Clone, Debug, PartialEq)]
pub struct StreamRow {
    /// On the board's clock, µs, as in a log.
    pub time_us: i64,
    /// The sequence number, unwrapped.
    pub index: i64,
    /// When it arrived, µs since 1970 by the clock of this computer.
    pub host_us: i64,
    /// Steps of the 12-bit converter.
    pub readings: Option<[f64; CHANNELS]>,
    /// N and N·m.
    pub wrench: Option<PerAxis<f64>>,
    /// Of the wrench, where the calibration knows them.
    pub standard_errors: Option<PerAxis<f64>>,
    /// As in a log, and `tared`, `markN`.
    pub flags: String,
}

/// Turns frames into rows.
#[derive(Clone, Debug)]
pub(crate) struct FrameRows {
    simultaneous: Option<Simultaneous>,
    forces: Option<RunningForces>,
    /// The axes of the wrenches.
    pub(crate) axes: Axes,
    /// Taken off the wrenches; the first row with a new one has the flag `tared`.
    pub(crate) tare: RunningTare,
    last_index: Option<i64>,
    /// Marks so far, and how many of them are to be set.
    marks: (u32, u32),
}

impl FrameRows {
    /// Nothing has come yet; see [`StreamOptions`](crate::StreamOptions).
    ///
    /// # Errors
    /// [`UnsuitableCalibration`] if it is for another number of channels.
    pub(crate) fn new(
        forces: Option<LiveForces>,
        from_log: bool,
        one_time: bool,
    ) -> Result<Self, UnsuitableCalibration> {
        let forces = forces.map(RunningForces::new).transpose()?;
        let simultaneous = match (from_log, one_time) {
            (true, _) => None,
            (false, true) => Some(Simultaneous::new(false)),
            (false, false) => Some(Simultaneous::immediate()),
        };
        let axes = forces.as_ref().map_or(Axes::ALL, RunningForces::axes);
        let tare = RunningTare::default();
        Ok(Self { simultaneous, forces, axes, tare, last_index: None, marks: (0, 0) })
    }

    /// Flags the next row with a mark; its number, from 1.
    pub(crate) fn mark(&mut self) -> u32 {
        self.marks = (self.marks.0 + 1, self.marks.1 + 1);
        self.marks.0
    }

    /// The rows of frames that arrive at `host_us`. With channels brought to one time they are those of
    /// earlier frames.
    ///
    /// # Errors
    /// [`RecordError`].
    pub(crate) fn of(
        &mut self,
        frames: &[BoardFrame],
        host_us: i64,
    ) -> Result<Vec<StreamRow>, RecordError> {
        let frames = match &mut self.simultaneous {
            Some(simultaneous) => simultaneous.take(frames.iter().cloned(), false),
            None => frames.to_vec(),
        };
        if frames.is_empty() {
            return Ok(Vec::new());
        }
        let has_readings = |frame: &BoardFrame| matches!(frame.measured, Measured::Readings(_));
        if self.forces.is_some() && !frames.iter().all(has_readings) {
            return Err(UnsuitableCalibration::Wrenches.into());
        }
        let forces = self.forces.as_mut().map(|forces| forces.of(&frames)).transpose()?;
        let errors = self.forces.as_ref().and_then(|forces| forces.standard_errors(&frames));
        let mut rows = Vec::with_capacity(frames.len());
        for (at, frame) in frames.iter().enumerate() {
            let force = forces.as_ref().map(|forces| &forces[at]);
            let is_late = self.last_index.is_some_and(|last| frame.index < last);
            self.last_index = self.last_index.max(Some(frame.index));
            let mut flags = row_flags(frame, force, is_late);
            let (readings, own) = match frame.measured {
                Measured::Readings(readings) => (Some(readings), None),
                Measured::Wrench(wrench) => (None, Some(wrench)),
            };
            let wrench = force.map(|force| force.wrench).or(own);
            let wrench = wrench.map(|wrench| self.tared(wrench, &mut flags));
            let (last, waiting) = self.marks;
            flags.extend((last - waiting + 1..=last).map(|number| format!("mark{number}")));
            self.marks.1 = 0;
            rows.push(StreamRow {
                time_us: frame.time_us,
                index: frame.index,
                host_us,
                readings,
                wrench,
                standard_errors: errors.as_ref().map(|errors| errors.each_ref().map(|it| it[at])),
                flags: flags.join(" "),
            });
        }
        Ok(rows)
    }

    /// A wrench without the zero that was asked for. Nothing is subtracted, to the bit, where none was.
    fn tared(&mut self, wrench: PerAxis<f64>, flags: &mut Vec<String>) -> PerAxis<f64> {
        if self.tare.push(wrench) {
            flags.push("tared".to_owned());
        }
        let zero = self.tare.zero;
        std::array::from_fn(|axis| wrench[axis] - zero[axis])
    }
}
