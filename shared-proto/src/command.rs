//! What the host asks of the board, and what the board answers.
//!
//! Every command carries a number of the host's choosing and the answer repeats it, so that a
//! command that was lost can be sent again: doing any of them twice is the same as doing it once.

use crate::CHANNELS;
use crate::board::{Identity, Status, Stream};
use crate::bytes::Bytes;
use crate::field::{Reader, variants};

/// Most bytes of a calibration in one command, or of last words in one answer.
pub const MAX_PIECE: usize = 32;

/// Some bytes of a calibration, or of last words.
pub type Piece = Bytes<MAX_PIECE>;

/// A request to the board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Command {
    /// Say what you are: [`Answer::Identity`].
    Identify,
    /// Say how you do: [`Answer::Status`].
    Status,
    /// Start streaming.
    Start,
    /// Stop streaming.
    Stop,
    /// Take a frame every so many µs.
    SetPeriod {
        /// Time from frame to frame in µs.
        period_us: u32,
    },
    /// Average so many conversions for each lit and each dark value.
    SetOversampling {
        /// Number of conversions, from 1.
        conversions: u8,
    },
    /// Wait so long after an emitter is switched before converting.
    SetSettling {
        /// Time in µs.
        settling_us: u16,
    },
    /// Stream readings or wrenches.
    SetStream(Stream),
    /// A calibration is going to be uploaded.
    BeginCalibration {
        /// Its length in bytes.
        size: u32,
        /// CRC-32 of all its bytes, see [`crate::crc32`].
        crc32: u32,
    },
    /// Some bytes of the calibration.
    CalibrationPiece {
        /// Where they belong.
        offset: u16,
        /// The bytes.
        data: Piece,
    },
    /// The calibration is complete: check it, keep it, use it.
    CommitCalibration,
    /// Take the mean wrench of the next frames as zero.
    Zero {
        /// How many frames to average; none takes the zero back.
        frames: u16,
    },
    /// Say what you said before the last reset, from a byte on: [`Answer::LastWords`].
    LastWords {
        /// The first byte wanted.
        offset: u16,
    },
    /// Light one emitter and say what every channel sees of it: [`Answer::SelfTest`].
    SelfTest {
        /// The emitter, from 0.
        emitter: u8,
    },
    /// Set the serial line to another rate once this is answered; back to the rate of before if nothing
    /// valid is heard at the new one.
    SetBaud {
        /// What the rate is called, in baud.
        baud: u32,
    },
    /// Start the chip's own bootloader once this is answered.
    Bootloader,
    /// A command that this version does not know, or one with arguments that are not its own.
    Unknown {
        /// The code that names it.
        code: u8,
    },
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
        Some(command.unwrap_or(Self::Unknown { code }))
    }
}

variants!(Command {
    0x01 = Identify,
    0x02 = Status,
    0x03 = Start,
    0x04 = Stop,
    0x05 = SetPeriod { period_us },
    0x06 = SetOversampling { conversions },
    0x07 = SetSettling { settling_us },
    0x08 = SetStream(stream),
    0x09 = BeginCalibration { size, crc32 },
    0x0A = CalibrationPiece { offset, data },
    0x0B = CommitCalibration,
    0x0C = Zero { frames },
    0x0D = LastWords { offset },
    0x10 = SelfTest { emitter },
    0x11 = SetBaud { baud },
    0x12 = Bootloader,
    _ = Unknown { code }
});

/// What the board has to say to a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Answer {
    /// Done, or begun.
    Done,
    /// To [`Command::Identify`].
    Identity(Identity),
    /// To [`Command::Status`].
    Status(Status),
    /// Not done; nothing has changed.
    Refused(Refusal),
    /// To [`Command::LastWords`].
    LastWords {
        /// Length of the whole text in bytes, 0 if nothing was said.
        len: u16,
        /// Its bytes from the offset on; none at the end.
        text: Piece,
    },
    /// To [`Command::SelfTest`].
    SelfTest {
        /// The emitter.
        emitter: u8,
        /// By how much it raises each channel, in steps of the converter.
        rise: [i16; CHANNELS],
    },
    /// One that this version does not know.
    Other {
        /// The code that names it.
        code: u8,
    },
}

impl Answer {
    pub(crate) fn read_all(mut body: Reader<'_>) -> Option<Self> {
        match body.get()? {
            // A newer board may add bytes to a reason, and send answers that are not known: what follows is ignored.
            answer @ (Self::Refused(_) | Self::Other { .. }) => Some(answer),
            answer => body.end(answer),
        }
    }
}

variants!(Answer {
    0x00 = Done,
    0x01 = Identity(identity),
    0x02 = Status(status),
    0x03 = Refused(refusal),
    0x04 = LastWords { len, text },
    0x06 = SelfTest { emitter, rise },
    _ = Other { code }
});

/// Why the board does not do what it was asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Refusal {
    /// The board does not know the command, or not with these arguments.
    UnknownCommand,
    /// The board speaks another version of the protocol: that of the answer's own header.
    OtherVersion,
    /// An argument is outside its range.
    OutOfRange,
    /// Conversions and settling of a frame would take longer than the period.
    PeriodTooShort {
        /// The shortest period that would do, in µs.
        shortest_us: u32,
    },
    /// Wrenches need a calibration, and there is none.
    NoCalibration,
    /// A piece or a commit of a calibration that was not begun.
    NoUpload,
    /// The piece does not follow on the one before.
    WrongOffset,
    /// The calibration has not the length of one, or not the one announced.
    WrongSize,
    /// The CRC-32 of the calibration is not the one announced.
    WrongCrc,
    /// The calibration arrived whole but is not one that this board can use.
    BadCalibration,
    /// The flash did not keep the calibration; the one before is still in use.
    StorageFailed,
    /// Samples would come faster than the serial line takes them.
    LineTooSlow {
        /// The shortest period that would do, in µs.
        shortest_us: u32,
    },
    /// Not while it streams.
    Streaming,
    /// This board has nothing that could do it.
    NotOnThisBoard,
    /// A reason that this version does not know.
    Other(u8),
}

variants!(Refusal {
    1 = UnknownCommand,
    2 = OtherVersion,
    3 = OutOfRange,
    4 = PeriodTooShort { shortest_us },
    5 = NoCalibration,
    6 = NoUpload,
    7 = WrongOffset,
    8 = WrongSize,
    9 = WrongCrc,
    10 = BadCalibration,
    11 = StorageFailed,
    12 = LineTooSlow { shortest_us },
    16 = Streaming,
    17 = NotOnThisBoard,
    _ = Other { 0 }
});
