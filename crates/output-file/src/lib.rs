//! Writing results: the one place where files are opened to be written.
//!
//! [`Outputs`] knows what a command reads and writes, and opens nothing that would replace an input
//! or another output, by whatever name. A file appears whole or not at all: the bytes go to a
//! temporary file beside the target ([`AtomicFile`]), which is renamed over it once all of them are
//! written. It is not forced to the disk first: a result can be made again from its logs, and waiting
//! for the disk takes longer than a fit. The temporary file is made when the output is opened, so a
//! path that cannot be written is found before the work, not after. What is replaced keeps its
//! permissions, and a symbolic link keeps leading to it. Devices and pipes, which cannot be
//! replaced, are written to directly.

#![allow(clippy::disallowed_methods, clippy::disallowed_types, reason = "writes files")]

mod identity;
mod temporary;

use shell_data::hint::Hint;
use shell_data::lock::lock;
use std::fs::{self, File, Permissions};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use identity::{FileIdentity, Files};
use temporary::Temporary;

pub use temporary::{before_unfinished, remove_unfinished};

/// What a command reads and writes.
#[derive(Debug, Default)]
pub struct Outputs {
    known: Mutex<Files<KnownFile>>,
}

/// A file that is read, or that was announced or opened as an output.
#[derive(Debug, Default)]
struct KnownFile {
    path: PathBuf,
    stage: FileStage,
}

/// How far an output has come; no way leads back.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
enum FileStage {
    #[default]
    Announced,
    Probed,
    Opened,
    /// It is no output.
    Input,
}

/// An output that could not be opened, written or put in place.
#[derive(Debug, thiserror::Error)]
pub enum OutputError {
    /// The system does not let it.
    #[error("cannot write `{}`", path.display())]
    Failed {
        /// The file that was to be written.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// It is what is read.
    #[error("the output `{}` would replace the input `{}`", path.display(), input.display())]
    IsInput {
        /// The file that was to be written.
        path: PathBuf,
        /// The input that it is.
        input: PathBuf,
    },
    /// It is written already.
    #[error("two outputs would be written to one file, `{}`{}", path.display(), also(path, other))]
    Twice {
        /// The file that was to be written.
        path: PathBuf,
        /// The output that it is.
        other: PathBuf,
    },
    /// It stands for the standard output, which a recording is not written to.
    #[error("a recording is a file, and `-` stands for the standard output")]
    Stdout,
    /// It is named as a table in binary, which cannot be read before its end is written.
    #[error("what grows is text, and `{}` is named as something else", .0.display())]
    NotText(PathBuf),
}

impl OutputError {
    /// The error of the system for a file.
    pub fn failed(path: impl Into<PathBuf>, source: io::Error) -> Self {
        Self::Failed { path: path.into(), source }
    }

    /// Refuses a name of a file that frames are to be written to as text while they arrive.
    ///
    /// # Errors
    /// [`OutputError::NotText`].
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
    /// Nothing is read and nothing written so far.
    pub fn new() -> Self {
        Self::default()
    }

    /// Says that `path` is read, so no output may replace it.
    ///
    /// # Errors
    /// [`OutputError::IsInput`] if it is an output that was announced.
    pub fn protect(&self, path: &Path) -> Result<(), OutputError> {
        let Some(identity) = FileIdentity::from_path(path) else { return Ok(()) };
        let (mut known, input) = (lock(&self.known), path.to_path_buf());
        match known.find(&identity) {
            None => known.insert(identity, KnownFile { path: input, stage: FileStage::Input }),
            Some(KnownFile { stage: FileStage::Input, .. }) => {}
            Some(KnownFile { path, .. }) => {
                return Err(OutputError::IsInput { path: path.clone(), input });
            }
        }
        Ok(())
    }

    /// Announces an output that is opened later, or not at all.
    ///
    /// # Errors
    /// [`OutputError::IsInput`], [`OutputError::Twice`].
    pub fn announce(&self, path: &Path) -> Result<(), OutputError> {
        self.claim(path, FileStage::Announced)
    }

    /// Announces an output and finds out whether it can be written, before the work that makes it.
    ///
    /// # Errors
    /// [`OutputError`].
    pub fn probe(&self, path: &Path) -> Result<(), OutputError> {
        self.open(path, FileStage::Probed).map(drop)
    }

    /// Opens `path` for writing without touching what is there.
    ///
    /// # Errors
    /// [`OutputError`] if it is an input or another output, the directory does not exist or is not
    /// writable, or `path` is a directory.
    pub fn create(&self, path: impl AsRef<Path>) -> Result<AtomicFile, OutputError> {
        self.open(path.as_ref(), FileStage::Opened)
    }

    fn open(&self, path: &Path, stage: FileStage) -> Result<AtomicFile, OutputError> {
        self.claim(path, stage)?;
        match OutputTarget::open(path) {
            Ok(target) => Ok(AtomicFile { path: path.to_path_buf(), target }),
            Err(source) => Err(OutputError::failed(path, source)),
        }
    }

    /// Writes `bytes` to `path`, whole or not at all.
    ///
    /// # Errors
    /// [`OutputError`], as for [`create`](Self::create).
    pub fn write(&self, path: impl AsRef<Path>, bytes: &[u8]) -> Result<(), OutputError> {
        self.create(path)?.commit_with(bytes)
    }

    /// Lets every output be written once more, for a command that does its work again.
    pub fn renew(&self) {
        let mut known = lock(&self.known);
        let outputs = known.iter_mut().filter(|file| file.stage != FileStage::Input);
        outputs.for_each(|output| output.stage = FileStage::Announced);
    }

    fn claim(&self, path: &Path, stage: FileStage) -> Result<(), OutputError> {
        let Some(identity) = FileIdentity::from_path(path) else { return Ok(()) };
        let (mut known, path) = (lock(&self.known), path.to_path_buf());
        match known.find(&identity) {
            None => known.insert(identity, KnownFile { path, stage }),
            Some(KnownFile { path: input, stage: FileStage::Input }) => {
                return Err(OutputError::IsInput { path, input: input.clone() });
            }
            Some(file) if file.path == path && file.stage < stage => file.stage = stage,
            Some(file) => return Err(OutputError::Twice { path, other: file.path.clone() }),
        }
        Ok(())
    }
}

/// The other name of a file, if it has one.
fn also(path: &Path, other: &Path) -> String {
    if path == other { String::new() } else { format!(", which is `{}`", other.display()) }
}

/// A file that is being written and does not exist yet under its own name.
#[derive(Debug)]
pub struct AtomicFile {
    path: PathBuf,
    target: OutputTarget,
}

#[derive(Debug)]
enum OutputTarget {
    Replace {
        file: BufWriter<Temporary>,
        /// The end of the links that the path leads through.
        path: PathBuf,
        /// Those of the file that is replaced.
        permissions: Option<Permissions>,
    },
    Device(File),
    Stdout(BufWriter<io::Stdout>),
}

impl AtomicFile {
    /// The standard output in place of a file, for what is not printed line by line.
    pub fn stdout() -> Self {
        Self { path: "-".into(), target: OutputTarget::Stdout(BufWriter::new(io::stdout())) }
    }

    /// Puts the finished file in place.
    ///
    /// # Errors
    /// [`OutputError`] if the last bytes cannot be written or the file cannot be renamed.
    pub fn commit(self) -> Result<(), OutputError> {
        let Self { path, target } = self;
        target.finish().map_err(|source| OutputError::failed(path, source))
    }

    /// Writes all of the file, and puts it in place.
    ///
    /// # Errors
    /// As for [`commit`](Self::commit).
    pub fn commit_with(mut self, bytes: &[u8]) -> Result<(), OutputError> {
        match self.target.writer().write_all(bytes) {
            Ok(()) => self.commit(),
            Err(source) => Err(OutputError::failed(self.path, source)),
        }
    }

    /// An error of the system as one that names the file, and is of the same kind.
    fn named(&self, error: io::Error) -> io::Error {
        io::Error::new(error.kind(), OutputError::failed(&self.path, error))
    }
}

impl OutputTarget {
    fn open(path: &Path) -> io::Result<Self> {
        let metadata = fs::metadata(path).ok();
        if metadata.as_ref().is_some_and(fs::Metadata::is_dir) {
            return Err(io::ErrorKind::IsADirectory.into());
        }
        if metadata.as_ref().is_some_and(|metadata| !metadata.is_file()) {
            return File::options().write(true).open(path).map(OutputTarget::Device);
        }
        let path = identity::resolved(path);
        let directory = match path.parent() {
            Some(parent) if !parent.as_os_str().is_empty() => parent,
            _ => Path::new("."),
        };
        match Temporary::create_in(directory) {
            Ok(file) => Ok(OutputTarget::Replace {
                file: BufWriter::new(file),
                permissions: metadata.map(|metadata| metadata.permissions()),
                path,
            }),
            Err(_) if !directory.is_dir() => Err(io::Error::new(
                io::ErrorKind::NotFound,
                format!("there is no directory `{}`", directory.display()),
            )),
            // The name of the temporary file says nothing to a user; the kind of error does.
            Err(error) => Err(error.kind().into()),
        }
    }

    fn writer(&mut self) -> &mut dyn Write {
        match self {
            OutputTarget::Replace { file, .. } => file,
            OutputTarget::Device(file) => file,
            OutputTarget::Stdout(stdout) => stdout,
        }
    }

    fn finish(mut self) -> io::Result<()> {
        let OutputTarget::Replace { file, path, permissions } = self else {
            return self.writer().flush();
        };
        let mut file = file.into_inner().map_err(io::IntoInnerError::into_error)?;
        if let Some(permissions) = permissions {
            // A file system without permissions keeps none.
            let _ = file.file()?.set_permissions(permissions);
        }
        file.rename(&path)
    }
}

impl Write for AtomicFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.target.writer().write(bytes).map_err(|error| self.named(error))
    }

    fn flush(&mut self) -> io::Result<()> {
        self.target.writer().flush().map_err(|error| self.named(error))
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
        let error = Outputs::new().create(&path).unwrap_err();
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
        outputs.renew();
        outputs.write(&path, b"3").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"3");
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
    fn what_is_replaced_keeps_its_permissions_and_its_link() {
        use std::os::unix::fs::{PermissionsExt, symlink};
        let dir = tempfile::tempdir().unwrap();
        let [file, link] = ["file", "link"].map(|name| dir.path().join(name));
        fs::write(&file, "old").unwrap();
        fs::set_permissions(&file, Permissions::from_mode(0o600)).unwrap();
        symlink("file", &link).unwrap();
        Outputs::new().write(&link, b"new").unwrap();
        assert!(link.is_symlink());
        assert_eq!(fs::read(&file).unwrap(), b"new");
        assert_eq!(fs::metadata(&file).unwrap().permissions().mode() & 0o777, 0o600);
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_full_disk_is_told_with_the_name_of_the_file() {
        let outputs = Outputs::new();
        let mut file = outputs.create("/dev/full").unwrap();
        let error = file.write_all(b"1").unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::StorageFull);
        assert!(error.to_string().contains("`/dev/full`"));
    }
}
