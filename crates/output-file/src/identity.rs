//! Which file a path means, whatever it is called.

use std::collections::HashMap;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// Links that lead to each other are given up after so many, as the systems do.
const MOST_LINKS: usize = 40;

/// What tells a file from others: where it is in the end and, if it is there, device and number.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct FileIdentity {
    path: PathBuf,
    number: Option<(u64, u64)>,
}

impl FileIdentity {
    /// `None` for what is no file that could be replaced: devices, pipes, folders.
    pub(super) fn from_path(path: &Path) -> Option<Self> {
        let metadata = fs::metadata(path).ok();
        if metadata.as_ref().is_some_and(|metadata| !metadata.is_file()) {
            return None;
        }
        Some(Self { path: resolved(path), number: metadata.as_ref().and_then(number) })
    }
}

/// Something about each of many files.
#[derive(Debug, Default)]
pub(super) struct Files<T> {
    entries: Vec<T>,
    by_path: HashMap<PathBuf, usize>,
    by_number: HashMap<(u64, u64), usize>,
}

impl<T> Files<T> {
    pub(super) fn find(&mut self, identity: &FileIdentity) -> Option<&mut T> {
        let by_number = || identity.number.and_then(|number| self.by_number.get(&number));
        let index = self.by_path.get(&identity.path).or_else(by_number)?;
        self.entries.get_mut(*index)
    }

    pub(super) fn insert(&mut self, identity: FileIdentity, entry: T) {
        let index = self.entries.len();
        self.entries.push(entry);
        self.by_path.insert(identity.path, index);
        self.by_number.extend(identity.number.map(|number| (number, index)));
    }

    pub(super) fn iter_mut(&mut self) -> impl Iterator<Item = &mut T> {
        self.entries.iter_mut()
    }
}

#[cfg(unix)]
#[expect(clippy::unnecessary_wraps, reason = "elsewhere there is no such number")]
fn number(metadata: &fs::Metadata) -> Option<(u64, u64)> {
    use std::os::unix::fs::MetadataExt;
    Some((metadata.dev(), metadata.ino()))
}

#[cfg(not(unix))]
fn number(_: &fs::Metadata) -> Option<(u64, u64)> {
    None
}

/// Where a path leads, through links, even if nothing is there yet.
pub(super) fn resolved(path: &Path) -> PathBuf {
    if let Ok(resolved) = path.canonicalize() {
        return resolved;
    }
    let path = follow(path).unwrap_or_else(|_| path.to_path_buf());
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    match (folder.unwrap_or(Path::new(".")).canonicalize(), path.file_name()) {
        (Ok(folder), Some(name)) => folder.join(name),
        _ => path,
    }
}

/// The end of a chain of links, at which nothing is.
fn follow(path: &Path) -> io::Result<PathBuf> {
    let mut path = path.to_path_buf();
    for _ in 0..MOST_LINKS {
        if !path.is_symlink() {
            return Ok(path);
        }
        let target = fs::read_link(&path)?;
        path = path.parent().unwrap_or(Path::new("")).join(target);
    }
    Err(io::ErrorKind::InvalidInput.into())
}

#[cfg(all(test, unix))]
mod tests {
    use std::os::unix::fs::symlink;

    use super::*;

    #[test]
    fn a_file_is_the_same_by_any_name() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        fs::write(at("a"), "1").unwrap();
        fs::hard_link(at("a"), at("hard")).unwrap();
        symlink("a", at("soft")).unwrap();
        symlink("new", at("dangling")).unwrap();
        fs::create_dir(at("folder")).unwrap();
        let is = |a: &str, b: &str| {
            let mut files = Files::default();
            files.insert(FileIdentity::from_path(&at(a)).unwrap(), ());
            files.find(&FileIdentity::from_path(&at(b)).unwrap()).is_some()
        };
        assert!(is("a", "hard") && is("a", "soft") && is("a", "folder/../a"));
        assert!(is("new", "dangling") && is("new", "folder/../new"));
        assert!(!is("a", "new"));
    }

    #[test]
    fn what_cannot_be_replaced_has_no_identity() {
        assert!(FileIdentity::from_path(Path::new("/dev/null")).is_none());
        assert!(FileIdentity::from_path(Path::new("/")).is_none());
    }

    #[test]
    fn links_in_a_circle_end() {
        let dir = tempfile::tempdir().unwrap();
        let (a, b) = (dir.path().join("a"), dir.path().join("b"));
        symlink(&a, &b).unwrap();
        symlink(&b, &a).unwrap();
        assert!(follow(&a).is_err());
    }
}
