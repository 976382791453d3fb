//! Conversion of table columns to parsed columns; rows with an invalid value are removed.

use std::collections::BTreeMap;

use table_file::{Cell, ColumnPart, TablePart, WantedColumn};

use super::date::parse_date;
use super::marks::has_decimal_comma;
use super::number::{finite, parse_field, with_points};
use super::parsed_rows::{ParsedRows, RowError};
use super::rows::{ColumnUse, RowPlan};
use crate::error::{FieldProblem, RowProblem};

#[derive(Default)]
struct WrongRows {
    rows: Vec<usize>,
    first: Option<(usize, RowProblem)>,
    /// Numbers of invalid fields by column.
    fields: BTreeMap<String, u64>,
}

impl WrongRows {
    /// Adds an invalid row. Only its first invalid column is reported.
    fn add(&mut self, row: usize, problem: impl FnOnce() -> RowProblem) {
        self.rows.push(row);
        let problem = problem();
        *self.fields.entry(problem.class()).or_default() += 1;
        if self.first.as_ref().is_none_or(|(first, _)| row < *first) {
            self.first = Some((row, problem));
        }
    }
}

impl RowPlan {
    /// Returns the columns to request from a table: numbers in their order, followed by texts.
    pub(crate) fn wanted(&self) -> Vec<WantedColumn> {
        let numbers = self.numbers().map(|(at, _)| WantedColumn { at, is_text: false });
        numbers.chain(self.labels.iter().map(|&at| WantedColumn { at, is_text: true })).collect()
    }

    fn numbers(&self) -> impl Iterator<Item = (usize, ColumnUse)> {
        let uses = self.uses.iter().copied().enumerate();
        uses.filter(|(_, column_use)| *column_use != ColumnUse::Skip)
    }

    /// Moves the rows of a part of a table into `parsed`. The part has the [requested columns](Self::wanted).
    ///
    /// # Errors
    /// The first invalid row and its error, unless invalid rows are skipped.
    pub(crate) fn parse_part(
        &self,
        part: &mut TablePart,
        skip_bad_rows: bool,
        parsed: &mut ParsedRows,
    ) -> Result<(), (usize, RowProblem)> {
        let numbers = self.numbers().count();
        parsed.clear(numbers, 0);
        parsed.rows = part.rows;
        let mut wrong = WrongRows::default();
        let columns = parsed.columns.iter_mut().zip(&mut part.columns);
        for ((at, column_use), (values, column)) in self.numbers().zip(columns) {
            self.numbers_of(at, column_use, column, &part.blank, values, &mut wrong);
        }
        if !skip_bad_rows && let Some(first) = wrong.first {
            return Err(first);
        }
        (parsed.skipped_for, parsed.first_skipped) =
            (wrong.fields, wrong.first.map(|(row, problem)| RowError { offset: row, problem }));
        parsed.skipped = {
            wrong.rows.sort_unstable();
            wrong.rows.dedup();
            wrong.rows.len() as u64
        };
        wrong.rows.extend(&part.blank);
        wrong.rows.sort_unstable();
        let is_row = |row: &usize| wrong.rows.binary_search(row).is_err();
        let labels = part.columns.iter().skip(numbers).enumerate();
        for (label, column) in labels {
            let ColumnPart::Cells(cells) = column else { continue };
            let rows = cells.iter().enumerate().filter(|(row, _)| is_row(row));
            rows.for_each(|(_, cell)| parsed.push_label(label, cell.text().as_bytes()));
        }
        if !wrong.rows.is_empty() {
            leave_out(&wrong.rows, parsed);
        }
        Ok(())
    }

    /// Converts the numbers of the column at `at`; blank rows are not invalid.
    fn numbers_of(
        &self,
        at: usize,
        column_use: ColumnUse,
        column: &mut ColumnPart,
        blank: &[usize],
        values: &mut Vec<f64>,
        wrong: &mut WrongRows,
    ) {
        let mut refuse = |row: usize, problem: FieldProblem, found: &str| {
            if blank.binary_search(&row).is_err() {
                wrong.add(row, || self.problem(problem, at, found.as_bytes()));
            }
        };
        match column {
            ColumnPart::Numbers { values: numbers, missing } => {
                std::mem::swap(values, numbers);
                // Usually all values are valid; this check has no branch per value.
                let most = column_use.most();
                if values.iter().fold(true, |all, value| all & (value.abs() <= most)) {
                    return;
                }
                for (row, &value) in values.iter().enumerate() {
                    match column_use.check(value) {
                        Ok(_) => {}
                        Err(_) if missing.binary_search(&row).is_ok() => {
                            refuse(row, FieldProblem::Empty, "");
                        }
                        Err(problem) => refuse(row, problem, &Cell::Real(value).text()),
                    }
                }
            }
            ColumnPart::Cells(cells) => {
                values.clear();
                let has_commas = cells.iter().any(|cell| match cell {
                    Cell::Text(text) => has_decimal_comma(text.as_bytes()),
                    _ => false,
                });
                for (row, cell) in cells.iter().enumerate() {
                    let value = match (cell, column_use) {
                        (Cell::Missing, _) => Err(FieldProblem::Empty),
                        (Cell::Time { .. }, ColumnUse::Date(_)) => {
                            Ok(cell.number().unwrap_or(f64::NAN))
                        }
                        (Cell::Text(text), ColumnUse::Date(order)) => {
                            parse_date(text.as_bytes(), order)
                        }
                        (_, ColumnUse::Date(_)) => Err(FieldProblem::NotADate),
                        (Cell::Time { .. }, _) => Err(FieldProblem::NotANumber),
                        (Cell::Text(text), _) if has_commas => {
                            parse_field(&with_points(text.as_bytes()))
                        }
                        (Cell::Text(text), _) => parse_field(text.as_bytes()),
                        _ => cell.number().ok_or(FieldProblem::Empty).and_then(finite),
                    };
                    match value.and_then(|value| column_use.check(value)) {
                        Ok(value) => values.push(value),
                        Err(problem) => {
                            values.push(f64::NAN);
                            refuse(row, problem, &cell.text());
                        }
                    }
                }
            }
        }
    }
}

/// Removes rows, given in order, from all numeric columns, and counts them as lines that are not rows.
fn leave_out(rows: &[usize], parsed: &mut ParsedRows) {
    let all = parsed.rows;
    for column in &mut parsed.columns {
        let mut row = 0;
        column.retain(|_| {
            row += 1;
            rows.binary_search(&(row - 1)).is_err()
        });
    }
    for (passed, &row) in rows.iter().enumerate() {
        parsed.rows = row - passed;
        parsed.pass_lines(1);
    }
    parsed.rows = all - rows.len();
}
