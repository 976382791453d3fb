//! Errors of methods over hundreds of cases with known truth: `cargo xtask check studies`.

mod trial_intervals;
mod virtual_trials;
