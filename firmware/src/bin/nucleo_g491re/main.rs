//! The firmware on a Nucleo-G491RE: STM32G491RE, Cortex-M4F, 64 pins.
//!
//! | pins | use |
//! |---|---|
//! | PA0, PA1, PB0, PC1, PC0, PC2, PC3, PB1 | photointerrupters 1 to 8 (ADC1, IN1, 2, 15, 7, 6, 8, 9, 12) |
//! | PB5, PB10, PA8, PC7, PB6, PA7, PA6, PA5 | their emitters, high is lit |
//! | PA9, PA10, PA11, PA12 | XBee: TX, RX (pulled up), CTS (pulled down), RTS (USART1) |
//! | PA15 | sync input, rising edges (EXTI; pulled up, as it is after a reset as JTDI) |
//! | PA13, PA14 | debugger (SWD), defmt over RTT |
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod board;
#[cfg(target_os = "none")]
#[path = "../stm32/mod.rs"]
mod stm32;

#[cfg(not(target_os = "none"))]
fn main() {}
