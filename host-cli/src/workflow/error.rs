//! Why a task over logs could not be done.

use std::io;
use std::path::PathBuf;

use alignment::AlignError;
use calibration::FitError;
use calibration::fit::HoldMismatch;
use calibration::recalibration::RecalibrationError;
use calibration::uncertainty::NoIntervals;
use calibration_file::MergeError;
use forces::ForceError;
use forces::drift::FEWEST_RESTS;
use forces::payload::{MotionError, PayloadError};
use log_file::LogError;
use shell_data::hint::{Hint, OTHER_CHANNELS};
use shell_data::wrench::Axes;
use trial::{NoWindow, TrialError};

/// Why a task over logs could not be done.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WorkflowError {
    /// A log cannot be read.
    #[error(transparent)]
    Log(#[from] LogError),
    /// The rows do not determine a calibration, or nothing of what was asked of them.
    #[error(transparent)]
    Fit(#[from] FitError),
    /// A log has another number of channels than the calibration, or than the first log.
    #[error(transparent)]
    Channels(#[from] ChannelMismatch),
    /// Two training logs have different axes of the wrench.
    #[error("`{}` has the axes {found} of the wrench, the logs before it have {expected}", path.display())]
    Axes {
        /// The log.
        path: PathBuf,
        /// Axes of the first log.
        expected: Axes,
        /// Axes of the log.
        found: Axes,
    },
    /// Partial fits that cannot be merged.
    #[error(transparent)]
    Merge(MergeError),
    /// There was nothing to work on.
    #[error("no logs were given")]
    NoLogs,
    /// There is no group column, and loads cannot be told by still readings.
    #[error(transparent)]
    Holds(#[from] HoldMismatch),
    /// No row has the label of a load.
    #[error(
        "no row has the label of a load: the first label is `{found}`, the first load `{load}`"
    )]
    NoLabels {
        /// A label of the logs.
        found: String,
        /// One of the table.
        load: String,
    },
    /// Every load has the mass 0.
    #[error("no weight hangs in any line of the table")]
    NoWeight,
    /// A calibration that cannot be brought up to date, or loads that do not serve for it.
    #[error(transparent)]
    Recalibration(#[from] RecalibrationError),
    /// Too few frames to scatter.
    #[error("`{path}` has `{found}` frames to tell the noise from, at least 2 are needed")]
    TooFewFrames {
        /// The log.
        path: String,
        /// Frames found.
        found: u64,
    },
    /// Too few rests to tell a drift.
    #[error(
        "`{path}` has `{found}` stretches at rest, {FEWEST_RESTS} at least are needed to tell a drift"
    )]
    TooFewRests {
        /// The log.
        path: String,
        /// Stretches found.
        found: usize,
    },
    /// A temperature that is no number.
    #[error("`{path}`: `{text}` in column `{column}` is no temperature")]
    Temperature {
        /// The log.
        path: String,
        /// The column.
        column: String,
        /// What stands there.
        text: String,
    },
    /// A recording holds whole wrenches with their time.
    #[error(
        "a recording in MCAP needs time and all six axes of a wrench: without, write `.csv`, `.parquet`, \
         `.mat` or `.npy`"
    )]
    PartOfWrench,
    /// Axes were asked for that the calibration does not give.
    #[error("the calibration gives {axes}, not {absent}")]
    AbsentAxes {
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
    /// A log gives no forces as asked.
    #[error("{}", without_forces(path, error))]
    Forces {
        /// The log.
        path: String,
        /// Why.
        error: ForceError,
    },
    /// A zero that follows the stationary intervals would take the weight for drift.
    #[error(
        "a tare that follows the stationary intervals takes what the sensor carries for its zero"
    )]
    RestsUnderLoad,
    /// Stationary intervals are stretches of time.
    #[error("`{0}` has no time column, without which no rests are found for the tare to follow")]
    RestsWithoutTime(String),
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
    /// The poses do not tell what a sensor carries.
    #[error(transparent)]
    Payload(#[from] PayloadError),
    /// Nothing says how the sensor lies.
    #[error(
        "`{}` has no columns of orientation (`gx gy gz` of gravity, `r11` … `r33`, `qx qy qz qw`) or \
         acceleration (`ax ay az`)", .0.display()
    )]
    NoMotion(PathBuf),
    /// A number of columns that stands for nothing.
    #[error(
        "`{0}` columns of orientation, expected 3 (gravity), 4 (quaternion x y z w) or 9 (rotation matrix, \
         row by row)"
    )]
    OrientationColumns(usize),
    /// A number of columns of acceleration other than three.
    #[error("`{0}` columns of acceleration, expected 3")]
    AccelerationColumns(usize),
    /// Values that are no rotation or direction.
    #[error("`{}`, data row {row}: {what}", path.display())]
    NoOrientation {
        /// The log.
        path: PathBuf,
        /// The row, from 1, counted without headers.
        row: u64,
        /// What is wrong with it.
        what: String,
    },
    /// Accelerations in a unit that their size does not tell.
    #[error(
        "`{}`: accelerations at rest are `{size:.4}` long, neither m/s² nor multiples of g", path.display()
    )]
    AccelerationUnit {
        /// The log.
        path: PathBuf,
        /// Their median.
        size: f64,
    },
    /// Accelerations without a frame.
    #[error(
        "`{}` has accelerations, but the payload does not know the accelerometer's frame", .0.display()
    )]
    UnknownFrame(PathBuf),
    /// Samples that are no motion.
    #[error("`{}`: {error}", path.display())]
    Motion {
        /// The log.
        path: PathBuf,
        /// Why.
        error: MotionError,
    },
    /// Two logs do not match, or not clearly.
    #[error("cannot align `{}` with `{}`", board.display(), reference.display())]
    Align {
        /// The reference's file.
        reference: PathBuf,
        /// The board's file.
        board: PathBuf,
        /// Why.
        source: AlignError,
    },
    /// A trial cannot be evaluated on its log.
    #[error(transparent)]
    Trial(#[from] TrialError),
    /// The window of a trial was to be found, and cannot be.
    #[error("no window found")]
    Window(#[from] NoWindow),
    /// The window was to be found in forces, and the log gives none.
    #[error("no window found: there are no forces to find it in")]
    NoForces,
    /// The window was to be found in forces, which need a calibration.
    #[error("without a calibration there is no drag to find the window in")]
    NoCalibration,
    /// The calibration does not have axes that are to be compared.
    #[error("{asked} cannot be compared: the calibration gives {calibrated} only")]
    Uncalibrated {
        /// What was asked for.
        asked: Axes,
        /// What the calibration has.
        calibrated: Axes,
    },
    /// A limit is for axes that are left out.
    #[error("the limit of {0} is for none of the axes that are compared")]
    LimitsNothing(&'static str),
}

/// What the force pipeline says of the log at `path`.
fn without_forces(path: &str, error: &ForceError) -> String {
    match error {
        ForceError::TareFrames { wanted, found } => {
            format!("`{path}` has only `{found}` frames, `{wanted}` are to be taken as unloaded")
        }
        ForceError::TareTime { start_s, end_s, first_s, last_s } => format!(
            "`{path}` has no frame between `{start_s}` and `{end_s}` s to tare on: \
             its frames run from `{first_s}` to `{last_s}` s"
        ),
        ForceError::NoRate(reason) => {
            format!("`{path}` does not tell the sampling rate, which a low-pass needs: {reason}")
        }
        ForceError::Filter(error) => error.to_string(),
    }
}

impl WorkflowError {
    /// Whether two logs could be read and compared, but their match is not to be trusted.
    pub fn is_refusal(&self) -> bool {
        matches!(self, Self::Align { source, .. } if source.is_refusal())
    }
}

impl Hint for WorkflowError {
    fn hint(&self) -> Option<String> {
        let text = match self {
            Self::Log(error) => return error.hint(),
            Self::Fit(error) => return error.hint(),
            Self::Channels(error) => return error.hint(),
            Self::Merge(error) => return error.hint(),
            Self::Payload(error) => return error.hint(),
            Self::Align { source, .. } => return source.hint(),
            Self::Trial(error) => return error.hint(),
            Self::Holds(_) => {
                "give the log a group column with the labels of the table, as `live --plan` writes it"
            }
            Self::NoLabels { .. } => "name the log's column of labels with `--group`",
            Self::Recalibration(RecalibrationError::NoErrors) => {
                "an imported matrix says nothing of its errors: fit anew, without `--from`"
            }
            Self::TooFewFrames { .. } | Self::Motion { .. } => {
                "`shellcal info` tells the times of a log"
            }
            Self::TooFewRests { .. } => {
                "begin with the sensor at rest and unloaded, and let it rest for a second or more now and then"
            }
            Self::Temperature { .. } => "name the column of temperature with `--temperature`",
            Self::Forces { error, .. } => match error {
                ForceError::TareFrames { .. } => "take fewer frames with `--tare`, or `--no-tare`",
                ForceError::TareTime { .. } => "`shellcal info` tells the times of a log",
                ForceError::NoRate(_) => {
                    "say how many rows there are in a second with `--rate`, or leave the filter out with `--no-lowpass`"
                }
                ForceError::Filter(error) => return error.hint(),
            },
            Self::RestsUnderLoad => {
                "leave out `--tare rests`, or take the weight off by `payload subtract` first"
            }
            Self::RestsWithoutTime(_) => "name it with `--time`, or tare on the first frames",
            Self::Backward { .. } => {
                "recordings that were put together: convert each by itself, or leave the filter out with `--no-lowpass`"
            }
            Self::NoIntervals(NoIntervals::IndependentRows) => {
                "fit again without `--model` or with groups (`--group`), or ask for standard errors alone"
            }
            Self::NoCovariance => {
                "leave out `--interval`, and `se` of `--columns`; `shellcal fit` puts a covariance into the calibration unless there are fewer than twice as many groups as features, or `--covariance none`"
            }
            Self::NoMotion(_) | Self::OrientationColumns(_) | Self::AccelerationColumns(_) => {
                "name the columns with `--orientation` or `--accelerations`, in a run those of another log with \
                 `--motion`"
            }
            Self::NoOrientation { .. } => {
                "correct the row, or name the right columns with `--orientation`"
            }
            Self::AccelerationUnit { .. } => {
                "scale them to m/s², or give orientations besides: then any unit will do"
            }
            Self::UnknownFrame(_) => {
                "fit the payload to poses that have accelerations, too, or name columns of `--orientation`"
            }
            Self::Uncalibrated { asked, calibrated } => {
                let names: Vec<_> =
                    calibrated.iter().map(|axis| axis.name().to_lowercase()).collect();
                return Some(format!(
                    "compare what there is with `--axes {}`, which leaves out {asked}",
                    names.join(",")
                ));
            }
            Self::LimitsNothing(_) => "leave the limit out, or add an axis to `--axes`",
            _ => return None,
        };
        Some(text.to_owned())
    }
}

impl From<MergeError> for WorkflowError {
    /// Sums that are not exact are an error of the fit, which has a hint of its own.
    fn from(error: MergeError) -> Self {
        match error {
            MergeError::NotExact(error) => FitError::NotExact(error).into(),
            error => WorkflowError::Merge(error),
        }
    }
}

/// A log of another number of channels than the calibration, or than the first log.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("`{}` has `{found}` sensor channels, expected `{expected}`", path.display())]
pub struct ChannelMismatch {
    /// The log.
    pub path: PathBuf,
    /// Channels of the calibration or of the first log.
    pub expected: usize,
    /// Channels of the log.
    pub found: usize,
}

impl Hint for ChannelMismatch {
    fn hint(&self) -> Option<String> {
        Some(OTHER_CHANNELS.to_owned())
    }
}
