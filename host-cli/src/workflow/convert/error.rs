//! Why a log cannot be converted.

use shell_data::hint::Hint;
use std::io;
use std::path::Path;

use crate::workflow::ChannelMismatch;
use crate::workflow::selection::TimeWindow;
use calibration::uncertainty::NoIntervals;
use forces::ForceError;
use forces::filter::FilterError;
use log_file::LogError;
use shell_data::wrench::Axes;

/// A log that cannot be converted as asked.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ConvertError {
    /// The log cannot be read.
    #[error(transparent)]
    Log(#[from] LogError),
    /// A recording holds whole wrenches with their time.
    #[error(
        "a recording in MCAP needs time and all six axes of a wrench: without, write `.csv`, `.parquet`, \
         `.mat` or `.npy`"
    )]
    PartOfWrench,
    /// Axes were asked for that the calibration does not give.
    #[error("the calibration gives {axes}, not {absent}")]
    Axes {
        /// What was asked for in vain.
        absent: Axes,
        /// What there is.
        axes: Axes,
    },
    /// A time that no message can carry.
    #[error("the time `{0}` s is none since 1970 that a message can carry")]
    Epoch(f64),
    /// All rows were left out.
    #[error("`{0}`: no row is left to convert")]
    NoFrames(String),
    /// The calibration is for another sensor.
    #[error(transparent)]
    Channels(#[from] ChannelMismatch),
    /// Too few frames for the tare.
    #[error("`{path}` has only `{found}` frames, `{wanted}` are to be taken as unloaded")]
    TareFrames {
        /// The log.
        path: String,
        /// Frames asked for.
        wanted: usize,
        /// Frames in the log.
        found: usize,
    },
    /// A zero that follows the stationary intervals would take the weight for drift.
    #[error(
        "a tare that follows the stationary intervals takes what the sensor carries for its zero"
    )]
    RestsUnderLoad,
    /// Stationary intervals are stretches of time.
    #[error("`{0}` has no time column, without which no rests are found for the tare to follow")]
    RestsWithoutTime(String),
    /// No frame within the tare window.
    #[error(
        "`{path}` has no frame between `{start}` and `{end}` s to tare on: \
         its frames run from `{first}` to `{last}` s", start = window.start_s, end = window.end_s
    )]
    TareTime {
        /// The log.
        path: String,
        /// The window asked for.
        window: TimeWindow,
        /// Time of the first frame.
        first: f64,
        /// Time of the last frame read.
        last: f64,
    },
    /// The rate is needed, and the log does not give it.
    #[error("`{path}` does not tell the sampling rate, which a low-pass needs: {reason}")]
    NoRate {
        /// The log.
        path: String,
        /// Why.
        reason: &'static str,
    },
    /// The clock was set back.
    #[error(
        "`{path}`: the clock jumps back from `{before}` to `{after}` s, across which a low-pass cannot run"
    )]
    Backward {
        /// The log.
        path: String,
        /// The latest time before, s.
        before: f64,
        /// The time after, s.
        after: f64,
    },
    /// The filter is impossible.
    #[error(transparent)]
    Filter(#[from] FilterError),
    /// Standard errors were asked for by name, and cannot be given.
    #[error("the calibration carries no covariance, from which standard errors and intervals come")]
    NoCovariance,
    /// An interval was asked for that the calibration's groups cannot tell.
    #[error(transparent)]
    NoIntervals(#[from] NoIntervals),
    /// Readings so large that the wrench overflows.
    #[error("`{path}`: the wrench of frame `{frame}` is not finite")]
    NotFinite {
        /// The log.
        path: String,
        /// Number of the frame among those used, from 1.
        frame: u64,
    },
    /// The result cannot be written.
    #[error("cannot write the result")]
    Output(#[from] io::Error),
}

impl Hint for ConvertError {
    fn hint(&self) -> Option<String> {
        let text = match self {
            Self::Log(error) => return error.hint(),
            Self::Channels(error) => return error.hint(),
            Self::TareFrames { .. } => "take fewer frames with `--tare`, or `--no-tare`",
            Self::RestsUnderLoad => {
                "leave out `--tare rests`, or take the weight off by `payload subtract` first"
            }
            Self::RestsWithoutTime(_) => "name it with `--time`, or tare on the first frames",
            Self::TareTime { .. } => "`shellcal info` tells the times of a log",
            Self::NoRate { .. } => {
                "say how many rows there are in a second with `--rate`, or leave the filter out with `--no-lowpass`"
            }
            Self::Backward { .. } => {
                "recordings that were put together: convert each by itself, or leave the filter out with `--no-lowpass`"
            }
            Self::Filter(error) => return error.hint(),
            Self::NoIntervals(NoIntervals::IndependentRows) => {
                "fit again without `--model` or with groups (`--group`), or ask for standard errors alone"
            }
            Self::NoCovariance => {
                "leave out `--interval`, and `se` of `--columns`; `shellcal fit` puts a covariance into the calibration unless there are fewer than twice as many groups as features, or `--covariance none`"
            }
            _ => return None,
        };
        Some(text.to_owned())
    }
}

impl ConvertError {
    /// What the pipeline says of the log at `path`.
    pub(super) fn from_log(path: &Path, error: ForceError) -> Self {
        let path = path.display().to_string();
        match error {
            ForceError::TareFrames { wanted, found } => Self::TareFrames { path, wanted, found },
            ForceError::TareTime { start_s, end_s, first_s: first, last_s: last } => {
                Self::TareTime { path, window: TimeWindow { start_s, end_s }, first, last }
            }
            ForceError::NoRate(reason) => Self::NoRate { path, reason },
            ForceError::Filter(error) => Self::Filter(error),
        }
    }
}
