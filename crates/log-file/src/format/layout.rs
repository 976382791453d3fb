//! Recognises a log from its first lines: its format, the position of its rows, and the names of its columns.

use memchr::memchr;

use super::choice::{Comparison, Interleaving, PlacedCondition};
use super::clock::{CLOCK_ROWS, ClockFields, DateColumn, is_since_1970, origin_of_days};
use super::clock_parts::{
    ClockPart, OF_NANOSECONDS, PartValues, date_part, has_fraction, is_fraction, nameless_stamp,
};
use super::columns::{Column, ColumnRoles, by_shape, positions, recognise, stated_unit};
use super::head::{self, Head, line_separator, numbered};
use super::keys::Keys;
use super::lines::{LayoutLine, all_lines, fields, lines, texts};
use super::mapping::{LogFormat, Mapping, TimeUnit};
use super::meaning::{Meaning, StatedUnit, known_names};
use super::stated_units::{apply_keys, are_counts, unit_columns};
use crate::error::{FieldProblem, LogError, PlacedProblem};
use crate::line::line_ends;
use crate::parse::console;
use crate::parse::date::{DateOrder, is_date};
use crate::parse::form::{RowBody, RowForm};
use crate::parse::marks::NumberMarks;
use crate::parse::number::parse_field;
use crate::parse::rows::HeadLines;
use crate::stream::clock_turns::{ClockTurns, TURN};
use crate::stream::companion::SideRows;
use crate::stream::source::LogSource;
use shell_data::unit::{Quantity, Scale};
use shell_data::wrench::Axis;
use table_file::{FileKind, Table};

/// Number of bytes examined at the start of a file; a header must fit.
pub(crate) const HEAD_BYTES: u64 = 1 << 16;

#[derive(Debug)]
pub(crate) struct FileLayout {
    pub(crate) header: Header,
    pub(crate) columns: Vec<Column>,
    pub(crate) roles: ColumnRoles,
    /// The line number of the first row, from 1.
    pub(crate) rows_line: u64,
    pub(crate) dates: Option<DateColumn>,
    /// Rows per second stated above the names, if no column is a time.
    pub(crate) rate_hz: Option<f64>,
    /// The day number of 1970-01-01, if the times are days.
    pub(crate) origin_days: Option<f64>,
    /// True if the times are integers in ms, µs or ns, and the first one fits 32 bits.
    pub(crate) counts_in_32_bits: bool,
    /// Step per row of times without a unit that may number the rows.
    pub(crate) unclear_time: Option<f64>,
    pub(crate) conditions: Vec<PlacedCondition>,
    /// Column that distinguishes sensors whose rows alternate.
    pub(crate) interleaving: Option<Interleaving>,
    pub(crate) decisions: Vec<String>,
}

impl FileLayout {
    /// Returns the clock if it may wrap around: the robot's in µs, 32-bit integers in another unit, or the time of
    /// day.
    pub(crate) fn clock(&self) -> Option<ClockTurns> {
        let column = self.roles.time.filter(|_| self.roles.time_parts.is_empty())?;
        let per = self.columns[column].meaning.scale().per;
        let clock = ClockTurns::new(self.header.form.clone(), self.header.separator, column);
        if self.header.format == LogFormat::Telemetry {
            return (per == 1e6).then_some(clock);
        }
        match &self.dates {
            Some(dates) => dates.is_of_day.then(|| clock.of_day()),
            None => self.counts_in_32_bits.then(|| clock.of_counter()),
        }
    }
}

#[derive(Debug)]
pub(crate) struct Header {
    pub(crate) format: LogFormat,
    pub(crate) separator: u8,
    pub(crate) form: RowForm,
    names: Vec<String>,
    /// Empty if no line of units follows the names.
    pub(crate) units: Vec<String>,
    units_line: Option<u64>,
    keys: Keys,
    /// Position of the first row in the uncompressed file.
    pub(crate) rows_start: usize,
    /// The number of the line that names the columns, or of the first row if there is none.
    pub(crate) names_line: u64,
    /// The position of whole seconds in a log without names. The next column has the nanoseconds.
    nameless_stamp: Option<usize>,
    /// The lines of the names and units, if there are any.
    pub(crate) head_lines: Option<HeadLines>,
    pub(crate) marks: NumberMarks,
    /// The line number of the first row, from 1.
    first_row: u64,
}

impl Header {
    fn new(format: LogFormat, names: Vec<String>, rows_start: usize, names_line: u64) -> Self {
        Self {
            format,
            separator: b',',
            form: RowForm::default(),
            names,
            units: Vec::new(),
            units_line: None,
            keys: Keys::default(),
            rows_start,
            names_line,
            nameless_stamp: None,
            head_lines: None,
            marks: NumberMarks::default(),
            first_row: 1,
        }
    }
}

impl Header {
    pub(crate) fn kind(&self) -> String {
        match &self.form.body {
            _ if self.keys.is_labview => "LabVIEW measurement file".to_owned(),
            _ if self.keys.is_vicon => "Vicon export".to_owned(),
            RowBody::Json(_) => "JSON lines".to_owned(),
            RowBody::Labels(_) => "lines of labels and values".to_owned(),
            RowBody::Blanks | RowBody::Separated => self.format.to_string(),
        }
    }

    /// Returns the lines of names and units, if the rows are below them.
    fn head_lines(&self, head: &[u8]) -> Option<HeadLines> {
        let above = &head[..self.rows_start.min(head.len())];
        let line = |number: u64| all_lines(above, 0, 1).find(|line| line.number == number);
        let names = line(self.names_line)?.text.to_vec();
        let units = self.units_line.and_then(line).map(|line| line.text.to_vec());
        Some(HeadLines { number: self.names_line, names, units: units.unwrap_or_default() })
    }

    /// Describes the text of two logs that are joined row by row. If both have a wrench, the columns of the first
    /// wrench are renamed, so that the second one is used. Any other name that both logs have refers to the first log.
    pub(crate) fn joined(logs: [(&Self, &ColumnRoles); 2], separator: u8) -> Self {
        let [(first, roles), (second, others)] = logs;
        let has_wrench = others.wrench.iter().any(Option::is_some);
        let of_first = first.names.iter().enumerate().map(|(at, name)| {
            match has_wrench && roles.wrench.contains(&Some(at)) {
                true => format!("1st {name}"),
                false => name.clone(),
            }
        });
        let mut names: Vec<String> = of_first.collect();
        let of_second = second.names.iter().map(|name| {
            match names.iter().any(|taken| taken.eq_ignore_ascii_case(name)) {
                true => format!("2nd {name}"),
                false => name.clone(),
            }
        });
        let of_second: Vec<String> = of_second.collect();
        names.extend(of_second);
        let units = [first, second].into_iter().flat_map(|of| {
            let mut units = of.units.clone();
            units.resize(of.names.len(), String::new());
            units
        });
        let keys = match has_wrench {
            true => {
                Keys { rate_hz: first.keys.rate_hz.or(second.keys.rate_hz), ..second.keys.clone() }
            }
            false => first.keys.clone(),
        };
        // Lines above the rows of the joined text are empty.
        let rows_start = first.first_row as usize - 1;
        let names_line = first.names_line;
        let new = Self::new(LogFormat::Csv, names, rows_start, names_line);
        Self { separator, units: units.collect(), keys, ..new }
    }

    /// Returns the notation of the rows, if a line above them names the columns.
    pub(crate) fn side_rows(&self) -> Option<SideRows> {
        let is_log = self.format == LogFormat::Csv && self.names_line < self.first_row;
        is_log.then(|| SideRows {
            lines: [self.names_line, self.first_row],
            separator: self.separator,
            form: self.form.clone(),
            marks: self.marks.clone(),
            columns: self.names.len(),
        })
    }

    pub(crate) fn ends_at_blank(&self) -> bool {
        self.keys.is_vicon
    }
}

/// Recognises the layout of the log that starts with `head`; `whole` is true if `head` is the whole log. `known` is the
/// header of a log that is joined from others.
pub(crate) fn recognise_layout(
    source: &LogSource,
    head: &[u8],
    whole: bool,
    mapping: &Mapping,
    known: Option<Header>,
) -> Result<FileLayout, LogError> {
    let path = || source.path.clone();
    if let Some((offset, byte)) = binary_byte(head) {
        return Err(LogError::Binary { path: path(), offset: offset as u64, byte });
    }
    if head.trim_ascii().is_empty() || head == BYTE_ORDER_MARK {
        return Err(LogError::Empty(path()));
    }
    let mut header = match known {
        Some(header) => header,
        None => read_header(source, head, whole, mapping)?,
    };
    header.first_row = 1 + line_ends(&head[..header.rows_start.min(head.len())]);
    if source.as_table().is_none() {
        header.head_lines = header.head_lines(head);
    }
    if whole && head[header.rows_start.min(head.len())..].trim_ascii().is_empty() {
        return Err(LogError::NoRows(path()));
    }
    let Header { separator, ref names, rows_start, .. } = header;
    let error = |problem| source.error_at(header.names_line, problem);
    let is_of_matrices = |table: &Table| matches!(table.kind, FileKind::Hdf5 | FileKind::Matlab);
    let mapping = match source.as_whole_table().is_some_and(is_of_matrices) {
        true => &by_shape(names, mapping),
        false => mapping,
    };
    let (mut columns, mut roles) =
        recognise(names.clone(), &header.units, header.format, mapping).map_err(error)?;
    let rows = head.get(rows_start..).unwrap_or_default();
    let made = (!header.form.is_plain()).then(|| header.form.separated(rows, separator));
    let written = made.as_deref().unwrap_or(rows);
    let rows_line = 1 + line_ends(&head[..rows_start]);
    check_marks(source, &header, &columns, (written, rows_line))?;
    let made = (!header.marks.is_plain()).then(|| header.marks.rewritten(written, separator));
    let rows = made.as_deref().unwrap_or(written);
    let clock_at = |at: usize| ClockFields::new(rows, separator, at);
    if let (None, LogFormat::Csv) = (roles.time, header.format)
        && let Some(at) = only_dates(rows, separator, &columns)
    {
        columns[at].meaning = Meaning::Time(Scale::ONE);
        roles.time = Some(at);
    }
    let mut keys = header.keys.clone();
    for (name, unit) in unit_columns(rows, separator, &columns) {
        keys.read(&name, &unit, 0);
    }
    apply_keys(&keys, &mut columns);
    if are_counts(rows, separator, &columns) {
        let loads = columns.iter_mut().filter(|column| matches!(column.meaning, Meaning::Load(..)));
        loads.for_each(|column| column.set_unit(StatedUnit::Unknown("counts".to_owned())));
    }
    let order = mapping.for_columns(names).date_order();
    let is_time = |clock: &ClockFields| {
        let is_number = |field: &[u8]| parse_field(field).is_ok();
        match clock.dates(order) {
            // A clock that shows whole seconds, such as in ATI's demo, is less useful than the rate.
            Some(_) => !clock.repeats(),
            None => clock.first().is_some_and(is_number),
        }
    };
    let is_named = mapping.time.is_some();
    let date = add_parts(source, &header, rows, (order, is_named), (&mut columns, &mut roles));
    let said_rate = header.keys.rate_hz.filter(|_| header.format == LogFormat::Csv);
    if said_rate.is_some()
        && roles.time_parts.is_empty()
        && let Some(at) = roles.time
        && !is_time(&clock_at(at))
    {
        columns[at] =
            Column { meaning: Meaning::Other, unit: StatedUnit::None, ..columns[at].clone() };
        roles.time = None;
    }
    let rate_hz = said_rate.filter(|_| roles.time.is_none()).map(|(rate, _)| rate);
    let clock = roles.time.map(clock_at);
    let mut dates = clock.as_ref().and_then(|clock| clock.dates(order));
    if let (Some(dates), Some(date)) = (&mut dates, date) {
        dates.is_of_day = false;
        dates.unclear = dates.unclear.take().or(date.unclear);
    }
    // A binary table has its times in s, even if the name has another unit and the first rows have no time.
    let is_typed = |at: usize| source.as_whole_table().is_some_and(|table| table.is_time(at));
    if let Some(at) = roles.time
        && (dates.is_some() || is_typed(at) || is_sum_of_seconds(&columns[at], &roles))
    {
        columns[at].set_unit(TimeUnit::Second.into());
    }
    let mut unclear_time = None;
    if let (Some(at), Some(clock), None) = (roles.time, &clock, mapping.time_unit)
        && columns[at].meaning == Meaning::Time(Scale::ONE)
        && columns[at].unit == StatedUnit::None
    {
        let unclear = |step| PlacedProblem::UnclearTimeUnit { column: names[at].clone(), step };
        // The rate in the head may show which of two units is right.
        let by_rate = |step: f64| {
            let (rate, _) = header.keys.rate_hz?;
            let is_of = |unit: &TimeUnit| (step / unit.per_second() * rate - 1.0).abs() < 0.2;
            TimeUnit::ALL.into_iter().find(is_of)
        };
        let in_name = stated_unit(&names[at], &[], 0, Quantity::Time);
        let unit = match clock.unit().map_err(|step| (step, by_rate(step))) {
            Ok(unit) => unit,
            // A name such as `time_s` has the unit that a time has without one.
            Err((_, None)) if in_name.known().is_some() => None,
            Err((_, Some(unit))) => Some(unit),
            // Seconds, milliseconds or numbers of rows: most commands need none of them.
            Err((ROW_STEP, None)) => {
                unclear_time = Some(ROW_STEP);
                None
            }
            Err((step, None)) => return Err(error(unclear(step))),
        };
        if let Some(unit) = unit {
            columns[at].set_unit(unit.into());
        }
    }
    let first_time = clock.as_ref().and_then(ClockFields::first);
    let is_in_days = |at: usize| columns[at].meaning.scale().times == DAY_S && dates.is_none();
    let first_day = first_time.and_then(|field| parse_field(field).ok());
    let first_day = first_day.filter(|_| roles.time.is_some_and(is_in_days));
    let origin_days = first_day.and_then(origin_of_days);
    let counts_in_32_bits = roles.time.is_some_and(|at| {
        let is_count = |time: f64| time.fract() == 0.0 && (0.0..TURN).contains(&time);
        let is_small = columns[at].meaning.scale().per >= 1e3;
        let first = first_time.and_then(|field| parse_field(field).ok());
        is_small && dates.is_none() && first.is_some_and(is_count)
    });
    let conditions = conditions(names, roles.group, &header, mapping).map_err(error)?;
    let interleaving = interleaving(rows, separator, &columns)
        .filter(|found| !conditions.iter().any(|of| columns[of.column].name == found.column));
    let mut decisions = decisions(&header, rows_line, rate_hz.is_some());
    if let (Some(at), false) = (roles.time, roles.time_parts.is_empty()) {
        let parts = roles.time_parts.iter().map(|part| part.column);
        let parts: Vec<_> = std::iter::once(at).chain(parts).map(|at| names[at].as_str()).collect();
        decisions.push(format!("time is the sum of `{}`", parts.join("` and `")));
    }
    if origin_days.is_some() {
        decisions.push("time in days of a spreadsheet, as seconds since 1970".to_owned());
    }
    Ok(FileLayout {
        header,
        columns,
        roles,
        rows_line,
        dates,
        rate_hz,
        origin_days,
        counts_in_32_bits,
        unclear_time,
        conditions,
        interleaving,
        decisions,
    })
}

fn conditions(
    names: &[String],
    group: Option<usize>,
    header: &Header,
    mapping: &Mapping,
) -> Result<Vec<PlacedCondition>, PlacedProblem> {
    let references: Vec<_> = mapping.rows.iter().map(|of| of.column.clone()).collect();
    let columns = positions(names, &references)?;
    let missing = |what: &str| {
        let found = names.to_vec();
        PlacedProblem::MissingColumns { missing: vec![what.to_owned()], found }
    };
    let mut placed: Vec<PlacedCondition> = columns
        .into_iter()
        .zip(&mapping.rows)
        .map(|(column, of)| PlacedCondition {
            column,
            comparison: of.comparison,
            value: of.value.clone(),
        })
        .collect();
    for value in &mapping.excluded_groups {
        let column = group.ok_or_else(|| missing("group"))?;
        let (comparison, value) = (Comparison::Unequal, value.clone());
        placed.push(PlacedCondition { column, comparison, value });
    }
    // A console log has no texts to compare.
    match header.format {
        LogFormat::Console if !placed.is_empty() => Err(missing("of text")),
        _ => Ok(placed),
    }
}

/// Finds the only column of dates or times of day that change, such as the index of pandas, by its values alone.
fn only_dates(rows: &[u8], separator: u8, columns: &[Column]) -> Option<usize> {
    let first = fields(lines(rows, 0, 1).next()?.text, separator);
    let is_unused = |at: &usize| columns[*at].meaning == Meaning::Other;
    let candidates = (0..columns.len().min(first.len())).filter(is_unused);
    let dates = candidates.filter(|&at| !is_number(&first[at]) && is_date(&first[at]));
    let mut found = dates.filter(|&at| ClockFields::new(rows, separator, at).changes());
    found.next().filter(|_| found.next().is_none())
}

fn interleaving(rows: &[u8], separator: u8, columns: &[Column]) -> Option<Interleaving> {
    let rows: Vec<Vec<Vec<u8>>> = lines(rows, 0, 1)
        .take(CLOCK_ROWS)
        .map(|line| fields(line.text, separator))
        .filter(|fields| fields.len() == columns.len())
        .collect();
    let others = columns.iter().enumerate().filter(|(_, of)| of.meaning == Meaning::Other);
    let of_column = |(at, column): (usize, &Column)| {
        let texts =
            rows.iter().map(|fields| String::from_utf8_lossy(&fields[at]).trim().to_owned());
        let name = column.name.clone();
        (name, texts.collect::<Vec<String>>())
    };
    let found: Vec<(String, Vec<String>)> = others.map(of_column).collect();
    let found: Vec<(&str, Vec<String>)> =
        found.iter().map(|(name, fields)| (name.as_str(), fields.clone())).collect();
    Interleaving::find(&found)
}

const DAY_S: f64 = 86_400.0;

/// Step of a column that numbers the rows.
const ROW_STEP: f64 = 1.0;

/// Refuses a column with a meaning if the point or comma in a number may be decimal or between thousands.
fn check_marks(
    source: &LogSource,
    header: &Header,
    columns: &[Column],
    (rows, rows_line): (&[u8], u64),
) -> Result<(), LogError> {
    let is_used = |of: &Column| {
        matches!(of.meaning, Meaning::Time(_) | Meaning::Sensor(_) | Meaning::Load(..))
    };
    for (at, column) in columns.iter().enumerate().filter(|(_, column)| is_used(column)) {
        let Some(number) = header.marks.unclear(at) else { continue };
        let is_there = |line: &LayoutLine<'_>| {
            let fields = fields(line.text, header.separator);
            fields.get(at).is_some_and(|field| field.trim_ascii() == number.as_bytes())
        };
        let line = lines(rows, 0, rows_line).find(is_there).map_or(rows_line, |line| line.number);
        let (column, number) = (column.name.clone(), number.to_owned());
        return Err(source.error_at(line, PlacedProblem::UnclearMark { column, number }));
    }
    Ok(())
}

/// Finds the columns that are added to the time, and gives them their meaning; no date if the user has named the column
/// of the time (`is_named`). Returns the notation of dates among them.
fn add_parts(
    source: &LogSource,
    header: &Header,
    rows: &[u8],
    (order, is_named): (Option<DateOrder>, bool),
    (columns, roles): (&mut [Column], &mut ColumnRoles),
) -> Option<DateColumn> {
    let at = roles.time.filter(|_| header.format == LogFormat::Csv)?;
    let separator = header.separator;
    if header.nameless_stamp == Some(at) {
        roles.time_parts = vec![ClockPart { column: at + 1, values: OF_NANOSECONDS }];
    }
    let was_named = !roles.time_parts.is_empty();
    let repeats = ClockFields::new(rows, separator, at).repeats();
    let is_sure = repeats || has_fraction(&header.names, at) || header.nameless_stamp == Some(at);
    roles.time_parts.retain(|part| is_sure && is_fraction(rows, separator, at, *part));
    if was_named && roles.time_parts.is_empty() && repeats && has_fraction(&header.names, at) {
        // Without the fraction, several rows would have the same time.
        columns[at].meaning = Meaning::Other;
        roles.time = None;
        return None;
    }
    let kind = source.as_whole_table().map(|table| table.kind);
    let is_sheet = matches!(kind, Some(FileKind::Xlsx | FileKind::Ods));
    let mut date = None;
    // A column that the user names is the whole time: the file may hold the date of something else.
    let free: Vec<usize> =
        (0..columns.len()).filter(|at| columns[*at].meaning == Meaning::Other).collect();
    let found = (!is_named).then(|| date_part(rows, separator, at, &free, is_sheet)).flatten();
    if let Some(column) = found {
        date = ClockFields::new(rows, separator, column).dates(order);
        let of_dates = |dates: &DateColumn| PartValues::Dates(dates.order);
        let values = date.as_ref().map_or(PartValues::Numbers(Scale::ONE), of_dates);
        roles.time_parts.push(ClockPart { column, values });
    }
    roles.time_parts.iter().for_each(|part| columns[part.column].meaning = Meaning::TimePart);
    date
}

/// Returns true for whole seconds without a unit, to which other columns are added.
fn is_sum_of_seconds(column: &Column, roles: &ColumnRoles) -> bool {
    column.unit == StatedUnit::None && !roles.time_parts.is_empty()
}

/// Describes unusual decisions about the lines above the rows.
fn decisions(header: &Header, rows_line: u64, takes_rate: bool) -> Vec<String> {
    let mut said = Vec::new();
    match &header.form.body {
        RowBody::Json(_) => {
            said.push("names from the keys of each line, objects of JSON".to_owned())
        }
        RowBody::Labels(_) => said.push("names from the labels in each line".to_owned()),
        _ if header.names_line < rows_line => {
            said.push(format!("names from line {}", header.names_line));
        }
        _ => said.push("no names".to_owned()),
    }
    said.extend(header.units_line.map(|line| format!("units from line {line}")));
    let to = if header.keys.is_vicon { " to the next blank line" } else { "" };
    said.push(format!("data from line {rows_line}{to}"));
    if header.form.body == RowBody::Blanks {
        said.push("columns between blanks".to_owned());
    }
    if !header.marks.grouped.is_empty() {
        let grouped = header.marks.grouped.iter();
        let names = grouped.filter_map(|&at| header.names.get(at).map(String::as_str));
        let names = names.collect::<Vec<_>>().join("`, `");
        said.push(format!("marks between thousands, in `{names}`"));
    }
    if header.form.has_arrow {
        said.push("time before the values of a line".to_owned());
    }
    let place = |line: u64| match line {
        0 => "the file's attributes".to_owned(),
        line => format!("line {line}"),
    };
    if let (Some((rate, line)), true) = (header.keys.rate_hz, takes_rate) {
        said.push(format!("{rate} Hz from {}, as time", place(line)));
    }
    for (what, counts) in ["forces", "moments"].iter().zip(header.keys.counts) {
        if let Some((counts, line)) = counts {
            let counts = grouped(counts);
            said.push(format!("{what} in counts, divided by {counts} from {}", place(line)));
        }
    }
    let is_usual = header.format != LogFormat::Csv
        || (said.len() == 2 && header.form.is_plain() && rows_line <= 2);
    if is_usual { Vec::new() } else { said }
}

fn grouped(number: f64) -> String {
    let text = number.to_string();
    let (whole, rest) = text.split_at(text.find('.').unwrap_or(text.len()));
    let groups: Vec<&str> =
        whole.as_bytes().rchunks(3).rev().filter_map(|group| str::from_utf8(group).ok()).collect();
    format!("{}{rest}", groups.join(","))
}

const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

fn read_header(
    source: &LogSource,
    head: &[u8],
    whole: bool,
    mapping: &Mapping,
) -> Result<Header, LogError> {
    let start = if head.starts_with(BYTE_ORDER_MARK) { BYTE_ORDER_MARK.len() } else { 0 };
    let first = lines(head, start, 1).next();
    let first = first.ok_or_else(|| LogError::NoRows(source.path.clone()))?;
    if memchr(b'\r', first.text).is_some() {
        return Err(source.error_at(first.number, PlacedProblem::CarriageReturns));
    }
    let is_long = !whole && first.next == head.len() && !head.ends_with(b"\n");
    let is_alone = || whole && lines(head, first.next, first.number + 1).next().is_none();
    let has_lists = || str::from_utf8(first.text).is_ok_and(|text| text.matches(',').count() > 16);
    if first.text.trim_ascii_start().starts_with(b"{")
        && (is_long || first.text.trim_ascii() == b"{" || is_alone() && has_lists())
    {
        let what = "a JSON document";
        let remedy = "write CSV, or one object per line: in Python \
                      `pandas.read_json(FILE).to_csv('log.csv')`";
        return Err(LogError::Foreign { path: source.path.clone(), what, remedy });
    }
    let of_octave = head[start..].starts_with(b"# Created by Octave");
    if of_octave && memchr::memmem::find_iter(head, b"\n# name:").count() > 1 {
        let what = "text of Octave with several variables";
        let remedy = "save it with `save -v7 log.mat`, which is read";
        return Err(LogError::Foreign { path: source.path.clone(), what, remedy });
    }
    if is_long {
        return Err(source.error_at(first.number, PlacedProblem::LineTooLong(head.len())));
    }
    let format = match mapping.format {
        Some(format) => format,
        None if source.as_table().is_some() => LogFormat::Csv,
        None if is_telemetry(&head[start..]) => LogFormat::Telemetry,
        None if is_console(head) => LogFormat::Console,
        None => LogFormat::Csv,
    };
    match format {
        LogFormat::Telemetry => telemetry_header(source, head, &first),
        LogFormat::Console => {
            let names = CONSOLE.map(str::to_owned).to_vec();
            Ok(Header::new(format, names, start, first.number))
        }
        LogFormat::Csv | LogFormat::Training | LogFormat::Reference => {
            separated_header(source, head, &first, mapping)
        }
    }
}

/// Parses a telemetry header: the last `%` line with `|` names the columns.
fn telemetry_header(
    source: &LogSource,
    head: &[u8],
    first: &LayoutLine<'_>,
) -> Result<Header, LogError> {
    let lines = || lines(head, first.start, first.number);
    let is_above = |line: &LayoutLine<'_>| line.text.starts_with(b"%");
    let names = lines().take_while(is_above).filter(|line| line.text.contains(&b'|')).last();
    let names = names.ok_or_else(|| LogError::NoColumnNames(source.path.clone()))?;
    let rows_start = lines().find(|line| !is_above(line)).map_or(head.len(), |line| line.start);
    let text = String::from_utf8_lossy(names.text);
    let line = names.number;
    let names = text.trim_start_matches('%').split('|').map(|name| name.trim().to_owned());
    Ok(Header::new(LogFormat::Telemetry, names.collect(), rows_start, line))
}

/// Parses the header of separated values, or recognises a known layout without a header.
fn separated_header(
    source: &LogSource,
    head: &[u8],
    first: &LayoutLine<'_>,
    mapping: &Mapping,
) -> Result<Header, LogError> {
    let format = mapping.format.unwrap_or(LogFormat::Csv);
    let table = source.as_whole_table();
    if let Some(names) = table.and_then(Table::names)
        && format == LogFormat::Csv
    {
        let units = table.map(Table::units).unwrap_or_default();
        let mut keys = Keys::default();
        let attributes = table.map(|table| table.attributes.as_slice()).unwrap_or_default();
        attributes.iter().for_each(|(key, value)| keys.read(key, value, 0));
        return Ok(Header { units, keys, ..Header::new(format, names, first.next, first.number) });
    }
    let start = if head.starts_with(BYTE_ORDER_MARK) { BYTE_ORDER_MARK.len() } else { 0 };
    let comma = table.map(|_| b',');
    let found = usual_head(head, first, comma, mapping).or_else(|| {
        let found = head::find(head, start, comma, mapping);
        let is_named = found.as_ref().is_some_and(|found| found.names.is_some());
        let alone = || names_alone(head, first, comma, mapping);
        if is_named { found } else { alone().or(found) }
    });
    let Some(found) = found else {
        return Err(source.error_at(first.number, PlacedProblem::NoTable));
    };
    let Head { separator, form, names, units, mut rows_start, mut rows_line, columns, keys } =
        found;
    let is_all_rows = names.is_none() && rows_line == first.number;
    if names.is_none()
        && let Some(line) = lines(&head[rows_start..], 0, 1).next()
        && counts_columns(&fields(line.text, separator))
    {
        rows_start += line.next;
        rows_line += 1;
    }
    let rows = form.separated(&head[rows_start..], separator);
    let is_list = separator != b',' && form.body == RowBody::Separated;
    let of_line = |line: LayoutLine<'_>| fields(line.text, separator);
    let marks = match table {
        Some(_) => NumberMarks::default(),
        None => NumberMarks::new(lines(&rows, 0, 1).map(of_line), is_list),
    };
    let is_nameless_text = names.is_none() && table.is_none();
    let nameless_stamp = is_nameless_text.then(|| nameless_stamp(&rows, separator)).flatten();
    let (units_line, units) = units.map_or((None, Vec::new()), |(line, units)| (Some(line), units));
    let header = Header {
        separator,
        form,
        units,
        units_line,
        keys,
        nameless_stamp,
        marks,
        ..Header::new(format, Vec::new(), rows_start, rows_line)
    };
    let is_of_layout = |(format, layout): &&(LogFormat, &[&str])| match mapping.format {
        Some(wanted) => *format == wanted,
        None => is_all_rows && layout.len() == columns,
    };
    if let Some(&(format, layout)) = NAMELESS.iter().find(is_of_layout) {
        if layout.len() != columns {
            let (expected, found) = (layout.len(), columns);
            let problem = PlacedProblem::LayoutMismatch { format, expected, found };
            return Err(source.error_at(first.number, problem));
        }
        let names = layout.iter().map(|&name| name.to_owned()).collect();
        return Ok(Header { format, names, ..header });
    }
    if let Some((names_line, names)) = names {
        return Ok(Header { names, names_line, ..header });
    }
    // Columns in an unknown order are useful only if the user specifies some of them.
    if mapping.sensors.is_none() && mapping.wrench.is_none() && mapping.time.is_none() {
        let rows = header.form.separated(&head[rows_start..], separator);
        let first = lines(&rows, 0, 1).next().map(|line| fields(line.text, separator));
        let since_1970 = first.iter().flatten().position(|field| is_since_1970(field));
        let firsts = lines(&rows, 0, 1).take(ROWS_OF_CLOCK);
        let number = |field: &Vec<u8>| std::str::from_utf8(field).ok()?.trim().parse().ok();
        let firsts =
            firsts.filter_map(|line| fields(line.text, separator).first().and_then(number));
        let runs_on = firsts.collect::<Vec<f64>>().is_sorted();
        let time = since_1970.or(runs_on.then_some(0)).map(|at| at + 1);
        return Err(source.error_at(rows_line, PlacedProblem::UnknownLayout { columns, time }));
    }
    Ok(Header { names: numbered(1, columns), ..header })
}

/// Number of rows in which the first column must rise to be a time.
const ROWS_OF_CLOCK: usize = 20;

/// Recognises the head of most logs: known column names, then rows with as many fields.
fn usual_head(
    head: &[u8],
    first: &LayoutLine<'_>,
    comma: Option<u8>,
    mapping: &Mapping,
) -> Option<Head> {
    let separator = comma.unwrap_or_else(|| line_separator(first.text));
    let fields = |line: &LayoutLine<'_>| fields(line.text, separator);
    let names = fields(first);
    let is_asked = mapping.header_line.is_some() || mapping.skip_lines.is_some();
    let mut below = lines(head, first.next, first.number + 1);
    let second = below.next()?;
    if is_asked
        || head::is_of_other_form(first.text)
        || first.text.starts_with(b"%")
        || first.text.starts_with(b"LabVIEW Measurement")
        || fields(&second).len() != names.len()
        || known_names(&texts(&names)) == 0
        || names.iter().any(|name| head::is_numeric(name))
        || head::with_groups(&texts(&names), &texts(&fields(&second))).is_some()
    {
        return None;
    }
    let mut found = named_head(first, separator, &names, &second);
    let above = all_lines(&head[..first.start], 0, 1);
    found.keys = Keys::new(above.map(|line| (line.number, head::bare(line.text))));
    let has_numbers =
        |line: &LayoutLine<'_>| fields(line).iter().any(|field| head::is_numeric(field));
    // A line of units precedes a line of numbers; a quantity without a unit may have `1` in it.
    if (!has_numbers(&second) || head::are_units_or_ones(&texts(&fields(&second))))
        && let Some(third) = below.next()
        && has_numbers(&third)
    {
        found.units = Some((second.number, texts(&fields(&second))));
        (found.rows_start, found.rows_line) = (third.start, third.number);
    }
    Some(found)
}

/// Recognises the head of a text without rows in sight, if its first line names columns.
fn names_alone(
    head: &[u8],
    first: &LayoutLine<'_>,
    comma: Option<u8>,
    mapping: &Mapping,
) -> Option<Head> {
    let separator = comma.unwrap_or_else(|| line_separator(first.text));
    let names = fields(first.text, separator);
    let second = lines(head, first.next, first.number + 1).next();
    let is_text = !names.iter().any(|name| head::is_numeric(name));
    // Columns that the user refers to by number need no names.
    let is_said = mapping.names_columns();
    let is_known = is_said || known_names(&texts(&names)) > 0 || mapping.format.is_some();
    let next =
        LayoutLine { text: b"", start: first.next, next: first.next, number: first.number + 1 };
    let second = second.unwrap_or(next);
    let is_text = is_text && !head::is_of_other_form(first.text);
    (is_text && is_known).then(|| named_head(first, separator, &names, &second))
}

/// Returns true if the names are the numbers of the columns, as in a data frame made from an array.
fn counts_columns(fields: &[Vec<u8>]) -> bool {
    let counts_from = |start: usize| {
        let mut numbered = fields.iter().enumerate();
        numbered.all(|(at, field)| field.trim_ascii() == (at + start).to_string().as_bytes())
    };
    fields.len() > Axis::ALL.len() && (counts_from(0) || counts_from(1))
}

fn named_head(
    first: &LayoutLine<'_>,
    separator: u8,
    names: &[Vec<u8>],
    second: &LayoutLine<'_>,
) -> Head {
    Head {
        separator,
        columns: names.len(),
        names: Some((first.number, texts(names))),
        rows_start: first.next,
        rows_line: second.number,
        ..Head::default()
    }
}

/// Columns of formats that do not name them.
const TRAINING: [&str; 15] =
    ["time", "s1", "s2", "s3", "s4", "s5", "s6", "s7", "s8", "Fx", "Fy", "Fz", "Mx", "My", "Mz"];
const REFERENCE: [&str; 12] =
    ["column 1", "column 2", "time", "Fx", "Fy", "Fz", "Mx", "My", "Mz", "ax", "ay", "az"];
const NAMELESS: [(LogFormat, &[&str]); 2] =
    [(LogFormat::Training, &TRAINING), (LogFormat::Reference, &REFERENCE)];
const CONSOLE: [&str; 9] = ["s1", "s2", "s3", "s4", "s5", "s6", "s7", "s8", "time_us"];

fn is_number(field: &[u8]) -> bool {
    matches!(parse_field(field), Ok(_) | Err(FieldProblem::NotFinite))
}

/// Returns true for robot telemetry: there are `%` lines above the rows. Either one of them contains `|`, or none is a
/// key and one contains no separator.
fn is_telemetry(head: &[u8]) -> bool {
    let mut lines = lines(head, 0, 1).map(|line| line.text);
    let above: Vec<&[u8]> = lines.by_ref().take_while(|text| text.starts_with(b"%")).collect();
    let separates =
        |text: &&[u8]| text.contains(&b'|') || !text.iter().any(|byte| b",;\t".contains(byte));
    let is_key = |text: &&[u8]| text.contains(&b':') || text.contains(&b'=');
    let has_names = above.iter().any(|text| text.contains(&b'|'));
    !above.is_empty() && above.iter().any(separates) && (has_names || !above.iter().any(is_key))
}

/// Returns true if a line reports a received payload, `SRC: 0x2052 |  [69, 20, …]`.
fn is_console(head: &[u8]) -> bool {
    // Most logs do not contain `SRC:` at all; this search is faster than one line by line.
    memchr::memmem::find(head, b"SRC:").is_some()
        && (head.starts_with(b"SRC: ")
            || head.split(|&b| b == b'\n').any(|line| console::payload(line).is_some()))
}

/// Returns the first byte that does not occur in text: a control character other than white space.
fn binary_byte(head: &[u8]) -> Option<(usize, u8)> {
    let control =
        |b: u8| (b < 0x20 && !b.is_ascii_whitespace() && b != 0x0b && b != 0x1b) || b == 0x7f;
    // A part is searched without an early exit, so that the compiler can use vector instructions.
    const PART: usize = 512;
    let has_control = |part: &[u8]| part.iter().fold(false, |any, &b| any | control(b));
    let start = PART * head.chunks(PART).position(has_control)?;
    let at = start + head[start..].iter().position(|&b| control(b))?;
    Some((at, head[at]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_separator_is_what_stands_between_the_fields() {
        for (line, expected) in [
            ("a,b,c", b','),
            ("a;b;c", b';'),
            ("a\tb\tc", b'\t'),
            ("1,5;2,5;3,5", b';'),
            ("alone", b','),
            ("alone and text", b','),
            (" 1.0   2.0 3e5", b' '),
            ("1, 2, 3", b','),
            (" 1 , 2 , 3 ", b','),
            ("0,5 1,5 2", b' '),
            ("\"a;b;c;d\",e,f", b','),
        ] {
            assert_eq!(line_separator(line.as_bytes()), expected, "{line}");
        }
    }

    #[test]
    fn control_characters_are_not_text() {
        assert_eq!(binary_byte(b"PK\x03\x04"), Some((2, 3)));
        assert_eq!(binary_byte(b"a\0b"), Some((1, 0)));
        let late = [&[b'1'; 1000][..], b"\x7f\0"].concat();
        assert_eq!(binary_byte(&late), Some((1000, 0x7f)));
        assert_eq!(binary_byte("\u{feff}t (µs),\r\n\t".as_bytes()), None);
    }
}
