//! What the host asks of the board, and what the board answers.
//!
//! Every command carries a number of the host's choosing and the answer repeats it, so that a
//! command that was lost can be sent again: doing any of them twice is the same as doing it once.

use crate::CHANNELS;
use crate::board::{Identity, Status, Stream};
use crate::field::{Bytes, Reader, coded};

/// Most bytes of a calibration in one command, or of last words in one answer.
pub const MAX_PIECE: usize = 32;

/// Some bytes of a calibration, or of last words.
pub type Piece = Bytes<MAX_PIECE>;

coded! {
    /// A request to the board. One that is not known, or whose arguments are not its own, is read as
    /// [`Command::Unknown`].
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    #[non_exhaustive]
    #[expect(missing_docs, reason = "a variant says what its fields are")]
    pub enum Command {
        /// Say what you are: [`Answer::Identity`].
        Identify = 0x01,
        /// Say how you do: [`Answer::Status`].
        Status = 0x02,
        /// Start streaming.
        Start = 0x03,
        /// Stop streaming.
        Stop = 0x04,
        /// Take a frame every so many µs.
        SetPeriod { period_us: u32 } = 0x05,
        /// Average so many conversions, from 1, for each lit and each dark value.
        SetOversampling { conversions: u8 } = 0x06,
        /// Wait so long, µs, after an emitter is switched before converting.
        SetSettling { settling_us: u16 } = 0x07,
        /// Stream readings or wrenches.
        SetStream(stream: Stream) = 0x08,
        /// A calibration of so many bytes is going to be uploaded; see [`crate::crc32`].
        BeginCalibration { size: u32, crc32: u32 } = 0x09,
        /// Some bytes of the calibration, which belong to an offset.
        CalibrationPiece { offset: u16, data: Piece } = 0x0A,
        /// The calibration is complete: check it, keep it, use it.
        CommitCalibration = 0x0B,
        /// Take the mean wrench of so many next frames as zero; none takes the zero back.
        Zero { frames: u16 } = 0x0C,
        /// Say what you said before the last reset, from a byte on: [`Answer::LastWords`].
        LastWords { offset: u16 } = 0x0D,
        /// Light one emitter, counted from 0, and say what every channel sees of it: [`Answer::SelfTest`].
        SelfTest { emitter: u8 } = 0x10,
        /// Set the serial line to the rate that is called so, in baud, once this is answered; back to the rate of
        /// before if nothing valid is heard at the new one.
        SetBaud { baud: u32 } = 0x11,
        /// Start the chip's own bootloader once this is answered.
        Bootloader = 0x12,
        _ = Unknown,
    }
}

impl Command {
    /// Whether the command may be sent to every board that hears it: it asks, or it starts and stops
    /// streams together. Anything else is done by the board that it names only.
    pub const fn is_for_all(&self) -> bool {
        matches!(
            self,
            Self::Identify | Self::Status | Self::Start | Self::Stop | Self::LastWords { .. }
        )
    }

    /// `None` if there is not even a code.
    pub(crate) fn read_all(mut body: Reader<'_>) -> Option<Self> {
        let code = *body.0.first()?;
        let command = body.get().and_then(|command| body.end(command));
        Some(command.unwrap_or(Self::Unknown(code)))
    }
}

coded! {
    /// What the board has to say to a command.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    #[non_exhaustive]
    #[expect(missing_docs, reason = "a variant says what its fields are")]
    pub enum Answer {
        /// Done, or begun.
        Done = 0x00,
        /// To [`Command::Identify`].
        Identity(identity: Identity) = 0x01,
        /// To [`Command::Status`].
        Status(status: Status) = 0x02,
        /// Not done; nothing has changed.
        Refused(refusal: Refusal) = 0x03,
        /// To [`Command::LastWords`]: the length of the whole text in bytes, 0 if nothing was said, and its bytes from the
        /// offset on; none at the end.
        LastWords { len: u16, text: Piece } = 0x04,
        /// To [`Command::SelfTest`]: by how much the emitter raises each channel, in steps of the converter.
        SelfTest { emitter: u8, rise: [i16; CHANNELS] } = 0x06,
        _ = Other,
    }
}

impl Answer {
    pub(crate) fn read_all(mut body: Reader<'_>) -> Option<Self> {
        match body.get()? {
            // A newer board may add bytes to a reason, and send answers that are not known: what follows is ignored.
            answer @ (Self::Refused(_) | Self::Other(_)) => Some(answer),
            answer => body.end(answer),
        }
    }
}

coded! {
    /// Why the board does not do what it was asked.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    #[non_exhaustive]
    #[expect(missing_docs, reason = "a variant says what its fields are")]
    pub enum Refusal {
        /// The board does not know the command, or not with these arguments.
        UnknownCommand = 1,
        /// The board speaks another version of the protocol: that of the answer's own header.
        OtherVersion = 2,
        /// An argument is outside its range.
        OutOfRange = 3,
        /// Conversions and settling of a frame would take longer than the period; the shortest that would do.
        PeriodTooShort { shortest_us: u32 } = 4,
        /// Wrenches need a calibration, and there is none.
        NoCalibration = 5,
        /// A piece or a commit of a calibration that was not begun.
        NoUpload = 6,
        /// The piece does not follow on the one before.
        WrongOffset = 7,
        /// The calibration has not the length of one, or not the one announced.
        WrongSize = 8,
        /// The CRC-32 of the calibration is not the one announced.
        WrongCrc = 9,
        /// The calibration arrived whole but is not one that this board can use.
        BadCalibration = 10,
        /// The flash did not keep the calibration; the one before is still in use.
        StorageFailed = 11,
        /// Samples would come faster than the serial line takes them; the shortest period that would do.
        LineTooSlow { shortest_us: u32 } = 12,
        /// Not while it streams.
        Streaming = 16,
        /// This board has nothing that could do it.
        NotOnThisBoard = 17,
        _ = Other,
    }
}
