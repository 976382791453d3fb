//! Which interrupt goes to which driver.

use crate::sync_input::Stamp;
use embassy_stm32::{bind_interrupts, dma, peripherals, usart};

bind_interrupts!(pub(crate) struct Irqs {
    USART1 => usart::BufferedInterruptHandler<peripherals::USART1>;
    EXTI15_10 => Stamp;
    DMA1_CHANNEL1 => dma::InterruptHandler<peripherals::DMA1_CH1>;
});
