//! HTML pages, tables and figures, and formatted numbers.

use std::fmt::Write;

pub(super) use shell_data::escape::markup as escape;

const STYLE: &str = include_str!("../assets/report.css");

/// Formats a number in four significant digits, with a true minus sign; a dash for none.
pub(super) fn figure(value: impl Into<Option<f64>>) -> String {
    significant(value, 4)
}

pub(super) fn significant(value: impl Into<Option<f64>>, digits: i32) -> String {
    let Some(value) = value.into().filter(|value| value.is_finite()) else {
        return "–".to_owned();
    };
    let text = match value.abs() {
        0.0 => "0".to_owned(),
        size if (1e-4..1e6).contains(&size) => {
            let decimals = (digits - 1 - size.log10().floor() as i32).clamp(0, 7) as usize;
            format!("{value:.decimals$}")
        }
        _ => format!("{value:.*e}", digits as usize - 1),
    };
    text.replace('-', "\u{2212}")
}

pub(super) struct Column {
    name: String,
    class: &'static str,
    cells: Vec<String>,
}

impl Column {
    fn new(name: &str, class: &'static str, cells: impl IntoIterator<Item: ToString>) -> Self {
        let cells = cells.into_iter().map(|cell| cell.to_string()).collect();
        Self { name: name.to_owned(), class, cells }
    }

    pub(super) fn text(name: &str, cells: impl IntoIterator<Item: ToString>) -> Self {
        Self::new(name, "text", cells)
    }

    pub(super) fn long(name: &str, cells: impl IntoIterator<Item: ToString>) -> Self {
        Self::new(name, "text long", cells)
    }

    pub(super) fn numbers(name: &str, cells: impl IntoIterator<Item: ToString>) -> Self {
        Self::new(name, "", cells)
    }

    /// A column of numbers in four significant digits.
    pub(super) fn figures(name: &str, values: impl IntoIterator<Item: Into<Option<f64>>>) -> Self {
        Self::numbers(name, values.into_iter().map(figure))
    }
}

/// A table of columns of equal length, in a box that scrolls on narrow screens.
pub(super) fn table(caption: &str, columns: &[Column]) -> String {
    let caption = escape(caption);
    let rows = columns.first().map_or(0, |column| column.cells.len());
    let mut html = format!(
        "<div class=\"table\" tabindex=\"0\" role=\"region\" aria-label=\"{caption}\">\n<table>\n\
         <caption>{caption}</caption>\n<thead><tr>"
    );
    for Column { name, class, .. } in columns {
        let class = if class.is_empty() || rows == 0 { "" } else { " class=\"text\"" };
        let _ = write!(html, "<th scope=\"col\"{class}>{}</th>", escape(name));
    }
    html.push_str("</tr></thead>\n<tbody>\n");
    for row in 0..rows {
        html.push_str("<tr>");
        for Column { class, cells, .. } in columns {
            let text = escape(&cells[row]);
            let _ = match *class {
                "" => write!(html, "<td>{text}</td>"),
                class => write!(html, "<td class=\"{class}\">{text}</td>"),
            };
        }
        html.push_str("</tr>\n");
    }
    html.push_str("</tbody>\n</table>\n</div>\n");
    html
}

pub(super) fn facts_table<N: ToString>(caption: &str, facts: &[(N, String)]) -> String {
    let names = facts.iter().map(|(name, _)| name.to_string());
    let values = facts.iter().map(|(_, value)| value);
    table(caption, &[Column::text("what", names), Column::long("value", values)])
}

pub(super) fn reproduction(command: &str) -> String {
    format!("<pre><code>{}</code></pre>\n", escape(command))
}

pub(super) fn plot_figure(id: &str, class: &str, alt: &str, caption: &str) -> String {
    let (alt, caption) = (escape(alt), escape(caption));
    format!(
        "<figure>\n<div id=\"{id}\" class=\"plot{class}\" role=\"group\" aria-label=\"{alt}\"></div>\n\
         <div class=\"keys\" role=\"group\" aria-label=\"Show and hide\"></div>\n\
         <figcaption>{caption}</figcaption>\n</figure>\n"
    )
}

/// A drawing on white, in a box that scrolls if the drawing is wider than the page.
pub(super) fn drawing(id: &str, svg: &str, alt: &str, caption: &str) -> String {
    let (alt, caption) = (escape(alt), escape(caption));
    // The root element gets the alternative text; HTML does not allow an XML declaration.
    let svg = svg.find("<svg").map_or(svg, |start| &svg[start..]);
    // Make the names of clip paths unique, as one page may have several drawings.
    let svg = svg.replace("id=\"clip", &format!("id=\"{id}-clip"));
    let svg = svg.replace("url(#clip", &format!("url(#{id}-clip"));
    let svg = svg.replacen("<svg", &format!("<svg role=\"img\" aria-label=\"{alt}\""), 1);
    format!(
        "<figure>\n<div class=\"table drawing\" tabindex=\"0\" role=\"region\" aria-label=\"Figure: {caption}\">\n\
         {svg}\n</div>\n<figcaption>{caption}</figcaption>\n</figure>\n"
    )
}

pub(super) fn folded(title: &str, content: &str) -> String {
    format!("<details>\n<summary>{}</summary>\n{content}</details>\n", escape(title))
}

pub(super) fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
}

#[derive(Clone, Copy, Debug)]
pub struct Heading<'a> {
    pub title: &'a str,
    pub made_by: &'a str,
    pub date: &'a str,
    pub command: &'a str,
}

impl Heading<'_> {
    pub(super) fn made(&self) -> String {
        format!("{}, {}.", self.made_by, self.date)
    }
}

/// A section of a report: its anchor, its heading, and HTML, which is empty for an omitted section.
pub(super) type PageSection = (&'static str, &'static str, String);

/// The content of a file with `subtitle` below its title. `script` contains the script elements and
/// a fallback for pages without scripts. A content security policy forbids all that the file does
/// not contain.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_four_digits() {
        let written = [0.0, -0.0357124, 44.13217, 12345.678, 2.5e-7, 3.2e9].map(figure);
        assert_eq!(written, ["0", "−0.03571", "44.13", "12346", "2.500e−7", "3.200e9"]);
        assert_eq!([figure(None), figure(f64::NAN)], ["–", "–"]);
    }
}
