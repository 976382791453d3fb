//! The flashed image, as executed: power cuts, wires, faults, noise. `cargo xtask test` builds the
//! image, sets up its microcontroller's model, and passes both in `SHELLCAL_FLASHED_IMAGE` and
//! `SHELLCAL_MODEL_PYTHON`.

mod host;
mod line;
mod power;
mod program;
mod studies;
mod wires;
