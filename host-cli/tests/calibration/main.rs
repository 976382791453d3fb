//! Tests of fitting and judging calibrations, by the library and the program. Without
//! `SHELLCAL_REAL_DATA` at build time, tests on real recordings are ignored (`build.rs`).

#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    unreachable_pub,
    reason = "a test may panic and say why, and report its figures"
)]

mod any_numbers;
mod calibration_cli;
mod certificate;
mod certified;
mod cross_validation;
mod exact_coefficients;
mod exact_optimum;
mod exact_sums;
mod fit_report;
mod found_groups;
mod gates;
mod golden;
mod hung_loads;
mod instruction_sets;
mod lag_and_memory;
mod memory;
mod one_time;
mod outliers;
mod partial_fits;
mod physics_command;
mod plan_command;
mod rational;
#[path = "../support/recording.rs"]
#[allow(dead_code, reason = "each test program uses a part of it")]
mod recording;
mod refits;
#[path = "../support/sealed.rs"]
#[allow(dead_code, reason = "each test program uses a part of it")]
mod sealed;
mod sitting;
mod solver_identities;
mod solver_intervals;
mod some_axes;
mod spoilt_files;
mod studies;
mod temperature;
mod verdict;
