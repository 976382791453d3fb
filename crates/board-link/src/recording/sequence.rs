//! Order of numbered samples; missing, duplicate and late samples; and times of sync edges.

use std::collections::VecDeque;

use shared_proto::Edge;

/// Maximum distance at which a late sample can be distinguished from a repeat. XBee modules hold
/// only a few packets for retransmission.
pub(super) const WINDOW: u32 = u128::BITS;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Arrival {
    /// Newer than all before; samples in between have not arrived (yet).
    InOrder,
    /// Older than the newest; counted as missing until now.
    Late,
    Duplicate,
}

/// Unwraps 16-bit sequence numbers and counts missing, duplicate and late samples, with a window of bits over the
/// newest numbers (like RFC 4303 §3.4.3). A step of 32,768 or more counts as a step back.
#[derive(Clone, Debug, Default)]
pub(super) struct Tracker {
    newest: Option<i64>,
    oldest: i64,
    /// Bit i: index `newest - i` has arrived.
    arrived: u128,
    distinct: u64,
    missing_before_restart: u64,
    offset: i64,
    /// Number of runs of missing samples, each counted when a newer sample came.
    pub(super) gaps: u64,
    pub(super) duplicates: u64,
    pub(super) reordered: u64,
    pub(super) restarts: u64,
}

impl Tracker {
    pub(super) fn missing(&self) -> u64 {
        self.missing_before_restart + self.missing_since_restart()
    }

    fn missing_since_restart(&self) -> u64 {
        self.newest.map_or(0, |newest| ((newest - self.oldest + 1) as u64) - self.distinct)
    }

    /// Handles a restart: the next sample follows after `lost` missing ones, and its number starts a new numbering.
    pub(super) fn restart(&mut self, lost: u64) {
        let Some(newest) = self.newest else { return };
        self.missing_before_restart = self.missing() + lost;
        self.gaps += u64::from(lost > 0);
        self.restarts += 1;
        self.newest = None;
        self.offset = newest.saturating_add_unsigned(lost) + 1;
    }

    /// Takes a sample that was sent `sent` samples after the newest. Its number alone does not show this distance.
    pub(super) fn advance(&mut self, sent: u64) -> (i64, Arrival) {
        let index = self.newest.unwrap_or(self.offset - 1).saturating_add_unsigned(sent);
        self.newest = Some(index);
        self.arrived = 1;
        self.distinct += 1;
        self.gaps += u64::from(sent > 1);
        (index, Arrival::InOrder)
    }

    /// Returns the unwrapped index of a sample, and how it arrived. The first index is the sequence
    /// number; a late sample can precede it.
    pub(super) fn position(&mut self, sequence: u16) -> (i64, Arrival) {
        let Some(newest) = self.newest else {
            let first = if self.offset == 0 { i64::from(sequence) } else { self.offset };
            // From here on `index - offset` is congruent to the sequence number.
            self.offset = first - i64::from(sequence);
            (self.newest, self.oldest) = (Some(first), first);
            (self.arrived, self.distinct) = (1, 1);
            return (first, Arrival::InOrder);
        };
        let step = sequence.wrapping_sub((newest - self.offset) as u16) as i16;
        let index = newest + i64::from(step);
        if step > 0 {
            let step = step.unsigned_abs();
            self.arrived = self.arrived.checked_shl(u32::from(step)).unwrap_or(0) | 1;
            self.newest = Some(index);
            self.distinct += 1;
            self.gaps += u64::from(step > 1);
            return (index, Arrival::InOrder);
        }
        let back = u32::from(step.unsigned_abs());
        if back >= WINDOW {
            self.restart(0);
            return self.position(sequence);
        }
        let bit = 1 << back;
        if self.arrived & bit != 0 {
            self.duplicates += 1;
            return (index, Arrival::Duplicate);
        }
        self.arrived |= bit;
        self.distinct += 1;
        self.oldest = self.oldest.min(index);
        self.reordered += 1;
        (index, Arrival::Late)
    }
}

/// Maximum number of edges that wait for a row, which comes at least every ten seconds; a board
/// sends a few hundred per second.
const MOST_WAITING: usize = 4096;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BoardEdge {
    /// Number of earlier edges, unwrapped.
    pub number: i64,
    pub time_us: i64,
}

/// Edges that wait for frames; every frame carries at most one.
#[derive(Clone, Debug, Default)]
pub(super) struct EdgeTracker {
    tracker: Tracker,
    /// Number, unwrapped, and the board's clock.
    waiting: VecDeque<(i64, u32)>,
    left_out: u64,
}

impl EdgeTracker {
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

    /// Handles a start of the board: numbers begin again, and no frame carries earlier edges.
    pub(super) fn restart(&mut self) {
        self.tracker.restart(0);
        self.left_out += self.waiting.drain(..).count() as u64;
    }

    /// Returns a frame's edge. The clock wraps every 71.6 min; the edge is within half of that.
    pub(super) fn give(&mut self, clock_us: u32, time_us: i64) -> Option<BoardEdge> {
        let (number, at_us) = self.waiting.pop_front()?;
        let since_us = i64::from(at_us.wrapping_sub(clock_us).cast_signed());
        Some(BoardEdge { number, time_us: time_us + since_us })
    }

    pub(super) fn missing(&self) -> u64 {
        self.tracker.missing()
    }

    pub(super) fn left_out(&self) -> u64 {
        self.left_out + self.waiting.len() as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::HashSet;

    fn placed(numbers: &[u16]) -> (Tracker, Vec<(i64, Arrival)>) {
        let mut tracker = Tracker::default();
        let placed = numbers.iter().map(|&number| tracker.position(number)).collect();
        (tracker, placed)
    }

    const NEXT: Arrival = Arrival::InOrder;

    #[test]
    fn numbers_in_order_have_no_losses_across_the_wrap() {
        let (tracker, placed) = placed(&[65_534, 65_535, 0, 1]);
        assert_eq!(placed, [(65_534, NEXT), (65_535, NEXT), (65_536, NEXT), (65_537, NEXT)]);
        assert_eq!((tracker.missing(), tracker.gaps), (0, 0));
    }

    #[test]
    fn a_late_sample_fills_its_gap_and_a_second_one_is_a_duplicate() {
        let (tracker, _) = placed(&[10, 13]);
        assert_eq!((tracker.missing(), tracker.gaps), (2, 1));
        let (tracker, placed) = placed(&[10, 13, 11, 11, 14]);
        assert_eq!(
            placed[1..],
            [(13, NEXT), (11, Arrival::Late), (11, Arrival::Duplicate), (14, NEXT)]
        );
        assert_eq!((tracker.missing(), tracker.gaps), (1, 1));
        assert_eq!((tracker.duplicates, tracker.reordered), (1, 1));
    }

    #[test]
    fn samples_may_come_before_the_first_that_arrived() {
        let (tracker, placed) = placed(&[1, 65_535]);
        assert_eq!(placed[1], (-1, Arrival::Late));
        assert_eq!(tracker.missing(), 1);
    }

    #[test]
    fn a_number_far_behind_is_a_restart_and_its_index_goes_on() {
        let (tracker, placed) = placed(&[500, 502, 0, 1]);
        assert_eq!(placed[2..], [(503, NEXT), (504, NEXT)]);
        assert_eq!((tracker.restarts, tracker.missing()), (1, 1));
    }

    #[test]
    fn an_announced_restart_is_not_a_gap() {
        let mut tracker = Tracker::default();
        tracker.position(40_000);
        tracker.restart(0);
        assert_eq!(tracker.position(3), (40_001, NEXT));
        assert_eq!(tracker.position(5), (40_003, NEXT));
        assert_eq!((tracker.restarts, tracker.missing()), (1, 1));
    }

    #[test]
    fn edges_are_given_out_once_with_their_times_across_the_wrap_of_the_clock() {
        let mut edges = EdgeTracker::default();
        for (number, clock_us) in [(65_535, u32::MAX - 9), (65_535, u32::MAX - 9), (0, 20)] {
            edges.take(Edge { number, clock_us });
        }
        // Clock 10 is 5 s on the time axis of the recording.
        let at = |number, time_us| Some(BoardEdge { number, time_us });
        assert_eq!(edges.give(10, 5_000_000), at(65_535, 4_999_980));
        assert_eq!(edges.give(110, 5_000_100), at(65_536, 5_000_010));
        assert_eq!(edges.give(210, 5_000_200), None);
        edges.take(Edge { number: 3, clock_us: 250 });
        assert_eq!((edges.missing(), edges.left_out()), (2, 1));
        edges.restart();
        assert_eq!((edges.give(0, 0), edges.left_out()), (None, 1));
    }

    proptest! {
        // Compares with sets of numbers that do not wrap.
        #[test]
        fn counts_equal_those_of_a_record_of_all_arrivals(
            start in 0..65_536_i64,
            steps in prop::collection::vec((0..4_i64, 0..100_i64), 1..300),
        ) {
            let mut tracker = Tracker::default();
            let (mut seen, mut newest, mut late, mut double) = (HashSet::new(), i64::MIN, 0, 0);
            let mut next = start;
            let mut first = None;
            for (ahead, behind) in steps {
                // The tracker gets the first number below 65,536.
                next += if first.is_some() { ahead } else { 0 };
                // A number before the first would look like a restart.
                let number = (next - behind).max(first.unwrap_or(next));
                first.get_or_insert(number);
                let arrival = tracker.position(number as u16);
                if !seen.insert(number) {
                    double += 1;
                } else if number < newest {
                    late += 1;
                }
                newest = newest.max(number);
                prop_assert_eq!(arrival.0, number);
            }
            let span = newest - first.unwrap() + 1;
            prop_assert_eq!(tracker.missing(), span as u64 - seen.len() as u64);
            prop_assert_eq!((tracker.reordered, tracker.duplicates), (late, double));
        }
    }
}
