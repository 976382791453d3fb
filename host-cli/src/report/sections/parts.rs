//! Tables, figures and numbers that several sections have.

use super::super::markup::{Cell, escape, table};

pub(super) fn facts_table(caption: &str, facts: &[(&str, String)]) -> String {
    let rows: Vec<Vec<Cell>> = facts
        .iter()
        .map(|(name, value)| vec![Cell::from(*name), Cell::Long(value.clone())])
        .collect();
    table(caption, &[("", true), ("", true)], &rows)
}

pub(super) fn plot_figure(id: &str, class: &str, alt: &str, caption: &str) -> String {
    let (alt, caption) = (escape(alt), escape(caption));
    format!(
        "<figure>\n<div id=\"{id}\" class=\"plot{class}\" role=\"img\" aria-label=\"{alt}\"></div>\n\
         <div class=\"keys\" role=\"group\" aria-label=\"Show and hide\"></div>\n\
         <figcaption>{caption}</figcaption>\n</figure>\n"
    )
}

/// What only some readers want, behind its title.
pub(super) fn folded(title: &str, content: &str) -> String {
    format!("<details>\n<summary>{}</summary>\n{content}</details>\n", escape(title))
}

pub(super) fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
}
