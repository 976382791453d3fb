//! Tests of trials, simulations and their documents.
//!
//! Tests on real recordings are ignored unless `SHELLCAL_REAL_DATA` names their directory at build
//! time; see `build.rs`.

#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    unreachable_pub,
    reason = "a test may panic and say why, and report its figures"
)]

mod batch_command;
mod book;
#[cfg(target_os = "linux")]
mod install_script;
mod readme;
mod shell_integration;
mod simulate_command;
mod studies;
mod synth_command;
mod synth_physics;
mod trial_figures_command;
mod trial_profiles;
mod trial_real;
#[cfg(unix)]
mod tutorial;
