//! The pages of the repository as a book: every page is a chapter, every link leads somewhere.

use std::collections::{BTreeSet, HashMap};
use std::fs;
use std::path::{Component, Path, PathBuf};

pub fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap()
}

/// The pages below a folder, by their paths from the repository's root.
pub fn pages(folder: &Path) -> Vec<PathBuf> {
    let mut pages = Vec::new();
    for entry in fs::read_dir(root().join(folder)).unwrap() {
        let entry = entry.unwrap();
        let name = entry.file_name().into_string().unwrap();
        let path = folder.join(&name);
        let is_ours = !name.starts_with('.') && name != "target";
        if entry.file_type().unwrap().is_dir() {
            if is_ours {
                pages.extend(self::pages(&path));
            }
        } else if name.ends_with(".md") {
            pages.push(path);
        }
    }
    pages.sort();
    pages
}

fn prose(text: &str) -> String {
    let mut in_code = false;
    let is_prose = |line: &&str| {
        let is_fence = line.trim_start().starts_with("```");
        in_code ^= is_fence;
        !in_code && !is_fence
    };
    text.lines().filter(is_prose).collect::<Vec<_>>().join("\n")
}

fn links(text: &str) -> Vec<String> {
    // Text between backticks is not a link.
    let plain: String = prose(text).split('`').step_by(2).collect::<Vec<_>>().join("`");
    let ends = plain.split("](").skip(1);
    let targets = ends.filter_map(|rest| rest.split_once(')').map(|(target, _)| target.to_owned()));
    targets.filter(|target| !target.contains("://") && !target.starts_with("mailto:")).collect()
}

/// The anchors of a page's headings, as GitHub makes them.
fn anchors(text: &str) -> BTreeSet<String> {
    let mut seen: HashMap<String, usize> = HashMap::new();
    let headings = prose(text);
    let headings = headings.lines().filter(|line| line.starts_with('#'));
    let anchor = |line: &str| {
        let kept = |c: char| match c {
            ' ' => Some('-'),
            c if c.is_alphanumeric() || c == '-' || c == '_' => Some(c),
            _ => None,
        };
        let title = line.trim_start_matches('#').trim().to_lowercase();
        let slug: String = title.chars().filter_map(kept).collect();
        let count = seen.entry(slug.clone()).or_default();
        *count += 1;
        if *count == 1 { slug } else { format!("{slug}-{}", *count - 1) }
    };
    headings.map(anchor).collect()
}

/// `docs/../README.md` is `README.md`.
fn normal(path: &Path) -> PathBuf {
    let mut normal = PathBuf::new();
    for part in path.components() {
        match part {
            Component::ParentDir => assert!(normal.pop(), "{}", path.display()),
            Component::CurDir => {}
            part => normal.push(part),
        }
    }
    normal
}

#[test]
fn every_link_of_every_page_leads_to_a_file_and_a_heading() {
    let pages = pages(Path::new(""));
    assert!(pages.len() > 40, "{}", pages.len());
    let mut dead = Vec::new();
    let mut count = 0;
    for page in pages {
        let text = fs::read_to_string(root().join(&page)).unwrap();
        for link in links(&text) {
            count += 1;
            let (path, anchor) = link.split_once('#').unwrap_or((&link, ""));
            let target = match path {
                "" => page.clone(),
                path => normal(&page.parent().unwrap().join(path)),
            };
            let file = root().join(&target);
            let leads = match anchor {
                "" => file.exists(),
                anchor => {
                    fs::read_to_string(&file).is_ok_and(|text| anchors(&text).contains(anchor))
                }
            };
            if !leads {
                dead.push(format!("{}: {link}", page.display()));
            }
        }
    }
    assert_eq!(dead, Vec::<String>::new());
    assert!(count > 150, "{count}");
}

#[test]
fn every_page_of_the_documentation_is_a_chapter_and_every_chapter_is_there() {
    let summary = Path::new("docs/SUMMARY.md");
    let text = fs::read_to_string(root().join(summary)).unwrap();
    let chapter = |link: String| normal(&Path::new("docs").join(link));
    let chapters: Vec<PathBuf> = links(&text).into_iter().map(chapter).collect();
    let once: BTreeSet<&PathBuf> = chapters.iter().collect();
    assert_eq!(once.len(), chapters.len(), "a chapter stands twice");
    let pages: BTreeSet<PathBuf> = pages(Path::new("docs")).into_iter().collect();
    let missing: Vec<_> =
        pages.iter().filter(|page| *page != summary && !once.contains(page)).collect();
    assert_eq!(missing, Vec::<&PathBuf>::new());
    assert_eq!(once.into_iter().find(|chapter| !root().join(chapter).is_file()), None);
}

#[test]
fn the_screen_in_the_book_equals_that_of_the_live_view() {
    let page = fs::read_to_string(root().join("docs/board.md")).unwrap();
    let golden = "host-cli/tests/boards/golden/live/forces-80x24.txt";
    let screen = fs::read_to_string(root().join(golden)).unwrap();
    assert!(page.contains(&format!("```text\n{}\n```", screen.trim_end())), "copy {golden}");
}

#[test]
fn anchors_equal_those_of_github() {
    let of = |text: &str| anchors(text).into_iter().collect::<Vec<_>>();
    assert_eq!(of("## `--model auto`"), ["--model-auto"]);
    assert_eq!(
        of("# Kind 8: command\n```\n# code\n```\n# A b\n# A b"),
        ["a-b", "a-b-1", "kind-8-command"]
    );
    let text = "[a](b.md#c) `[no](code)` ![p](x.svg) [web](https://w.org/) \n```\n[no](x)\n```";
    assert_eq!(links(text), ["b.md#c", "x.svg"]);
}
