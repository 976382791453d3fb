//! What the host asks of the board, and what the board answers.
//!
//! Every command carries a number of the host's choosing and the answer repeats it, so that a
//! command that was lost can be sent again: doing any of them twice is the same as doing it once.

use crate::CHANNELS;
use crate::board::{Identity, Status, Stream};
use crate::bytes::{Bytes, Reader};

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

    /// The code that names the command on the wire.
    pub const fn code(&self) -> u8 {
        match self {
            Self::Identify => 0x01,
            Self::Status => 0x02,
            Self::Start => 0x03,
            Self::Stop => 0x04,
            Self::SetPeriod { .. } => 0x05,
            Self::SetOversampling { .. } => 0x06,
            Self::SetSettling { .. } => 0x07,
            Self::SetStream(_) => 0x08,
            Self::BeginCalibration { .. } => 0x09,
            Self::CalibrationPiece { .. } => 0x0A,
            Self::CommitCalibration => 0x0B,
            Self::Zero { .. } => 0x0C,
            Self::LastWords { .. } => 0x0D,
            Self::SelfTest { .. } => 0x10,
            Self::SetBaud { .. } => 0x11,
            Self::Bootloader => 0x12,
            Self::Unknown { code } => *code,
        }
    }

    pub(crate) fn write<const N: usize>(&self, out: &mut Bytes<N>) {
        out.push(self.code());
        match self {
            Self::Identify | Self::Status | Self::Start | Self::Stop => {}
            Self::CommitCalibration | Self::Bootloader | Self::Unknown { .. } => {}
            Self::SetPeriod { period_us } => out.extend(&period_us.to_le_bytes()),
            Self::SetOversampling { conversions } => out.push(*conversions),
            Self::SetSettling { settling_us } => out.extend(&settling_us.to_le_bytes()),
            Self::SetStream(stream) => out.push(stream.code()),
            Self::BeginCalibration { size, crc32 } => {
                out.extend(&size.to_le_bytes());
                out.extend(&crc32.to_le_bytes());
            }
            Self::CalibrationPiece { offset, data } => {
                out.extend(&offset.to_le_bytes());
                out.extend(data);
            }
            Self::Zero { frames } => out.extend(&frames.to_le_bytes()),
            Self::LastWords { offset } => out.extend(&offset.to_le_bytes()),
            Self::SelfTest { emitter } => out.push(*emitter),
            Self::SetBaud { baud } => out.extend(&baud.to_le_bytes()),
        }
    }

    /// `None` if there is not even a code.
    pub(crate) fn read(mut body: Reader<'_>) -> Option<Self> {
        let code = body.u8()?;
        Some(Self::read_arguments(code, body).unwrap_or(Self::Unknown { code }))
    }

    fn read_arguments(code: u8, mut body: Reader<'_>) -> Option<Self> {
        let command = match code {
            0x01 => Self::Identify,
            0x02 => Self::Status,
            0x03 => Self::Start,
            0x04 => Self::Stop,
            0x05 => Self::SetPeriod { period_us: body.u32()? },
            0x06 => Self::SetOversampling { conversions: body.u8()? },
            0x07 => Self::SetSettling { settling_us: body.u16()? },
            0x08 => Self::SetStream(Stream::from_code(body.u8()?)),
            0x09 => Self::BeginCalibration { size: body.u32()?, crc32: body.u32()? },
            0x0A => {
                let offset = body.u16()?;
                return Some(Self::CalibrationPiece { offset, data: Piece::copy_of(body.rest())? });
            }
            0x0B => Self::CommitCalibration,
            0x0C => Self::Zero { frames: body.u16()? },
            0x0D => Self::LastWords { offset: body.u16()? },
            0x10 => Self::SelfTest { emitter: body.u8()? },
            0x11 => Self::SetBaud { baud: body.u32()? },
            0x12 => Self::Bootloader,
            _ => return None,
        };
        body.end(command)
    }
}

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
    const DONE: u8 = 0x00;
    const IDENTITY: u8 = 0x01;
    const STATUS: u8 = 0x02;
    const REFUSED: u8 = 0x03;
    const LAST_WORDS: u8 = 0x04;
    const SELF_TEST: u8 = 0x06;

    pub(crate) fn write<const N: usize>(&self, out: &mut Bytes<N>) {
        match self {
            Self::Done => out.push(Self::DONE),
            Self::Identity(identity) => {
                out.push(Self::IDENTITY);
                identity.write(out);
            }
            Self::Status(status) => {
                out.push(Self::STATUS);
                status.write(out);
            }
            Self::Refused(refusal) => {
                out.push(Self::REFUSED);
                refusal.write(out);
            }
            Self::LastWords { len, text } => {
                out.push(Self::LAST_WORDS);
                out.extend(&len.to_le_bytes());
                out.extend(text);
            }
            Self::SelfTest { emitter, rise } => {
                out.push(Self::SELF_TEST);
                out.push(*emitter);
                rise.iter().for_each(|rise| out.extend(&rise.to_le_bytes()));
            }
            Self::Other { code } => out.push(*code),
        }
    }

    pub(crate) fn read(mut body: Reader<'_>) -> Option<Self> {
        let answer = match body.u8()? {
            Self::DONE => Self::Done,
            Self::IDENTITY => Self::Identity(Identity::read(&mut body)?),
            Self::STATUS => Self::Status(Status::read(&mut body)?),
            // What a newer board adds to a reason is not looked at.
            Self::REFUSED => return Some(Self::Refused(Refusal::read(&mut body)?)),
            Self::LAST_WORDS => {
                let len = body.u16()?;
                return Some(Self::LastWords { len, text: Piece::copy_of(body.rest())? });
            }
            Self::SELF_TEST => {
                let emitter = body.u8()?;
                let rise = body.numbers(|body| body.u16().map(u16::cast_signed))?;
                Self::SelfTest { emitter, rise }
            }
            code => return Some(Self::Other { code }),
        };
        body.end(answer)
    }
}

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

impl Refusal {
    /// The code on the wire.
    pub const fn code(self) -> u8 {
        match self {
            Self::UnknownCommand => 1,
            Self::OtherVersion => 2,
            Self::OutOfRange => 3,
            Self::PeriodTooShort { .. } => 4,
            Self::NoCalibration => 5,
            Self::NoUpload => 6,
            Self::WrongOffset => 7,
            Self::WrongSize => 8,
            Self::WrongCrc => 9,
            Self::BadCalibration => 10,
            Self::StorageFailed => 11,
            Self::LineTooSlow { .. } => 12,
            Self::Streaming => 16,
            Self::NotOnThisBoard => 17,
            Self::Other(code) => code,
        }
    }

    fn write<const N: usize>(self, out: &mut Bytes<N>) {
        out.push(self.code());
        if let Self::PeriodTooShort { shortest_us } | Self::LineTooSlow { shortest_us } = self {
            out.extend(&shortest_us.to_le_bytes());
        }
    }

    fn read(body: &mut Reader<'_>) -> Option<Self> {
        Some(match body.u8()? {
            1 => Self::UnknownCommand,
            2 => Self::OtherVersion,
            3 => Self::OutOfRange,
            4 => Self::PeriodTooShort { shortest_us: body.u32()? },
            5 => Self::NoCalibration,
            6 => Self::NoUpload,
            7 => Self::WrongOffset,
            8 => Self::WrongSize,
            9 => Self::WrongCrc,
            10 => Self::BadCalibration,
            11 => Self::StorageFailed,
            12 => Self::LineTooSlow { shortest_us: body.u32()? },
            16 => Self::Streaming,
            17 => Self::NotOnThisBoard,
            code => Self::Other(code),
        })
    }
}
