//! The image that is flashed, executed: power cuts, wires, faults, noise.
//!
//! `cargo xtask test` builds the image, sets the model of its microcontroller up, and names both to these
//! tests.

mod host;
mod line;
mod measures;
mod power;
mod program;
mod wires;
