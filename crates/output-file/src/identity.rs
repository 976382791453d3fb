//! The identity of a file, which shows if two names belong to the same file.

use std::fs;
use std::io;
#[cfg(unix)]
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// Longest chain of symbolic links, as in operating systems, because links may form a cycle.
const MOST_LINKS: usize = 40;

#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(super) enum FileKey {
    Path(PathBuf),
    /// Device and inode number.
    #[cfg(unix)]
    Number(u64, u64),
}

/// Returns all keys of a file; paths with a common key name the same file. `None` for devices,
/// pipes and folders, which cannot be replaced.
pub(super) fn keys(path: &Path) -> Option<Vec<FileKey>> {
    let metadata = fs::metadata(path).ok();
    if metadata.as_ref().is_some_and(|metadata| !metadata.is_file()) {
        return None;
    }
    let keys = std::iter::once(FileKey::Path(resolved(path)));
    #[cfg(unix)]
    let keys = keys.chain(metadata.map(|it| FileKey::Number(it.dev(), it.ino())));
    Some(keys.collect())
}

/// Resolves symbolic links, even if their target does not exist yet.
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

#[cfg(unix)]
#[cfg(test)]
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
            let known = keys(&at(a)).unwrap();
            keys(&at(b)).unwrap().iter().any(|key| known.contains(key))
        };
        assert!(is("a", "hard") && is("a", "soft") && is("a", "folder/../a"));
        assert!(is("new", "dangling") && is("new", "folder/../new"));
        assert!(!is("a", "new"));
    }

    #[test]
    fn files_that_cannot_be_replaced_have_no_identity() {
        assert!(keys(Path::new("/dev/null")).is_none());
        assert!(keys(Path::new("/")).is_none());
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
