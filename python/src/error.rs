//! Errors of the libraries as exceptions of the package, with file, line, column and what to do.

use std::error::Error;
use std::path::Path;

use calibration::FitError;
use calibration::physics::PhysicsError;
use calibration_file::{CalibrationFileError, MergeError, Problem};
use log_file::{FieldProblem, LogError, PlacedProblem, RowProblem};
use pyo3::prelude::*;
use shell_data::hint::with_causes;
use shellcal::workflow::WorkflowError;

/// What went wrong.
#[derive(Debug)]
pub(crate) enum PythonFailure {
    /// As a library says it.
    Told(PythonMessage),
    /// As Python says it, such as an interrupt.
    Python(PyErr),
}

/// An error in words, and where it is.
#[derive(Debug, Default)]
pub(crate) struct PythonMessage {
    /// The class of `shellcal._errors`.
    pub(crate) class: &'static str,
    pub(crate) message: String,
    pub(crate) file: Option<String>,
    pub(crate) line: Option<u64>,
    pub(crate) column: Option<u64>,
    pub(crate) hint: Option<&'static str>,
}

impl PythonMessage {
    pub(crate) fn new(class: &'static str, message: String) -> Self {
        Self { class, message, ..Self::default() }
    }

    /// An error of this class, with its causes.
    fn from_error(class: &'static str, error: &dyn Error) -> Self {
        Self::new(class, with_causes(error))
    }

    fn in_file(self, path: &Path) -> Self {
        Self { file: Some(path.to_string_lossy().into_owned()), ..self }
    }
}

impl From<PyErr> for PythonFailure {
    fn from(error: PyErr) -> Self {
        Self::Python(error)
    }
}

impl From<PythonMessage> for PythonFailure {
    fn from(told: PythonMessage) -> Self {
        Self::Told(told)
    }
}

impl From<LogError> for PythonFailure {
    fn from(error: LogError) -> Self {
        let told = PythonMessage::from_error("LogError", &error);
        let hint = match &error {
            LogError::Unpacking { .. } => Some("copy the file again: it is cut short or damaged"),
            LogError::At { problem, .. } => hint_at(problem),
            _ => None,
        };
        let told = PythonMessage { hint, ..told };
        let told = match &error {
            LogError::At { path, position, problem } => {
                let column = match problem {
                    PlacedProblem::Row(RowProblem::Field { column, problem, .. })
                        if *problem != FieldProblem::NotADate =>
                    {
                        Some(*column as u64 + 1)
                    }
                    _ => None,
                };
                PythonMessage { line: position.number(), column, ..told.in_file(path) }
            }
            LogError::Io { path, .. }
            | LogError::Unpacking { path, .. }
            | LogError::Empty(path)
            | LogError::NoRows(path)
            | LogError::Binary { path, .. }
            | LogError::NoColumnNames(path) => told.in_file(path),
            _ => told,
        };
        told.into()
    }
}

fn hint_at(problem: &PlacedProblem) -> Option<&'static str> {
    Some(match problem {
        PlacedProblem::MissingColumns { .. } => {
            "name the columns with sensors=, wrench=, time= or group="
        }
        PlacedProblem::DuplicateColumn { .. } => {
            "say which one is meant with sensors=, wrench= or time="
        }
        PlacedProblem::UnknownLayout { .. } => {
            "say which columns are which: sensors=\"2-9\", wrench=\"10-15\", time=\"1\""
        }
        PlacedProblem::Row(_) => "correct the line, or leave such rows out with skip_bad_rows=True",
        _ => return None,
    })
}

impl From<CalibrationFileError> for PythonFailure {
    fn from(error: CalibrationFileError) -> Self {
        let told = PythonMessage::from_error("DocumentError", &error).in_file(&error.path);
        placed(told, &error.problem).into()
    }
}

impl From<Problem> for PythonFailure {
    fn from(problem: Problem) -> Self {
        placed(PythonMessage::from_error("DocumentError", &problem), &problem).into()
    }
}

fn placed(told: PythonMessage, problem: &Problem) -> PythonMessage {
    match problem {
        Problem::NotJson(at) | Problem::Field(at) => {
            PythonMessage { line: Some(at.line as u64), column: Some(at.column as u64), ..told }
        }
        Problem::SchemaVersion { .. } => PythonMessage {
            hint: Some("use the version of shellcal that wrote it, or a later one"),
            ..told
        },
        Problem::Checksum(_) => PythonMessage {
            hint: Some(
                "copy it again from where it was made; if you have edited it, say so with edited=True",
            ),
            ..told
        },
        _ => told,
    }
}

impl From<MergeError> for PythonFailure {
    fn from(error: MergeError) -> Self {
        let class = match error {
            MergeError::Twice(_) => "CountedTwiceError",
            _ => "MergeError",
        };
        let hint = match error {
            MergeError::Model { .. } => Some("make both with the same model= and intercept="),
            MergeError::Channels { .. } => Some("give both the same sensors"),
            MergeError::Twice(_) => Some("leave one of them out; has_counted() tells before"),
            MergeError::Groups { .. } => Some("make all with groups, or all without"),
            MergeError::Split { .. } => Some("make all with the same seed="),
            MergeError::SameName(_) => Some("groups are files: give them different names"),
            _ => None,
        };
        PythonMessage { hint, ..PythonMessage::from_error(class, &error) }.into()
    }
}

impl From<WorkflowError> for PythonFailure {
    fn from(error: WorkflowError) -> Self {
        match error {
            WorkflowError::Log(error) => error.into(),
            WorkflowError::Merge(error) => error.into(),
            WorkflowError::Fit(error) => error.into(),
            error => PythonMessage::from_error("FitError", &error).into(),
        }
    }
}

impl From<FitError> for PythonFailure {
    fn from(error: FitError) -> Self {
        PythonMessage { hint: hint_after(&error), ..PythonMessage::from_error("FitError", &error) }
            .into()
    }
}

fn hint_after(error: &FitError) -> Option<&'static str> {
    Some(match error {
        FitError::TooFewRows { .. } => "record more poses, or choose a smaller model=",
        FitError::IdenticalRows(_) => {
            "the readings never move: check the cable, the shell and the columns"
        }
        FitError::RankDeficient(_) | FitError::NearlyDependent => {
            "record loads that move the channels independently, drop a channel, choose a smaller \
             model=, or accept a damped answer with ridge=1e-6"
        }
        FitError::Solver(_) => "use solver=\"exact\" or \"wide-tsqr\", or choose a smaller model=",
        FitError::Overflow => "check the units of readings and wrench",
        FitError::TooLarge(_) => "choose a smaller model=, or fewer channels",
        FitError::NotExact(_) => {
            "readings have to be counts of a converter; Calibration.fit solves others by QR"
        }
        FitError::NoGroups => "give groups=, a label of each row",
        FitError::NoGroupSums => "make the partial fits with groups",
        FitError::TooFewGroups { .. } => "record more poses, or name the groups= of the rows",
        FitError::Weights(_) => {
            "give integers as sample_weight, which are numbers of rows, or leave this option out"
        }
        FitError::Physics(PhysicsError::TooFewObservations { .. }) => {
            "record more poses, and name them with groups="
        }
        FitError::Physics(PhysicsError::TooFewGroups(_)) => "give groups=, a label of each pose",
        FitError::Physics(PhysicsError::TooFewChannels(_)) => {
            "check the cable, the shell and the columns, or take model=\"linear\""
        }
        FitError::Copy { .. } => "leave one of them out",
        _ => return None,
    })
}

impl From<PythonFailure> for PyErr {
    fn from(failure: PythonFailure) -> Self {
        let told = match failure {
            PythonFailure::Python(error) => return error,
            PythonFailure::Told(told) => told,
        };
        Python::attach(|py| {
            let class = py.import("shellcal._errors").and_then(|errors| errors.getattr(told.class));
            let arguments = (told.message, told.file, told.line, told.column, told.hint);
            match class.and_then(|class| class.call1(arguments)) {
                Ok(error) => PyErr::from_value(error),
                Err(error) => error,
            }
        })
    }
}
