//! The result of parsing rows: columns of numbers, and texts in run-length encoding.

use super::field_ends::FieldEnds;
use super::rows::RowError;

/// Rows, column by column.
#[derive(Debug, Default, PartialEq)]
pub(crate) struct ParsedRows {
    pub(crate) rows: usize,
    pub(crate) skipped: u64,
    /// The first of them: where it starts, and what is wrong with it.
    pub(crate) first_skipped: Option<RowError>,
    /// Lines that are no rows: how many there are before which row.
    pub(crate) passed: Vec<(usize, u64)>,
    pub(crate) columns: Vec<Vec<f64>>,
    /// For each column of text, run-length encoded.
    pub(crate) labels: Vec<Vec<(String, usize)>>,
    /// Working memory: where fields end.
    pub(super) ends: FieldEnds,
}

impl ParsedRows {
    /// Forgets all rows and makes room for `capacity` rows of `columns` columns.
    pub(crate) fn clear(&mut self, columns: usize, capacity: usize) {
        (self.rows, self.skipped, self.first_skipped) = (0, 0, None);
        self.passed.clear();
        self.labels.iter_mut().for_each(Vec::clear);
        self.columns.resize_with(columns, Vec::new);
        // Old numbers stay until new ones are written over them: filling columns with zeros in
        // between would take time.
        for column in &mut self.columns {
            column.reserve(capacity.saturating_sub(column.len()));
        }
    }

    /// Puts a number into the row that follows the last.
    pub(crate) fn put(&mut self, column: usize, number: f64) {
        let column = &mut self.columns[column];
        match column.get_mut(self.rows) {
            Some(position) => *position = number,
            None => column.push(number),
        }
    }

    /// Counts lines that are no rows.
    pub(crate) fn pass_lines(&mut self, count: u64) {
        match self.passed.last_mut() {
            _ if count == 0 => {}
            Some((row, lines)) if *row == self.rows => *lines += count,
            _ => self.passed.push((self.rows, count)),
        }
    }

    /// Leaves only the numbers of rows in the columns.
    pub(crate) fn finish(&mut self) {
        self.columns.iter_mut().for_each(|column| column.truncate(self.rows));
    }

    /// Adds the text of a row to the runs of equal ones.
    pub(super) fn push_label(&mut self, label: usize, text: &[u8]) {
        if self.labels.len() <= label {
            self.labels.resize_with(label + 1, Vec::new);
        }
        let (runs, text) = (&mut self.labels[label], text.trim_ascii());
        match runs.last_mut() {
            Some((last, rows)) if last.as_bytes() == text => *rows += 1,
            _ => runs.push((String::from_utf8_lossy(text).into_owned(), 1)),
        }
    }
}
