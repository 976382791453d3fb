//! Tables as HTML, and numbers as people read them.

use std::fmt::Write;

pub(super) use shell_data::escape::markup as escape;

/// A number in four significant digits, with a true minus sign; a dash for none.
pub fn figure(value: impl Into<Option<f64>>) -> String {
    significant(value, 4)
}

/// As [`figure`], in as many digits.
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

/// One column of a table.
pub(super) enum TableCell {
    /// A name.
    Text(String),
    /// A text that may be broken.
    Long(String),
    /// A number.
    Figure(String),
}

impl From<f64> for TableCell {
    fn from(value: f64) -> Self {
        Self::Figure(figure(value))
    }
}

impl From<Option<f64>> for TableCell {
    fn from(value: Option<f64>) -> Self {
        Self::Figure(figure(value))
    }
}

impl From<u64> for TableCell {
    fn from(value: u64) -> Self {
        Self::Figure(value.to_string())
    }
}

impl From<&str> for TableCell {
    fn from(text: &str) -> Self {
        Self::Text(text.to_owned())
    }
}

/// A cell of a text that may be broken.
pub(super) fn long(text: &str) -> TableCell {
    TableCell::Long(text.to_owned())
}

/// A table in a box that scrolls on narrow screens. A column is text where it is in the first of `rows`.
pub(super) fn table(
    caption: &str,
    header: &[impl AsRef<str>],
    rows: impl IntoIterator<Item = Vec<TableCell>>,
) -> String {
    let (caption, rows): (_, Vec<_>) = (escape(caption), rows.into_iter().collect());
    let mut html = format!(
        "<div class=\"table\" tabindex=\"0\" role=\"region\" aria-label=\"{caption}\">\n<table>\n\
         <caption>{caption}</caption>\n<thead><tr>"
    );
    for (column, name) in header.iter().enumerate() {
        let is_text = rows.first().is_some_and(|row| !matches!(row[column], TableCell::Figure(_)));
        let class = if is_text { " class=\"text\"" } else { "" };
        let _ = write!(html, "<th scope=\"col\"{class}>{}</th>", escape(name.as_ref()));
    }
    html.push_str("</tr></thead>\n<tbody>\n");
    for row in rows {
        html.push_str("<tr>");
        for cell in row {
            let (class, text) = match cell {
                TableCell::Text(text) => (" class=\"text\"", text),
                TableCell::Long(text) => (" class=\"text long\"", text),
                TableCell::Figure(text) => ("", text),
            };
            let _ = write!(html, "<td{class}>{}</td>", escape(&text));
        }
        html.push_str("</tr>\n");
    }
    html.push_str("</tbody>\n</table>\n</div>\n");
    html
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
