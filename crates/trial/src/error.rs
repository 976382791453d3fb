//! Reasons why a trial cannot be evaluated.

use forces::ForceError;
use shell_data::hint::{Hint, OTHER_CHANNELS};
use shell_data::wrench::Axes;

/// Minimum length of a window, in periods of the log.
pub(super) const FEWEST_PERIODS: f64 = 10.0;

#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum TrialError {
    #[error("drag and lift are made of Fx and Fz: the calibration has no {0}")]
    Axes(Axes),
    #[error(
        "the window from `{enter}` to `{exit}` s is not within the log, which runs from `{first}` to \
         `{last}` s"
    )]
    OutsideLog { enter: f64, exit: f64, first: f64, last: f64 },
    /// No rows at the start or the end of the window, s.
    #[error("the log has a gap where the window from `{enter}` to `{exit}` s begins or ends")]
    Gap { enter: f64, exit: f64 },
    #[error("the exit at `{exit}` s is not after the entry at `{enter}` s")]
    ExitBeforeEntry { enter: f64, exit: f64 },
    /// The window is too short for a mean over its rows, which are `period` apart, s.
    #[error(
        "the window from `{enter}` to `{exit}` s is shorter than {FEWEST_PERIODS} periods of the log, \
         `{period}` s each"
    )]
    Short { enter: f64, exit: f64, period: f64 },
    #[error("{what} is `{value}`, expected a positive number")]
    NotPositive { what: &'static str, value: f64 },
    /// Time runs backwards: row `row`, from 1, is at `after`, s, and the previous row at `before`.
    #[error("the clock jumps back from `{before}` to `{after}` s at row {row}")]
    Backward { row: u64, before: f64, after: f64 },
    #[error("the clock does not move on: `{0}` rows, all at one time")]
    NoClock(u64),
    #[error("the log has `{found}` sensor channels, the calibration `{expected}`")]
    Channels { expected: usize, found: usize },
    #[error("nothing to compute: {0}")]
    Nothing(String),
    #[error(transparent)]
    Forces(#[from] forces::ForceError),
    #[error("the {0} is not finite: readings or telemetry are far outside what they can be")]
    NotFinite(&'static str),
}

impl Hint for TrialError {
    fn hint(&self) -> Option<String> {
        let text = match self {
            Self::OutsideLog { .. } | Self::Gap { .. } => {
                "times are in s on the log's clock; `shellcal info` tells from when to when it runs"
            }
            Self::Backward { .. } => "cut the log there: its parts are two recordings",
            Self::Forces(ForceError::TareFrames { .. }) => {
                "take fewer frames with `--tare`, or name a time with `--tare-time`"
            }
            Self::Channels { .. } => OTHER_CHANNELS,
            Self::Nothing(_) => "forces need sensors and `--calibration`, energies need telemetry",
            _ => return None,
        };
        Some(text.to_owned())
    }
}
