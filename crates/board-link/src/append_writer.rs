//! Output of a recording, usually a file that grows while the recording runs.
//!
//! All other results are written completely or not at all ([`output_file`]). A recording cannot be
//! repeated, so received data reach the file within half a second and stay there if the program
//! fails. When the disk is full, the file is cut back to the last complete piece. Only a kill in
//! the middle of a write may leave a partial line, which readers of logs skip.

use std::fmt::Debug;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use output_file::OutputError;

/// A growing output for a log or for raw bytes: a file, or the memory of a web page.
pub trait LogSink: Debug + Send {
    /// Appends a piece, completely or not at all. Fails with [`OutputError`] if there is no room
    /// for it.
    fn append(&mut self, piece: &[u8]) -> Result<(), OutputError>;

    /// Closes the output. Fails with [`OutputError`] if part of the data is lost.
    fn close(self: Box<Self>) -> Result<(), OutputError>;

    fn path(&self) -> &Path;

    /// Creates an output for another board, whose name becomes part of the path. Fails with
    /// [`OutputError`] if it cannot be created.
    fn beside(&self, board: &str) -> Result<Box<dyn LogSink>, OutputError>;
}

#[derive(Debug)]
pub struct AppendWriter {
    path: PathBuf,
    file: File,
    length: u64,
    regular: bool,
    /// Set after an error. Data written later would follow a hole that looks like a transmission loss.
    failed: bool,
}

impl AppendWriter {
    /// Creates the file. Fails like [`open_growing`].
    pub fn create(path: &Path, overwrite: bool) -> Result<Self, OutputError> {
        if path.as_os_str() == "-" {
            return Err(OutputError::Stdout);
        }
        let (file, regular) = open_growing(path, overwrite)?;
        Ok(Self { path: path.to_path_buf(), file, length: 0, regular, failed: false })
    }

    /// Checks that the file was not removed. Outside Unix, an open file cannot be removed.
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
            // If this fails too, a partial line stays at the end.
            let _ = self.file.set_len(self.length);
            return Err(OutputError::failed(&self.path, source));
        }
        self.length += piece.len() as u64;
        Ok(())
    }

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

    /// Creates `log-2052.csv` next to `log.csv`, or `log-2052-2.csv` if that exists: a recording cannot ask the user.
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

/// Opens a file for appending, but keeps an existing one unless `overwrite` is set; returns true
/// for a regular file. Fails with [`OutputError`] if the file cannot be created or its name has the
/// extension of a binary table; if the file exists, the error's source has kind `AlreadyExists`.
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

const MOST_NAMES: u32 = 1000;
