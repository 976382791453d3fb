//! The page around the sections of a report: what is in its head, and the way to each section.

use std::fmt::Write;

use super::content::Heading;
use super::markup::escape;

const STYLE: &str = include_str!("../assets/report.css");

/// A part of a report with a heading of its own: its anchor, its heading, and HTML, which is empty for a section
/// that is left out.
pub(super) type PageSection = (&'static str, &'static str, String);

/// The content of a file with `subtitle`, a text, below its title. `script` are elements, and what is said where
/// they do not run. The file needs no network, and a content security policy forbids everything that is not in it.
pub(super) fn page(
    heading: Heading<'_>,
    subtitle: &str,
    sections: &[PageSection],
    script: Option<(&str, &str)>,
) -> String {
    let [title, made_by, subtitle] = [heading.title, heading.made_by, subtitle].map(escape);
    let (mut links, mut main) = (String::new(), String::new());
    for (id, name, content) in sections.iter().filter(|(.., content)| !content.is_empty()) {
        let _ = writeln!(links, "<li><a href=\"#{id}\">{name}</a></li>");
        let _ = write!(
            main,
            "<section aria-labelledby=\"{id}\">\n<h2 id=\"{id}\">{name}</h2>\n{content}</section>\n"
        );
    }
    let without = script.map(|(_, without)| format!("<noscript><p>{without}</p></noscript>\n"));
    let (without, script) = (without.unwrap_or_default(), script.unwrap_or_default().0);
    format!(
        r##"<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:; base-uri 'none'; form-action 'none'">
<meta name="generator" content="{made_by}">
<link rel="icon" href="data:,">
<title>{title}</title>
<style>
{STYLE}</style>
</head>
<body>
<a class="skip" href="#main">Skip to the results</a>
<header>
<h1>{title}</h1>
<p class="quiet">{subtitle}</p>
<nav aria-label="Sections"><ul>
{links}</ul></nav>
{without}</header>
<main id="main">
{main}</main>
{script}</body>
</html>
"##
    )
}
