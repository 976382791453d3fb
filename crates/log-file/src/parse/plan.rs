//! The plan for parsing the requested columns and converting them to a block in SI units.

use memchr::{memchr, memrchr};
use table_file::{TablePart, WantedColumn};

use super::console;
use super::form::RowForm;
use super::marks::NumberMarks;
use super::parsed_rows::{ParsedRows, RowError};
use super::rows::{ColumnUse, Limit, RowPlan};
use crate::error::RowProblem;
use crate::format::choice::{PlacedCondition, keep_chosen};
use crate::format::clock_parts::{ClockPart, PartValues};
use crate::format::columns::Wanted;
use crate::format::layout::FileLayout;
use crate::format::mapping::LogFormat;
use crate::line::line_ends;
use crate::stream::clock_turns::ClockTurns;
use crate::stream::piece::LogPiece;
use shell_data::block::Block;
use shell_data::instructions::arch;
use shell_data::unit::Scale;

#[derive(Debug)]
pub(crate) struct ReadPlan {
    rows: RowSyntax,
    marks: NumberMarks,
    form: RowForm,
    /// Line number of the first row and rows per second, if times are computed from them.
    rate: Option<(u64, f64)>,
    numbers: usize,
    time: Option<OutputColumn>,
    /// The day number of 1970-01-01, if the times are days.
    origin_days: Option<f64>,
    /// Columns that are added to the time.
    time_parts: Vec<OutputColumn>,
    /// The clock, if it wraps around.
    clock: Option<ClockTurns>,
    readings: Vec<OutputColumn>,
    /// Empty, or one element per axis.
    wrench: Vec<Option<OutputColumn>>,
    others: Vec<OutputColumn>,
    /// Number of requested text columns, including the groups.
    labels: usize,
    has_groups: bool,
    /// Number of text columns in the result.
    texts: usize,
    /// Conditions; their columns follow the other text columns.
    conditions: Vec<PlacedCondition>,
}

#[derive(Debug)]
enum RowSyntax {
    Separated(RowPlan),
    /// Positions of the requested values in a [`ConsoleFrame`](super::console::ConsoleFrame).
    Console(Vec<usize>),
}

/// A column of the block: its index among the parsed columns, and the scale to SI units.
#[derive(Clone, Copy, Debug)]
struct OutputColumn {
    slot: usize,
    scale: Scale,
}

#[derive(Debug, Default)]
pub(crate) struct BlockBuffer {
    pub(crate) parsed: ParsedRows,
    pub(crate) block: Block,
}

impl BlockBuffer {
    /// Parses the lines of a chunk, or takes the rows of a table, into the block.
    ///
    /// # Errors
    /// The line number of the first invalid row, and its error.
    pub(crate) fn fill(
        &mut self,
        plan: &ReadPlan,
        piece: &mut LogPiece,
        skip_bad_rows: bool,
    ) -> Result<(), (u64, RowProblem)> {
        let parsed = &mut self.parsed;
        match piece {
            LogPiece::Text(chunk) => {
                let lines = chunk.lines();
                let placed = |error: RowError| {
                    (chunk.line + line_ends(&lines[..error.offset]), error.problem)
                };
                plan.parse(lines, skip_bad_rows, parsed).map_err(placed)?;
                plan.fill(&mut self.block, parsed, chunk.turns);
                self.block.readings_before = plan.last_readings(&chunk.context);
                (self.block.offset, self.block.lines.first) = (chunk.offset, chunk.line);
            }
            LogPiece::Rows(rows) => {
                let placed = |(row, problem)| (rows.line + row as u64, problem);
                plan.parse_part(&mut rows.part, skip_bad_rows, parsed).map_err(placed)?;
                plan.fill(&mut self.block, parsed, rows.turns);
                self.block.readings_before = plan.last_readings_of(&mut rows.before);
                (self.block.offset, self.block.lines.first) = (rows.row, rows.line);
            }
        }
        plan.fill_times(&mut self.block);
        Ok(())
    }
}

impl BlockBuffer {
    /// Returns the line number of the first skipped row of a piece, and its error.
    pub(crate) fn first_skipped(&mut self, piece: &LogPiece) -> Option<(u64, RowProblem)> {
        let RowError { offset, problem } = self.parsed.first_skipped.take()?;
        let line = match piece {
            LogPiece::Text(chunk) => chunk.line + line_ends(&chunk.lines()[..offset]),
            LogPiece::Rows(rows) => rows.line + offset as u64,
        };
        Some((line, problem))
    }
}

impl ReadPlan {
    /// Plans the reading of the requested columns. The log must have all of them.
    pub(crate) fn new(layout: &FileLayout, wanted: &Wanted) -> Self {
        let roles = &layout.roles;
        let mut positions = roles.numbers(wanted);
        positions.sort_unstable();
        positions.dedup();
        let output = |position: &usize| {
            let slot = positions.binary_search(position).expect("every wanted place is listed");
            OutputColumn { slot, scale: layout.columns[*position].meaning.scale() }
        };
        let outputs = |wanted: bool, positions: &[usize]| -> Vec<OutputColumn> {
            if wanted { positions.iter().map(output).collect() } else { Vec::new() }
        };
        let reading_limit = match layout.header.format {
            LogFormat::Telemetry => Limit::LOGGED_READING,
            _ => Limit::READING,
        };
        let limit = |at: usize| match at {
            _ if wanted.wrench && roles.wrench.contains(&Some(at)) => Some(Limit::LOAD),
            _ if wanted.readings && roles.sensors.contains(&at) => Some(reading_limit),
            _ => None,
        };
        let column_use = |at: usize| match at {
            _ if positions.binary_search(&at).is_err() => ColumnUse::Skip,
            _ => match &layout.dates {
                Some(dates) if roles.time == Some(at) => ColumnUse::Date(dates.order),
                _ => match roles.time_parts.iter().find(|part| part.column == at) {
                    Some(ClockPart { values: PartValues::Dates(order), .. }) => {
                        ColumnUse::Date(*order)
                    }
                    _ => ColumnUse::Number(limit(at)),
                },
            },
        };
        let part = |part: &ClockPart| {
            let scale = match part.values {
                PartValues::Dates(_) => Scale::ONE,
                PartValues::Numbers(scale) => scale,
            };
            OutputColumn { scale, ..output(&part.column) }
        };
        let group = roles.group.filter(|_| wanted.groups);
        let decide = layout.conditions.iter().map(|of| of.column);
        let labels: Vec<usize> = wanted.texts.iter().copied().chain(decide).chain(group).collect();
        Self {
            marks: layout.header.marks.clone(),
            form: layout.header.form.clone(),
            rate: layout.rate_hz.filter(|_| wanted.time).map(|rate| (layout.rows_line, rate)),
            numbers: positions.len(),
            time: roles.time.filter(|_| wanted.time).as_ref().map(output),
            origin_days: layout.origin_days.filter(|_| wanted.time),
            time_parts: match wanted.time {
                true => roles.time_parts.iter().map(part).collect(),
                false => Vec::new(),
            },
            clock: layout.clock(),
            readings: outputs(wanted.readings, &roles.sensors),
            wrench: match wanted.wrench {
                true => roles.wrench.iter().map(|position| position.as_ref().map(output)).collect(),
                false => Vec::new(),
            },
            others: outputs(true, &wanted.others),
            labels: labels.len(),
            has_groups: group.is_some(),
            texts: wanted.texts.len(),
            conditions: layout.conditions.clone(),
            rows: match layout.header.format {
                LogFormat::Console => RowSyntax::Console(positions),
                _ => RowSyntax::Separated(RowPlan {
                    separator: layout.header.separator,
                    uses: (0..layout.columns.len()).map(column_use).collect(),
                    labels,
                    names: layout.columns.iter().map(|column| column.name.clone()).collect(),
                    head: layout.header.head_lines.clone(),
                }),
            },
        }
    }

    /// Parses whole lines into `parsed`, which is cleared first.
    pub(crate) fn parse(
        &self,
        lines: &[u8],
        skip_bad_rows: bool,
        parsed: &mut ParsedRows,
    ) -> Result<(), RowError> {
        match &self.rows {
            RowSyntax::Separated(plan) => {
                let made =
                    (!self.form.is_plain()).then(|| self.form.separated(lines, plan.separator));
                let lines = made.as_deref().unwrap_or(lines);
                let points =
                    (!self.marks.is_plain()).then(|| self.marks.rewritten(lines, plan.separator));
                let (written, lines) = (lines, points.as_deref().unwrap_or(lines));
                // Rows usually have similar lengths; otherwise the columns grow.
                let first = memchr(b'\n', lines).unwrap_or(lines.len()) + 1;
                parsed.clear(self.numbers, lines.len() / first * 9 / 8);
                plan.parse_lines(arch(), lines, skip_bad_rows, parsed)
                    .map_err(|error| error.into_written(written, plan.separator))?;
                parsed.finish();
                Ok(())
            }
            RowSyntax::Console(positions) => {
                *parsed = console::parse_lines(lines, positions, skip_bad_rows)?;
                Ok(())
            }
        }
    }

    /// Returns the columns to request from a table; none for a console log.
    pub(crate) fn wanted_columns(&self) -> Vec<WantedColumn> {
        match &self.rows {
            RowSyntax::Separated(plan) => plan.wanted(),
            RowSyntax::Console(_) => Vec::new(),
        }
    }

    /// Moves rows of a table into `parsed`, which is cleared first.
    fn parse_part(
        &self,
        part: &mut TablePart,
        skip_bad_rows: bool,
        parsed: &mut ParsedRows,
    ) -> Result<(), (usize, RowProblem)> {
        match &self.rows {
            RowSyntax::Separated(plan) => plan.parse_part(part, skip_bad_rows, parsed),
            // A console log is never a table.
            RowSyntax::Console(_) => Ok(()),
        }
    }

    /// Converts the parsed rows to a block. The clock has wrapped around `turns` times before the first row. Columns
    /// are swapped with those in `block`, whose memory is reused.
    pub(crate) fn fill(&self, block: &mut Block, parsed: &mut ParsedRows, turns: u32) {
        block.rows = parsed.rows;
        // `others` come first and are copied, because several may share a column; other columns are not shared.
        block.others.resize_with(self.others.len(), Vec::new);
        for (column, output) in block.others.iter_mut().zip(&self.others) {
            column.clone_from(&parsed.columns[output.slot]);
        }
        if let (Some(clock), Some(output)) = (&self.clock, &self.time) {
            clock.unwrap(&mut parsed.columns[output.slot], turns);
        }
        if let (Some(origin), Some(output)) = (self.origin_days, &self.time) {
            parsed.columns[output.slot].iter_mut().for_each(|day| *day -= origin);
        }
        let rows = parsed.rows;
        let parts = self.time_parts.iter();
        let parts: Vec<_> = parts
            .map(|part| (std::mem::take(&mut parsed.columns[part.slot]), part.scale))
            .collect();
        let mut take = |column: &mut Vec<f64>, output: &OutputColumn| {
            std::mem::swap(column, &mut parsed.columns[output.slot]);
            if output.scale != Scale::ONE {
                column.iter_mut().for_each(|value| *value = output.scale.to_si(*value));
            }
        };
        if let Some(output) = &self.time {
            take(&mut block.time_s, output);
        }
        for (part, scale) in parts {
            let times = block.time_s.iter_mut().zip(part);
            times.for_each(|(time, part)| *time += scale.to_si(part));
        }
        block.readings.resize_with(self.readings.len(), Vec::new);
        block.memory_columns = 0;
        let readings = block.readings.iter_mut().zip(&self.readings);
        readings.for_each(|(column, output)| take(column, output));
        block.wrench.resize_with(self.wrench.len(), Vec::new);
        for (column, output) in block.wrench.iter_mut().zip(&self.wrench) {
            match output {
                Some(output) => take(column, output),
                None => {
                    column.clear();
                    column.resize(rows, 0.0);
                }
            }
        }
        std::mem::swap(&mut block.lines.passed, &mut parsed.passed);
        std::mem::swap(&mut block.texts, &mut parsed.labels);
        block.texts.resize_with(self.labels, Vec::new);
        block.groups = block.texts.pop_if(|_| self.has_groups).unwrap_or_default();
        if !self.conditions.is_empty() {
            let values = block.texts.split_off(self.texts);
            parsed.tallies = keep_chosen(block, &self.conditions, &values);
        }
        block.readings_before = None;
    }

    /// Returns the readings of the last valid row of a part; `None` if there is none, or if rows are selected.
    fn last_readings_of(&self, rows: &mut TablePart) -> Option<Vec<f64>> {
        let mut parsed = ParsedRows::default();
        if self.readings.is_empty()
            || !self.conditions.is_empty()
            || self.parse_part(rows, true, &mut parsed).is_err()
        {
            return None;
        }
        self.readings.iter().map(|o| parsed.columns[o.slot].last().copied()).collect()
    }

    /// Computes the times of rows from their line numbers, if there is no time column.
    pub(crate) fn fill_times(&self, block: &mut Block) {
        let Some((first, rate_hz)) = self.rate else { return };
        let lines = &block.lines;
        let time = |row| lines.line(row).saturating_sub(first) as f64 / rate_hz;
        block.time_s = (0..block.rows).map(time).collect();
    }

    /// Returns true if the first row meets the conditions.
    fn is_chosen(&self, parsed: &ParsedRows) -> bool {
        let values = parsed.labels.iter().skip(self.texts).filter_map(|runs| runs.first());
        self.conditions.iter().zip(values).all(|(condition, (value, _))| condition.is_met(value))
    }

    /// Returns the readings of the last valid and selected row in `lines`, if there is one.
    fn last_readings(&self, lines: &[u8]) -> Option<Vec<f64>> {
        let mut end = lines.len();
        let mut parsed = ParsedRows::default();
        while end > 0 && !self.readings.is_empty() {
            let start = memrchr(b'\n', &lines[..end - 1]).map_or(0, |at| at + 1);
            if self.parse(&lines[start..end], false, &mut parsed).is_ok()
                && parsed.rows > 0
                && self.is_chosen(&parsed)
            {
                return Some(self.readings.iter().map(|o| parsed.columns[o.slot][0]).collect());
            }
            end = start;
        }
        None
    }
}
