//! Errors of methods over hundreds of cases with known truth: `cargo xtask check studies`.

mod align_accuracy;
mod align_foreign;
