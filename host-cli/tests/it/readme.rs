//! The README's console blocks, run as they stand.

use std::fs;
use std::path::Path;

/// In a copy of the folder, because the commands write files beside the data.
#[test]
fn the_console_blocks_of_the_readme_do_what_they_say() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let folder = tempfile::tempdir().unwrap();
    fs::copy(root.join("README.md"), folder.path().join("README.md")).unwrap();
    // The folder beside a document that trycmd runs its commands in.
    let data = folder.path().join("README.in/calibration-data");
    fs::create_dir_all(&data).unwrap();
    for entry in fs::read_dir(root.join("calibration-data")).unwrap() {
        let entry = entry.unwrap();
        fs::copy(entry.path(), data.join(entry.file_name())).unwrap();
    }
    trycmd::TestCases::new().case(folder.path().join("README.md")).run();
}
