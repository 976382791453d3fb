#![allow(clippy::unwrap_used, reason = "a test may panic and say why")]

mod clamped;
mod closeness;
mod independent;
mod quartic;
mod reference;
mod stress;
