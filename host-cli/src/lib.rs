//! Calibration and trial processing for an optical 6-axis force/torque shell.
//!
//! Three layers, arrows pointing inward only:
//!
//! - *pure core*: [`wrench`], [`block`], [`calibration`], [`alignment`], [`filter`],
//!   [`sensor_model`], [`plot`]: slices and matrices in, values out; no files, no clocks, no printing;
//! - *adapters*: [`log_file`], [`calibration_file`], [`output`]: the world to core types and back,
//!   and [`workflow`], which joins them to the core;
//! - *presentation*: the binary `shellcal`, one file per subcommand.

pub mod alignment;
pub mod block;
pub mod calibration;
pub mod calibration_file;
pub mod double_double;
pub mod filter;
pub mod log_file;
pub mod output;
pub mod plot;
pub mod sensor_model;
pub mod survey;
pub mod synthetic_log;
pub mod workflow;
pub mod wrench;
