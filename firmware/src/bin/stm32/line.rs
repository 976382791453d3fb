//! The serial line: its rate, and the way into the ROM's bootloader, which listens on it, too.

use super::bootloader;
use embassy_stm32::mode::Async;
use embassy_stm32::usart::UartTx;
use firmware::{Baud, Chip};

/// The chip. Its bootloader listens on USART1 at PA9 and PA10, as the firmware does (AN2606, "STM32L43xxx/44xxx").
pub(crate) struct Stm32;

impl Chip<UartTx<'static, Async>> for Stm32 {
    async fn set_baud(&mut self, sender: &mut UartTx<'static, Async>, rate: Baud) {
        // The receiver has the same divider. All rates of the table can be made.
        _ = sender.set_baudrate(rate.actual);
    }

    async fn start_bootloader(&mut self) {
        bootloader::enter()
    }
}
