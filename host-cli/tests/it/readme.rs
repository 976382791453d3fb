//! The console blocks of the README and of the pages under `docs`, run as they stand.

use std::fs;
use std::path::Path;

/// Pages with console blocks, in the order in which a reader meets them.
const PAGES: [&str; 5] =
    ["README.md", "docs/tour.md", "docs/trials.md", "docs/board.md", "docs/beam-channel.md"];

/// Each page in a folder of its own with the shipped data, because the commands write files beside them.
#[test]
fn the_console_blocks_of_the_pages_do_what_they_say() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let cases = trycmd::TestCases::new();
    for page in PAGES {
        let name = page.replace('/', "-");
        fs::copy(root.join(page), folder.path().join(&name)).unwrap();
        // The folder beside a document that trycmd runs its commands in.
        let stem = name.strip_suffix(".md").unwrap();
        let data = folder.path().join(format!("{stem}.in/calibration-data"));
        fs::create_dir_all(&data).unwrap();
        for entry in fs::read_dir(root.join("calibration-data")).unwrap() {
            let entry = entry.unwrap();
            fs::copy(entry.path(), data.join(entry.file_name())).unwrap();
        }
        cases.case(folder.path().join(&name));
    }
    cases.run();
}
