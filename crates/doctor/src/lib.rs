//! Checks of a set-up: a port and the board behind it, a log, or a calibration.
//!
//! ```text
//! port, board, file ─▶ observations ─▶ checks ─▶ findings
//! ```
//!
//! Checks return [`Finding`]s, each with an observation and advice. [`check_port`] and
//! [`check_board`] are pure, once [`board_link::handshake`] has queried the board. [`examine_log`]
//! and [`examine_calibration`] read files; [`check_rows`] takes rows in memory.

#![forbid(unsafe_code)]

mod board;
#[allow(
    clippy::disallowed_methods,
    clippy::disallowed_types,
    reason = "sources of a calibration are files"
)]
mod calibration_checks;
mod channels;
mod log;
mod port;
mod poses;
mod rows;

pub use board::{BoardObservations, check_board};
pub use calibration_checks::examine_calibration;
pub use log::examine_log;
pub use port::check_port;
pub use rows::check_rows;
use serde::Serialize;

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum FindingSeverity {
    Fine,
    /// May make results wrong, or makes them worse than necessary.
    Warning,
    /// Makes results wrong or impossible.
    Fault,
}

#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// Stable name of the check: `losses`, `channel-dead`.
    pub check: &'static str,
    pub severity: FindingSeverity,
    pub seen: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub advice: Option<String>,
}

impl Finding {
    fn fine(check: &'static str, seen: impl Into<String>) -> Self {
        Self { check, severity: FindingSeverity::Fine, seen: seen.into(), advice: None }
    }

    fn warning(check: &'static str, seen: impl Into<String>, advice: impl Into<String>) -> Self {
        let (seen, advice) = (seen.into(), Some(advice.into()));
        Self { check, severity: FindingSeverity::Warning, seen, advice }
    }

    /// Returns a finding about wrong or impossible results, with advice.
    pub fn fault(check: &'static str, seen: impl Into<String>, advice: impl Into<String>) -> Self {
        Self { severity: FindingSeverity::Fault, ..Self::warning(check, seen, advice) }
    }

    /// Returns a finding about a share: a warning above `some`, a fault above `most`.
    fn graded(
        check: &'static str,
        share: f64,
        [some, most]: [f64; 2],
        seen: String,
        advice: &str,
    ) -> Self {
        match share {
            _ if share > most => Self::fault(check, seen, advice),
            _ if share > some => Self::warning(check, seen, advice),
            _ => Self::fine(check, seen),
        }
    }
}

fn percent(share: f64) -> String {
    let percent = 100.0 * share;
    match percent {
        0.0 => "0 %".to_owned(),
        _ if percent < 0.095 => format!("{percent:.3} %"),
        _ if percent < 9.95 => format!("{percent:.1} %"),
        _ => format!("{percent:.0} %"),
    }
}
