//! Conversion of packets to frames with unwrapped index and clock, and the count of losses.

use std::time::Duration;

use super::sequence::{Arrival, BoardEdge, EdgeTracker};
use super::timeline::{FramePosition, Stamp, Timeline};
use serde::Serialize;
use shared_proto::{
    AXES, Answer, Boot, CHANNELS, COUNTS_PER_LSB, Health, Identity, Packet, ReceivedPacket, Sample,
    Status, Timing, Values, skinproc,
};

const FULL_SCALE: u16 = 4095;

#[derive(Clone, Debug, Default, PartialEq)]
pub struct BoardFrame {
    /// The board's clock since its first reset in this recording, µs, unwrapped.
    pub time_us: i64,
    /// The sequence number, unwrapped; for the original board, the number of frames received.
    pub index: i64,
    pub measured: Measured,
    /// Bit i is set if channel i was at an end of the converter's range.
    pub saturated: u8,
    /// Number of frames that the board did not take or could not send; wraps at 256.
    pub dropped: u8,
    pub restarted: bool,
    pub timing: Option<Timing>,
    pub health: Option<Health>,
    /// An edge at the sync input since the previous frame; one of them, if there were several.
    pub edge: Option<BoardEdge>,
    pub skewed: bool,
    /// Signal strength at the base station in dBm, if reported.
    pub rssi_dbm: Option<i16>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Measured {
    /// Readings in steps of the 12-bit converter.
    Readings([f64; CHANNELS]),
    /// Fx, Fy, Fz in N, Mx, My, Mz in N·m, converted on the board.
    Wrench([f64; AXES]),
}

impl Default for Measured {
    fn default() -> Self {
        Self::Readings([0.0; CHANNELS])
    }
}

impl Measured {
    pub fn readings(&self) -> Option<&[f64; CHANNELS]> {
        match self {
            Self::Readings(readings) => Some(readings),
            Self::Wrench(_) => None,
        }
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Losses {
    /// Frames sent, but not received.
    pub missing: u64,
    pub gaps: u64,
    pub duplicates: u64,
    pub reordered: u64,
    pub bad_crc: u64,
    /// Pieces that are not packets, bad API frames, frames that contradict their neighbours.
    pub damaged: u64,
    /// Bytes outside scans (original board only).
    pub skipped_bytes: u64,
    pub unknown: u64,
    /// Frames that the board did not take or could not send.
    pub dropped_on_board: u64,
    pub restarts: u64,
    /// Edges at the sync input that the board did not send, or that were lost.
    #[serde(skip_serializing_if = "is_zero")]
    pub missing_edges: u64,
    #[serde(skip_serializing_if = "is_zero")]
    pub edges_left_out: u64,
    /// Silences in which more frames may have been lost than are counted as missing.
    #[serde(skip_serializing_if = "is_zero")]
    pub uncertain: u64,
}

impl Losses {
    fn counts(&mut self) -> [(&mut u64, &'static str); 13] {
        [
            (&mut self.missing, "missing"),
            (&mut self.dropped_on_board, "dropped on the board"),
            (&mut self.bad_crc, "bad CRC"),
            (&mut self.damaged, "damaged"),
            (&mut self.duplicates, "duplicates"),
            (&mut self.reordered, "reordered"),
            (&mut self.unknown, "unknown"),
            (&mut self.skipped_bytes, "bytes skipped"),
            (&mut self.restarts, "restarts"),
            (&mut self.missing_edges, "sync edges missing"),
            (&mut self.gaps, ""),
            (&mut self.edges_left_out, ""),
            (&mut self.uncertain, ""),
        ]
    }

    pub fn in_words(mut self) -> String {
        let lost =
            self.counts().into_iter().filter(|(count, what)| **count > 0 && !what.is_empty());
        let mut lost: Vec<String> = lost.map(|(count, what)| format!("{count} {what}")).collect();
        // The loss before an unannounced restart is unknown.
        if self.uncertain > 0 {
            match self.missing {
                0 => lost.insert(0, "at least 0 missing".to_owned()),
                _ => lost[0].insert_str(0, "at least "),
            }
        }
        match lost.is_empty() {
            true => "nothing lost".to_owned(),
            false => lost.join(", "),
        }
    }
}

impl std::ops::AddAssign for Losses {
    fn add_assign(&mut self, mut other: Self) {
        for ((sum, _), (count, _)) in self.counts().into_iter().zip(other.counts()) {
            *sum += *count;
        }
    }
}

fn is_zero(count: &u64) -> bool {
    *count == 0
}

#[derive(Clone, Debug, Default)]
pub struct Reception {
    timeline: Timeline,
    /// A frame that does not follow the previous ones; the next frame decides its fate.
    held: Option<(Stamp, BoardFrame)>,
    contradicted: u64,
    last_dropped: Option<u8>,
    dropped_on_board: u64,
    pub(crate) start: Option<u16>,
    pub(crate) boot: Option<Boot>,
    pub(crate) identity: Option<Identity>,
    pub(crate) status: Option<Status>,
    timing: Option<Timing>,
    health: Option<Health>,
    edges: EdgeTracker,
    host_us: Option<u64>,
    scans: i64,
}

impl Reception {
    /// Sets the arrival time of the next packets, on a monotonic clock that shows the length of silences.
    pub fn arrived_at(&mut self, now: Duration) {
        self.host_us = Some(u64::try_from(now.as_micros()).unwrap_or(u64::MAX));
    }

    /// Takes a packet, with its signal strength in −dBm if known, and appends its new frames.
    pub fn take(
        &mut self,
        received: ReceivedPacket,
        rssi: Option<u8>,
        frames: &mut Vec<BoardFrame>,
    ) {
        let start = received.origin.map(|origin| origin.start);
        let is_boot = matches!(received.packet, Packet::Boot(_));
        if is_boot {
            self.timeline.boot();
        }
        if start != self.start || (is_boot && start.is_none()) {
            self.run_begins(start);
        }
        match received.packet {
            Packet::Sample(sample) => {
                self.take_sample(sample, rssi.map(|rssi| -i16::from(rssi)), frames)
            }
            Packet::Health(word) => {
                self.timing = Some(word.timing);
                self.health = Some(word);
            }
            Packet::Edge(edge) => self.edges.take(edge),
            Packet::Boot(word) => self.boot = Some(word),
            Packet::Answer { answer: Answer::Status(status), .. } => self.status = Some(status),
            Packet::Answer { answer: Answer::Identity(identity), .. } => {
                self.identity = Some(identity);
            }
            Packet::Answer { .. } | Packet::Command { .. } => {}
        }
    }

    fn run_begins(&mut self, start: Option<u16>) {
        if self.start.is_some() || start.is_none() {
            self.edges.restart();
        }
        (self.timing, self.status) = (None, None);
        self.start = start;
    }

    fn take_sample(&mut self, sample: Sample, rssi_dbm: Option<i16>, frames: &mut Vec<BoardFrame>) {
        let Sample { sequence, clock_us, values, saturated, dropped } = sample;
        let stamp = Stamp { sequence, clock_us, dropped, start: self.start, host_us: self.host_us };
        let steps = |counts: u16| f64::from(counts) / f64::from(COUNTS_PER_LSB);
        let measured = match values {
            Values::Readings(counts) => Measured::Readings(counts.map(steps)),
            Values::Wrench(wrench) => Measured::Wrench(wrench.map(f64::from)),
        };
        let (timing, health) = (self.timing, self.health.take());
        let frame = BoardFrame::new(0, 0, measured);
        let frame = BoardFrame { saturated, dropped, timing, health, rssi_dbm, ..frame };
        let arrived = (stamp, frame);
        let held = self.held.take();
        if self.timeline.is_followed_by(&stamp) {
            self.contradicted += u64::from(held.is_some());
            let placed = self.timeline.follow(stamp);
            return self.give(arrived, placed, frames);
        }
        match held {
            Some((before, frame)) if before.precedes(&stamp) => {
                let placed = self.timeline.jump(before);
                self.give((before, frame), placed, frames);
                // The new frame now follows the held one, unless the rate has changed again.
                let placed = match self.timeline.is_followed_by(&stamp) {
                    true => self.timeline.follow(stamp),
                    false => self.timeline.jump(stamp),
                };
                self.give(arrived, placed, frames);
            }
            held => {
                self.contradicted += u64::from(held.is_some());
                self.held = Some(arrived);
            }
        }
    }

    fn give(
        &mut self,
        (stamp, frame): (Stamp, BoardFrame),
        placed: FramePosition,
        frames: &mut Vec<BoardFrame>,
    ) {
        let FramePosition { index, time_us, arrival, restarted } = placed;
        if arrival == Arrival::Duplicate {
            return;
        }
        if restarted {
            self.last_dropped = None;
        }
        if arrival != Arrival::Late {
            let before = self.last_dropped.replace(stamp.dropped);
            let step = before.map_or(0, |before| stamp.dropped.wrapping_sub(before));
            self.dropped_on_board += u64::from(step);
        }
        let edge = self.edges.give(stamp.clock_us, time_us);
        frames.push(BoardFrame { index, time_us, restarted, edge, ..frame });
    }

    /// Takes a scan of the original board. A clock that goes back means a restart.
    pub(crate) fn take_scan(&mut self, scan: &skinproc::Scan, frames: &mut Vec<BoardFrame>) {
        let (index, sequence) = (self.scans, self.scans as u16);
        self.scans += 1;
        let stamp = Stamp { sequence, clock_us: scan.clock_us, ..Stamp::default() };
        let FramePosition { time_us, restarted, .. } = match self.timeline.is_forward(&stamp) {
            true => self.timeline.follow(stamp),
            false => self.timeline.jump(stamp),
        };
        let saturated = (0..CHANNELS)
            .filter(|&channel| matches!(scan.readings[channel], 0 | FULL_SCALE))
            .fold(0, |mask, channel| mask | 1 << channel);
        let frame =
            BoardFrame::new(time_us, index, Measured::Readings(scan.readings.map(f64::from)));
        frames.push(BoardFrame { saturated, restarted, ..frame });
    }

    /// Ends the stream. A held frame is either the only one, or contradicts the previous ones.
    pub fn finish(&mut self, frames: &mut Vec<BoardFrame>) {
        let Some(held) = self.held.take() else { return };
        if self.timeline.has_begun() {
            self.contradicted += 1;
            return;
        }
        let placed = self.timeline.follow(held.0);
        self.give(held, placed, frames);
    }

    pub(crate) fn has_begun(&self) -> bool {
        self.timeline.has_begun()
    }

    pub fn losses(&self) -> Losses {
        let Timeline { tracker, uncertain, .. } = &self.timeline;
        Losses {
            missing: tracker.missing(),
            gaps: tracker.gaps,
            duplicates: tracker.duplicates,
            reordered: tracker.reordered,
            damaged: self.contradicted,
            dropped_on_board: self.dropped_on_board,
            restarts: tracker.restarts,
            missing_edges: self.edges.missing(),
            edges_left_out: self.edges.left_out(),
            uncertain: *uncertain,
            ..Losses::default()
        }
    }
}

impl BoardFrame {
    pub fn new(time_us: i64, index: i64, measured: Measured) -> Self {
        Self { time_us, index, measured, ..Self::default() }
    }
}
