//! Why a log gives no forces.

use super::filter::FilterError;

/// A log that gives no forces as asked.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ForceError {
    /// Too few frames to tare on.
    #[error("only `{found}` frames to tare on, `{wanted}` wanted")]
    TareFrames {
        /// Frames wanted.
        wanted: usize,
        /// Frames found.
        found: usize,
    },
    /// No frame between the times of the tare.
    #[error(
        "no frame between `{start_s}` and `{end_s}` s to tare on: frames run from `{first_s}` to `{last_s}` s"
    )]
    TareTime {
        /// Start of the tare, s.
        start_s: f64,
        /// Its end, s.
        end_s: f64,
        /// Time of the first frame read, s.
        first_s: f64,
        /// Time of the last frame read, s.
        last_s: f64,
    },
    /// The low-pass needs the rate, and the log does not give it.
    #[error("the sampling rate, which a low-pass needs, is not known: {0}")]
    NoRate(&'static str),
    /// The filter is impossible.
    #[error(transparent)]
    Filter(#[from] FilterError),
}
