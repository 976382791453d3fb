//! Where a recording is kept: as a rule a file that grows while it runs.
//!
//! All other results appear whole or not at all ([`output_file`]). A recording is the exception:
//! it cannot be made again, so what has arrived goes to the file within half a second, and stays
//! there whatever happens to the program. Pieces are written whole: when the disk is full, the file
//! is cut back to the end of the last piece that fits. Only a kill in the middle of a write may leave a
//! part of a line, which a reader of logs leaves out.

use std::fmt::Debug;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use output_file::OutputError;

/// Where a log or the bytes of a port are kept while they grow: a file, or the memory of a page.
pub trait LogSink: Debug + Send {
    /// Adds a piece, whole or not at all.
    ///
    /// # Errors
    /// [`OutputError`] if there is no room for it.
    fn append(&mut self, piece: &[u8]) -> Result<(), OutputError>;

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

/// A growing file.
#[derive(Debug)]
pub struct AppendWriter {
    path: PathBuf,
    file: File,
    length: u64,
    regular: bool,
    /// After an error nothing more is written: a hole would be taken for a loss on the way.
    failed: bool,
}

impl AppendWriter {
    /// Makes the file as [`open_growing`] does.
    ///
    /// # Errors
    /// [`OutputError`] if it cannot be made, or is named as a table in binary; its source has kind `AlreadyExists` if it is there.
    pub fn create(path: &Path, overwrite: bool) -> Result<Self, OutputError> {
        if path.as_os_str() == "-" {
            return Err(OutputError::Stdout);
        }
        let (file, regular) = open_growing(path, overwrite)?;
        Ok(Self { path: path.to_path_buf(), file, length: 0, regular, failed: false })
    }

    /// Whether the file still has a name: where it was removed while it grew, all in it is lost. Elsewhere than on Unix
    /// a file that is open cannot be removed.
    fn check_there(&self) -> io::Result<()> {
        #[cfg(unix)]
        if std::os::unix::fs::MetadataExt::nlink(&self.file.metadata()?) == 0 {
            return Err(io::Error::new(io::ErrorKind::NotFound, "it was removed meanwhile"));
        }
        Ok(())
    }
}

impl LogSink for AppendWriter {
    fn append(&mut self, piece: &[u8]) -> Result<(), OutputError> {
        if self.failed {
            return Ok(());
        }
        if let Err(source) = self.file.write_all(piece) {
            self.failed = true;
            // If it cannot be cut back, a part of a line stays at the end; nothing else can be done.
            let _ = self.file.set_len(self.length);
            return Err(OutputError::failed(&self.path, source));
        }
        self.length += piece.len() as u64;
        Ok(())
    }

    /// Ends the file: on the disk if it holds anything, gone if it does not.
    fn close(self: Box<Self>) -> Result<(), OutputError> {
        if !self.regular {
            return Ok(());
        }
        let closed = match self.length {
            0 => fs::remove_file(&self.path),
            _ => self.file.sync_all().and_then(|()| self.check_there()),
        };
        closed.map_err(|source| OutputError::failed(self.path, source))
    }

    fn path(&self) -> &Path {
        &self.path
    }

    /// A log whose name has that of the board in it: `log-2052.csv` beside `log.csv`; where there is one
    /// already, `log-2052-2.csv` and so on, for a recording that runs cannot ask.
    fn beside(&self, board: &str) -> Result<Box<dyn LogSink>, OutputError> {
        let stem = self.path.file_stem().unwrap_or_default().to_string_lossy();
        let dot = self.path.extension().map(|it| format!(".{}", it.to_string_lossy()));
        let dot = dot.unwrap_or_default();
        let path = |number: u32| {
            let number_text = if number == 1 { String::new() } else { format!("-{number}") };
            self.path.with_file_name(format!("{stem}-{board}{number_text}{dot}"))
        };
        let free = (1..MOST_NAMES).map(path).find(|path| !path.exists());
        Ok(Box::new(Self::create(&free.unwrap_or_else(|| path(MOST_NAMES)), false)?))
    }
}

/// Opens a file that is to grow, and tells whether it is one: devices and pipes are written to. A file that exists is left
/// alone unless `overwrite`.
///
/// # Errors
/// [`OutputError`] if it cannot be made, or is named as a table in binary; its source has kind `AlreadyExists` if it is there.
pub fn open_growing(path: &Path, overwrite: bool) -> Result<(File, bool), OutputError> {
    OutputError::check_text(path)?;
    let is_device = path.exists() && !path.is_file() && !path.is_dir();
    let mut options = OpenOptions::new();
    match (is_device, overwrite) {
        (true, _) => options.write(true),
        (false, true) => options.write(true).create(true).truncate(true),
        (false, false) => options.write(true).create_new(true),
    };
    let file = options.open(path).map_err(|source| OutputError::failed(path, source))?;
    Ok((file, !is_device))
}

/// Names that are tried for the log of a further board.
const MOST_NAMES: u32 = 1000;
