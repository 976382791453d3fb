//! Edges at the sync input at given times.

use std::collections::VecDeque;
use std::future::poll_fn;
use std::task::Poll;

use firmware::{Clock, SeenEdge, SyncInput};

use super::PacedClock;

/// A signal that somebody has written down.
#[derive(Clone, Debug)]
pub(super) struct SyncScript {
    clock: PacedClock,
    /// Times of the edges that are still to come, µs, in their order.
    times_us: VecDeque<u64>,
}

impl SyncScript {
    /// Edges at these times of the board, s.
    pub(super) fn new(clock: PacedClock, times_s: &[f64]) -> Self {
        let mut times_us: Vec<u64> = times_s.iter().map(|time_s| (time_s * 1e6) as u64).collect();
        times_us.sort_unstable();
        Self { clock, times_us: times_us.into() }
    }
}

impl SyncInput for SyncScript {
    /// Looks whenever the board is awake and sets no alarm of its own: the clock would show the time of
    /// that to who waits for an earlier one.
    async fn next_edge(&mut self) -> SeenEdge {
        poll_fn(|_| match self.times_us.front() {
            Some(&at_us) if at_us <= self.clock.now_us() => {
                self.times_us.pop_front();
                Poll::Ready(SeenEdge { at_us, missed: 0 })
            }
            _ => Poll::Pending,
        })
        .await
    }
}
