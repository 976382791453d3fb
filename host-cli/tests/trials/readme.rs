//! The console blocks of the README and of the pages under `docs`, run unchanged.

use std::fs;
use std::path::{Path, PathBuf};

use super::book::{pages, root};

/// Its commands build on one another, and one runs in parallel; a separate test runs them.
const TUTORIAL: &str = "docs/tutorial.md";

fn console_pages() -> Vec<PathBuf> {
    let pages = [PathBuf::from("README.md")].into_iter().chain(pages(Path::new("docs")));
    let has_console = |page: &PathBuf| {
        let text = fs::read_to_string(root().join(page)).unwrap();
        page != Path::new(TUTORIAL) && text.lines().any(|line| line == "```console")
    };
    pages.filter(has_console).collect()
}

/// Each page runs in a separate folder with the shipped data, because the commands write files.
#[test]
fn the_console_blocks_of_the_pages_give_their_output() {
    let root = root();
    let folder = tempfile::tempdir().unwrap();
    let cases = trycmd::TestCases::new();
    let pages = console_pages();
    assert!(pages.len() > 7, "{pages:?}");
    for page in pages {
        let name = page.display().to_string().replace('/', "-");
        fs::copy(root.join(&page), folder.path().join(&name)).unwrap();
        // trycmd runs a document's commands in the folder beside it.
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
