//! The page around the sections of a report: what is in its head, and the way to each section.

use std::fmt::Write;

use super::content::Heading;
use super::markup::escape;

const STYLE: &str = include_str!("../assets/report.css");

/// A part of a report with a heading of its own.
pub(super) struct PageSection {
    /// Its anchor.
    pub(super) id: &'static str,
    /// Its heading.
    pub(super) name: &'static str,
    /// HTML; empty for a section that is left out.
    pub(super) content: String,
}

impl PageSection {
    pub(super) fn new(id: &'static str, name: &'static str, content: String) -> Self {
        Self { id, name, content }
    }
}

/// What a page is made of.
pub(super) struct ReportPage<'a> {
    pub(super) heading: Heading<'a>,
    /// Below the title, as text.
    pub(super) subtitle: &'a str,
    pub(super) sections: Vec<PageSection>,
    /// Script elements, and what is said where they do not run.
    pub(super) script: Option<(String, &'static str)>,
}

impl ReportPage<'_> {
    /// The content of the file. It needs no network, and a content security policy forbids everything that
    /// is not in it.
    pub(super) fn html(&self) -> String {
        let [title, made_by, subtitle] =
            [self.heading.title, self.heading.made_by, self.subtitle].map(escape);
        let shown = || self.sections.iter().filter(|section| !section.content.is_empty());
        let (mut links, mut main) = (String::new(), String::new());
        for PageSection { id, name, content } in shown() {
            let _ = writeln!(links, "<li><a href=\"#{id}\">{name}</a></li>");
            let _ = write!(
                main,
                "<section aria-labelledby=\"{id}\">\n<h2 id=\"{id}\">{name}</h2>\n{content}</section>\n"
            );
        }
        let (script, without) = match &self.script {
            Some((script, without)) => {
                (script.as_str(), format!("<noscript><p>{without}</p></noscript>\n"))
            }
            None => ("", String::new()),
        };
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
}
