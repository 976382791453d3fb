//! Calibration and trial processing for an optical 6-axis force/torque shell.
//!
//! [`workflow`] joins the crates into the tasks of the commands: it reads log files into data sets, calls the
//! pure crates for the computation, and writes documents and tables. The binary parses arguments, calls a
//! workflow, and prints.
//!
//! From a training log to the wrench of a frame:
//!
//! ```
//! use std::path::Path;
//!
//! use calibration::{Basis, FitOptions};
//! use log_file::{Log, Mapping};
//! use shellcal::workflow::fit::fit;
//!
//! let log = |name| Log::open(&Path::new("../calibration-data").join(name), &Mapping::default());
//! let options = FitOptions { model: Basis::Cubic.into(), ..FitOptions::default() };
//! let fitted = fit(&[log("synthetic-train.csv")?], &[log("synthetic-test.csv")?], &options)?;
//! let quality = fitted.tests[0].quality().ok_or("no rows")?;
//! assert!(quality[0].rms < 0.15, "Fx is off by {} N", quality[0].rms);
//!
//! // A frame of the unloaded sensor: eight columns of one row.
//! let frame = [1986.0, 1483.0, 1909.0, 1784.0, 1691.0, 1786.0, 2196.0, 1799.0].map(|s| vec![s]);
//! let mut wrench = Default::default();
//! fitted.calibration.wrench(&frame, &mut wrench);
//! assert!(wrench.iter().all(|axis| axis[0].abs() < 0.15));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

/// Name and version of the program, recorded in the files that it writes.
pub const PROGRAM: &str = concat!("shellcal ", env!("CARGO_PKG_VERSION"));

pub mod workflow;
