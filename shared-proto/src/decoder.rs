//! Bytes to packets, whatever the bytes, and finding out which protocol they speak.

use crate::field::Bytes;
use crate::frame::{DecodeError, MAX_FRAME};
use crate::packet::{self, Packet, ReceivedPacket};
use crate::skinproc;
use crate::xbee::{ApiFrame, Deframer, Mode};

/// How frames travel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Framing {
    /// As they are: COBS over a transparent XBee, or a wire.
    Cobs,
    /// As the data of XBee API frames.
    Xbee(Mode),
}

impl Framing {
    /// All framings, to find out by trying which one a stream has.
    pub const ALL: [Framing; 3] =
        [Framing::Cobs, Framing::Xbee(Mode::Plain), Framing::Xbee(Mode::Escaped)];
}

/// What came out of the bytes.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
#[expect(missing_docs, reason = "a variant says what its fields are")]
pub enum Event {
    /// A good packet.
    Packet(ReceivedPacket),
    /// A good packet of a version of the protocol that is not read; a board answers a command in its own version.
    OtherVersion { version: u8, command: bool },
}

/// What arrived, and what did not.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Good packets of all kinds, duplicates included.
    pub packets: u64,
    /// Frames whose CRC does not match.
    pub bad_crc: u64,
    /// Pieces between delimiters that are no frame, or whose body is not one of its kind.
    pub malformed: u64,
    /// XBee API frames with a wrong checksum or length, or cut short.
    pub bad_api_frames: u64,
    /// Good packets of another version.
    pub unknown_version: u64,
    /// Good packets of a kind that this version does not have.
    pub unknown_kind: u64,
}

/// Turns bytes into packets and counts what was damaged.
///
/// A damaged frame costs itself and nothing else: even where the damage is to the delimiter, the
/// frame after it is found.
#[derive(Clone, Debug)]
pub struct Decoder {
    deframer: Option<Deframer>,
    /// The start of a frame whose end has not arrived, or as much of its tail as a frame can have.
    partial: Bytes<{ 2 * MAX_FRAME }>,
    /// Whether a delimiter has been seen: what comes before the first is the end of a frame whose
    /// beginning nobody sent here.
    synchronised: bool,
    /// What arrived so far, and what did not.
    pub counters: Counters,
}

impl Decoder {
    /// Nothing has arrived.
    pub fn new(framing: Framing) -> Self {
        let deframer = match framing {
            Framing::Cobs => None,
            Framing::Xbee(mode) => Some(Deframer::new(mode)),
        };
        let counters = Counters::default();
        Self { deframer, partial: Bytes::new(), synchronised: false, counters }
    }

    /// Takes bytes, in slices of any size, and calls `sink` with every event.
    pub fn feed(&mut self, bytes: &[u8], mut sink: impl FnMut(Event)) {
        let Some(mut deframer) = self.deframer.take() else {
            return self.feed_frames(bytes, &mut sink);
        };
        deframer.feed(bytes, |frame| {
            if let ApiFrame::Receive { payload, .. } = frame {
                self.feed_frames(payload, &mut sink);
            }
        });
        self.counters.bad_api_frames = deframer.damaged;
        self.deframer = Some(deframer);
    }

    /// Takes a piece of the stream of frames.
    fn feed_frames(&mut self, mut bytes: &[u8], sink: &mut impl FnMut(Event)) {
        while let Some(end) = bytes.iter().position(|&byte| byte == 0) {
            self.keep(&bytes[..end]);
            bytes = &bytes[end + 1..];
            let frame = core::mem::take(&mut self.partial);
            self.take(&frame, sink);
            self.synchronised = true;
        }
        self.keep(bytes);
    }

    /// Appends to the partial frame. Of one that is too long to be good, the end is kept: another
    /// frame may stand there.
    fn keep(&mut self, bytes: &[u8]) {
        if !self.partial.try_extend(bytes) {
            let tail = &bytes[bytes.len().saturating_sub(MAX_FRAME)..];
            let excess = (self.partial.len() + tail.len()).saturating_sub(MAX_FRAME);
            self.partial.remove_front(excess);
            self.partial.extend(tail);
        }
    }

    /// Takes what stood between two delimiters.
    fn take(&mut self, frame: &[u8], sink: &mut impl FnMut(Event)) {
        if frame.is_empty() {
            return;
        }
        match Packet::decode(frame) {
            Ok(received) => self.accept(received, sink),
            Err(DecodeError::UnknownVersion { version, kind }) => {
                self.counters.unknown_version += 1;
                sink(Event::OtherVersion { version, command: kind == packet::COMMAND });
            }
            Err(DecodeError::UnknownKind(_)) => self.counters.unknown_kind += 1,
            Err(error) => {
                if self.synchronised {
                    match error {
                        DecodeError::Crc => self.counters.bad_crc += 1,
                        _ => self.counters.malformed += 1,
                    }
                }
                if let Some(received) = last_packet(frame) {
                    self.accept(received, sink);
                }
            }
        }
    }

    fn accept(&mut self, received: ReceivedPacket, sink: &mut impl FnMut(Event)) {
        self.counters.packets += 1;
        sink(Event::Packet(received));
    }
}

/// The packet at the end of a piece that is no packet as a whole: where a delimiter was damaged, the
/// frame after it stands there unharmed.
fn last_packet(piece: &[u8]) -> Option<ReceivedPacket> {
    let tail = &piece[piece.len().saturating_sub(MAX_FRAME)..];
    (0..tail.len())
        .filter_map(|start| tail.get(start..))
        .find_map(|frame| Packet::decode(frame).ok())
}

/// What a board can speak.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Protocol {
    /// The packets of this crate.
    Packets(Framing),
    /// That of the original SkinProc board.
    Original,
}

impl Protocol {
    /// The framing of packets, `None` for the original board.
    pub fn framing(self) -> Option<Framing> {
        match self {
            Self::Packets(framing) => Some(framing),
            Self::Original => None,
        }
    }

    /// How many frames of this protocol are in `bytes`, and how much in them is damage.
    pub fn frames_in(self, bytes: &[u8]) -> (u64, u64) {
        match self {
            Self::Packets(framing) => {
                let mut decoder = Decoder::new(framing);
                decoder.feed(bytes, |_| {});
                let counters = decoder.counters;
                let damaged = counters.bad_crc + counters.malformed + counters.bad_api_frames;
                (counters.packets + counters.unknown_version, damaged)
            }
            Self::Original => {
                let mut decoder = skinproc::Decoder::new();
                decoder.feed(bytes, |_| {});
                (decoder.scans, decoder.skipped / skinproc::SCAN_LEN as u64)
            }
        }
    }
}

/// The protocol that makes the most of `bytes`, `None` if none finds anything in them.
///
/// Frames inside API frames look like COBS with damage between, so damage counts against what is
/// found; of equals the simpler is taken, for escapes may not have occurred yet. A second of a
/// stream is plenty.
pub fn detect(bytes: &[u8]) -> Option<Protocol> {
    let protocols = Framing::ALL.into_iter().map(Protocol::Packets).chain([Protocol::Original]);
    protocols
        .map(|protocol| (protocol, protocol.frames_in(bytes)))
        .filter(|&(_, (found, _))| found > 0)
        .map(|(protocol, (found, damaged))| (protocol, found.cast_signed() - damaged.cast_signed()))
        .reduce(|best, next| if next.1 > best.1 { next } else { best })
        .map(|(protocol, _)| protocol)
}
