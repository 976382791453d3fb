//! What a name on the command line names: a port or a file.

use std::path::Path;

use board_link::TCP;

/// Whether a name is that of a port, there or not.
pub(super) fn is_port(path: &Path) -> bool {
    if let Ok(metadata) = std::fs::metadata(path) {
        return is_device(&metadata);
    }
    let text = path.to_string_lossy();
    let is_com = text.strip_prefix("COM").is_some_and(|rest| rest.parse::<u16>().is_ok());
    is_com || text.starts_with("/dev/") || text.starts_with(TCP)
}

#[cfg(unix)]
fn is_device(metadata: &std::fs::Metadata) -> bool {
    use std::os::unix::fs::FileTypeExt;
    metadata.file_type().is_char_device()
}

#[cfg(not(unix))]
fn is_device(metadata: &std::fs::Metadata) -> bool {
    !metadata.is_file() && !metadata.is_dir()
}
