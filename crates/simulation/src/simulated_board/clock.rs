//! Time for firmware in a process of an operating system.

use std::cell::{Cell, RefCell};
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
    time: Rc<Time>,
}

/// What the tasks of a board share.
#[derive(Debug, Default)]
struct Time {
    now_us: Cell<u64>,
    /// What is waited for, by all tasks: the time does not go past the first.
    waits_us: RefCell<Vec<u64>>,
}

impl PacedClock {
    /// It is zero now.
    pub fn start() -> Self {
        Self { start: Instant::now(), time: Rc::default() }
    }

    /// Follows the wall as far as the first time that is waited for.
    fn advance(&self) {
        let Time { now_us, waits_us } = &*self.time;
        let first_us = waits_us.borrow().iter().copied().fold(u64::MAX, u64::min);
        now_us.set(now_us.get().max(self.start.elapsed().as_micros().min(first_us)));
    }
}

impl Clock for PacedClock {
    fn now_us(&self) -> u64 {
        self.time.now_us.get()
    }

    async fn wait_until_us(&self, at_us: u64) {
        let _wait = Wait::new(&self.time, at_us);
        // Others have their turn even when there is nothing to wait for.
        yield_now().await;
        let far = Duration::from_secs(3600);
        let due = self.start.checked_add(Duration::from_micros(at_us));
        let due = due.and_then(|due| due.checked_add(LATE));
        let mut timer = pin!(Timer::at(due.unwrap_or(Instant::now() + far)));
        poll_fn(|context| {
            self.advance();
            if self.now_us() >= at_us {
                return Poll::Ready(());
            }
            // Due, but somebody waits for an earlier time and has the next turn.
            if timer.as_mut().poll(context).is_ready() {
                context.waker().wake_by_ref();
            }
            Poll::Pending
        })
        .await;
    }
}

/// A time that is waited for, until it is dropped.
struct Wait<'t> {
    time: &'t Time,
    at_us: u64,
}

impl<'t> Wait<'t> {
    fn new(time: &'t Time, at_us: u64) -> Self {
        time.waits_us.borrow_mut().push(at_us);
        Self { time, at_us }
    }
}

impl Drop for Wait<'_> {
    fn drop(&mut self) {
        let mut waits_us = self.time.waits_us.borrow_mut();
        if let Some(index) = waits_us.iter().position(|&it| it == self.at_us) {
            waits_us.swap_remove(index);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::thread;

    use embassy_futures::join::join;

    use super::*;

    /// One waits long and is polled first, whenever the machine wakes the process; nothing that the other
    /// waits for is passed.
    #[test]
    fn time_stops_for_each_that_waits() {
        let clock = PacedClock::start();
        let mut seen = Vec::new();
        pollster::block_on(join(clock.wait_until_us(20_000), async {
            for at_us in (1..=10).map(|it| it * 1000) {
                // Longer than the wait: the wall is ahead.
                thread::sleep(std::time::Duration::from_millis(2));
                clock.wait_until_us(at_us).await;
                seen.push(clock.now_us());
            }
        }));
        assert_eq!(seen, (1..=10).map(|it| it * 1000).collect::<Vec<_>>());
        assert_eq!(clock.now_us(), 20_000);
    }
}
