//! How far methods err, over hundreds of sensors, sessions or trials whose truth is known: `cargo xtask check studies`.

mod align_accuracy;
mod align_foreign;
