//! Errors of methods over hundreds of cases with known truth: `cargo xtask check studies`.

mod file_intervals;
mod planned_orders;
mod prediction_intervals;
mod recalibration;
mod sittings;
mod stated_intervals;
