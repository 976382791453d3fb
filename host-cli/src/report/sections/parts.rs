//! Tables, figures and numbers that several sections have.

use super::super::markup::{Cell, escape, significant, table};
use crate::trial::Interval;

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

pub(super) fn interval(interval: Option<Interval>) -> Cell {
    digits_of(interval, 4)
}

/// In three digits: wide tables are to be short.
pub(super) fn range(interval: Option<Interval>) -> Cell {
    digits_of(interval, 3)
}

fn digits_of(interval: Option<Interval>, digits: i32) -> Cell {
    Cell::Figure(interval.map_or("–".to_owned(), |Interval { low, high }| {
        format!("{} … {}", significant(low, digits), significant(high, digits))
    }))
}

pub(super) fn short(value: impl Into<Option<f64>>) -> Cell {
    Cell::Figure(significant(value, 3))
}

pub(super) fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
}
