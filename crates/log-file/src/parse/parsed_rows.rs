//! The result of parsing rows: columns of numbers, and labels in run-length encoding.

/// Rows, column by column.
#[derive(Debug, Default, PartialEq)]
pub(crate) struct ParsedRows {
    pub(crate) rows: usize,
    pub(crate) skipped: u64,
    pub(crate) columns: Vec<Vec<f64>>,
    pub(crate) groups: Vec<(String, usize)>,
    /// For each column of text, run-length encoded.
    pub(crate) texts: Vec<Vec<(String, usize)>>,
}

impl ParsedRows {
    /// Forgets all rows and makes room for `capacity` rows of `columns` columns.
    pub(crate) fn clear(&mut self, columns: usize, capacity: usize) {
        (self.rows, self.skipped) = (0, 0);
        self.groups.clear();
        self.texts.iter_mut().for_each(Vec::clear);
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

    /// Leaves only the numbers of rows in the columns.
    pub(crate) fn finish(&mut self) {
        self.columns.iter_mut().for_each(|column| column.truncate(self.rows));
    }

    pub(crate) fn push_group(&mut self, label: &[u8]) {
        push(&mut self.groups, label);
    }

    pub(super) fn push_text(&mut self, column: usize, text: &[u8]) {
        if self.texts.len() <= column {
            self.texts.resize_with(column + 1, Vec::new);
        }
        push(&mut self.texts[column], text);
    }

    /// Removes the traces of a bad row.
    pub(super) fn take_back_row(&mut self, labelled: bool) {
        if labelled && let Some((_, rows)) = self.groups.last_mut() {
            *rows -= 1;
            if *rows == 0 {
                self.groups.pop();
            }
        }
        self.skipped += 1;
    }
}

/// Adds the text of a row to runs of equal ones.
fn push(runs: &mut Vec<(String, usize)>, text: &[u8]) {
    match runs.last_mut() {
        Some((last, rows)) if last.as_bytes() == text => *rows += 1,
        _ => runs.push((String::from_utf8_lossy(text).into_owned(), 1)),
    }
}
