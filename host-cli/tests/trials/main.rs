//! Tests of trials, simulations and their documents. Without `SHELLCAL_REAL_DATA` at build time,
//! tests on real recordings are ignored (`build.rs`).

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
