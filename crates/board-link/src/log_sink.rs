//! Where a recording is kept.

use std::fmt::Debug;
use std::path::Path;

use output_file::OutputError;

/// Where a log or the bytes of a port are kept while they grow: a file, or the memory of a page.
pub trait LogSink: Debug + Send {
    /// Where a piece is put together that the next [`flush`](Self::flush) writes.
    fn pending(&mut self) -> &mut Vec<u8>;

    /// Writes what is pending, whole or not at all.
    ///
    /// # Errors
    /// [`OutputError`] if there is no room for it.
    fn flush(&mut self) -> Result<(), OutputError>;

    /// Ends it.
    ///
    /// # Errors
    /// [`OutputError`] if not all of it is kept.
    fn close(self: Box<Self>) -> Result<(), OutputError>;

    /// Its name.
    fn path(&self) -> &Path;

    /// One for a further board, which its name names.
    ///
    /// # Errors
    /// [`OutputError`] if it cannot be made.
    fn beside(&self, board: &str) -> Result<Box<dyn LogSink>, OutputError>;
}
