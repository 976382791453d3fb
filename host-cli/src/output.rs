//! Writing results: a file appears whole or not at all.
//!
//! The bytes go to a temporary file beside the target, which is renamed over it once all of them
//! are written. It is not forced to the disk first: a result can be made again from its logs, and
//! waiting for the disk takes longer than a fit. The temporary file is made when the output is opened, so a path that cannot be
//! written is found before the work, not after. Devices and pipes, which cannot be replaced, are
//! written to directly.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

/// A file that is being written and does not exist yet under its own name.
#[derive(Debug)]
pub struct AtomicFile {
    path: PathBuf,
    target: Target,
}

#[derive(Debug)]
enum Target {
    Replace(BufWriter<NamedTempFile>),
    Device(File),
}

/// An output that could not be opened, written or put in place.
#[derive(Debug, thiserror::Error)]
#[error("cannot write `{}`", path.display())]
pub struct OutputError {
    /// The file that was to be written.
    pub path: PathBuf,
    /// What the system said.
    pub source: io::Error,
}

impl AtomicFile {
    /// Opens `path` for writing without touching what is there.
    ///
    /// # Errors
    /// [`OutputError`] if the directory does not exist or is not writable, or `path` is a directory.
    pub fn create(path: impl AsRef<Path>) -> Result<Self, OutputError> {
        let path = path.as_ref().to_path_buf();
        match Target::open(&path) {
            Ok(target) => Ok(Self { path, target }),
            Err(source) => Err(OutputError { path, source }),
        }
    }

    /// Puts the finished file in place.
    ///
    /// # Errors
    /// [`OutputError`] if the last bytes cannot be written or the file cannot be renamed.
    pub fn commit(self) -> Result<(), OutputError> {
        let Self { path, target } = self;
        target.finish(&path).map_err(|source| OutputError { path, source })
    }
}

impl Target {
    fn open(path: &Path) -> io::Result<Self> {
        if path.is_dir() {
            return Err(io::ErrorKind::IsADirectory.into());
        }
        if path.exists() && !path.is_file() {
            return File::options().write(true).open(path).map(Target::Device);
        }
        let directory = match path.parent() {
            Some(parent) if !parent.as_os_str().is_empty() => parent,
            _ => Path::new("."),
        };
        let mut builder = tempfile::Builder::new();
        builder.prefix(".shellcal-");
        // Temporary files are private by default; a result is as open as the umask allows. Elsewhere
        // a new file has the permissions of its folder.
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
        match builder.tempfile_in(directory) {
            Ok(file) => Ok(Target::Replace(BufWriter::new(file))),
            Err(_) if !directory.is_dir() => Err(io::Error::new(
                io::ErrorKind::NotFound,
                format!("there is no directory `{}`", directory.display()),
            )),
            // The name of the temporary file says nothing to a user; the kind of error does.
            Err(error) => Err(error.kind().into()),
        }
    }

    fn finish(self, path: &Path) -> io::Result<()> {
        if let Target::Replace(file) = self {
            let file = file.into_inner().map_err(io::IntoInnerError::into_error)?;
            file.persist(path).map_err(|error| error.error)?;
        }
        Ok(())
    }
}

/// Writes `bytes` to `path`, whole or not at all.
///
/// # Errors
/// [`OutputError`] if the file cannot be written.
pub fn write_atomically(path: impl AsRef<Path>, bytes: &[u8]) -> Result<(), OutputError> {
    let mut file = AtomicFile::create(path)?;
    file.write_all(bytes).map_err(|source| OutputError { path: file.path.clone(), source })?;
    file.commit()
}

impl Write for AtomicFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match &mut self.target {
            Target::Replace(file) => file.write(bytes),
            Target::Device(file) => file.write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match &mut self.target {
            Target::Replace(file) => file.flush(),
            Target::Device(file) => file.flush(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_appears_before_commit_and_the_old_file_stays() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("result.json");
        write_atomically(&path, b"old").unwrap();
        let mut file = AtomicFile::create(&path).unwrap();
        file.write_all(b"new").unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
        file.commit().unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"new");
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_dropped_output_leaves_nothing_behind() {
        let dir = tempfile::tempdir().unwrap();
        drop(AtomicFile::create(dir.path().join("result.json")).unwrap());
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0);
    }

    #[test]
    fn a_missing_directory_is_found_when_the_output_is_opened() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("missing/result.json");
        let error = AtomicFile::create(&path).unwrap_err();
        assert_eq!(error.path, path);
        assert!(AtomicFile::create(dir.path()).is_err());
    }

    #[cfg(unix)]
    #[test]
    fn a_device_is_written_to_and_not_replaced() {
        write_atomically("/dev/null", b"gone").unwrap();
        assert!(!Path::new("/dev/null").is_file());
    }
}
