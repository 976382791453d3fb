//! The rate of USART1, and the way into the ROM's bootloader.

use super::bootloader;
use embassy_stm32::pac;
use embassy_time::{Duration, Timer};
use firmware::{Baud, Chip, baud};

/// The clock of USART1, Hz.
const CLOCK_HZ: u64 = baud::CLOCK_HZ as u64;

/// Between two looks at whether the last byte has left the buffer.
const LOOK: Duration = Duration::from_micros(100);

/// Bits of two bytes, one in the data register and one in the shift register, and one more.
const LAST_BITS: u64 = 21;

/// The chip.
pub(crate) struct Stm32;

impl Chip for Stm32 {
    const RATES: &'static [Baud] = &baud::RATES;

    /// It listens on USART1 at PA9 and PA10, as the firmware does (AN2606, "STM32L43xxx/44xxx").
    const HAS_BOOTLOADER: bool = true;

    async fn set_baud(&mut self, rate: Baud) {
        last_byte().await;
        critical_section::with(|_| {
            // The divider can be written only while the USART is off (RM0394, USART_BRR).
            pac::USART1.cr1().modify(|control| control.set_ue(false));
            pac::USART1.brr().write(|divider| divider.set_brr(rate.divider));
            pac::USART1.cr1().modify(|control| control.set_ue(true));
        });
    }

    async fn start_bootloader(&mut self) {
        last_byte().await;
        bootloader::enter()
    }
}

/// Waits until the last byte is on the line. The driver has the interrupt of an empty data register on as long
/// as there is something in its buffer, and has cleared the flag that the last byte has left.
async fn last_byte() {
    while pac::USART1.cr1().read().txeie() {
        Timer::after(LOOK).await;
    }
    let divider = u64::from(pac::USART1.brr().read().brr());
    Timer::after(Duration::from_micros(LAST_BITS * divider / (CLOCK_HZ / 1_000_000) + 1)).await;
}
