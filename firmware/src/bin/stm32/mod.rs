//! What boards with an STM32L4 or STM32G4 have in common: drivers, faults, and the way from the reset to the
//! running firmware. Pins, clocks and interrupts are each board's own.
//!
//! The two families have the same flash, USART, EXTI, RNG, watchdog and basic timer at the same addresses. Their
//! converters differ in their clocks, in inputs, in the name of an interrupt, and in how two registers are called.

mod bootloader;
pub(crate) mod converter;
mod last_words;
pub(crate) mod start;
mod storage;
mod tasks;
