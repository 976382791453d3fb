//! The result of parsing rows: numeric columns, and text columns in run-length encoding.

use std::collections::BTreeMap;

use super::field_ends::FieldEnds;
use super::number::with_points;
use crate::error::RowProblem;
use crate::format::choice::ConditionTally;

#[derive(Debug, Default, PartialEq)]
pub(crate) struct ParsedRows {
    pub(crate) rows: usize,
    pub(crate) skipped: u64,
    /// Lines that repeat the head of the log.
    pub(crate) repeated_heads: u64,
    pub(crate) first_skipped: Option<RowError>,
    /// Numbers of skipped rows by what they have in common.
    pub(crate) skipped_for: BTreeMap<String, u64>,
    /// Lines that are not rows: the row that they precede, and their number.
    pub(crate) passed: Vec<(usize, u64)>,
    pub(crate) columns: Vec<Vec<f64>>,
    /// For each text column, runs of equal texts.
    pub(crate) labels: Vec<Vec<(String, usize)>>,
    /// Tallies of the conditions on rows, in their order.
    pub(crate) tallies: Vec<ConditionTally>,
    pub(super) ends: FieldEnds,
}

impl ParsedRows {
    /// Removes all rows and makes room for `capacity` rows of `columns` columns.
    pub(crate) fn clear(&mut self, columns: usize, capacity: usize) {
        (self.rows, self.skipped, self.first_skipped) = (0, 0, None);
        self.repeated_heads = 0;
        self.skipped_for.clear();
        self.passed.clear();
        self.labels.iter_mut().for_each(Vec::clear);
        self.columns.resize_with(columns, Vec::new);
        // Old numbers stay until overwritten, because filling columns with zeros in between would take time.
        for column in &mut self.columns {
            column.reserve(capacity.saturating_sub(column.len()));
        }
    }

    /// Counts a skipped row; `offset` is the position of its line.
    pub(super) fn skip(&mut self, offset: usize, problem: RowProblem) {
        self.skipped += 1;
        *self.skipped_for.entry(problem.class()).or_default() += 1;
        self.first_skipped.get_or_insert(RowError { offset, problem });
    }

    /// Stores a number in the row after the last.
    pub(crate) fn put(&mut self, column: usize, number: f64) {
        let column = &mut self.columns[column];
        match column.get_mut(self.rows) {
            Some(position) => *position = number,
            None => column.push(number),
        }
    }

    /// Counts lines that are not rows.
    pub(crate) fn pass_lines(&mut self, count: u64) {
        match self.passed.last_mut() {
            _ if count == 0 => {}
            Some((row, lines)) if *row == self.rows => *lines += count,
            _ => self.passed.push((self.rows, count)),
        }
    }

    pub(crate) fn finish(&mut self) {
        self.columns.iter_mut().for_each(|column| column.truncate(self.rows));
    }

    /// Appends the text of a row to the runs of equal texts.
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

#[derive(Debug, PartialEq)]
pub(crate) struct RowError {
    /// Position in the parsed lines, or the row's index in a part of a table.
    pub(crate) offset: usize,
    pub(crate) problem: RowProblem,
}

impl RowError {
    /// Replaces the field in the error by the original one in `lines`, before decimal commas were converted.
    pub(crate) fn into_written(mut self, lines: &[u8], separator: u8) -> Self {
        if let RowProblem::Field { column, found, .. } = &mut self.problem
            && let Some(line) = lines[self.offset..].split(|&byte| byte == b'\n').next()
            && let Some(written) = line.split(|&byte| byte == separator).nth(*column)
            && let written = written.trim_ascii()
            && with_points(written) == found.as_bytes()
        {
            *found = String::from_utf8_lossy(written).into_owned();
        }
        self
    }
}
