//! Commands of the host, and answers of the board.
//!
//! Every command carries a number that the host chooses, and the answer repeats it. A lost command can be
//! sent again, because every command is idempotent.

use crate::CHANNELS;
use crate::board::{Identity, Status, Stream};
use crate::field::{Bytes, Reader, coded};

/// Maximum number of bytes of a calibration in one command, or of last words in one answer.
pub const MAX_PIECE: usize = 32;

/// A piece of a calibration, or of last words.
pub type Piece = Bytes<MAX_PIECE>;

coded! {
    /// A request to the board. An unknown code or invalid arguments are read as [`Command::Unknown`].
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    #[non_exhaustive]
    #[expect(missing_docs, reason = "a variant says what its fields are")]
    pub enum Command {
        /// Requests the identity: [`Answer::Identity`].
        Identify = 0x01,
        /// Requests the state: [`Answer::Status`].
        Status = 0x02,
        /// Starts streaming.
        Start = 0x03,
        /// Stops streaming.
        Stop = 0x04,
        /// Sets the period of frames in µs.
        SetPeriod { period_us: u32 } = 0x05,
        /// Sets the number of conversions, from 1, that are averaged for each lit and each dark value.
        SetOversampling { conversions: u8 } = 0x06,
        /// Sets the waiting time in µs between switching an emitter and converting.
        SetSettling { settling_us: u16 } = 0x07,
        /// Selects readings or wrenches for the stream.
        SetStream(stream: Stream) = 0x08,
        /// Begins the upload of a calibration of `size` bytes; see [`crate::crc32`].
        BeginCalibration { size: u32, crc32: u32 } = 0x09,
        /// Transfers a piece of the calibration at an offset.
        CalibrationPiece { offset: u16, data: Piece } = 0x0A,
        /// Completes the calibration: the board checks, stores and uses it.
        CommitCalibration = 0x0B,
        /// Takes the mean wrench of the next `frames` frames as zero; 0 removes the zero.
        Zero { frames: u16 } = 0x0C,
        /// Requests the words said before the last reset, from a byte offset on: [`Answer::LastWords`].
        LastWords { offset: u16 } = 0x0D,
        /// Lights one emitter, counted from 0, and requests its effect on every channel:
        /// [`Answer::SelfTest`].
        SelfTest { emitter: u8 } = 0x10,
        /// Sets the serial line to a nominal rate in baud after the answer. The board returns to the previous
        /// rate if it hears nothing valid at the new one.
        SetBaud { baud: u32 } = 0x11,
        /// Starts the chip's bootloader after the answer.
        Bootloader = 0x12,
        _ = Unknown,
    }
}

impl Command {
    /// Returns whether the command may be sent to all boards in range: queries, and starting or stopping all
    /// streams. Every other command must name its board.
    pub const fn is_for_all(&self) -> bool {
        matches!(
            self,
            Self::Identify | Self::Status | Self::Start | Self::Stop | Self::LastWords { .. }
        )
    }

    /// Reads a command; `None` if there is no code.
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
        /// Answers [`Command::Identify`].
        Identity(identity: Identity) = 0x01,
        /// Answers [`Command::Status`].
        Status(status: Status) = 0x02,
        /// Refused; the state is unchanged.
        Refused(refusal: Refusal) = 0x03,
        /// Answers [`Command::LastWords`]: the length of the whole text in bytes, 0 if there is none, and its
        /// bytes from the offset on; no bytes at the end.
        LastWords { len: u16, text: Piece } = 0x04,
        /// Answers [`Command::SelfTest`]: the rise of each channel under the emitter, in steps of the
        /// converter.
        SelfTest { emitter: u8, rise: [i16; CHANNELS] } = 0x06,
        _ = Other,
    }
}

impl Answer {
    pub(crate) fn read_all(mut body: Reader<'_>) -> Option<Self> {
        match body.get()? {
            // A newer board may append bytes to a refusal, and may send unknown answers; the additional bytes
            // are ignored.
            answer @ (Self::Refused(_) | Self::Other(_)) => Some(answer),
            answer => body.end(answer),
        }
    }
}

coded! {
    /// Why the board refuses a command.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    #[non_exhaustive]
    #[expect(missing_docs, reason = "a variant says what its fields are")]
    pub enum Refusal {
        /// The board does not know the command, or not with these arguments.
        UnknownCommand = 1,
        /// The board speaks another version of the protocol, which is in the answer's header.
        OtherVersion = 2,
        /// An argument is outside its range.
        OutOfRange = 3,
        /// Conversions and settling of a frame would take longer than the period; `shortest_us` is the
        /// shortest possible.
        PeriodTooShort { shortest_us: u32 } = 4,
        /// Wrenches need a calibration, and the board has none.
        NoCalibration = 5,
        /// A piece or a commit without a begin.
        NoUpload = 6,
        /// The piece does not continue the previous one.
        WrongOffset = 7,
        /// The length is not that of a calibration, or differs from the announced one.
        WrongSize = 8,
        /// The CRC-32 of the calibration differs from the announced one.
        WrongCrc = 9,
        /// The calibration arrived complete but the board cannot use it.
        BadCalibration = 10,
        /// The flash failed to store the calibration; the previous one is still in use.
        StorageFailed = 11,
        /// Samples would exceed the capacity of the serial line; `shortest_us` is the shortest possible
        /// period.
        LineTooSlow { shortest_us: u32 } = 12,
        /// Not possible while streaming.
        Streaming = 16,
        /// The board lacks the hardware for it.
        NotOnThisBoard = 17,
        _ = Other,
    }
}
