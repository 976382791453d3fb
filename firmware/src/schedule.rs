//! When to take frames.

use core::num::{NonZeroU32, NonZeroU64};

/// How late a frame may start, in µs; a slot that cannot be kept so well is skipped. It is a hundredth of the 10 ms
/// period.
const TOLERANCE_US: u64 = 100;

/// Slots at a fixed distance from the first: the error of one does not carry over to the next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Schedule {
    next_us: u64,
    period_us: NonZeroU32,
}

impl Schedule {
    /// The first slot is at `first_us`, the others every `period_us`, which is at least 1.
    pub(crate) fn new(first_us: u64, period_us: u32) -> Self {
        let period_us = NonZeroU32::new(period_us).unwrap_or(NonZeroU32::MIN);
        Self { next_us: first_us, period_us }
    }

    /// Time of the next slot that can still be kept, and how many before it cannot.
    pub(crate) fn next(&mut self, now_us: u64) -> (u64, u32) {
        let latest_us = self.next_us.saturating_add(TOLERANCE_US);
        let late_us = now_us.saturating_sub(latest_us);
        if late_us == 0 {
            return (self.next_us, 0); // nearly always, and without a 64-bit division
        }
        let period_us = NonZeroU64::from(self.period_us);
        let skipped = late_us.div_ceil(period_us.get());
        self.next_us = self.next_us.saturating_add(skipped * period_us.get());
        (self.next_us, u32::try_from(skipped).unwrap_or(u32::MAX))
    }

    /// The slot that [`Schedule::next`] gave is used.
    pub(crate) fn advance(&mut self) {
        self.next_us = self.next_us.saturating_add(u64::from(self.period_us.get()));
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;
    use proptest::prelude::*;

    #[test]
    fn slots_do_not_drift_with_the_time_that_frames_take() {
        let mut schedule = Schedule::new(1_000, 10_000);
        for slot in 0..1_000_000 {
            let at = 1_000 + slot * 10_000;
            assert_eq!(schedule.next(at + slot % 100), (at, 0));
            schedule.advance();
        }
    }

    #[test]
    fn slots_that_have_passed_are_skipped_and_counted() {
        let mut schedule = Schedule::new(0, 10_000);
        schedule.advance();
        assert_eq!(schedule.next(10_100), (10_000, 0));
        assert_eq!(schedule.next(10_101), (20_000, 1));
        assert_eq!(schedule.next(54_321), (60_000, 4));
        schedule.advance();
        assert_eq!(schedule.next(60_500), (70_000, 0));
    }

    proptest! {
        #[test]
        fn every_slot_is_used_or_skipped_once(
            period_us in 1..20_000_u32,
            frames in prop::collection::vec(0..60_000_u64, 1..200),
        ) {
            let mut schedule = Schedule::new(7, period_us);
            let (mut now, mut slots) = (0, 0_u64);
            for frame_us in frames {
                let (at, skipped) = schedule.next(now);
                slots += u64::from(skipped);
                prop_assert_eq!(at, 7 + slots * u64::from(period_us));
                prop_assert!(now <= at + 100);
                slots += 1;
                schedule.advance();
                now = now.max(at) + frame_us;
            }
        }
    }
}
