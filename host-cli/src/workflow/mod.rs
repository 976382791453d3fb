//! Whole tasks over logs: reading joined to the core, without printing and without files written.

pub mod align;
pub mod batch;
pub mod bench;
pub mod convert;
pub mod doctor;
pub mod eval;
pub mod figures;
pub mod fit;
pub mod group_errors;
pub mod groups;
pub mod in_memory;
mod kept_rows;
pub mod live;
pub mod log_facts;
mod log_rows;
pub mod log_summary;
pub mod merge;
pub mod model_choice;
pub mod moments;
pub mod noise;
pub mod outliers;
pub mod partial;
pub mod payload;
pub mod physics;
pub mod refits;
pub mod report;
pub mod sampling;
pub mod selection;
pub mod simulate;
mod solving;
mod spread_rows;
pub mod synthetic_trials;
pub mod trial;
mod uncertainty;
pub mod weighing;

use std::path::PathBuf;

use crate::calibration_file::MergeError;
use calibration::FitError;
use calibration::physics::PhysicsError;
use calibration::validation::ValidationError;
use log_file::{Log, LogError, Wanted};

/// Why a task over logs could not be done.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WorkflowError {
    /// A log cannot be read.
    #[error(transparent)]
    Log(#[from] LogError),
    /// The rows do not determine a calibration.
    #[error(transparent)]
    Fit(#[from] FitError),
    /// The rows do not determine a physics model.
    #[error(transparent)]
    Physics(#[from] PhysicsError),
    /// A log has another number of channels than the calibration, or than the first log.
    #[error(transparent)]
    Channels(#[from] ChannelMismatch),
    /// A calibration cannot be validated on these rows.
    #[error(transparent)]
    Validation(ValidationError),
    /// The logs have no groups, and are a single file.
    #[error(
        "there is nothing to hold out: the log has no group column, no plateaus of constant load and no \
         jumps of time; give several logs, or a column that is one value in each pose (`--group`)"
    )]
    NoGroups,
    /// Rows in memory without labels of groups, where something is asked of these.
    #[error("there is nothing to hold out: the rows have no labels of groups")]
    NoGroupLabels,
    /// Rows that count more or less than one another, where each has to count as itself.
    #[error("{what} takes rows that all count the same, or weights that are whole numbers")]
    Weights {
        /// What was asked for.
        what: &'static str,
    },
    /// The caller wanted no more of it.
    #[error("it was interrupted")]
    Interrupted,
    /// Partial fits that know nothing of groups, where something is asked of these.
    #[error("the partial fits keep no sums of groups to hold out")]
    NoGroupSums,
    /// Partial fits that cannot be merged.
    #[error(transparent)]
    Merge(MergeError),
    /// A log is a copy of another, and would be counted twice or tested on itself.
    #[error("`{}` has the same rows as `{}`", later.display(), earlier.display())]
    Copy {
        /// The one that was given first.
        earlier: PathBuf,
        /// The other.
        later: PathBuf,
    },
    /// A log was read twice, and in between it became another.
    #[error("`{}` has changed while it was being read", path.display())]
    Changed {
        /// The log.
        path: PathBuf,
    },
    /// Nothing was left to sum.
    #[error("no training rows are left")]
    NoRows,
    /// There was nothing to work on.
    #[error("no logs were given")]
    NoLogs,
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

/// The first of `logs`, if all, and `others` beside them, have what is wanted and as many channels as it.
fn check_logs<'a>(
    logs: &'a [Log],
    others: &[Log],
    wanted: &Wanted,
) -> Result<&'a Log, WorkflowError> {
    let first = logs.first().ok_or(WorkflowError::NoLogs)?;
    for log in logs.iter().chain(others) {
        log.require(wanted)?;
        check_channels(log, first.channels())?;
    }
    Ok(first)
}

fn check_channels(log: &Log, expected: usize) -> Result<(), ChannelMismatch> {
    let found = log.channels();
    if found == expected {
        return Ok(());
    }
    Err(ChannelMismatch { path: log.path().to_path_buf(), expected, found })
}
