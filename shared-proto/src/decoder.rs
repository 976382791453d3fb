//! Decoding of bytes to packets, and detection of a stream's protocol.

use crate::field::Bytes;
use crate::frame::{DecodeError, MAX_FRAME};
use crate::packet::{self, Packet, ReceivedPacket};
use crate::skinproc;
use crate::xbee::{ApiFrame, Deframer, Mode};

/// The way in which frames are transmitted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Framing {
    /// Directly: COBS over a transparent XBee, or a wire.
    Cobs,
    /// As the data of XBee API frames.
    Xbee(Mode),
}

impl Framing {
    /// All framings, for detection by trial.
    pub const ALL: [Framing; 3] =
        [Framing::Cobs, Framing::Xbee(Mode::Plain), Framing::Xbee(Mode::Escaped)];
}

/// A decoded item.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
#[expect(missing_docs, reason = "a variant says what its fields are")]
pub enum Event {
    /// A valid packet.
    Packet(ReceivedPacket),
    /// A packet of another version; a board answers a command with its own version.
    OtherVersion { version: u8, command: bool },
}

/// Counts of received packets and of damage.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Valid packets of all kinds, including duplicates.
    pub packets: u64,
    /// Frames whose CRC does not match.
    pub bad_crc: u64,
    /// Pieces between delimiters that are not frames, or whose body does not match their kind.
    pub malformed: u64,
    /// XBee API frames with a wrong checksum or length, or cut short.
    pub bad_api_frames: u64,
    /// Valid packets of another version.
    pub unknown_version: u64,
    /// Valid packets of an unknown kind.
    pub unknown_kind: u64,
}

/// Decodes bytes to packets and counts damage, which never affects other frames, even after a
/// damaged delimiter.
#[derive(Clone, Debug)]
pub struct Decoder {
    deframer: Option<Deframer>,
    /// An incomplete frame, or the longest tail that can be one.
    partial: Bytes<{ 2 * MAX_FRAME }>,
    /// True after the first delimiter; bytes before it belong to an earlier frame.
    synchronised: bool,
    /// Counts of received packets and of damage.
    pub counters: Counters,
}

impl Decoder {
    /// Creates a decoder.
    pub fn new(framing: Framing) -> Self {
        let deframer = match framing {
            Framing::Cobs => None,
            Framing::Xbee(mode) => Some(Deframer::new(mode)),
        };
        let counters = Counters::default();
        Self { deframer, partial: Bytes::new(), synchronised: false, counters }
    }

    /// Decodes bytes, in slices of any size, and calls `sink` with every event.
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

    /// Appends to the partial frame. If the result is too long, only its end is kept: a frame may be in it.
    fn keep(&mut self, bytes: &[u8]) {
        if !self.partial.try_extend(bytes) {
            let tail = &bytes[bytes.len().saturating_sub(MAX_FRAME)..];
            let excess = (self.partial.len() + tail.len()).saturating_sub(MAX_FRAME);
            self.partial.remove_front(excess);
            self.partial.extend(tail);
        }
    }

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

/// Returns the packet at the end of a piece: the frame after a damaged delimiter is intact.
fn last_packet(piece: &[u8]) -> Option<ReceivedPacket> {
    let tail = &piece[piece.len().saturating_sub(MAX_FRAME)..];
    (0..tail.len())
        .filter_map(|start| tail.get(start..))
        .find_map(|frame| Packet::decode(frame).ok())
}

/// A protocol that a board can speak.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Protocol {
    /// The packets of this crate.
    Packets(Framing),
    /// The protocol of the original SkinProc board.
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

    /// Returns the number of this protocol's frames in `bytes`, and the amount of damage.
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

/// Returns the protocol that fits `bytes` best, `None` without a frame; a second of data is plenty.
///
/// Frames inside API frames look like COBS with damage between them, so damage counts against
/// frames. In a tie the simpler protocol wins, since there may be no escapes yet.
pub fn detect(bytes: &[u8]) -> Option<Protocol> {
    let protocols = Framing::ALL.into_iter().map(Protocol::Packets).chain([Protocol::Original]);
    protocols
        .map(|protocol| (protocol, protocol.frames_in(bytes)))
        .filter(|&(_, (found, _))| found > 0)
        .map(|(protocol, (found, damaged))| (protocol, found.cast_signed() - damaged.cast_signed()))
        .reduce(|best, next| if next.1 > best.1 { next } else { best })
        .map(|(protocol, _)| protocol)
}
