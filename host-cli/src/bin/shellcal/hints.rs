//! What to do about an error, which the error itself knows.

use std::error::Error;
use std::io;

use beam_channel::SetupError;
use shell_data::hint::Hint;
use shellcal::workflow;

/// The next step after `error`, where one is known.
pub(crate) fn for_error(error: &anyhow::Error) -> Option<String> {
    error.chain().find_map(|cause| {
        let setup = cause.downcast_ref().and_then(SetupError::hint).map(str::to_owned);
        setup.or_else(|| HINTS.iter().find_map(|hint| hint(cause)))
    })
}

/// An error in a chain does not say which hints it has: every type that has some is tried.
const HINTS: [fn(&(dyn Error + 'static)) -> Option<String>; 10] = [
    hint::<board_link::LinkError>,
    hint::<board_link::NotForBoard>,
    hint::<board_link::RecordError>,
    hint::<calibration::FitError>,
    hint::<calibration::validation::ValidationError>,
    hint::<calibration_file::CalibrationFileError>,
    hint::<calibration_file::MergeError>,
    hint::<log_file::LogError>,
    hint::<output_file::OutputError>,
    hint::<workflow::WorkflowError>,
];

fn hint<E: Error + Hint + 'static>(cause: &(dyn Error + 'static)) -> Option<String> {
    cause.downcast_ref::<E>().and_then(Hint::hint)
}

/// Whether the reader of our output has gone away, which is not an error.
pub(crate) fn is_closed_pipe(error: &anyhow::Error) -> bool {
    error
        .chain()
        .filter_map(|cause| cause.downcast_ref::<io::Error>())
        .any(|error| error.kind() == io::ErrorKind::BrokenPipe)
}
