//! Time for firmware in a process, and edges at its sync input.

use std::cell::{Cell, RefCell};
use std::collections::VecDeque;
use std::future::poll_fn;
use std::pin::pin;
use std::rc::Rc;
use std::sync::Arc;
use std::task::{Context, Poll, Wake, Waker};
use std::thread::{self, Thread};
use std::time::{Duration, Instant};

use embassy_futures::yield_now;
use firmware::{Clock, SeenEdge};

/// Delay of a wake-up: merges the forty waits of a frame, each tens of µs of processor time.
const LATE: Duration = Duration::from_micros(250);

/// A clock that stops while the firmware computes, and shows exactly the awaited time.
///
/// The system wakes a process tens of µs late, and tens of ms late on a busy machine; a
/// microcontroller is less than one µs late. This clock skips waits until board and wall clock
/// agree again, so that frames start at their slots and none is skipped.
#[derive(Clone, Debug)]
pub struct PacedClock {
    start: Instant,
    time: Rc<Time>,
}

#[derive(Debug, Default)]
struct Time {
    now_us: Cell<u64>,
    /// Times that tasks wait for: the clock does not pass the first.
    waits_us: RefCell<Vec<u64>>,
}

impl PacedClock {
    pub fn start() -> Self {
        Self { start: Instant::now(), time: Rc::default() }
    }

    /// Runs the firmware to its end; sleeps until the first awaited time, or until it is woken.
    pub(super) fn run<F: Future>(&self, firmware: F) -> F::Output {
        let waker = Waker::from(Arc::new(WakeThread(thread::current())));
        let mut firmware = pin!(firmware);
        loop {
            if let Poll::Ready(output) = firmware.as_mut().poll(&mut Context::from_waker(&waker)) {
                return output;
            }
            let due = self.first_wait_us().map(Duration::from_micros);
            match due.and_then(|due| due.checked_add(LATE)) {
                Some(due) => thread::park_timeout(due.saturating_sub(self.start.elapsed())),
                None => thread::park(),
            }
        }
    }

    fn first_wait_us(&self) -> Option<u64> {
        self.time.waits_us.borrow().iter().copied().min()
    }

    fn advance(&self) {
        let wall_us = self.start.elapsed().as_micros() as u64;
        let reached_us = self.first_wait_us().map_or(wall_us, |first_us| first_us.min(wall_us));
        self.time.now_us.set(self.now_us().max(reached_us));
    }
}

impl Clock for PacedClock {
    fn now_us(&self) -> u64 {
        self.time.now_us.get()
    }

    async fn wait_until_us(&self, at_us: u64) {
        self.time.waits_us.borrow_mut().push(at_us);
        let _wait = Wait { time: &self.time, at_us };
        // Give other tasks their turn even if the time has passed already.
        yield_now().await;
        poll_fn(|_| {
            self.advance();
            if self.now_us() >= at_us { Poll::Ready(()) } else { Poll::Pending }
        })
        .await;
    }
}

struct WakeThread(Thread);

impl Wake for WakeThread {
    fn wake(self: Arc<Self>) {
        self.0.unpark();
    }
}

struct Wait<'t> {
    time: &'t Time,
    at_us: u64,
}

impl Drop for Wait<'_> {
    fn drop(&mut self) {
        let mut waits_us = self.time.waits_us.borrow_mut();
        if let Some(index) = waits_us.iter().position(|&it| it == self.at_us) {
            waits_us.swap_remove(index);
        }
    }
}

#[derive(Clone, Debug)]
pub(super) struct SyncScript {
    clock: PacedClock,
    times_us: VecDeque<u64>,
}

impl SyncScript {
    pub(super) fn new(clock: PacedClock, times_s: &[f64]) -> Self {
        let mut times_us: Vec<u64> = times_s.iter().map(|time_s| (time_s * 1e6) as u64).collect();
        times_us.sort_unstable();
        Self { clock, times_us: times_us.into() }
    }

    /// Waits for the next edge by polling: an alarm would stop the clock for earlier waits.
    pub(super) async fn next_edge(&mut self) -> SeenEdge {
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

#[cfg(test)]
mod tests {
    use embassy_futures::join::join;

    use super::*;

    /// One task waits long and is polled first; the clock must not pass the other's time.
    #[test]
    fn time_stops_for_each_waiting_task() {
        let clock = PacedClock::start();
        let mut seen = Vec::new();
        clock.run(join(clock.wait_until_us(20_000), async {
            for at_us in (1..=10).map(|it| it * 1000) {
                // Longer than the wait, so the wall clock is ahead.
                thread::sleep(Duration::from_millis(2));
                clock.wait_until_us(at_us).await;
                seen.push(clock.now_us());
            }
        }));
        assert_eq!(seen, (1..=10).map(|it| it * 1000).collect::<Vec<_>>());
        assert_eq!(clock.now_us(), 20_000);
    }
}
