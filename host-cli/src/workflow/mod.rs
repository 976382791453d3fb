//! Whole tasks over logs: reading joined to the core, without printing and without files written.

pub mod align;
pub mod batch;
pub mod bench;
pub mod convert;
pub mod drift;
pub mod eval;
pub mod factored;
pub mod figures;
pub mod fit;
pub mod group_errors;
pub mod groups;
pub mod in_memory;
mod kept_rows;
pub mod live;
pub mod log_facts;
mod log_rows;
pub mod means;
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
pub mod selection;
pub mod simulate;
mod solving;
mod spread_rows;
pub mod synthetic_trials;
pub mod trial;
mod uncertainty;
pub mod weighing;

use shell_data::hint::{Hint, OTHER_CHANNELS};
use std::path::PathBuf;

use calibration::FitError;
use calibration::physics::PhysicsError;
use calibration::validation::ValidationError;
use calibration_file::MergeError;
use log_file::{Log, LogError, Wanted};
use shell_data::wrench::Axes;

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
    /// A model of all six axes, of logs that have fewer.
    #[error(
        "the physics model takes all six axes of the wrench, as sensors answer to each; there are {found}"
    )]
    PhysicsAxes {
        /// The axes that there are.
        found: Axes,
    },
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

impl Hint for WorkflowError {
    fn hint(&self) -> Option<String> {
        let text = match self {
            Self::Log(error) => return error.hint(),
            Self::Fit(error) => return error.hint(),
            Self::Channels(error) => return error.hint(),
            Self::Validation(error) => return error.hint(),
            Self::Merge(error) => return error.hint(),
            Self::Copy { .. } => {
                "leave one of them out: errors on a copy say nothing about other data"
            }
            Self::Changed { .. } => "wait until it is written, and fit again",
            Self::NoGroupSums => "make the partial fits with `shellcal fit --partial --groups`",
            _ => return None,
        };
        Some(text.to_owned())
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

/// The axes of the wrench that a fit to `train` is of, which all of them have; of the others in `test`,
/// which have these, too, no more are used.
///
/// # Errors
/// [`WorkflowError::Axes`] if the training logs have different ones, [`LogError::MissingColumns`] if a log
/// has none or a test log lacks some.
pub fn agree_on_axes(train: &[Log], test: &mut [Log]) -> Result<Axes, WorkflowError> {
    let first = train.first().ok_or(WorkflowError::NoLogs)?;
    let expected = first.axes();
    for log in train {
        log.require(&Wanted { readings: true, wrench: true, ..Wanted::default() })?;
        let found = log.axes();
        if found != expected {
            return Err(WorkflowError::Axes { path: log.path().into(), expected, found });
        }
    }
    test.iter_mut().try_for_each(|log| log.keep_axes(expected))?;
    Ok(expected)
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
