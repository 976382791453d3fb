//! Errors of methods over hundreds of sensors, sessions or trials with known truth: `cargo xtask
//! check studies`.

mod align_accuracy;
mod align_foreign;
