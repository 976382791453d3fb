//! The tests of the library and of the program, one module for each subject.
//!
//! Tests on real recordings are ignored where `SHELLCAL_REAL_DATA` does not name their directory
//! when the tests are built; see `build.rs`.

#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    unreachable_pub,
    reason = "a test may panic and say why, and report its figures"
)]

mod align_command;
mod align_disturbed;
mod any_numbers;
mod batch_command;
mod bench_command;
#[cfg(unix)]
mod board_line;
#[cfg(unix)]
mod board_port;
mod board_wrench;
mod book;
mod calibration_cli;
mod certificate;
mod certified;
mod companion_files;
mod convert;
mod convert_formats;
mod cross_validation;
mod doctor;
#[cfg(unix)]
mod doctor_port;
mod drift;
mod exact_coefficients;
mod exact_optimum;
mod exact_sums;
mod fit_report;
mod found_groups;
mod gates;
mod golden;
mod hostile;
mod hung_loads;
#[cfg(target_os = "linux")]
mod install_script;
mod instruction_sets;
mod kept_columns;
mod lag_and_memory;
#[cfg(all(unix, feature = "live"))]
mod live;
#[cfg(all(unix, feature = "live"))]
mod live_serve;
mod log_bad_input;
mod log_containers;
mod log_formats;
mod log_real;
mod memory;
mod noise;
mod one_pipeline;
mod outages;
mod outliers;
mod partial_fits;
mod payload;
mod physics_command;
mod plan_command;
mod readme;
#[cfg(unix)]
mod record_port;
mod record_replay;
#[cfg(unix)]
mod record_restart;
mod refits;
mod settings;
mod shell_integration;
mod simulate_command;
mod solver_identities;
mod solver_intervals;
mod some_axes;
mod studies;
mod support;
mod synth_command;
mod synth_physics;
mod tcp_board;
mod temperature;
mod trial_figures_command;
mod trial_profiles;
mod trial_real;
#[cfg(unix)]
mod tutorial;
mod verdict;
