//! The firmware on the SkinProc board: STM32L432KC, Cortex-M4F, 32 pins.
//!
//! | pins | use |
//! |---|---|
//! | PA0 … PA7 | photointerrupters 1 to 8 (ADC1, IN5 to IN12) |
//! | PB0, PB1, PB3 … PB7, PA8 | their emitters, high is lit |
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
