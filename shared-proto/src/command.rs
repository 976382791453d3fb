//! Commands of the host, and answers of the board.
//!
//! The host chooses the number of a command, and the answer repeats it. Every command is
//! idempotent, so a lost one can be sent again.

use crate::CHANNELS;
use crate::board::{Identity, Status, Stream};
use crate::field::{Bytes, Reader, coded};

/// Maximum length of a piece of a calibration or of last words.
pub const MAX_PIECE: usize = 32;

/// A piece of a calibration, or of last words.
pub type Piece = Bytes<MAX_PIECE>;

coded! {
    /// A request to the board. An unknown code or invalid arguments become [`Command::Unknown`].
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    #[non_exhaustive]
    #[expect(missing_docs, reason = "a variant says what its fields are")]
    pub enum Command {
        /// Requests the identity: [`Answer::Identity`].
        Identify = 0x01,
        /// Requests the state: [`Answer::Status`].
        Status = 0x02,
        Start = 0x03,
        Stop = 0x04,
        /// Sets the period of frames, µs.
        SetPeriod { period_us: u32 } = 0x05,
        /// Sets the number of conversions, from 1, averaged for each lit and each dark value.
        SetOversampling { conversions: u8 } = 0x06,
        /// Sets the waiting time between switching an emitter and converting, µs.
        SetSettling { settling_us: u16 } = 0x07,
        SetStream(stream: Stream) = 0x08,
        /// Begins the upload of a calibration; see [`crate::crc32`].
        BeginCalibration { size: u32, crc32: u32 } = 0x09,
        CalibrationPiece { offset: u16, data: Piece } = 0x0A,
        /// Completes the calibration: the board checks, stores and uses it.
        CommitCalibration = 0x0B,
        /// Takes the mean wrench of the next frames as zero; 0 removes the zero.
        Zero { frames: u16 } = 0x0C,
        /// Requests the firmware's last words before the reset, from byte `offset` on: [`Answer::LastWords`].
        LastWords { offset: u16 } = 0x0D,
        /// Lights one emitter, from 0, and requests its effect on channels: [`Answer::SelfTest`].
        SelfTest { emitter: u8 } = 0x10,
        /// Sets a nominal baud rate after the answer; reverts it if nothing valid is heard.
        SetBaud { baud: u32 } = 0x11,
        /// Starts the chip's bootloader after the answer.
        Bootloader = 0x12,
        _ = Unknown,
    }
}

impl Command {
    /// Returns true for commands to all boards in range: queries, and starting or stopping streams.
    pub const fn is_for_all(&self) -> bool {
        matches!(
            self,
            Self::Identify | Self::Status | Self::Start | Self::Stop | Self::LastWords { .. }
        )
    }

    pub(crate) fn read_all(mut body: Reader<'_>) -> Option<Self> {
        let code = *body.0.first()?;
        let command = body.get().and_then(|command| body.end(command));
        Some(command.unwrap_or(Self::Unknown(code)))
    }
}

coded! {
    /// The board's answer to a command.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    #[non_exhaustive]
    #[expect(missing_docs, reason = "a variant says what its fields are")]
    pub enum Answer {
        /// Done, or begun.
        Done = 0x00,
        Identity(identity: Identity) = 0x01,
        Status(status: Status) = 0x02,
        /// Refused; the state is unchanged.
        Refused(refusal: Refusal) = 0x03,
        /// Length of the whole text, perhaps 0, and its bytes from the offset on; none at the end.
        LastWords { len: u16, text: Piece } = 0x04,
        /// Rise of each channel under the emitter, in converter steps.
        SelfTest { emitter: u8, rise: [i16; CHANNELS] } = 0x06,
        _ = Other,
    }
}

impl Answer {
    pub(crate) fn read_all(mut body: Reader<'_>) -> Option<Self> {
        match body.get()? {
            // A newer board may append bytes to a refusal, and send unknown answers.
            answer @ (Self::Refused(_) | Self::Other(_)) => Some(answer),
            answer => body.end(answer),
        }
    }
}

coded! {
    /// The reason of a refusal.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    #[non_exhaustive]
    #[expect(missing_docs, reason = "a variant says what its fields are")]
    pub enum Refusal {
        /// The board does not know the command, or not with these arguments.
        UnknownCommand = 1,
        /// The board's version of the protocol is in the answer's header.
        OtherVersion = 2,
        OutOfRange = 3,
        /// Conversions and settling take longer than the period; `shortest_us` would do.
        PeriodTooShort { shortest_us: u32 } = 4,
        /// Wrenches need a calibration, and the board has none.
        NoCalibration = 5,
        /// A piece or a commit without a begin.
        NoUpload = 6,
        WrongOffset = 7,
        /// The length is not that of a calibration, or not the announced one.
        WrongSize = 8,
        WrongCrc = 9,
        /// The calibration is complete but unusable.
        BadCalibration = 10,
        /// The flash failed; the previous calibration is still in use.
        StorageFailed = 11,
        /// Samples exceed the capacity of the line; `shortest_us` is the shortest possible period.
        LineTooSlow { shortest_us: u32 } = 12,
        Streaming = 16,
        NotOnThisBoard = 17,
        _ = Other,
    }
}
