//! Errors of methods over hundreds of sensors, sessions or trials with known truth: `cargo xtask
//! check studies`.

mod trial_intervals;
mod virtual_trials;
