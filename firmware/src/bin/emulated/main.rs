//! The firmware on a Cortex-M4F in emulation: QEMU's `mps2-an386`.
//!
//! QEMU has no model of the STM32's converter, timers and serial port, so this board has its own
//! layer of each under the same library. What it measures is what somebody has put into its memory,
//! see [`front_end`].
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod executor;
#[cfg(target_os = "none")]
mod front_end;
#[cfg(target_os = "none")]
mod orders;
#[cfg(target_os = "none")]
mod registers;
#[cfg(target_os = "none")]
mod start;
#[cfg(target_os = "none")]
mod time;
#[cfg(target_os = "none")]
mod uart;

#[cfg(not(target_os = "none"))]
fn main() {}
