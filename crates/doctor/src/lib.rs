//! What is wrong with a set-up: a port and the board behind it, a log, a calibration.
//!
//! ```text
//! port, board, file ─▶ what is known of it ─▶ checks ─▶ findings
//! ```
//!
//! [`check_port`], [`check_board`], [`check_log`] and [`check_calibration`] are pure: they look at what is
//! known and give [`Finding`]s, each with what was seen and what to do about it. [`examine_log`] and
//! [`examine_calibration`] read files first; [`board_link::handshake`] asks the board.
//!
//! A [`FindingSeverity::Fault`] makes results wrong or impossible. A [`FindingSeverity::Warning`] may, or makes
//! them worse than they could be.

#![forbid(unsafe_code)]
#![warn(missing_docs)]

mod board;
#[allow(
    clippy::disallowed_methods,
    clippy::disallowed_types,
    reason = "sources of a calibration are files"
)]
mod calibration_checks;
mod channels;
mod finding;
mod log;
mod port;
mod poses;

pub use board::{BoardObservations, check_board};
pub use calibration_checks::{check_calibration, examine_calibration};
pub use finding::{Finding, FindingSeverity};
pub use log::{CalibratedObservations, LogObservations, check_log, examine_log};
pub use port::check_port;
pub use poses::PoseJump;
