//! Pending changes of the serial line: another rate, or the chip's bootloader.

use crate::baud::Baud;

/// Trial of a new rate, µs; a host reopens its port within tens of ms.
const TRIAL_US: u64 = 3_000_000;

/// A change to make after the pending answers have left.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Change {
    Rate(Baud),
    Bootloader,
}

/// The line's rate. A new rate is reverted if nothing valid is heard at it; otherwise it could cut off a board.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct LineState {
    wanted: Option<Change>,
    /// `None` if the line has no rate to set.
    rate: Option<Baud>,
    trial: Option<RateTrial>,
}

#[derive(Clone, Copy, Debug)]
struct RateTrial {
    back_to: Baud,
    /// `None` while the line still has the previous rate.
    end_us: Option<u64>,
}

impl LineState {
    pub(crate) const fn new(rate: Option<Baud>) -> Self {
        Self { wanted: None, rate, trial: None }
    }

    pub(crate) fn want(&mut self, change: Change) {
        self.wanted = Some(change);
    }

    pub(crate) fn take(&mut self) -> Option<Change> {
        let change = self.wanted.take()?;
        if let (Change::Rate(rate), Some(old)) = (change, self.rate) {
            // Restoring the previous rate needs no trial.
            let is_back = self.trial.take().is_some_and(|trial| trial.back_to == rate);
            let is_new = rate != old && !is_back;
            self.trial = is_new.then_some(RateTrial { back_to: old, end_us: None });
            self.rate = Some(rate);
        }
        Some(change)
    }

    pub(crate) fn done(&mut self, now_us: u64) {
        if let Some(trial) = &mut self.trial {
            trial.end_us = Some(now_us + TRIAL_US);
        }
    }

    /// Confirms the rate, since something valid was heard, unless the line still had the previous rate.
    pub(crate) fn heard(&mut self) {
        self.trial = self.trial.filter(|trial| trial.end_us.is_none());
    }

    pub(crate) fn give_up(&mut self, now_us: u64) -> Option<Baud> {
        let is_over = |trial: &RateTrial| trial.end_us.is_some_and(|end_us| now_us >= end_us);
        let trial = self.trial.filter(is_over)?;
        self.want(Change::Rate(trial.back_to));
        Some(trial.back_to)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::baud::{FIRST, RATES};

    const FAST: Baud = RATES[4];

    /// A line with the fast rate since 1 ms.
    fn changed() -> LineState {
        let mut line = LineState::new(Some(FIRST));
        line.want(Change::Rate(FAST));
        assert_eq!(line.take(), Some(Change::Rate(FAST)));
        line.done(1_000);
        line
    }

    #[test]
    fn a_rate_without_reply_is_reverted_for_good() {
        let mut line = changed();
        assert_eq!(line.give_up(1_000 + TRIAL_US - 1), None);
        assert_eq!(line.give_up(1_000 + TRIAL_US), Some(FIRST));
        assert_eq!(line.take(), Some(Change::Rate(FIRST)));
        line.done(2_000 + TRIAL_US);
        assert_eq!((line.give_up(u64::MAX), line.take()), (None, None));
    }

    #[test]
    fn a_rate_with_a_reply_is_kept() {
        let mut line = changed();
        line.heard();
        assert_eq!(line.give_up(u64::MAX), None);
        line.want(Change::Rate(FAST));
        assert_eq!(line.take(), Some(Change::Rate(FAST)));
        line.done(0);
        assert_eq!(line.give_up(u64::MAX), None);
    }

    #[test]
    fn bytes_at_the_previous_rate_do_not_confirm_the_new_one() {
        let mut line = LineState::new(Some(FIRST));
        line.want(Change::Rate(FAST));
        line.take();
        line.heard();
        line.done(1_000);
        assert_eq!(line.give_up(1_000 + TRIAL_US), Some(FIRST));
    }
}
