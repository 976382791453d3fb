//! The library's tasks as embassy tasks, with their clock, serial line and sync input.
//!
//! The sync input has an executor whose interrupt has priority, so that edges are stamped while
//! frames are taken. A stamp is late by two interrupts plus any critical section: a few µs (a test
//! on the chip's model allows 20), and 25 ms while a flash page is erased.

use super::bootloader;
use super::converter::Photointerrupters;
use super::storage::Area;
use embassy_stm32::exti::ExtiInput;
use embassy_stm32::mode::Async;
use embassy_stm32::peripherals::IWDG;
use embassy_stm32::usart::{RingBufferedUartRx, UartTx};
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::channel::Channel;
use embassy_time::{Duration, Instant, Timer};
use firmware::{Baud, Chip, Clock, SeenEdge, Slots, Station};

pub(crate) struct EmbassyClock;

impl Clock for EmbassyClock {
    fn now_us(&self) -> u64 {
        Instant::now().as_micros()
    }

    async fn wait_until_us(&self, at_us: u64) {
        Timer::at(Instant::from_micros(at_us)).await;
    }
}

/// The chip, whose bootloader also listens on USART1 at PA9 and PA10 (AN2606, "STM32L43xxx/44xxx").
struct Stm32;

impl Chip<UartTx<'static, Async>> for Stm32 {
    async fn set_baud(&mut self, sender: &mut UartTx<'static, Async>, rate: Baud) {
        // The receiver shares the divider; every rate of the table is possible.
        _ = sender.set_baudrate(rate.actual);
    }

    async fn start_bootloader(&mut self) {
        bootloader::enter()
    }
}

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
    station.listen(async || SEEN.receive().await).await;
}

#[embassy_executor::task]
pub(crate) async fn watch(
    station: &'static Stm32Station,
    mut watchdog: IndependentWatchdog<'static, IWDG>,
) {
    station.watch(|| watchdog.pet()).await;
}

const WAITING: usize = 8;

/// Number of edges without room after which the input is ignored for a while: so many are not a signal.
const MOST_MISSED: u16 = 256;

const REST: Duration = Duration::from_millis(10);

static SEEN: Channel<CriticalSectionRawMutex, SeenEdge, WAITING> = Channel::new();

#[embassy_executor::task]
pub(crate) async fn stamp(mut input: ExtiInput<'static, Async>) {
    let mut missed = 0;
    loop {
        input.wait_for_rising_edge().await;
        let at_us = Instant::now().as_micros();
        if SEEN.try_send(SeenEdge { at_us, missed }).is_ok() {
            missed = 0;
            continue;
        }
        missed = missed.saturating_add(1);
        if missed.is_multiple_of(MOST_MISSED) {
            Timer::after(REST).await;
        }
    }
}
