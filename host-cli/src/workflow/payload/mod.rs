//! What a sensor carries: fitted to poses at rest, and taken off a run.

mod columns;
mod motion;
mod poses;

use shell_data::hint::Hint;
use std::path::PathBuf;

pub use columns::MotionColumns;
pub use motion::{find_motion_lag, read_motion};
pub use poses::{FittedPayload, GravityFrom, fit_payload};

use forces::payload::{MotionError, PayloadError};
use log_file::LogError;

/// Logs that do not tell what a sensor carries, or how it moved.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PayloadLogError {
    /// A log cannot be read.
    #[error(transparent)]
    Log(#[from] LogError),
    /// There was nothing to work on.
    #[error("no logs were given")]
    NoLogs,
    /// The poses do not suffice.
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
}

impl Hint for PayloadLogError {
    fn hint(&self) -> Option<String> {
        let text = match self {
            Self::Log(error) => return error.hint(),
            Self::Payload(error) => return error.hint(),
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
            Self::Motion { .. } => "`shellcal info` tells the times of a log",
            _ => return None,
        };
        Some(text.to_owned())
    }
}
