//! Code shared by boards with an STM32L4 or STM32G4: drivers, faults and start-up. Each board
//! defines its pins, clocks and interrupts.
//!
//! The two families have the same flash, USART, EXTI, RNG, watchdog and basic timer at the same
//! addresses. Their converters differ in clocks, in inputs, in the name of an interrupt, and in the
//! names of two registers.

mod bootloader;
pub(crate) mod converter;
mod last_words;
pub(crate) mod start;
mod storage;
mod tasks;
