//! Code shared by boards with an STM32L4 or STM32G4: drivers, faults and start-up. Each board
//! defines its pins, clocks and interrupts.
//!
//! Both families have the same flash, USART, EXTI, RNG, watchdog and basic timer at the same
//! addresses. Their converters differ in clocks, inputs, and names of an interrupt and two
//! registers.

mod bootloader;
pub(crate) mod converter;
mod last_words;
pub(crate) mod start;
mod storage;
mod tasks;
