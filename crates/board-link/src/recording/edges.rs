//! Edges at the sync input, on the time of the frames.

use std::collections::VecDeque;

use super::sequence::{Arrival, Tracker};
use shared_proto::Edge;

/// Most edges that wait for a row. A board sends at most some hundred in a second, and has a row in ten.
const MOST_WAITING: usize = 4096;

/// An edge at the board's sync input.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BoardEdge {
    /// The edges that the board had seen before, unwrapped.
    pub number: i64,
    /// When it was, on the clock of the frames, µs.
    pub time_us: i64,
}

/// Edges that have arrived, until a frame takes them: every frame takes one.
#[derive(Clone, Debug, Default)]
pub(super) struct EdgeTracker {
    tracker: Tracker,
    /// Number, unwrapped, and the board's clock.
    waiting: VecDeque<(i64, u32)>,
    /// Edges that no frame has taken and none will.
    left_out: u64,
}

impl EdgeTracker {
    /// An edge has arrived.
    pub(super) fn take(&mut self, edge: Edge) {
        let (number, arrival) = self.tracker.position(edge.number);
        if arrival == Arrival::Duplicate {
            return;
        }
        if self.waiting.len() >= MOST_WAITING {
            self.waiting.pop_front();
            self.left_out += 1;
        }
        self.waiting.push_back((number, edge.clock_us));
    }

    /// The board has started: its numbers begin anew, and what it has said before has no frame after it.
    pub(super) fn restart(&mut self) {
        self.tracker.restart(0);
        self.left_out += self.waiting.drain(..).count() as u64;
    }

    /// The edge for a frame with this clock and time. The clock wraps around every 71.6 min; an edge is within
    /// half of that of the frame that takes it.
    pub(super) fn give(&mut self, clock_us: u32, time_us: i64) -> Option<BoardEdge> {
        let (number, at_us) = self.waiting.pop_front()?;
        let since_us = i64::from(at_us.wrapping_sub(clock_us).cast_signed());
        Some(BoardEdge { number, time_us: time_us + since_us })
    }

    /// Edges that the board has seen and that are not here, nor will be.
    pub(super) fn missing(&self) -> u64 {
        self.tracker.missing()
    }

    /// Edges that have arrived and that no frame has taken.
    pub(super) fn left_out(&self) -> u64 {
        self.left_out + self.waiting.len() as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_are_given_out_once_with_their_times_across_the_wrap_of_the_clock() {
        let mut edges = EdgeTracker::default();
        for (number, clock_us) in [(65_535, u32::MAX - 9), (65_535, u32::MAX - 9), (0, 20)] {
            edges.take(Edge { number, clock_us });
        }
        // A frame at clock 10, which is 5 s on the time of the recording.
        let at = |number, time_us| Some(BoardEdge { number, time_us });
        assert_eq!(edges.give(10, 5_000_000), at(65_535, 4_999_980));
        assert_eq!(edges.give(110, 5_000_100), at(65_536, 5_000_010));
        assert_eq!(edges.give(210, 5_000_200), None);
        edges.take(Edge { number: 3, clock_us: 250 });
        assert_eq!((edges.missing(), edges.left_out()), (2, 1));
        edges.restart();
        assert_eq!((edges.give(0, 0), edges.left_out()), (None, 1));
    }
}
