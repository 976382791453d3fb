//! Tests of the flashed image, as executed: power cuts, wires, faults, noise.
//!
//! `cargo xtask test` builds the image, sets up the model of its microcontroller, and passes both to these
//! tests: `SHELLCAL_FLASHED_IMAGE` and `SHELLCAL_MODEL_PYTHON`.

mod host;
mod line;
mod power;
mod program;
mod studies;
mod wires;
