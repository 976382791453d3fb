//! What is wrong with a set-up: a port and the board behind it, a log, a calibration.
//!
//! ```text
//! port, board, file ─▶ what is known of it ─▶ checks ─▶ findings
//! ```
//!
//! Checks take observations and return [`Finding`]s, each with what was seen and what to do about it.
//! [`check_port`] and [`check_board`] are pure, after [`board_link::handshake`] has asked the board;
//! [`examine_log`] and [`examine_calibration`] read files first.
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
pub use calibration_checks::examine_calibration;
pub use finding::{Finding, FindingSeverity};
pub use log::examine_log;
pub use port::check_port;
