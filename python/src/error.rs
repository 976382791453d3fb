//! Conversion of library errors to exceptions of the package, with file, line, column and hint.

use std::error::Error;
use std::path::Path;

use calibration::FitError;
use calibration::physics::PhysicsError;
use calibration_file::{CalibrationFileError, MergeError, Problem};
use log_file::{FieldProblem, LogError, PlacedProblem, RowProblem};
use pyo3::prelude::*;
use shell_data::hint::{Hint, with_causes};
use shellcal::workflow::WorkflowError;

/// An exception of the package, or one of Python's, such as an interrupt.
#[derive(Debug)]
pub(crate) struct PythonFailure(pub(crate) PyErr);

#[derive(Debug, Default)]
pub(crate) struct PythonMessage {
    /// The class of `shellcal._errors`.
    pub(crate) class: &'static str,
    pub(crate) message: String,
    pub(crate) file: Option<String>,
    pub(crate) line: Option<u64>,
    pub(crate) column: Option<u64>,
    pub(crate) hint: Option<String>,
}

impl PythonMessage {
    pub(crate) fn new(class: &'static str, message: String) -> Self {
        Self { class, message, ..Self::default() }
    }

    /// Creates a message of this class, with the error's causes and hint.
    fn from_error(class: &'static str, error: &(impl Error + Hint)) -> Self {
        let hint = error.hint().map(|hint| in_python(&hint));
        Self { hint, ..Self::new(class, with_causes(error)) }
    }

    fn in_file(self, path: &Path) -> Self {
        Self { file: Some(path.to_string_lossy().into_owned()), ..self }
    }

    fn with_hint(self, hint: Option<&str>) -> Self {
        Self { hint: hint.map(str::to_owned).or(self.hint), ..self }
    }
}

/// Converts program options in a hint to Python arguments: `` `--ridge 1e-6` `` to `` `ridge=1e-6` ``.
fn in_python(hint: &str) -> String {
    let argument = |option: &str| {
        let (name, value) = option.split_once([' ', '=']).unwrap_or((option, ""));
        let is_text = !value.is_empty() && value.parse::<f64>().is_err();
        let value = if is_text { format!("\"{value}\"") } else { value.to_owned() };
        match name {
            "skip-bad-rows" | "edited" => format!("{}=True", name.replace('-', "_")),
            "no-intercept" => "intercept=False".to_owned(),
            _ => format!("{}={value}", name.replace('-', "_")),
        }
    };
    let code = |text: &str| match text.strip_prefix("--") {
        Some(options) => options.split(" --").map(argument).collect::<Vec<_>>().join(", "),
        None => text.to_owned(),
    };
    hint.split('`').map(code).collect::<Vec<_>>().join("`")
}

impl From<PyErr> for PythonFailure {
    fn from(error: PyErr) -> Self {
        Self(error)
    }
}

impl From<PythonFailure> for PyErr {
    fn from(PythonFailure(error): PythonFailure) -> Self {
        error
    }
}

impl From<PythonMessage> for PythonFailure {
    fn from(told: PythonMessage) -> Self {
        Python::attach(|py| {
            let class = py.import("shellcal._errors").and_then(|errors| errors.getattr(told.class));
            let arguments = (told.message, told.file, told.line, told.column, told.hint);
            let error = class.and_then(|class| class.call1(arguments));
            Self(error.map_or_else(|error| error, PyErr::from_value))
        })
    }
}

impl From<LogError> for PythonFailure {
    fn from(error: LogError) -> Self {
        let told = PythonMessage::from_error("LogError", &error);
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

impl From<CalibrationFileError> for PythonFailure {
    fn from(error: CalibrationFileError) -> Self {
        let told = PythonMessage::from_error("DocumentError", &error).in_file(&error.path);
        let (line, column) = match &error.problem {
            Problem::NotJson(at) | Problem::Field(at) => {
                (Some(at.line as u64), Some(at.column as u64))
            }
            _ => (None, None),
        };
        PythonMessage { line, column, ..told }.into()
    }
}

impl From<MergeError> for PythonFailure {
    fn from(error: MergeError) -> Self {
        let (class, hint) = match error {
            MergeError::Twice(_) => {
                let hint = "leave one of them out; has_counted() tells before";
                ("CountedTwiceError", Some(hint))
            }
            _ => ("MergeError", None),
        };
        PythonMessage::from_error(class, &error).with_hint(hint).into()
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
        PythonMessage::from_error("FitError", &error).with_hint(hint_after(&error)).into()
    }
}

fn hint_after(error: &FitError) -> Option<&'static str> {
    Some(match error {
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
        _ => return None,
    })
}
