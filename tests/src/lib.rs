//! What tests across the crates share: the emulated board, running `shellcal`, and where the real
//! recordings are.

pub mod emulation;
pub mod program;

use std::path::PathBuf;

/// The file `name` of the real recordings; where this machine has none, says that the test was
/// skipped.
///
/// The recordings are not part of the repository: `SHELLCAL_REAL_DATA` names the directory that
/// holds them.
#[expect(clippy::print_stdout, reason = "a skipped test says so")]
pub fn real_recording(name: &str) -> Option<PathBuf> {
    let path = std::env::var_os("SHELLCAL_REAL_DATA").map(|root| PathBuf::from(root).join(name));
    let path = path.filter(|path| path.exists());
    if path.is_none() {
        println!("skipped: SHELLCAL_REAL_DATA does not name a directory with `{name}`");
    }
    path
}
