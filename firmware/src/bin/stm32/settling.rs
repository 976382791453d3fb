//! TIM6: the time in which an emitter settles (RM0394, chapter 29; RM0440, chapter 30).
//!
//! It counts µs once, and its update is the trigger output, at which the converter starts.

use embassy_stm32::Peri;
use embassy_stm32::pac;
use embassy_stm32::pac::timer::vals::{Mms, Urs};
use embassy_stm32::peripherals::TIM6;
use embassy_stm32::time::Hertz;
use embassy_stm32::timer::low_level::Timer;

/// The timer.
pub(crate) struct SettlingTimer(Timer<'static, TIM6>);

impl SettlingTimer {
    pub(crate) fn new(timer: Peri<'static, TIM6>) -> Self {
        let mut timer = Timer::new(timer);
        timer.set_tick_freq(Hertz::mhz(1));
        // One pulse; only the end of the count is an update.
        timer.regs_core().cr1().modify(|control| {
            control.set_opm(true);
            control.set_urs(Urs::COUNTER_ONLY);
        });
        timer.regs_basic().cr2().modify(|control| control.set_mms(Mms::UPDATE));
        Self(timer)
    }

    /// From now on it counts so many µs, at least two: it does not count to zero.
    pub(crate) fn set(&self, us: u16) {
        let timer = self.0.regs_core();
        timer.arr().write(|reload| reload.set_arr(us.saturating_sub(1).max(1)));
        timer.cnt().write(|count| count.set_cnt(0));
    }
}

/// Counts. For the converter's interrupt, while the task that has the timer waits for that.
pub(crate) fn start() {
    pac::TIM6.cr1().modify(|control| control.set_cen(true));
}
