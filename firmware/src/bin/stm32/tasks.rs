//! A task for each concern, as the library has them, with the clock and the line that they are given.

use super::bootloader;
use super::front_end::Photointerrupters;
use super::storage::Area;
use super::sync_input::StampedEdges;
use embassy_stm32::mode::Async;
use embassy_stm32::peripherals::IWDG;
use embassy_stm32::usart::{RingBufferedUartRx, UartTx};
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_time::{Instant, Timer};
use firmware::{Baud, Chip, Clock, Slots, Station};

pub(crate) struct EmbassyClock;

impl Clock for EmbassyClock {
    fn now_us(&self) -> u64 {
        Instant::now().as_micros()
    }

    async fn wait_until_us(&self, at_us: u64) {
        Timer::at(Instant::from_micros(at_us)).await;
    }
}

/// The chip. Its bootloader listens on USART1 at PA9 and PA10, as the firmware does (AN2606, "STM32L43xxx/44xxx").
struct Stm32;

impl Chip<UartTx<'static, Async>> for Stm32 {
    async fn set_baud(&mut self, sender: &mut UartTx<'static, Async>, rate: Baud) {
        // The receiver has the same divider. All rates of the table can be made.
        _ = sender.set_baudrate(rate.actual);
    }

    async fn start_bootloader(&mut self) {
        bootloader::enter()
    }
}

/// What the tasks share.
pub(crate) type Stm32Station = Station<'static, EmbassyClock>;

#[embassy_executor::task]
pub(crate) async fn acquire(station: &'static Stm32Station, front_end: Photointerrupters) {
    station.acquire(front_end).await;
}

#[embassy_executor::task]
pub(crate) async fn send(station: &'static Stm32Station, sender: UartTx<'static, Async>) {
    station.send(sender, Stm32).await;
}

#[embassy_executor::task]
pub(crate) async fn receive(
    station: &'static Stm32Station,
    receiver: RingBufferedUartRx<'static>,
    slots: Slots<Area>,
) {
    station.receive(receiver, slots).await;
}

#[embassy_executor::task]
pub(crate) async fn listen(station: &'static Stm32Station) {
    station.listen(StampedEdges).await;
}

#[embassy_executor::task]
pub(crate) async fn watch(
    station: &'static Stm32Station,
    mut watchdog: IndependentWatchdog<'static, IWDG>,
) {
    station.watch(|| watchdog.pet()).await;
}
