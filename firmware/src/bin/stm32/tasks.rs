//! A task for each concern, as the library has them.

use super::front_end::Photointerrupters;
use super::line::Stm32;
use super::storage::Area;
use super::sync_input::StampedEdges;
use super::time::{EmbassyClock, Independent};
use embassy_stm32::mode::Async;
use embassy_stm32::usart::{RingBufferedUartRx, UartTx};
use firmware::{Slots, Station};

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
pub(crate) async fn watch(station: &'static Stm32Station, watchdog: Independent) {
    station.watch(watchdog).await;
}
