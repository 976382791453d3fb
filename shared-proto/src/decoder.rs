//! Bytes to packets, whatever the bytes.

use crate::authentication::Signature;
use crate::board::BoardId;
use crate::bytes::Bytes;
use crate::command::{Answer, Command};
use crate::edge::Edge;
use crate::error::DecodeError;
use crate::frame::MAX_FRAME;
use crate::health::Health;
use crate::outage::{Gap, Period, Silence, Verdict};
use crate::packet::{self, Boot, Packet, Sample};
use crate::sequence::{Arrival, Tracker};
use crate::xbee::{ApiFrame, Deframer, Mode, TransmitStatus};

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
pub enum Event {
    /// A frame of the stream; duplicates too.
    Sample {
        /// The sample.
        sample: Sample,
        /// Its sequence number without the wraps, see [`Tracker::place`].
        index: i64,
        /// How it arrived.
        arrival: Arrival,
        /// What the silence before it was.
        silence: Silence,
    },
    /// When the readings of the samples after it are taken, and how the board is.
    Health(Health),
    /// An edge at the board's sync input; duplicates too.
    Edge(Edge),
    /// A request of the host.
    Command {
        /// Number that the answer repeats.
        number: u16,
        /// The board that it is for, `None` for every board.
        to: Option<BoardId>,
        /// What to do.
        command: Command,
        /// By the board's key, if the host has signed it.
        signature: Option<Signature>,
    },
    /// An answer of the board.
    Answer {
        /// Number of the command that is answered.
        number: u16,
        /// What came of it.
        answer: Answer,
    },
    /// The board has started, so its numbering begins anew.
    Boot(Boot),
    /// The module at this end says what became of a transmission.
    TransmitStatus(TransmitStatus),
    /// A good packet of another version of the protocol.
    OtherVersion {
        /// The version.
        version: u8,
        /// Whether it is a command, which a board answers in its own version.
        command: bool,
    },
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
    /// Samples that are missing between the first and the newest.
    pub missing: u64,
    /// Times that one or more samples in a row were missing when a newer one came.
    pub gaps: u64,
    /// Samples that had arrived before.
    pub duplicates: u64,
    /// Samples that came after a newer one.
    pub reordered: u64,
    /// Times that the board's numbering began anew.
    pub restarts: u64,
    /// Silences in which more may have been lost than is counted as missing.
    pub uncertain: u64,
}

/// Turns bytes into packets and counts what was lost.
///
/// A damaged frame costs itself and nothing else: even where the damage is to the delimiter, the
/// frame after it is found.
#[derive(Clone, Debug)]
pub struct Decoder {
    deframer: Option<Deframer>,
    stream: Stream,
}

impl Decoder {
    /// Nothing has arrived.
    pub const fn new(framing: Framing) -> Self {
        let deframer = match framing {
            Framing::Cobs => None,
            Framing::Xbee(mode) => Some(Deframer::new(mode)),
        };
        Self { deframer, stream: Stream::new() }
    }

    /// Takes bytes, in slices of any size, and calls `sink` with every event.
    pub fn feed(&mut self, bytes: &[u8], mut sink: impl FnMut(Event)) {
        let Self { deframer: Some(deframer), stream } = self else {
            return self.stream.feed(bytes, &mut sink);
        };
        deframer.feed(bytes, |frame| match frame {
            ApiFrame::Receive { payload, .. } => stream.feed(payload, &mut sink),
            ApiFrame::TransmitStatus(status) => sink(Event::TransmitStatus(status)),
            ApiFrame::Transmit { .. } | ApiFrame::Other { .. } => {}
        });
    }

    /// Says when the bytes arrive that are fed from now on, by a clock of the host that does not go
    /// back, in µs: the length of long silences follows from it.
    pub fn arrived_at(&mut self, host_us: u64) {
        self.stream.host_us = Some(host_us);
    }

    /// What arrived so far, and what did not.
    pub fn counters(&self) -> Counters {
        let tracker = &self.stream.tracker;
        Counters {
            bad_api_frames: self.deframer.as_ref().map_or(0, |deframer| deframer.damaged),
            missing: tracker.missing(),
            gaps: tracker.gaps,
            duplicates: tracker.duplicates,
            reordered: tracker.reordered,
            restarts: tracker.restarts,
            ..self.stream.counters
        }
    }
}

/// The stream of frames, in whatever pieces it arrives.
#[derive(Clone, Debug)]
struct Stream {
    /// The start of a frame whose end has not arrived, or as much of its tail as a frame can have.
    partial: Bytes<{ 2 * MAX_FRAME }>,
    /// Whether a delimiter has been seen: what comes before the first is the end of a frame whose
    /// beginning nobody sent here.
    synchronised: bool,
    tracker: Tracker,
    newest: Option<Newest>,
    period: Period,
    /// The host's time now, µs, where it is known.
    host_us: Option<u64>,
    counters: Counters,
}

/// What is known of the newest sample.
#[derive(Clone, Copy, Debug)]
struct Newest {
    sequence: u16,
    clock_us: u32,
    dropped: u8,
    host_us: Option<u64>,
}

impl Newest {
    fn gap(&self, sample: &Sample, host_us: Option<u64>) -> Gap {
        Gap {
            sequence: sample.sequence.wrapping_sub(self.sequence),
            clock_us: sample.clock_us.wrapping_sub(self.clock_us),
            dropped: sample.dropped.wrapping_sub(self.dropped),
            host_us: host_us.zip(self.host_us).map(|(now, then)| now.saturating_sub(then)),
        }
    }
}

impl Stream {
    const fn new() -> Self {
        Self {
            partial: Bytes::new(),
            synchronised: false,
            tracker: Tracker::new(),
            newest: None,
            period: Period::new(),
            host_us: None,
            counters: Counters {
                packets: 0,
                bad_crc: 0,
                malformed: 0,
                bad_api_frames: 0,
                unknown_version: 0,
                unknown_kind: 0,
                missing: 0,
                gaps: 0,
                duplicates: 0,
                reordered: 0,
                restarts: 0,
                uncertain: 0,
            },
        }
    }

    fn feed(&mut self, mut bytes: &[u8], sink: &mut impl FnMut(Event)) {
        while let Some(end) = bytes.iter().position(|&byte| byte == 0) {
            let (frame, rest) = (&bytes[..end], &bytes[end + 1..]);
            bytes = rest;
            if self.partial.is_empty() {
                self.take(frame, sink);
            } else {
                self.keep(frame);
                let frame = core::mem::take(&mut self.partial);
                self.take(&frame, sink);
            }
            self.synchronised = true;
        }
        self.keep(bytes);
    }

    /// Appends to the partial frame. Of one that is too long to be good, the end is kept: another
    /// frame may stand there.
    fn keep(&mut self, bytes: &[u8]) {
        if !self.partial.extend(bytes) {
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
            Ok(packet) => self.accept(packet, sink),
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
                if let Some(packet) = last_packet(frame) {
                    self.accept(packet, sink);
                }
            }
        }
    }

    fn accept(&mut self, packet: Packet, sink: &mut impl FnMut(Event)) {
        self.counters.packets += 1;
        sink(match packet {
            Packet::Sample(sample) => {
                let (index, arrival, silence) = self.place(&sample);
                Event::Sample { sample, index, arrival, silence }
            }
            Packet::Health(health) => Event::Health(health),
            Packet::Edge(edge) => Event::Edge(edge),
            Packet::Command { number, to, command } => {
                Event::Command { number, to, command, signature: None }
            }
            Packet::Signed { number, to, signature, command } => {
                Event::Command { number, to, command, signature: Some(signature) }
            }
            Packet::Answer { number, answer } => Event::Answer { number, answer },
            Packet::Boot(boot) => {
                self.tracker.restart();
                self.newest = None;
                self.period = Period::new();
                Event::Boot(boot)
            }
        });
    }

    /// Where a sample belongs among those before it.
    fn place(&mut self, sample: &Sample) -> (i64, Arrival, Silence) {
        let gap = self.newest.map(|newest| newest.gap(sample, self.host_us));
        let verdict = gap.map(|gap| self.period.judge(&gap));
        let silence = verdict.map_or(Silence::Short, |verdict| verdict.silence);
        let (index, arrival) = match verdict {
            Some(Verdict { silence: Silence::Long { .. }, sent, certain }) => {
                self.counters.uncertain += u64::from(!certain);
                self.tracker.advance(sent)
            }
            _ => {
                let before = self.tracker.restarts;
                if silence == Silence::Restart || gap.is_some_and(|gap| has_restarted(&gap)) {
                    self.tracker.restart();
                }
                let placed = self.tracker.place(sample.sequence);
                let restarts = self.tracker.restarts - before;
                let certain = restarts == 0 && verdict.is_none_or(|verdict| verdict.certain);
                self.counters.uncertain += u64::from(!certain);
                if restarts > 0 {
                    self.period = Period::new();
                }
                placed
            }
        };
        if matches!(arrival, Arrival::InOrder { .. }) {
            if let (Some(gap), Silence::Short) = (&gap, silence) {
                self.period.observe(gap);
            }
            let Sample { sequence, clock_us, dropped, .. } = *sample;
            self.newest = Some(Newest { sequence, clock_us, dropped, host_us: self.host_us });
        }
        (index, arrival, silence)
    }
}

/// Whether a step shows that the board has started anew and word of it was lost: the number is ahead
/// of the newest, the clock behind.
fn has_restarted(gap: &Gap) -> bool {
    gap.sequence.cast_signed() > 0 && gap.clock_us.cast_signed() < 0
}

/// The packet at the end of a piece that is no packet as a whole: where a delimiter was damaged, the
/// frame after it stands there unharmed.
fn last_packet(piece: &[u8]) -> Option<Packet> {
    let tail = &piece[piece.len().saturating_sub(MAX_FRAME)..];
    (0..tail.len())
        .filter_map(|start| tail.get(start..))
        .filter(|frame| Packet::has_known_header(frame))
        .find_map(|frame| Packet::decode(frame).ok())
}
