//! What to do about an error: which flag, which file, which column.

use std::io;

/// The next step after `error`, where one is known.
pub(crate) fn for_error(_error: &anyhow::Error) -> Option<String> {
    None
}

/// Whether the reader of our output has gone away, which is not an error.
pub(crate) fn is_closed_pipe(error: &anyhow::Error) -> bool {
    error
        .chain()
        .filter_map(|cause| cause.downcast_ref::<io::Error>())
        .any(|error| error.kind() == io::ErrorKind::BrokenPipe)
}
