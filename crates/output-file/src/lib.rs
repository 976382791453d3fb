//! The one place where files are opened for writing.
//!
//! [`Outputs`] refuses an output that would replace an input or another output, under any name. A file appears whole or
//! not at all: a temporary file in the same folder ([`AtomicFile`]) replaces the target by a rename. The temporary file
//! is not synced first, because a result can be computed again from its logs, and a sync takes longer than a fit. It is
//! created when the output is opened, so that an unwritable path is reported before the work. A replaced file keeps its
//! permissions and the symbolic links to it. Devices and pipes are written directly.

#![allow(clippy::disallowed_methods, clippy::disallowed_types, reason = "writes files")]

mod identity;
mod temporary;

use shell_data::hint::Hint;
use shell_data::lock::lock;
use std::collections::HashMap;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use identity::FileKey;
use temporary::Temporary;

pub use temporary::{before_unfinished, remove_unfinished};

#[derive(Debug, Default)]
pub struct Outputs {
    known: Mutex<KnownFiles>,
}

#[derive(Debug, Default)]
struct KnownFiles {
    files: Vec<KnownFile>,
    by_key: HashMap<FileKey, usize>,
}

#[derive(Debug)]
struct KnownFile {
    path: PathBuf,
    stage: FileStage,
}

/// Stages of an output, in order of progress; an input is last.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum FileStage {
    Announced,
    Probed,
    Opened,
    Input,
}

#[derive(Debug, thiserror::Error)]
pub enum OutputError {
    #[error("cannot write `{}`", path.display())]
    Failed { path: PathBuf, source: io::Error },
    #[error("the output `{}` would replace the input `{}`", path.display(), input.display())]
    IsInput { path: PathBuf, input: PathBuf },
    #[error("two outputs would be written to one file, `{}`{}", path.display(), also(path, other))]
    Twice { path: PathBuf, other: PathBuf },
    #[error("a recording is a file, and `-` stands for the standard output")]
    Stdout,
    /// The name of a growing output has the extension of a binary table, which cannot be read until it is complete.
    #[error("what grows is text, and `{}` is named as something else", .0.display())]
    NotText(PathBuf),
}

impl OutputError {
    pub fn failed(path: impl Into<PathBuf>, source: io::Error) -> Self {
        Self::Failed { path: path.into(), source }
    }

    pub fn check_text(path: &Path) -> Result<(), Self> {
        let extension = path.extension().map(|it| it.to_string_lossy().to_lowercase());
        let is_binary = |extension: &str| ["mcap", "parquet", "mat", "npy"].contains(&extension);
        match extension.as_deref().is_some_and(is_binary) {
            true => Err(Self::NotText(path.to_path_buf())),
            false => Ok(()),
        }
    }
}

impl Hint for OutputError {
    fn hint(&self) -> Option<String> {
        let text = match self {
            Self::IsInput { .. } | Self::Twice { .. } => "choose another name for it",
            Self::NotText(path) => {
                let (path, log) = (path.display(), path.with_extension("csv"));
                let log = log.display();
                return Some(format!(
                    "write `{log}`, and then `shellcal convert CAL {log} --causal --all-rows -o {path}`"
                ));
            }
            Self::Stdout => {
                "`shellcal stream` writes frames to the standard output as they arrive; a file of that name is `./-`"
            }
            Self::Failed { source, .. } => match source.kind() {
                io::ErrorKind::AlreadyExists => "choose another name, or `--overwrite` it",
                io::ErrorKind::StorageFull => "what was written until then is whole; make room",
                _ => return None,
            },
        };
        Some(text.to_owned())
    }
}

impl Outputs {
    pub fn new() -> Self {
        Self::default()
    }

    /// Registers an input, which no output may replace.
    ///
    /// # Errors
    /// [`OutputError::IsInput`] if it is an announced output.
    pub fn protect(&self, path: &Path) -> Result<(), OutputError> {
        self.claim(path, FileStage::Input)
    }

    /// Announces an output that may be opened later.
    ///
    /// # Errors
    /// [`OutputError::IsInput`], [`OutputError::Twice`].
    pub fn announce(&self, path: &Path) -> Result<(), OutputError> {
        self.claim(path, FileStage::Announced)
    }

    /// Announces an output and checks that it can be written, before the work.
    pub fn probe(&self, path: &Path) -> Result<(), OutputError> {
        self.open(path, FileStage::Probed).map(drop)
    }

    /// Opens `path` for writing. An existing file is unchanged until the commit.
    ///
    /// # Errors
    /// [`OutputError`] if it is an input, another output or a directory, or cannot be written.
    pub fn create(&self, path: impl AsRef<Path>) -> Result<AtomicFile, OutputError> {
        self.open(path.as_ref(), FileStage::Opened)
    }

    fn open(&self, path: &Path, stage: FileStage) -> Result<AtomicFile, OutputError> {
        self.claim(path, stage)?;
        AtomicFile::open(path).map_err(|source| OutputError::failed(path, source))
    }

    /// Writes `bytes` to `path`, whole or not at all, with the errors of [`create`](Self::create).
    pub fn write(&self, path: impl AsRef<Path>, bytes: &[u8]) -> Result<(), OutputError> {
        self.create(path)?.commit_with(bytes)
    }

    fn claim(&self, path: &Path, stage: FileStage) -> Result<(), OutputError> {
        let Some(keys) = identity::keys(path) else { return Ok(()) };
        let (mut known, path) = (lock(&self.known), path.to_path_buf());
        let KnownFiles { files, by_key } = &mut *known;
        // A known key may be out of date: the system reuses the inode number of a replaced file.
        let has_now = |at: usize, key: &FileKey| {
            identity::keys(&files[at].path).is_some_and(|keys| keys.contains(key))
        };
        let known = |key: &FileKey| by_key.get(key).copied().filter(|at| has_now(*at, key));
        let Some(position) = keys.iter().find_map(known) else {
            by_key.extend(keys.into_iter().map(|key| (key, files.len())));
            files.push(KnownFile { path, stage });
            return Ok(());
        };
        let file = &mut files[position];
        match (file.stage, stage) {
            (FileStage::Input, FileStage::Input) => {}
            (FileStage::Input, _) => {
                return Err(OutputError::IsInput { path, input: file.path.clone() });
            }
            (_, FileStage::Input) => {
                return Err(OutputError::IsInput { path: file.path.clone(), input: path });
            }
            (before, _) if before < stage && file.path == path => file.stage = stage,
            _ => return Err(OutputError::Twice { path, other: file.path.clone() }),
        }
        Ok(())
    }
}

fn also(path: &Path, other: &Path) -> String {
    if path == other { String::new() } else { format!(", which is `{}`", other.display()) }
}

/// A file that appears under its name on [`commit`](Self::commit).
pub struct AtomicFile {
    path: PathBuf,
    file: BufWriter<Box<dyn Write + Send>>,
    replacement: Option<(Temporary, PathBuf)>,
}

impl AtomicFile {
    pub fn stdout() -> Self {
        let stdout: Box<dyn Write + Send> = Box::new(io::stdout());
        Self { path: "standard output".into(), file: BufWriter::new(stdout), replacement: None }
    }

    fn open(path: &Path) -> io::Result<Self> {
        let metadata = fs::metadata(path).ok();
        if metadata.as_ref().is_some_and(fs::Metadata::is_dir) {
            return Err(io::ErrorKind::IsADirectory.into());
        }
        let named = path.to_path_buf();
        if metadata.as_ref().is_some_and(|metadata| !metadata.is_file()) {
            // Without a buffer, the reader of a pipe gets the bytes at once.
            let device = File::options().write(true).open(path)?;
            let file = BufWriter::with_capacity(0, Box::new(device) as _);
            return Ok(Self { path: named, file, replacement: None });
        }
        let target = identity::resolved(path);
        let directory = match target.parent() {
            Some(parent) if !parent.as_os_str().is_empty() => parent,
            _ => Path::new("."),
        };
        let (file, temporary) = match Temporary::create_in(directory) {
            Ok(created) => created,
            Err(_) if !directory.is_dir() => {
                let text = format!("there is no directory `{}`", directory.display());
                return Err(io::Error::new(io::ErrorKind::NotFound, text));
            }
            // Only the kind of error is kept, because the user does not know the temporary file's name.
            Err(error) => return Err(error.kind().into()),
        };
        if let Some(replaced) = metadata {
            // Errors are ignored, because some file systems have no permissions.
            let _ = file.set_permissions(replaced.permissions());
        }
        let file = BufWriter::new(Box::new(file) as _);
        Ok(Self { path: named, file, replacement: Some((temporary, target)) })
    }

    /// Puts the finished file in place.
    ///
    /// # Errors
    /// [`OutputError`] if the last bytes cannot be written or the file cannot be renamed.
    pub fn commit(mut self) -> Result<(), OutputError> {
        self.finish().map_err(|source| OutputError::failed(self.path, source))
    }

    fn finish(&mut self) -> io::Result<()> {
        self.file.flush()?;
        match self.replacement.take() {
            Some((temporary, target)) => temporary.rename(&target),
            None => Ok(()),
        }
    }

    /// Writes the whole content, and puts the file in place like [`commit`](Self::commit).
    pub fn commit_with(mut self, bytes: &[u8]) -> Result<(), OutputError> {
        match self.file.write_all(bytes) {
            Ok(()) => self.commit(),
            Err(source) => Err(OutputError::failed(self.path, source)),
        }
    }

    fn named(&self, error: io::Error) -> io::Error {
        io::Error::new(error.kind(), OutputError::failed(&self.path, error))
    }
}

impl Write for AtomicFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write(bytes).map_err(|error| self.named(error))
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush().map_err(|error| self.named(error))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_appears_before_commit_and_the_old_file_stays() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("result.json");
        Outputs::new().write(&path, b"old").unwrap();
        let mut file = Outputs::new().create(&path).unwrap();
        file.write_all(b"new").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"old");
        file.commit().unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"new");
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_dropped_output_leaves_nothing_behind() {
        let dir = tempfile::tempdir().unwrap();
        drop(Outputs::new().create(dir.path().join("result.json")).unwrap());
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 0);
    }

    #[test]
    fn a_missing_directory_is_found_when_the_output_is_opened() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("missing/result.json");
        let error = Outputs::new().create(&path).err().unwrap();
        assert!(error.to_string().contains(&path.display().to_string()));
        assert!(Outputs::new().create(dir.path()).is_err());
    }

    #[test]
    fn an_input_is_never_an_output() {
        let dir = tempfile::tempdir().unwrap();
        let [a, b] = ["a", "b"].map(|name| dir.path().join(name));
        fs::write(&a, "1").unwrap();
        fs::hard_link(&a, &b).unwrap();
        let outputs = Outputs::new();
        outputs.protect(&a).unwrap();
        for path in [&a, &b] {
            assert!(matches!(outputs.create(path), Err(OutputError::IsInput { .. })));
            assert!(matches!(outputs.announce(path), Err(OutputError::IsInput { .. })));
        }
        let late = Outputs::new();
        late.announce(&a).unwrap();
        assert!(matches!(late.protect(&b), Err(OutputError::IsInput { .. })));
    }

    #[test]
    fn two_outputs_are_never_one_file() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a");
        let outputs = Outputs::new();
        outputs.announce(&path).unwrap();
        outputs.write(&path, b"1").unwrap();
        let other = dir.path().join(".").join("a");
        for path in [&path, &other] {
            assert!(matches!(outputs.write(path, b"2"), Err(OutputError::Twice { .. })));
        }
        assert_eq!(fs::read(&path).unwrap(), b"1");
    }

    #[cfg(unix)]
    #[test]
    fn a_device_is_written_to_and_not_replaced() {
        let outputs = Outputs::new();
        outputs.write("/dev/null", b"gone").unwrap();
        outputs.write("/dev/null", b"gone").unwrap();
        assert!(!Path::new("/dev/null").is_file());
    }

    #[cfg(unix)]
    #[test]
    fn a_replaced_file_keeps_its_permissions_and_its_link() {
        use std::os::unix::fs::{PermissionsExt, symlink};
        let dir = tempfile::tempdir().unwrap();
        let [file, link] = ["file", "link"].map(|name| dir.path().join(name));
        fs::write(&file, "old").unwrap();
        fs::set_permissions(&file, fs::Permissions::from_mode(0o600)).unwrap();
        symlink("file", &link).unwrap();
        Outputs::new().write(&link, b"new").unwrap();
        assert!(link.is_symlink());
        assert_eq!(fs::read(&file).unwrap(), b"new");
        assert_eq!(fs::metadata(&file).unwrap().permissions().mode() & 0o777, 0o600);
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_full_disk_is_an_error_that_names_the_file() {
        let outputs = Outputs::new();
        let mut file = outputs.create("/dev/full").unwrap();
        let error = file.write_all(b"1").unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::StorageFull);
        assert!(error.to_string().contains("`/dev/full`"));
    }
}
