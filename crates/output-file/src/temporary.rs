//! Temporary files, and their removal by signals, which end the program without destructors.

use std::collections::BTreeSet;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use shell_data::lock::lock;
use tempfile::TempPath;

/// Paths of temporary files. Every change is a single call, so the set stays valid if a thread panics.
static UNFINISHED: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

/// The function that runs once, before the first temporary file is created.
static BEFORE: Mutex<Option<fn()>> = Mutex::new(None);

/// Registers `prepare` to run before the first temporary file is created; many commands create none.
pub fn before_unfinished(prepare: fn()) {
    *lock(&BEFORE) = Some(prepare);
}

/// Removes the temporary files of unfinished outputs when a signal ends the program. Afterwards, opening or finishing
/// an output blocks forever.
pub fn remove_unfinished() {
    let unfinished = lock(&UNFINISHED);
    for path in unfinished.iter() {
        // The file may already be gone.
        let _ = std::fs::remove_file(path);
    }
    std::mem::forget(unfinished);
}

#[derive(Debug)]
pub(super) struct Temporary {
    /// `None` once the file is in place or removed.
    path: Option<TempPath>,
}

impl Temporary {
    pub(super) fn create_in(directory: &Path) -> io::Result<(File, Self)> {
        let mut builder = tempfile::Builder::new();
        builder.prefix(".shellcal-");
        // Outputs get the permissions that the umask allows; temporary files would be private by default. On other
        // systems, the folder decides.
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
        if let Some(prepare) = lock(&BEFORE).take() {
            prepare();
        }
        let mut unfinished = lock(&UNFINISHED);
        let (file, path) = builder.tempfile_in(directory)?.into_parts();
        unfinished.insert(path.to_path_buf());
        Ok((file, Self { path: Some(path) }))
    }

    pub(super) fn rename(mut self, target: &Path) -> io::Result<()> {
        let mut unfinished = lock(&UNFINISHED);
        let Some(path) = self.path.take() else { return Ok(()) };
        unfinished.remove(&*path);
        path.persist(target).map_err(|error| error.error)
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        if let Some(path) = self.path.take() {
            let mut unfinished = lock(&UNFINISHED);
            unfinished.remove(&*path);
            // The set is still locked here, so that a signal waits for the removal.
            drop(path);
        }
    }
}
