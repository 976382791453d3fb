//! Tests of reading, converting and aligning logs. Without `SHELLCAL_REAL_DATA` at build time,
//! tests on real recordings are ignored (`build.rs`).

#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    unreachable_pub,
    reason = "a test may panic and say why, and report its figures"
)]

mod align_command;
mod align_disturbed;
#[path = "../support/alignment.rs"]
#[allow(dead_code, reason = "each test program uses a part of it")]
mod alignment;
mod companion_files;
mod convert;
mod convert_formats;
mod drift;
mod foreign;
mod foreign_tables;
mod hints;
mod hostile;
mod instruments;
mod kept_columns;
mod library_files;
mod log_bad_input;
mod log_containers;
mod log_formats;
mod log_real;
mod noise;
mod one_pipeline;
mod outages;
mod payload;
mod payload_motion;
#[path = "../support/recording.rs"]
#[allow(dead_code, reason = "each test program uses a part of it")]
mod recording;
#[path = "../support/sealed.rs"]
#[allow(dead_code, reason = "each test program uses a part of it")]
mod sealed;
mod settings;
mod streams;
mod studies;
mod xdf;
