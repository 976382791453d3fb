//! How far methods err, over hundreds of sensors, sessions or trials whose truth is known: `cargo xtask check studies`.

mod align_accuracy;
mod align_foreign;
mod file_intervals;
mod prediction_intervals;
mod recalibration;
mod stated_intervals;
mod trial_intervals;
mod virtual_trials;
