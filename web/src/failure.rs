//! Why something could not be done, as the terminal says it.

use std::error::Error;

use board_link::RecordError;
use calibration::FitError;
use log_file::LogError;
use output_file::OutputError;
use serde_json::json;
use shell_data::hint::{Hint, with_causes};
use shellcal::workflow::WorkflowError;

use crate::Answer;

/// An error with its causes, and the next step.
pub(crate) struct Failure {
    error: String,
    hint: Option<String>,
}

impl Failure {
    pub(crate) fn new(error: &dyn Error, hint: Option<String>) -> Self {
        Self { error: with_causes(error), hint }
    }

    /// The same of some files.
    pub(crate) fn about(self, names: &str) -> Self {
        Self { error: format!("{names}: {}", self.error), ..self }
    }
}

impl From<String> for Failure {
    fn from(error: String) -> Self {
        Self { error, hint: None }
    }
}

impl From<serde_json::Error> for Failure {
    fn from(error: serde_json::Error) -> Self {
        Self::new(&error, None)
    }
}

macro_rules! with_hint {
    ($($error:ty),*) => {$(
        impl From<$error> for Failure {
            fn from(error: $error) -> Self {
                let hint = error.hint();
                Self::new(&error, hint)
            }
        }
    )*};
}

with_hint!(FitError, LogError, OutputError, RecordError, WorkflowError);

impl From<Failure> for Answer {
    fn from(Failure { error, hint }: Failure) -> Self {
        json!({ "error": error, "hint": hint }).into()
    }
}
