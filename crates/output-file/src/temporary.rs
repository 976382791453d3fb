//! Temporary files, and the list of them: a signal ends the program without running destructors.

use std::collections::BTreeSet;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use shell_data::lock::lock;
use tempfile::TempPath;

/// Each change of it is one call, so whoever panics while holding it leaves it whole.
static UNFINISHED: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

/// What is to be done before there is one, until it is done.
static BEFORE: Mutex<Option<fn()>> = Mutex::new(None);

/// Has `prepare` called before the first temporary file is made, which is when there is something to
/// remove: many commands make none.
pub fn before_unfinished(prepare: fn()) {
    *lock(&BEFORE) = Some(prepare);
}

/// Removes the temporary files of all outputs that are not finished.
///
/// For the end of the program by a signal: whoever opens or finishes an output afterwards waits for
/// ever.
pub fn remove_unfinished() {
    let unfinished = lock(&UNFINISHED);
    for path in unfinished.iter() {
        // It may be gone already; there is nobody to tell, either.
        let _ = std::fs::remove_file(path);
    }
    std::mem::forget(unfinished);
}

/// A file that is removed unless it is put in place.
#[derive(Debug)]
pub(super) struct Temporary {
    /// `None` once it is in place.
    path: Option<TempPath>,
}

impl Temporary {
    pub(super) fn create_in(directory: &Path) -> io::Result<(File, Self)> {
        let mut builder = tempfile::Builder::new();
        builder.prefix(".shellcal-");
        // Temporary files are private by default; a result is as open as the umask allows. Elsewhere
        // a new file has the permissions of its folder.
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
            // Removed before a signal, which waits for the list, can end the program.
            drop(path);
        }
    }
}
