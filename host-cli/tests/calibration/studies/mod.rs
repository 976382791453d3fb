//! How far methods err, over hundreds of sensors, sessions or trials whose truth is known: `cargo xtask check studies`.

mod file_intervals;
mod planned_orders;
mod prediction_intervals;
mod recalibration;
mod sittings;
mod stated_intervals;
