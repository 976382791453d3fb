//! Failures that must not happen for any files, names, arguments and signals.
//!
//! [`cases`] are single regressions; [`random`] draws commands over damaged files from seeds. Together with
//! the other tests it draws a few hundred; `SHELLCAL_HOSTILE_SECONDS=3600` draws for an hour.

mod cases;
#[cfg(target_os = "linux")]
mod files;
#[cfg(target_os = "linux")]
mod random;
#[cfg(target_os = "linux")]
mod run;
