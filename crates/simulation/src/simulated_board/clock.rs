//! Time for firmware in a process of an operating system.

use std::cell::Cell;
use std::future::poll_fn;
use std::pin::pin;
use std::rc::Rc;
use std::task::Poll;

use embassy_futures::yield_now;
use embassy_time::{Duration, Instant, Timer};
use firmware::Clock;

/// A process that is waited for is woken so much later, and makes up for it without waiting: the forty waits of a frame
/// are then a few, where each takes the system some tens of µs of processor time.
const LATE: Duration = Duration::from_micros(250);

/// A clock that stands still while the firmware computes, and shows exactly the time that was
/// waited for.
///
/// A process is woken tens of µs late as a rule and tens of ms late on a busy machine, where a
/// microcontroller is late by less than one. This clock does not show it: what was late is made up
/// for, by not waiting, until board and wall agree again. So frames start at their slots, and none
/// is skipped because the machine had other things to do.
#[derive(Clone, Debug)]
pub struct PacedClock {
    start: Instant,
    now_us: Rc<Cell<u64>>,
}

impl PacedClock {
    /// It is zero now.
    pub fn start() -> Self {
        Self { start: Instant::now(), now_us: Rc::default() }
    }

    fn advance(&self, to_us: u64) {
        self.now_us.set(self.now_us.get().max(to_us));
    }
}

impl Clock for PacedClock {
    fn now_us(&self) -> u64 {
        self.now_us.get()
    }

    async fn wait_until_us(&self, at_us: u64) {
        // Others have their turn even when there is nothing to wait for.
        yield_now().await;
        let far = Duration::from_secs(3600);
        let due = self.start.checked_add(Duration::from_micros(at_us));
        let due = due.and_then(|due| due.checked_add(LATE));
        let mut timer = pin!(Timer::at(due.unwrap_or(Instant::now() + far)));
        poll_fn(|context| {
            // Whatever wakes the firmware, the time has gone on; but never past what is waited for.
            let elapsed_us = self.start.elapsed().as_micros();
            self.advance(elapsed_us.min(at_us));
            match elapsed_us >= at_us {
                true => Poll::Ready(()),
                false => timer.as_mut().poll(context),
            }
        })
        .await;
    }
}
