//! Bytes to frames with unwrapped index and clock, and the books of what was lost.

use std::time::Duration;

use super::edges::{BoardEdge, EdgeTracker};
use serde::Serialize;
use shared_proto::{
    AXES, Arrival, Boot, CHANNELS, COUNTS_PER_LSB, Clock, Counters, Decoder, Event, Health,
    Protocol, Sample, Silence, Timing, Values, skinproc,
};

/// Largest code of the original board's 12-bit converter.
const FULL_SCALE: u16 = 4095;

/// One frame that arrived.
#[derive(Clone, Debug, PartialEq)]
pub struct BoardFrame {
    /// The board's clock since its first reset in this recording, µs, unwrapped.
    pub time_us: i64,
    /// The sequence number, unwrapped; that of the original board counts what arrived.
    pub index: i64,
    /// What was measured.
    pub measured: Measured,
    /// Bit i is set if channel i was at an end of the converter's range.
    pub saturated: u8,
    /// The board's count of frames that it did not take or could not send, which wraps.
    pub dropped: u8,
    /// The board has restarted before this frame.
    pub restarted: bool,
    /// When its readings were taken, where the board has said so.
    pub timing: Option<Timing>,
    /// How the board is, where it has said so since the frame before.
    pub health: Option<Health>,
    /// An edge at the sync input since the frame before, or one of several.
    pub edge: Option<BoardEdge>,
    /// Its readings are known to be of different times.
    pub skewed: bool,
    /// Strength that the base station received it with, in dBm, where it says so.
    pub rssi_dbm: Option<i16>,
}

/// What a frame holds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Measured {
    /// Readings in steps of the 12-bit converter.
    Readings([f64; CHANNELS]),
    /// Fx, Fy, Fz in N, Mx, My, Mz in N·m, converted on the board.
    Wrench([f64; AXES]),
}

/// What the frames of a log hold, which decides on its columns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Content {
    /// Readings; `numbered` unless they come from the original board.
    Readings {
        /// Whether frames have sequence numbers.
        numbered: bool,
    },
    /// Wrenches.
    Wrench,
}

/// What arrived, and what did not.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Losses {
    /// Frames that the board sent and that did not arrive.
    pub missing: u64,
    /// Times that one or more in a row were missing.
    pub gaps: u64,
    /// Frames that arrived twice; they are written once.
    pub duplicates: u64,
    /// Frames that arrived after a later one.
    pub reordered: u64,
    /// Packets whose CRC did not match.
    pub bad_crc: u64,
    /// Other damage: pieces that are no packet, bad API frames.
    pub damaged: u64,
    /// Bytes that belonged to nothing (original board only).
    pub skipped_bytes: u64,
    /// Packets of another version or of an unknown kind.
    pub unknown: u64,
    /// Frames that the board did not take or could not send.
    pub dropped_on_board: u64,
    /// Times that the board restarted.
    pub restarts: u64,
    /// Edges at the sync input that the board did not send, or that were lost.
    #[serde(skip_serializing_if = "is_zero")]
    pub missing_edges: u64,
    /// Edges that arrived after the last row.
    #[serde(skip_serializing_if = "is_zero")]
    pub edges_left_out: u64,
    /// Silences in which more may have been lost than is counted as missing.
    #[serde(skip_serializing_if = "is_zero")]
    pub uncertain: u64,
}

impl std::ops::AddAssign for Losses {
    fn add_assign(&mut self, other: Self) {
        let Self {
            missing,
            gaps,
            duplicates,
            reordered,
            bad_crc,
            damaged,
            skipped_bytes,
            unknown,
            dropped_on_board,
            restarts,
            missing_edges,
            edges_left_out,
            uncertain,
        } = other;
        self.missing += missing;
        self.gaps += gaps;
        self.duplicates += duplicates;
        self.reordered += reordered;
        self.bad_crc += bad_crc;
        self.damaged += damaged;
        self.skipped_bytes += skipped_bytes;
        self.unknown += unknown;
        self.dropped_on_board += dropped_on_board;
        self.restarts += restarts;
        self.missing_edges += missing_edges;
        self.edges_left_out += edges_left_out;
        self.uncertain += uncertain;
    }
}

/// Recordings without long silences say nothing about them.
fn is_zero(count: &u64) -> bool {
    *count == 0
}

/// Turns the bytes of one protocol into frames.
#[derive(Clone, Debug)]
pub struct Reception {
    decoder: AnyDecoder,
    timeline: Timeline,
    last_dropped: Option<u8>,
    dropped_on_board: u64,
    boot: Option<Boot>,
    timing: Option<Timing>,
    /// Not given to a frame yet.
    health: Option<Health>,
    edges: EdgeTracker,
    rssi_dbm: Option<i16>,
}

#[derive(Clone, Debug)]
enum AnyDecoder {
    Packets(Box<Decoder>),
    Original(skinproc::Decoder),
}

impl Reception {
    /// Nothing has arrived.
    pub fn new(protocol: Protocol) -> Self {
        let decoder = match protocol {
            Protocol::Packets(framing) => AnyDecoder::Packets(Box::new(Decoder::new(framing))),
            Protocol::Original => AnyDecoder::Original(skinproc::Decoder::new()),
        };
        Self {
            decoder,
            timeline: Timeline::default(),
            last_dropped: None,
            dropped_on_board: 0,
            boot: None,
            timing: None,
            health: None,
            edges: EdgeTracker::default(),
            rssi_dbm: None,
        }
    }

    /// Says when the bytes arrive that are fed from now on, by a clock of the host that does not go
    /// back: the length of long silences follows from it.
    pub fn arrived_at(&mut self, now: Duration) {
        if let AnyDecoder::Packets(decoder) = &mut self.decoder {
            decoder.arrived_at(u64::try_from(now.as_micros()).unwrap_or(u64::MAX));
        }
    }

    /// Says how strongly the bytes arrive that are fed from now on, in −dBm, where the base station tells.
    pub(crate) fn received_with(&mut self, rssi: Option<u8>) {
        self.rssi_dbm = rssi.map(|rssi| -i16::from(rssi));
    }

    /// Takes bytes, in slices of any size, and appends the frames in them, duplicates left out.
    pub fn feed(&mut self, bytes: &[u8], frames: &mut Vec<BoardFrame>) {
        let Self {
            decoder,
            timeline,
            last_dropped,
            dropped_on_board,
            boot,
            timing,
            health,
            edges,
            rssi_dbm,
        } = self;
        match decoder {
            AnyDecoder::Packets(decoder) => decoder.feed(bytes, |event| match event {
                Event::Sample { arrival: Arrival::Duplicate, .. } => {}
                Event::Sample { sample, index, arrival, silence } => {
                    let (time_us, restarted) = timeline.place(sample.clock_us, arrival, silence);
                    if restarted {
                        *last_dropped = None;
                    }
                    if arrival != Arrival::Late {
                        let before = last_dropped.replace(sample.dropped);
                        let step = before.map_or(0, |before| sample.dropped.wrapping_sub(before));
                        *dropped_on_board += u64::from(step);
                    }
                    let mut frame = BoardFrame::from_sample(&sample, index, time_us, restarted);
                    frame.timing = *timing;
                    frame.health = health.take();
                    frame.edge = edges.give(sample.clock_us, time_us);
                    frame.rssi_dbm = *rssi_dbm;
                    frames.push(frame);
                }
                Event::Health(word) => {
                    *timing = Some(word.timing);
                    *health = Some(word);
                }
                Event::Edge(edge) => edges.take(edge),
                Event::Boot(word) => {
                    edges.restart();
                    *boot = Some(word);
                    *timing = None;
                    timeline.restart();
                }
                _ => {}
            }),
            AnyDecoder::Original(decoder) => {
                let mut index = decoder.scans.cast_signed();
                decoder.feed(bytes, |scan| {
                    frames.push(BoardFrame::from_scan(&scan, index, timeline));
                    index += 1;
                });
            }
        }
    }

    /// Ends the stream: the last scan of the original board waits for a next one until then.
    pub fn finish(&mut self, frames: &mut Vec<BoardFrame>) {
        if let AnyDecoder::Original(decoder) = &mut self.decoder {
            let index = decoder.scans.cast_signed();
            decoder.finish(|scan| {
                frames.push(BoardFrame::from_scan(&scan, index, &mut self.timeline))
            });
        }
    }

    /// What a board said of itself when it last started, if it did.
    pub fn boot(&self) -> Option<Boot> {
        self.boot
    }

    /// What has been lost so far.
    pub fn losses(&self) -> Losses {
        let dropped_on_board = self.dropped_on_board;
        match &self.decoder {
            AnyDecoder::Packets(decoder) => {
                let Counters {
                    bad_crc,
                    malformed,
                    bad_api_frames,
                    unknown_version,
                    unknown_kind,
                    missing,
                    gaps,
                    duplicates,
                    reordered,
                    restarts,
                    uncertain,
                    ..
                } = decoder.counters();
                Losses {
                    missing,
                    gaps,
                    duplicates,
                    reordered,
                    bad_crc,
                    damaged: malformed + bad_api_frames,
                    skipped_bytes: 0,
                    unknown: unknown_version + unknown_kind,
                    dropped_on_board,
                    restarts,
                    missing_edges: self.edges.missing(),
                    edges_left_out: self.edges.left_out(),
                    uncertain,
                }
            }
            AnyDecoder::Original(decoder) => Losses {
                skipped_bytes: decoder.skipped,
                restarts: self.timeline.restarts,
                ..Losses::default()
            },
        }
    }
}

impl BoardFrame {
    /// A frame of which nothing else is known.
    pub fn new(time_us: i64, index: i64, measured: Measured) -> Self {
        Self {
            time_us,
            index,
            measured,
            saturated: 0,
            dropped: 0,
            restarted: false,
            timing: None,
            health: None,
            edge: None,
            skewed: false,
            rssi_dbm: None,
        }
    }

    /// What it holds, for the columns of a log.
    pub fn content(&self, numbered: bool) -> Content {
        match self.measured {
            Measured::Readings(_) => Content::Readings { numbered },
            Measured::Wrench(_) => Content::Wrench,
        }
    }

    fn from_sample(sample: &Sample, index: i64, time_us: i64, restarted: bool) -> Self {
        let measured = match sample.values {
            Values::Readings(counts) => Measured::Readings(
                counts.map(|counts| f64::from(counts) / f64::from(COUNTS_PER_LSB)),
            ),
            Values::Wrench(wrench) => Measured::Wrench(wrench.map(f64::from)),
        };
        let (saturated, dropped) = (sample.saturated, sample.dropped);
        Self { saturated, dropped, restarted, ..Self::new(time_us, index, measured) }
    }

    fn from_scan(scan: &skinproc::Scan, index: i64, timeline: &mut Timeline) -> Self {
        let (time_us, restarted) =
            timeline.place(scan.clock_us, Arrival::InOrder { missing: 0 }, Silence::Short);
        let saturated = (0..CHANNELS)
            .filter(|&channel| matches!(scan.readings[channel], 0 | FULL_SCALE))
            .fold(0, |mask, channel| mask | 1 << channel);
        let measured = Measured::Readings(scan.readings.map(f64::from));
        Self { saturated, restarted, ..Self::new(time_us, index, measured) }
    }
}

/// The board's time, over wraps of its clock and over restarts.
///
/// How long a board was off nobody knows. Its time goes on from the last frame by the time since
/// its reset, which is the least it can have been; the frame is marked.
#[derive(Clone, Debug, Default)]
struct Timeline {
    clock: Clock,
    offset_us: i64,
    newest: Option<(u32, i64)>,
    pending_restart: bool,
    restarts: u64,
}

impl Timeline {
    fn restart(&mut self) {
        self.pending_restart = self.newest.is_some();
    }

    /// The time of a frame, and whether the board has restarted before it.
    fn place(&mut self, clock_us: u32, arrival: Arrival, silence: Silence) -> (i64, bool) {
        if let (Silence::Long { elapsed_us }, Some((_, newest_us))) = (silence, self.newest) {
            let time_us = newest_us.saturating_add_unsigned(elapsed_us);
            self.clock = Clock::at(time_us - self.offset_us);
            self.newest = Some((clock_us, time_us));
            return (time_us, false);
        }
        let is_late = arrival == Arrival::Late;
        let went_back = self
            .newest
            .is_some_and(|(newest, _)| !is_late && clock_us.wrapping_sub(newest).cast_signed() < 0);
        let restarted = went_back || self.pending_restart || silence == Silence::Restart;
        if restarted {
            self.pending_restart = false;
            self.restarts += 1;
            self.clock = Clock::new();
            self.offset_us = self.newest.map_or(0, |(_, time_us)| time_us);
        }
        let time_us = self.offset_us + self.clock.unwrap_us(clock_us);
        if !is_late {
            self.newest = Some((clock_us, time_us));
        }
        (time_us, restarted)
    }
}
