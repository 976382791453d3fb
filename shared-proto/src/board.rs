//! A board: its identity, stream and status.

use crate::calibration::crc32;
use crate::field::{Bytes, Field, Reader, coded, fields};

coded! {
    /// The hardware that the firmware runs on.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    #[non_exhaustive]
    pub enum Board {
        /// STM32L432KC.
        SkinProc = 1,
        /// A process on the host.
        Simulated = 3,
        /// The Nucleo-G491RE: STM32G491RE.
        NucleoG491re = 4,
        _ = Other,
    }
}

coded! {
    /// Content of the stream's samples.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
    pub enum Stream {
        /// Readings.
        #[default]
        Raw = 0,
        /// Wrenches, converted on the board.
        Wrench = 1,
        _ = Other,
    }
}

coded! {
    /// The cause of the board's last start.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
    #[non_exhaustive]
    pub enum ResetCause {
        /// Power was switched on, or the voltage dropped too low.
        Power = 1,
        /// The reset line, or a debugger.
        Pin = 2,
        /// The firmware panicked.
        Panic = 3,
        /// The watchdog was not fed.
        Watchdog = 4,
        /// The board cannot tell the cause.
        #[default]
        Unspecified = 5,
        /// The core met an instruction or access that it cannot execute.
        Fault = 6,
        _ = Other,
    }
}

/// A board's name in commands: the CRC-32 of its serial number. Two given boards share a name with
/// a probability of one in four thousand million.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct BoardId(u32);

impl BoardId {
    /// Returns the name of the board with this serial number.
    pub fn from_serial(serial: &[u8; 12]) -> Self {
        Self(crc32(serial).max(1)) // 0 stands for every board
    }

    /// Returns the name in the board's own packets: the lower half.
    pub const fn short(self) -> u16 {
        self.0 as u16
    }

    pub(crate) fn code(id: Option<Self>) -> u32 {
        id.map_or(0, |id| id.0)
    }

    pub(crate) fn from_code(code: u32) -> Option<Self> {
        (code != 0).then_some(Self(code))
    }
}

/// Identity of a board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Identity {
    /// The hardware that the firmware runs on.
    pub board: Board,
    /// Version of the firmware: major, minor, patch.
    pub firmware: [u8; 3],
    /// Serial number of the chip.
    pub serial: [u8; 12],
    /// Shortest period that the board accepts, in µs.
    pub min_period_us: u32,
}

impl Identity {
    /// Returns the board's name in commands.
    pub fn id(&self) -> BoardId {
        BoardId::from_serial(&self.serial)
    }
}

fields!(Identity { board, firmware, serial, min_period_us });

/// State of a board. Counts are since the last reset and wrap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Status {
    /// True if the board streams.
    pub streaming: bool,
    /// True if the board has a calibration.
    pub calibrated: bool,
    /// True if the wrench has a zero.
    pub zeroed: bool,
    /// Content of the stream.
    pub stream: Stream,
    /// Why the board last started.
    pub reset_cause: ResetCause,
    /// Time between frames in µs.
    pub period_us: u32,
    /// Conversions averaged for each lit and each dark value.
    pub conversions: u8,
    /// Time from switching an emitter to converting, µs.
    pub settling_us: u16,
    /// Time since the reset in s.
    pub uptime_s: u32,
    /// Frames taken.
    pub frames: u32,
    /// Frames not taken because they were due too long ago.
    pub late: u32,
    /// Frames taken but dropped because the link was not drained.
    pub overflowed: u32,
    /// Frames that arrived damaged at the board.
    pub damaged: u16,
    /// Longest duration of a frame in µs; saturates.
    pub longest_frame_us: u16,
    /// CRC-32 of the calibration in use, zero without one.
    pub calibration_crc32: u32,
    /// Commands addressed to another board.
    pub foreign: u16,
}

impl Field for Status {
    fn write<const N: usize>(&self, out: &mut Bytes<N>) {
        let flags = u8::from(self.streaming)
            | u8::from(self.calibrated) << 1
            | u8::from(self.zeroed) << 2
            | self.stream.code() << 3;
        out.push(flags);
        self.reset_cause.write(out);
        self.period_us.write(out);
        self.conversions.write(out);
        self.settling_us.write(out);
        [self.uptime_s, self.frames, self.late, self.overflowed].write(out);
        [self.damaged, self.longest_frame_us].write(out);
        self.calibration_crc32.write(out);
        self.foreign.write(out);
    }

    fn read(body: &mut Reader<'_>) -> Option<Self> {
        let flags: u8 = body.get()?;
        Some(Self {
            streaming: flags & 1 != 0,
            calibrated: flags & 2 != 0,
            zeroed: flags & 4 != 0,
            stream: Stream::from_code(flags >> 3)?,
            reset_cause: body.get()?,
            period_us: body.get()?,
            conversions: body.get()?,
            settling_us: body.get()?,
            uptime_s: body.get()?,
            frames: body.get()?,
            late: body.get()?,
            overflowed: body.get()?,
            damaged: body.get()?,
            longest_frame_us: body.get()?,
            calibration_crc32: body.get()?,
            foreign: body.get()?,
        })
    }
}
