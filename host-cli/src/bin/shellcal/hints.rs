//! What to do about an error: which flag, which file, which column.

use std::io;

use shellcal::calibration::FitError;
use shellcal::calibration_file::matrix::MatrixError;
use shellcal::calibration_file::{CalibrationFileError, Problem, SCHEMA_VERSION};
use shellcal::workflow::WorkflowError;

/// The next step after `error`, where one is known.
pub(crate) fn for_error(error: &anyhow::Error) -> Option<String> {
    let hint = error.chain().find_map(|cause| {
        let fit = match cause.downcast_ref() {
            Some(WorkflowError::Fit(fit)) => Some(fit),
            _ => cause.downcast_ref::<FitError>(),
        };
        fit.and_then(after_fit).or_else(|| {
            cause.downcast_ref::<CalibrationFileError>().and_then(|e| after_reading(&e.problem))
        })
    });
    hint.map(str::to_owned)
}

fn after_fit(error: &FitError) -> Option<&'static str> {
    Some(match error {
        FitError::TooFewRows { .. } => "record more poses, or choose a smaller `--model`",
        FitError::IdenticalRows { .. } => {
            "the readings never move: check the cable and the shell, and that `--sensors` names the \
             right columns"
        }
        FitError::RankDeficient(_) | FitError::NearlyDependent => {
            "record loads that move the channels independently, drop a channel with `--sensors`, \
             choose a smaller `--model`, or accept a damped answer with `--ridge 1e-6`"
        }
        FitError::Overflow => "check the units of the readings and of the wrench",
        _ => return None,
    })
}

fn after_reading(problem: &Problem) -> Option<&'static str> {
    Some(match problem {
        Problem::NotJson { .. } => {
            "a calibration is the JSON file that `shellcal fit --output` or `shellcal import` writes"
        }
        Problem::SchemaVersion { found } if *found > SCHEMA_VERSION => {
            "use the version of shellcal that wrote it, or a later one"
        }
        Problem::SchemaVersion { .. } => "make it again with `shellcal fit`",
        Problem::Matrix(MatrixError::Variable { .. }) => "choose one with `--variable`",
        _ => return None,
    })
}

/// Whether the reader of our output has gone away, which is not an error.
pub(crate) fn is_closed_pipe(error: &anyhow::Error) -> bool {
    error
        .chain()
        .filter_map(|cause| cause.downcast_ref::<io::Error>())
        .any(|error| error.kind() == io::ErrorKind::BrokenPipe)
}
