//! What the whole-system tests share: where the real recordings are.

use std::path::PathBuf;

/// The file `name` of the real recordings, if this machine has them.
///
/// The recordings are not part of the repository: `SHELLCAL_REAL_DATA` names the directory that
/// holds them. Without it the caller's test says that it was skipped.
pub fn real_recording(name: &str) -> Option<PathBuf> {
    let root = PathBuf::from(std::env::var_os("SHELLCAL_REAL_DATA")?);
    let path = root.join(name);
    path.exists().then_some(path)
}
