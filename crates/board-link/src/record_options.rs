//! How a recording is made, and why it ends before its time.

use std::time::Duration;

use output_file::OutputError;
use shared_proto::Protocol;
use shell_data::hint::Hint;

use super::{LinkError, Uplink};
use crate::recording::{LiveForces, NoFrame, UnsuitableCalibration};

/// How a recording is made.
#[derive(Clone, Debug, Default)]
pub struct RecordOptions {
    /// The protocol, if it is not to be recognised.
    pub protocol: Option<Protocol>,
    /// For forces beside the readings.
    pub forces: Option<LiveForces>,
    /// When to end.
    pub duration: Option<Duration>,
    /// Tells the board to start streaming, again as before if it restarts, and to stop at the end.
    pub start: Option<Uplink>,
    /// Channels are not brought to one time.
    pub as_sampled: bool,
    /// Stretches are labelled while they are recorded ([`RecordCommand::Label`](super::RecordCommand::Label)): there is a
    /// column for the labels, and rows of the first board wait until they are
    /// [settled](super::RecordCommand::Settled), so that a stretch may have begun when it is found.
    pub labels: bool,
}

/// A recording that has ended before its time. What arrived until then is in the files.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// The source.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// A file.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// There is no frame from the port or file, for a reason.
    #[error("`{source_name}`: {problem}")]
    NoFrame { source_name: String, problem: NoFrame },
    /// The calibration.
    #[error(transparent)]
    Calibration(#[from] UnsuitableCalibration),
    /// The low-pass of the forces.
    #[error(transparent)]
    Forces(#[from] forces::ForceError),
}

impl Hint for RecordError {
    fn hint(&self) -> Option<String> {
        let text = match self {
            Self::Link(error) => return error.hint(),
            Self::Output(error) => return error.hint(),
            Self::NoFrame { problem: NoFrame::Any { .. }, .. } => {
                "try another `--baud` (57600 unless told), or `--framing` if you know it"
            }
            Self::NoFrame { problem: NoFrame::OtherProtocol { .. }, .. } => {
                "leave out `--framing` to have it recognised"
            }
            Self::NoFrame { problem: NoFrame::Silence | NoFrame::NotStreaming, .. } => {
                "a board streams once it is started: `--start`, or `shellcal board PORT start`"
            }
            Self::Calibration(UnsuitableCalibration::Wrenches) => {
                "leave out `--calibration`, or have it stream readings: `shellcal board PORT mode raw`"
            }
            _ => return None,
        };
        Some(text.to_owned())
    }
}
