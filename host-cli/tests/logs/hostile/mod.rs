//! Failures that must not happen with any files, names, arguments or signals. [`cases`] are single regressions;
//! [`random`] draws a few hundred commands over damaged files from seeds, or for an hour with
//! `SHELLCAL_HOSTILE_SECONDS=3600`.

mod cases;
#[cfg(target_os = "linux")]
mod files;
#[cfg(target_os = "linux")]
mod random;
#[cfg(target_os = "linux")]
mod run;
