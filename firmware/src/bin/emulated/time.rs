//! Time from the CMSDK dual timer (Arm DDI0479, chapter 4), which runs at the core's clock.
//!
//! Timer 1 runs freely, 32 bits, and wraps every 171.8 s; timer 2 is the alarm. There is no
//! periodic interrupt: however late the emulator serves one, no time is lost.

use crate::registers::Block;
use core::cell::{Cell, RefCell};
use core::task::Waker;
use critical_section::{CriticalSection, Mutex};
use embassy_time_driver::{Driver, TICK_HZ};
use embassy_time_queue_utils::Queue;

/// The core's clock.
pub(crate) const CORE_HZ: u32 = 25_000_000;

const CLOCKS_PER_TICK: u64 = CORE_HZ as u64 / TICK_HZ;

/// Registers of timer 1; those of timer 2 are at an offset.
const LOAD: usize = 0x00;
const VALUE: usize = 0x04;
const CONTROL: usize = 0x08;
const CLEAR: usize = 0x0C;
const RAW_INTERRUPT: usize = 0x10;
const ALARM: usize = 0x20;

const ENABLE: u32 = 1 << 7;
const INTERRUPT: u32 = 1 << 5;
const WIDE: u32 = 1 << 1;
const ONE_SHOT: u32 = 1;

/// Longest time for which the alarm is set, in clocks; what is later is set again then.
const LONGEST: u64 = 1 << 31;

struct DualTimer {
    wraps: Mutex<Cell<u32>>,
    queue: Mutex<RefCell<Queue>>,
}

embassy_time_driver::time_driver_impl!(static DRIVER: DualTimer = DualTimer {
    wraps: Mutex::new(Cell::new(0)),
    queue: Mutex::new(RefCell::new(Queue::new())),
});

/// Starts counting.
pub(crate) fn start() {
    let timer = Block::DUAL_TIMER;
    timer.write(CONTROL, 0);
    timer.write(ALARM + CONTROL, 0);
    timer.write(LOAD, u32::MAX);
    timer.write(CONTROL, ENABLE | INTERRUPT | WIDE);
}

/// Serves the interrupt of either timer.
pub(crate) fn on_interrupt() {
    critical_section::with(|cs| {
        if Block::DUAL_TIMER.read(RAW_INTERRUPT) & 1 != 0 {
            Block::DUAL_TIMER.write(CLEAR, 1);
            let wraps = DRIVER.wraps.borrow(cs);
            wraps.set(wraps.get().wrapping_add(1));
        }
        DRIVER.set_alarm(cs);
    });
}

impl DualTimer {
    fn clocks(&self, cs: CriticalSection<'_>) -> u64 {
        let wraps = self.wraps.borrow(cs).get();
        let before = Block::DUAL_TIMER.read(VALUE);
        // A wrap that its interrupt has not counted yet; the value is read again, for it may be
        // from before the wrap.
        let wrapped = Block::DUAL_TIMER.read(RAW_INTERRUPT) & 1 != 0;
        let value = if wrapped { Block::DUAL_TIMER.read(VALUE) } else { before };
        let wraps = wraps.wrapping_add(u32::from(wrapped));
        u64::from(wraps) << 32 | u64::from(!value)
    }

    fn set_alarm(&self, cs: CriticalSection<'_>) {
        let timer = Block::DUAL_TIMER;
        let mut queue = self.queue.borrow(cs).borrow_mut();
        loop {
            let next = queue.next_expiration(self.clocks(cs) / CLOCKS_PER_TICK);
            timer.write(ALARM + CONTROL, 0);
            timer.write(ALARM + CLEAR, 1);
            if next == u64::MAX {
                return;
            }
            let wait = next.saturating_mul(CLOCKS_PER_TICK).saturating_sub(self.clocks(cs));
            if wait > 0 {
                timer.write(ALARM + LOAD, wait.min(LONGEST) as u32);
                timer.write(ALARM + CONTROL, ENABLE | INTERRUPT | WIDE | ONE_SHOT);
                return;
            }
        }
    }
}

impl Driver for DualTimer {
    fn now(&self) -> u64 {
        critical_section::with(|cs| self.clocks(cs)) / CLOCKS_PER_TICK
    }

    fn schedule_wake(&self, at: u64, waker: &Waker) {
        critical_section::with(|cs| {
            if self.queue.borrow(cs).borrow_mut().schedule_wake(at, waker) {
                self.set_alarm(cs);
            }
        });
    }
}
