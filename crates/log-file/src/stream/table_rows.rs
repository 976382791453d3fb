//! The rows of a log with at least one table, possibly with a companion, part by part.

use table_file::{Cell, ColumnPart, TablePart, TableStream, WantedColumn};

use super::bytes::ReadMeter;
use super::clock_turns::ClockTurns;
use super::companion::RowMismatch;
use super::source::LogSource;
use super::text_rows::TextRows;
use crate::error::LogError;
use crate::parse::date::{DateOrder, parse_date};
use crate::parse::number::parse_field;

const CONTEXT_ROWS: usize = 8;

#[derive(Debug, Default)]
pub(crate) struct RowPart {
    pub(crate) part: TablePart,
    /// The rows just before this part.
    pub(crate) before: TablePart,
    /// Wraparounds of the clock before the part.
    pub(crate) turns: u32,
    /// The index of the first row in the log, from 0.
    pub(crate) row: u64,
    /// The line number of the first row in an equivalent text.
    pub(crate) line: u64,
}

/// A stream of the requested rows of a log, from the first row on.
pub(crate) struct TableRows<'a> {
    sides: Vec<TableSide<'a>>,
    part_rows: usize,
    next: u64,
    first_line: u64,
    before: TablePart,
    ended: bool,
    meter: ReadMeter,
    /// Number of bytes of the file that have not been counted.
    bytes_left: u64,
    /// Present if a clock may wrap, with the position of its times among the requested columns.
    pub(crate) clock: Option<(ClockTurns, usize)>,
}

/// One of the files whose columns are joined.
struct TableSide<'a> {
    source: &'a LogSource,
    rows: SideRows,
    wanted: Vec<WantedColumn>,
    /// Positions of its columns among all requested columns.
    places: Vec<usize>,
    part: TablePart,
}

enum SideRows {
    Table(TableStream),
    Text(TextRows),
}

impl<'a> TableSide<'a> {
    /// Opens the columns of `source`, which are at positions `columns` of the log. Its rows begin at line `rows_line`.
    fn new(
        source: &'a LogSource,
        wanted: &[WantedColumn],
        columns: std::ops::Range<usize>,
        rows_line: u64,
        threads: usize,
    ) -> Result<Self, LogError> {
        let own = wanted.iter().enumerate().filter(|(_, wanted)| columns.contains(&wanted.at));
        let (places, wanted): (Vec<_>, Vec<_>) = own
            .map(|(place, wanted)| {
                (place, WantedColumn { at: wanted.at - columns.start, ..*wanted })
            })
            .unzip();
        let table = source.as_table();
        let rows = match table {
            Some(table) => {
                let rows = table.rows(wanted.clone(), threads);
                SideRows::Table(rows.map_err(|problem| source.table_error(problem))?)
            }
            None => SideRows::Text(TextRows::new(source.open_alone()?)),
        };
        let mut side = Self { source, rows, wanted, places, part: TablePart::default() };
        // In a file without names, the lines above the rows are rows of the table.
        let has_names = table.is_some_and(|table| table.columns.is_some());
        let above = rows_line - 1 - u64::from(has_names);
        for _ in 0..above {
            side.next(1)?;
        }
        Ok(side)
    }

    fn next(&mut self, rows: usize) -> Result<bool, LogError> {
        match &mut self.rows {
            SideRows::Table(table) => {
                let next = table.next(rows, &mut self.part);
                next.map_err(|problem| self.source.table_error(problem))
            }
            SideRows::Text(text) => {
                let next = text.fill(rows, &self.wanted, &mut self.part);
                next.map_err(|error| self.source.error(error))
            }
        }
    }
}

impl<'a> TableRows<'a> {
    /// Opens the rows of `source` from line `rows_line` on, in parts of about `part_bytes` bytes.
    pub(crate) fn new(
        source: &'a LogSource,
        wanted: &[WantedColumn],
        rows_line: u64,
        part_bytes: usize,
        threads: usize,
        meter: ReadMeter,
    ) -> Result<Self, LogError> {
        let sides = match &source.companion {
            None => vec![TableSide::new(source, wanted, 0..usize::MAX, rows_line, threads)?],
            Some(companion) => {
                let [first, _] = source.sides.columns;
                vec![
                    TableSide::new(source, wanted, 0..first, rows_line, threads)?,
                    TableSide::new(companion, wanted, first..usize::MAX, rows_line, threads)?,
                ]
            }
        };
        let tables = [Some(source), source.companion.as_deref()].into_iter().flatten();
        let rows = tables.filter_map(|source| Some(source.as_table()?.rows_of_part(part_bytes)));
        Ok(Self {
            sides,
            part_rows: rows.min().unwrap_or(1),
            next: 0,
            first_line: rows_line,
            before: TablePart::default(),
            ended: false,
            meter,
            bytes_left: source.bytes,
            clock: None,
        })
    }

    pub(crate) fn ended(&self) -> bool {
        self.ended
    }

    /// Reads the next rows into `rows`; `false` if there are no more.
    pub(crate) fn next(&mut self, rows: &mut RowPart) -> Result<bool, LogError> {
        // Stays set if reading fails: there is no part after an error.
        if std::mem::replace(&mut self.ended, true) {
            return Ok(false);
        }
        let part = &mut rows.part;
        let columns = self.sides.iter().map(|side| side.places.len()).sum();
        part.columns.resize_with(columns, ColumnPart::default);
        for side in self.sides.iter_mut().rev() {
            side.next(self.part_rows)?;
            // Columns are swapped, so that their memory is reused for the next rows.
            for (column, &place) in side.part.columns.iter_mut().zip(&side.places) {
                std::mem::swap(column, &mut part.columns[place]);
            }
            part.rows = side.part.rows;
            std::mem::swap(&mut side.part.blank, &mut part.blank);
        }
        let counts: Vec<usize> = self.sides.iter().map(|side| side.part.rows).collect();
        if let [first, second] = *counts
            && first != second
        {
            let line = self.first_line + self.next + first.min(second) as u64;
            return Err(self.sides[0].source.mismatch(RowMismatch::Lines(line)));
        }
        rows.turns = self.clock.as_mut().map_or(0, |(clock, at)| {
            clock.before_times(&part.columns.get(*at).map(times).unwrap_or_default())
        });
        (rows.row, rows.line) = (self.next, self.first_line + self.next);
        self.next += part.rows as u64;
        self.ended = part.rows < self.part_rows;
        rows.before = std::mem::replace(&mut self.before, last_rows(part));
        let bytes = if self.ended { self.bytes_left } else { (8 * columns * part.rows) as u64 };
        let counted = bytes.min(self.bytes_left);
        self.bytes_left -= counted;
        self.meter.count(counted);
        Ok(part.rows > 0)
    }
}

/// Returns the times in a column that are numbers or times of day.
fn times(column: &ColumnPart) -> Vec<f64> {
    let of_cell = |cell: &Cell| match cell {
        Cell::Text(text) => parse_date(text.as_bytes(), DateOrder::DayFirst)
            .or_else(|_| parse_field(text.as_bytes()))
            .ok(),
        cell => cell.number(),
    };
    match column {
        ColumnPart::Numbers { values, .. } => {
            values.iter().copied().filter(|time| time.is_finite()).collect()
        }
        ColumnPart::Cells(cells) => cells.iter().filter_map(of_cell).collect(),
    }
}

fn last_rows(part: &TablePart) -> TablePart {
    let from = part.rows.saturating_sub(CONTEXT_ROWS);
    let rows_of = |rows: &[usize]| -> Vec<usize> {
        rows.iter().filter_map(|row| row.checked_sub(from)).collect()
    };
    let of_column = |column: &ColumnPart| match column {
        ColumnPart::Numbers { values, missing } => ColumnPart::Numbers {
            values: values.get(from..).unwrap_or_default().to_vec(),
            missing: rows_of(missing),
        },
        ColumnPart::Cells(cells) => {
            ColumnPart::Cells(cells.get(from..).map(<[Cell]>::to_vec).unwrap_or_default())
        }
    };
    TablePart {
        rows: part.rows - from,
        columns: part.columns.iter().map(of_column).collect(),
        blank: rows_of(&part.blank),
    }
}
