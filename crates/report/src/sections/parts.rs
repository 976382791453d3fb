//! Tables, figures and numbers that several sections have.

use super::super::markup::{Column, escape, table};

pub(crate) fn facts_table<N: ToString>(caption: &str, facts: &[(N, String)]) -> String {
    let names = facts.iter().map(|(name, _)| name.to_string());
    let values = facts.iter().map(|(_, value)| value);
    table(caption, &[Column::text("what", names), Column::long("value", values)])
}

pub(super) fn plot_figure(id: &str, class: &str, alt: &str, caption: &str) -> String {
    let (alt, caption) = (escape(alt), escape(caption));
    format!(
        "<figure>\n<div id=\"{id}\" class=\"plot{class}\" role=\"group\" aria-label=\"{alt}\"></div>\n\
         <div class=\"keys\" role=\"group\" aria-label=\"Show and hide\"></div>\n\
         <figcaption>{caption}</figcaption>\n</figure>\n"
    )
}

/// A finished picture, which is on white paper whatever the page is, and scrolls in a box of its own where it
/// is wider than the page.
pub(crate) fn drawing(id: &str, svg: &str, alt: &str, caption: &str) -> String {
    let (alt, caption) = (escape(alt), escape(caption));
    // The root element of the document carries what it shows; an XML declaration has no place in HTML.
    let svg = svg.find("<svg").map_or(svg, |start| &svg[start..]);
    // Several drawings in one page have names of their own for what they clip by.
    let svg = svg.replace("id=\"clip", &format!("id=\"{id}-clip"));
    let svg = svg.replace("url(#clip", &format!("url(#{id}-clip"));
    let svg = svg.replacen("<svg", &format!("<svg role=\"img\" aria-label=\"{alt}\""), 1);
    format!(
        "<figure>\n<div class=\"table drawing\" tabindex=\"0\" role=\"region\" aria-label=\"Figure: {caption}\">\n\
         {svg}\n</div>\n<figcaption>{caption}</figcaption>\n</figure>\n"
    )
}

/// What only some readers want, behind its title.
pub(crate) fn folded(title: &str, content: &str) -> String {
    format!("<details>\n<summary>{}</summary>\n{content}</details>\n", escape(title))
}

pub(super) fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
}
