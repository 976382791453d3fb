use std::path::PathBuf;

/// Writes `bytes` to a file of this process, in memory if the system has a folder for that.
pub fn file(bytes: &[u8]) -> PathBuf {
    let folder = Some(PathBuf::from("/dev/shm")).filter(|folder| folder.is_dir());
    let folder = folder.unwrap_or_else(std::env::temp_dir);
    let path = folder.join(format!("shellcal-fuzz-{}", std::process::id()));
    std::fs::write(&path, bytes).expect("the folder for temporary files can be written to");
    path
}
