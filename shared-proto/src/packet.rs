//! Content and layout of each kind of packet.

use crate::board::{Board, BoardId, ResetCause};
use crate::command::{Answer, Command};
use crate::field::{Bytes, Field, Reader, fields};
use crate::frame::{self, DecodeError, Frame, Plain};
use crate::{AXES, CHANNELS};
use crc::{CRC_16_M17, Crc};

/// Version of the protocol: the upper four bits of every header.
pub const VERSION: u8 = 3;

/// The previous version, still read. Like version 1, it has no origin and no mask in its CRC.
const VERSION_2: u8 = 2;

/// Steps of a reading per step of the board's 12-bit converter: means with four fractional bits, so
/// that a calibration is valid for every oversampling.
pub const COUNTS_PER_LSB: u16 = 16;

/// CRC-16/M17, polynomial 0x5935: detects every error of up to four bits in up to 241 bits of
/// content (P. Koopman, "Best CRC Polynomials", 16 bits, HD=5); a packet of readings has 240.
/// 0x1021 detects three.
static CRC: Crc<u16> = Crc::<u16>::new(&CRC_16_M17);

/// Kinds of packet, the header's lower four bits. Unused values would make the header an escaped
/// byte in versions 1 and 7, and always need a mask.
const SAMPLE_READINGS: u8 = 0x4;
const SAMPLE_WRENCH: u8 = 0x5;
const HEALTH: u8 = 0x6;
const EDGE: u8 = 0x7;
pub(crate) const COMMAND: u8 = 0x8;
const ANSWER: u8 = 0x9;
const BOOT: u8 = 0xA;

/// A packet between board and host.
#[derive(Clone, Copy, Debug, PartialEq)]
#[expect(missing_docs, reason = "a variant says what its fields are")]
pub enum Packet {
    /// One frame of the stream.
    Sample(Sample),
    /// Times of the readings, and the state of the board.
    Health(Health),
    /// An edge at the sync input.
    Edge(Edge),
    /// A command for one board or, if `None`, for every board; the answer repeats the number.
    Command { number: u16, to: Option<BoardId>, command: Command },
    /// The answer to the command with this number.
    Answer { number: u16, answer: Answer },
    /// A start of the board.
    Boot(Boot),
}

/// The board that sent a packet, and its run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct PacketOrigin {
    /// See [`BoardId::short`].
    pub board: u16,
    /// A number that changes at every start of the board.
    pub start: u16,
}

/// A received packet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReceivedPacket {
    /// The origin, which commands and packets of version 2 lack.
    pub origin: Option<PacketOrigin>,
    /// The packet.
    pub packet: Packet,
}

/// One frame of the stream.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Number of samples that the board has sent since its reset; wraps.
    pub sequence: u16,
    /// The board's clock at the start of the frame, in µs since its reset; it wraps.
    pub clock_us: u32,
    /// The measured values.
    pub values: Values,
    /// Bit i is set if channel i was at an end of the converter's range.
    pub saturated: u8,
    /// Number of frames that the board did not take or could not send; wraps.
    pub dropped: u8,
}

/// Content of a sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Values {
    /// Readings in counts, [`COUNTS_PER_LSB`] per step of a 12-bit converter.
    Readings([u16; CHANNELS]),
    /// Fx, Fy, Fz in N, then Mx, My, Mz in N·m.
    Wrench([f32; AXES]),
}

/// A rising edge at the board's sync input, by which another recorder's clock can be compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Edge {
    /// Edges since the reset, including those not sent; wraps. A gap means edges that were lost or
    /// came faster than the line can carry.
    pub number: u16,
    /// The board's clock at the edge, in µs, as in samples.
    pub clock_us: u32,
}

/// The board's announcement after a start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Boot {
    /// The hardware that the firmware runs on.
    pub board: Board,
    /// Version of the firmware: major, minor, patch.
    pub firmware: [u8; 3],
    /// Why the board started.
    pub cause: ResetCause,
}

/// Length in bytes of a sample of readings: mask, header, sequence number, origin, clock, readings,
/// saturation, dropped and CRC, plus a COBS code and the delimiter.
pub const READINGS_FRAME: usize = 16 + 2 * CHANNELS + 2;

/// Length in bytes of a sample with a wrench.
pub const WRENCH_FRAME: usize = 16 + 4 * AXES + 2;

impl Packet {
    /// Encodes the packet with its delimiter and a default origin.
    pub fn encode(&self) -> Frame {
        self.encode_from(PacketOrigin::default())
    }

    /// Encodes the packet of a board with its delimiter; a command has no origin.
    pub fn encode_from(&self, origin: PacketOrigin) -> Frame {
        let (kind, number) = match self {
            Self::Sample(Sample { sequence, values: Values::Readings(_), .. }) => {
                (SAMPLE_READINGS, *sequence)
            }
            Self::Sample(Sample { sequence, .. }) => (SAMPLE_WRENCH, *sequence),
            Self::Health(health) => (HEALTH, health.sequence),
            Self::Edge(edge) => (EDGE, edge.number),
            Self::Command { number, .. } => (COMMAND, *number),
            Self::Answer { number, .. } => (ANSWER, *number),
            Self::Boot(_) => (BOOT, 0),
        };
        let mut packet = Plain::new();
        packet.push(0);
        packet.push(VERSION << 4 | kind);
        number.write(&mut packet);
        if kind != COMMAND {
            origin.write(&mut packet);
        }
        match self {
            Self::Sample(sample) => sample.write(&mut packet),
            Self::Health(health) => health.write(&mut packet),
            Self::Edge(edge) => edge.clock_us.write(&mut packet),
            Self::Command { to, command, .. } => {
                BoardId::code(*to).write(&mut packet);
                command.write(&mut packet);
            }
            Self::Answer { answer, .. } => answer.write(&mut packet),
            Self::Boot(boot) => boot.write(&mut packet),
        }
        frame::encode(packet, |masked| CRC.checksum(masked))
    }

    /// Decodes a frame without its delimiter.
    ///
    /// # Errors
    /// [`DecodeError`] if the bytes are no frame, damaged, or of another version.
    pub fn decode(frame: &[u8]) -> Result<ReceivedPacket, DecodeError> {
        let wire = frame::decode(frame)?;
        let Some((masked, crc)) = wire.split_last_chunk() else { return Err(DecodeError::Framing) };
        let &[mask, header, ..] = masked else { return Err(DecodeError::Framing) };
        let header = header ^ mask;
        let mut plain = Plain::copy_of(masked).ok_or(DecodeError::Framing)?;
        plain.as_mut_slice().iter_mut().for_each(|byte| *byte ^= mask);
        let version = header >> 4;
        let (computed, crc) = if (1..=VERSION_2).contains(&version) {
            let content = plain.get(1..).unwrap_or_default();
            (CRC.checksum(content), crc.map(|byte| byte ^ mask))
        } else {
            (CRC.checksum(masked), *crc)
        };
        if computed != u16::from_le_bytes(crc) {
            return Err(DecodeError::Crc);
        }
        let kind = header & 0xF;
        if !matches!(version, VERSION | VERSION_2) || (version == VERSION_2 && kind == COMMAND) {
            return Err(DecodeError::UnknownVersion { version, kind });
        }
        let mut body = Reader(plain.get(2..).unwrap_or_default());
        let number = body.get().ok_or(DecodeError::Body)?;
        let origin = match version == VERSION && kind != COMMAND {
            true => Some(body.get().ok_or(DecodeError::Body)?),
            false => None,
        };
        let packet = match kind {
            SAMPLE_READINGS | SAMPLE_WRENCH => Sample::read(kind, number, body).map(Self::Sample),
            HEALTH => Health::read(number, body).map(Self::Health),
            EDGE => {
                let clock_us = body.get().ok_or(DecodeError::Body)?;
                body.end(Self::Edge(Edge { number, clock_us }))
            }
            COMMAND => Self::read_command(number, body),
            ANSWER => Answer::read_all(body).map(|answer| Self::Answer { number, answer }),
            BOOT => body.get().and_then(|boot| body.end(Self::Boot(boot))),
            kind => return Err(DecodeError::UnknownKind(kind)),
        };
        Ok(ReceivedPacket { origin, packet: packet.ok_or(DecodeError::Body)? })
    }

    fn read_command(number: u16, mut body: Reader<'_>) -> Option<Self> {
        let to = BoardId::from_code(body.get()?);
        Some(Self::Command { number, to, command: Command::read_all(body)? })
    }
}

fields!(PacketOrigin { board, start });
fields!(Boot { board, firmware, cause });

impl Sample {
    fn write(&self, out: &mut Plain) {
        self.clock_us.write(out);
        match &self.values {
            Values::Readings(readings) => readings.write(out),
            Values::Wrench(wrench) => wrench.write(out),
        }
        out.push(self.saturated);
        out.push(self.dropped);
    }

    fn read(kind: u8, sequence: u16, mut body: Reader<'_>) -> Option<Self> {
        let clock_us = body.get()?;
        let values = match kind {
            SAMPLE_READINGS => Values::Readings(body.get()?),
            _ => Values::Wrench(body.get()?),
        };
        let (saturated, dropped) = (body.get()?, body.get()?);
        body.end(Self { sequence, clock_us, values, saturated, dropped })
    }
}

/// Times of a frame's readings, relative to its sample's time. Channels are read one after the other; the time of a
/// reading is the middle of its lit conversions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Timing {
    /// Time from the start of the frame to the first channel's reading, µs.
    pub first_us: u16,
    /// Time from one channel's reading to the next, µs.
    pub step_us: u16,
}

/// Temperature and supply, as far as the board measures them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Vitals {
    /// Temperature of the chip in hundredths of a degree Celsius.
    pub temperature_cdeg: Option<i16>,
    /// Supply of the converter in mV.
    pub supply_mv: Option<u16>,
    /// Reading of the chip's voltage reference, in counts.
    pub reference: Option<u16>,
}

/// A report that is sent once a second, and before the first sample of a stream or after a change of settings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Health {
    /// Sequence number of the next sample.
    pub sequence: u16,
    /// The board's clock, as in samples.
    pub clock_us: u32,
    /// Times of the readings, from the next sample on.
    pub timing: Timing,
    /// Temperature and supply.
    pub vitals: Vitals,
    /// Dark values of the channels (emitters off), in counts.
    pub dark: [u16; CHANNELS],
}

fields!(Timing { first_us, step_us });

const NO_TEMPERATURE: i16 = i16::MIN;

impl Field for Vitals {
    fn write<const N: usize>(&self, out: &mut Bytes<N>) {
        self.temperature_cdeg.unwrap_or(NO_TEMPERATURE).write(out);
        [self.supply_mv, self.reference].map(Option::unwrap_or_default).write(out);
    }

    fn read(body: &mut Reader<'_>) -> Option<Self> {
        let temperature = body.get()?;
        let [supply, reference] = body.get()?;
        Some(Self {
            temperature_cdeg: (temperature != NO_TEMPERATURE).then_some(temperature),
            supply_mv: (supply != 0).then_some(supply),
            reference: (reference != 0).then_some(reference),
        })
    }
}

impl Health {
    fn write(&self, out: &mut Plain) {
        self.clock_us.write(out);
        self.timing.write(out);
        self.vitals.write(out);
        self.dark.write(out);
    }

    /// Ignores fields that a newer board appends.
    fn read(sequence: u16, mut body: Reader<'_>) -> Option<Self> {
        let (clock_us, timing) = (body.get()?, body.get()?);
        Some(Self { sequence, clock_us, timing, vitals: body.get()?, dark: body.get()? })
    }
}
