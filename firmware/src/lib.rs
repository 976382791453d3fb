//! The behaviour of the SkinProc board, independent of the hardware that it runs on.
//!
//! At every slot of a schedule, [`acquisition`] reads the eight channels through a [`FrontEnd`].
//! The core turns frames into samples, on request through the [`Converter`], executes commands, and
//! puts samples and answers into the outbox. [`Station`] has the tasks.
//!
//! A board is a binary with the traits of [`board`]. There is no heap, and every queue is bounded.
#![no_std]
#![forbid(unsafe_code)]
#![expect(async_fn_in_trait, reason = "one executor on one core: no future has to be Send")]

pub mod acquisition;
pub mod baud;
pub mod board;
mod core;
mod factory;
mod last_words;
mod line;
mod outbox;
mod setup;
mod slots;
mod station;
mod upload;
mod wrench;

pub use crate::setup::BoardSetup;
pub use acquisition::Settings;
pub use baud::Baud;
pub use board::{Chip, Clock, FrontEnd, NoChip, SeenEdge, Storage, StorageError, VITALS_US};
pub use factory::Factory;
pub use last_words::LastWords;
pub use slots::Slots;
pub use station::Station;
pub use upload::{RECORD, Record};
pub use wrench::Converter;

pub const VERSION: [u8; 3] = [
    part(env!("CARGO_PKG_VERSION_MAJOR")),
    part(env!("CARGO_PKG_VERSION_MINOR")),
    part(env!("CARGO_PKG_VERSION_PATCH")),
];

const fn part(digits: &str) -> u8 {
    match u8::from_str_radix(digits, 10) {
        Ok(part) => part,
        Err(_) => panic!("a part of the version does not fit in a byte"),
    }
}
