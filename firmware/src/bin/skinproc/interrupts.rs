//! Which interrupt goes to which driver.

use crate::converter;
use crate::sync_input::Stamp;
use embassy_stm32::{bind_interrupts, peripherals, usart};

bind_interrupts!(pub(crate) struct Irqs {
    USART1 => usart::BufferedInterruptHandler<peripherals::USART1>;
    EXTI15_10 => Stamp;
    ADC1 => converter::EndOfBurst;
    TIM6_DAC => converter::Settled;
});
