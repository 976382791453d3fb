//! Putting numbered samples back in order: what is missing, double or late.

/// How far behind the newest sample one may arrive and still be distinguished from a repeat.
///
/// XBee modules hold a few packets for repeated transmission, never this many.
pub(super) const WINDOW: u32 = u128::BITS;

/// How a sample arrived.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Arrival {
    /// Newer than any before.
    InOrder {
        /// Samples between it and the newest before that have not arrived (yet).
        missing: u64,
    },
    /// After a newer one; it was counted as missing until now.
    Late,
    /// Arrived before.
    Duplicate,
}

/// Unwraps 16-bit sequence numbers and counts what is missing, double or late.
///
/// A window of bits over the newest numbers, as in the anti-replay service of RFC 4303 §3.4.3. A
/// step of 32,768 or more cannot be distinguished from one backwards.
#[derive(Clone, Debug, Default)]
pub(super) struct Tracker {
    /// Newest index; `None` before the first sample.
    newest: Option<i64>,
    oldest: i64,
    /// Bit i: index `newest - i` has arrived.
    arrived: u128,
    distinct: u64,
    missing_before_restart: u64,
    /// What to add to an unwrapped number to make its index.
    offset: i64,
    /// Times that one or more samples in a row were missing when a newer one came.
    pub(super) gaps: u64,
    /// Samples that had arrived before.
    pub(super) duplicates: u64,
    /// Samples that came after a newer one.
    pub(super) reordered: u64,
    /// Times that the numbering began anew.
    pub(super) restarts: u64,
}

impl Tracker {
    /// Samples between the oldest and the newest that have not arrived.
    pub(super) fn missing(&self) -> u64 {
        self.missing_before_restart + self.missing_since_restart()
    }

    fn missing_since_restart(&self) -> u64 {
        self.newest.map_or(0, |newest| ((newest - self.oldest + 1) as u64) - self.distinct)
    }

    /// The board has started anew: the next sample is a first one, and follows on the newest with so many
    /// lost between them.
    pub(super) fn restart(&mut self, lost: u64) {
        let Some(newest) = self.newest else { return };
        self.missing_before_restart = self.missing() + lost;
        self.gaps += u64::from(lost > 0);
        self.restarts += 1;
        self.newest = None;
        self.offset = newest.saturating_add_unsigned(lost) + 1;
    }

    /// Takes a sample that was sent so many after the newest, which its number alone does not tell.
    pub(super) fn advance(&mut self, sent: u64) -> (i64, Arrival) {
        let index = self.newest.unwrap_or(self.offset - 1).saturating_add_unsigned(sent);
        self.newest = Some(index);
        self.arrived = 1;
        self.distinct += 1;
        self.gaps += u64::from(sent > 1);
        (index, Arrival::InOrder { missing: sent.saturating_sub(1) })
    }

    /// The index of a sample, which does not wrap, and how it arrived.
    ///
    /// The first index is the sequence number itself; a sample that comes late can precede it.
    pub(super) fn position(&mut self, sequence: u16) -> (i64, Arrival) {
        let Some(newest) = self.newest else {
            let first = if self.offset == 0 { i64::from(sequence) } else { self.offset };
            // From here on `index - offset` is congruent to the sequence number.
            self.offset = first - i64::from(sequence);
            (self.newest, self.oldest) = (Some(first), first);
            (self.arrived, self.distinct) = (1, 1);
            return (first, Arrival::InOrder { missing: 0 });
        };
        let step = sequence.wrapping_sub((newest - self.offset) as u16) as i16;
        let index = newest + i64::from(step);
        if step > 0 {
            let step = step.unsigned_abs();
            self.arrived = self.arrived.checked_shl(u32::from(step)).unwrap_or(0) | 1;
            self.newest = Some(index);
            self.distinct += 1;
            self.gaps += u64::from(step > 1);
            return (index, Arrival::InOrder { missing: u64::from(step - 1) });
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

    const NEXT: Arrival = Arrival::InOrder { missing: 0 };

    #[test]
    fn numbers_in_order_have_no_losses_across_the_wrap() {
        let (tracker, placed) = placed(&[65_534, 65_535, 0, 1]);
        assert_eq!(placed, [(65_534, NEXT), (65_535, NEXT), (65_536, NEXT), (65_537, NEXT)]);
        assert_eq!((tracker.missing(), tracker.gaps), (0, 0));
    }

    #[test]
    fn a_late_sample_fills_its_gap_and_a_second_one_is_a_duplicate() {
        let (tracker, placed) = placed(&[10, 13, 11, 11, 14]);
        assert_eq!(
            placed[1..],
            [
                (13, Arrival::InOrder { missing: 2 }),
                (11, Arrival::Late),
                (11, Arrival::Duplicate),
                (14, NEXT)
            ]
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
        assert_eq!(tracker.position(5), (40_003, Arrival::InOrder { missing: 1 }));
        assert_eq!((tracker.restarts, tracker.missing()), (1, 1));
    }

    proptest! {
        // Against bookkeeping with sets over numbers that do not wrap.
        #[test]
        fn counts_are_those_of_a_record_of_all_arrivals(
            start in 0..65_536_i64,
            steps in prop::collection::vec((0..4_i64, 0..100_i64), 1..300),
        ) {
            let mut tracker = Tracker::default();
            let (mut seen, mut newest, mut late, mut double) = (HashSet::new(), i64::MIN, 0, 0);
            let mut next = start;
            let mut first = None;
            for (ahead, behind) in steps {
                // The first number is as the tracker gets it, below 65,536.
                next += if first.is_some() { ahead } else { 0 };
                // Not before the first, which the record could not tell from a restart.
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
