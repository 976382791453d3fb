//! Rows of logs that are not to be trusted, and why.

use super::markup::{Column, escape, table};

/// Rows that are not to be trusted.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OutlierTable {
    /// As many of them as are shown.
    pub rows: Vec<OutlierRow>,
    /// All of them.
    pub count: usize,
    /// Whether they were left out.
    pub left_out: bool,
}

/// A row that is not to be trusted.
#[derive(Clone, Debug, PartialEq)]
pub struct OutlierRow {
    /// Its log.
    pub file: String,
    /// Its line, or row of a table.
    pub line: u64,
    /// What is wrong with it.
    pub what: String,
}

impl OutlierTable {
    /// A sentence about them, and a table of the rows.
    pub(super) fn html(&self, sentence: &str, caption: &str) -> String {
        if self.count == 0 {
            return "<p>None was found.</p>\n".to_owned();
        }
        let columns = [
            Column::text("log", self.rows.iter().map(|row| &row.file)),
            Column::numbers("line", self.rows.iter().map(|row| row.line)),
            Column::long("what", self.rows.iter().map(|row| &row.what)),
        ];
        let caption = match self.rows.len() == self.count {
            true => caption.to_owned(),
            false => format!("The first {} of them", self.rows.len()),
        };
        format!("<p>{}</p>\n{}", escape(sentence), table(&caption, &columns))
    }
}
