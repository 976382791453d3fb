//! The image that is flashed, executed: power cuts, wires, faults, noise.
//!
//! `cargo xtask test` builds the image, sets up the model of its microcontroller, and names both to these tests:
//! `SHELLCAL_FLASHED_IMAGE` and `SHELLCAL_MODEL_PYTHON`.

mod host;
mod line;
mod power;
mod program;
mod studies;
mod wires;
