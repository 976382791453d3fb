//! The clock and the watchdog.

use embassy_stm32::Peri;
use embassy_stm32::peripherals::IWDG;
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_time::{Instant, Timer};
use firmware::{Clock, Watchdog};

const WATCHDOG_US: u32 = 1_000_000;

pub(crate) struct EmbassyClock;

impl Clock for EmbassyClock {
    fn now_us(&self) -> u64 {
        Instant::now().as_micros()
    }

    async fn wait_until_us(&self, at_us: u64) {
        Timer::at(Instant::from_micros(at_us)).await;
    }
}

pub(crate) struct Independent(IndependentWatchdog<'static, IWDG>);

impl Independent {
    /// From now on the firmware has to be quick.
    pub(crate) fn start(watchdog: Peri<'static, IWDG>) -> Self {
        let mut watchdog = IndependentWatchdog::new(watchdog, WATCHDOG_US);
        watchdog.unleash();
        Self(watchdog)
    }
}

impl Watchdog for Independent {
    fn feed(&mut self) {
        self.0.pet();
    }
}
