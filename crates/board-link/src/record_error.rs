//! Why a recording ends before its time.

use super::{LinkError, VERSIONS};
use crate::recording::{NoFrame, UnsuitableCalibration};
use output_file::OutputError;
use shell_data::hint::Hint;

/// A recording that has ended before its time. What arrived until then is in the files.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// The source.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// A file.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// The bytes.
    #[error("`{source_name}`: {problem}")]
    NoFrame {
        /// The port or file.
        source_name: String,
        /// What is wrong.
        problem: NoFrame,
    },
    /// Not a single byte has come.
    #[error("nothing arrived from `{source_name}`")]
    Silence {
        /// The port or file.
        source_name: String,
    },
    /// Packets, but none with readings or forces.
    #[error("`{source_name}`: the board is there, but sends no frames")]
    NotStreaming {
        /// The port or file.
        source_name: String,
    },
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
            Self::NoFrame { problem: NoFrame::OtherVersion { .. }, .. } => VERSIONS,
            Self::Silence { .. } | Self::NotStreaming { .. } => {
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
