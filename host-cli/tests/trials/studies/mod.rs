//! How far methods err, over hundreds of sensors, sessions or trials whose truth is known: `cargo xtask check studies`.

mod trial_intervals;
mod virtual_trials;
