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

/// A column of a table: its heading, the classes of its cells, and their texts.
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

    /// Names.
    pub(super) fn text(name: &str, cells: impl IntoIterator<Item: ToString>) -> Self {
        Self::new(name, "text", cells)
    }

    /// Texts that may be broken.
    pub(super) fn long(name: &str, cells: impl IntoIterator<Item: ToString>) -> Self {
        Self::new(name, "text long", cells)
    }

    /// Numbers as they are to be read.
    pub(super) fn numbers(name: &str, cells: impl IntoIterator<Item: ToString>) -> Self {
        Self::new(name, "", cells)
    }

    /// Numbers in four significant digits.
    pub(super) fn figures(name: &str, values: impl IntoIterator<Item: Into<Option<f64>>>) -> Self {
        Self::numbers(name, values.into_iter().map(figure))
    }
}

/// A table in a box that scrolls on narrow screens, of columns of one length.
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
