//! Recognises a log from its first lines: what kind of file it is, where its rows start, and what
//! its columns are called.

use memchr::memchr;

use super::columns::{Column, ColumnRoles, by_shape, recognise};
use super::mapping::{LogFormat, Mapping, TimeUnit};
use super::meaning::{Meaning, names_a_unit};
use crate::error::{FieldProblem, LogError, PlacedProblem};
use crate::parse::console;
use crate::parse::number::{parse_date, parse_field, with_points};
use crate::parse::rows::{is_comment, quoted_fields};
use crate::stream::chunk::line_ends;
use crate::stream::clock_turns::ClockTurns;
use crate::stream::source::LogSource;
use shell_data::statistics::upper_median;
use table_file::{FileKind, Table};

/// How much of a file is looked at. A header must fit.
pub(crate) const HEAD_BYTES: u64 = 1 << 16;

/// The layout of a log.
#[derive(Debug)]
pub(crate) struct FileLayout {
    pub(crate) header: Header,
    pub(crate) columns: Vec<Column>,
    pub(crate) roles: ColumnRoles,
    /// The number of the line of the first row, from 1.
    pub(crate) rows_line: u64,
    /// Whether times are dates, in ISO 8601.
    pub(crate) has_dates: bool,
}

impl FileLayout {
    /// The clock, where it is one of 32 bits that wraps around: the robot's, in µs.
    pub(crate) fn clock(&self) -> Option<ClockTurns> {
        let column = self.roles.time.filter(|_| self.header.format == LogFormat::Telemetry)?;
        let in_us = self.columns[column].meaning.per_si_unit() == 1e6;
        in_us.then(|| ClockTurns::new(self.header.separator, column))
    }
}

/// What the lines before the rows say.
#[derive(Debug)]
pub(crate) struct Header {
    pub(crate) format: LogFormat,
    pub(crate) separator: u8,
    names: Vec<String>,
    /// What a line below the names says of them; empty if there is none.
    units: Vec<String>,
    /// Where the first row starts, in the uncompressed file.
    pub(crate) rows_start: usize,
    /// The line that names the columns, or the first row where none does.
    pub(crate) names_line: u64,
    /// Whether numbers have decimal commas.
    pub(crate) has_decimal_commas: bool,
}

impl Header {
    /// One of names and values separated by commas, without units.
    fn new(format: LogFormat, names: Vec<String>, rows_start: usize, names_line: u64) -> Self {
        let (separator, units, has_decimal_commas) = (b',', Vec::new(), false);
        Self { format, separator, names, units, rows_start, names_line, has_decimal_commas }
    }
}

/// Recognises the layout of the log that starts with `head`; `whole` if that is the whole log.
pub(crate) fn recognise_layout(
    source: &LogSource,
    head: &[u8],
    whole: bool,
    mapping: &Mapping,
) -> Result<FileLayout, LogError> {
    let path = || source.path.clone();
    if let Some((offset, byte)) = binary_byte(head) {
        return Err(LogError::Binary { path: path(), offset: offset as u64, byte });
    }
    if head.trim_ascii().is_empty() || head == BYTE_ORDER_MARK {
        return Err(LogError::Empty(path()));
    }
    let header = read_header(source, head, whole, mapping)?;
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
    let (mut columns, roles) =
        recognise(names.clone(), &header.units, header.format, mapping).map_err(error)?;
    let first = lines(head, rows_start, 1).next().map(|line| fields(line.text, separator));
    let first_time = roles.time.and_then(|at| first.as_ref()?.get(at));
    let has_dates = first_time.is_some_and(|field| parse_date(field).is_ok());
    if let (true, Some(at)) = (has_dates, roles.time) {
        columns[at].meaning = Meaning::Time(TimeUnit::Second);
    }
    if let (Some(at), None) = (roles.time, mapping.time_unit)
        && columns[at].meaning == Meaning::Time(TimeUnit::Second)
        && !has_dates
        && !names_a_unit(&columns[at].name)
    {
        let step = || median_step(head, rows_start, separator, at);
        let unit = match first_time.and_then(|field| epoch_unit(field)) {
            None => step().map(unit_by_step).transpose(),
            epoch => Ok(epoch),
        };
        let unclear = |step| PlacedProblem::UnclearTimeUnit { column: names[at].clone(), step };
        if let Some(unit) = unit.map_err(|step| error(unclear(step)))? {
            columns[at].meaning = Meaning::Time(unit);
        }
    }
    let rows_line = 1 + line_ends(&head[..rows_start]);
    Ok(FileLayout { header, columns, roles, rows_line, has_dates })
}

/// The unit of a clock that counts from 1970, by its digits: in the years 2001 to 2286 it has ten in s, thirteen in
/// ms, and so on.
fn epoch_unit(first: &[u8]) -> Option<TimeUnit> {
    let time = parse_field(first).ok()?;
    let has_digits = |digits: i32| (10_f64.powi(digits - 1)..10_f64.powi(digits)).contains(&time);
    let mut units = TimeUnit::ALL.into_iter().zip([10, 13, 16, 19]);
    units.find(|(_, digits)| has_digits(*digits)).map(|(unit, _)| unit)
}

/// The unit of a clock whose whole numbers go on by so many from row to row, as far as 2 s are too long for that and
/// 100 µs too short. Fewer than a hundred are taken for seconds, as times are that do not say.
///
/// # Errors
/// The step, if two units are possible.
fn unit_by_step(step: f64) -> Result<TimeUnit, f64> {
    match step {
        ..100.0 => Ok(TimeUnit::Second),
        2e3..5e5 => Ok(TimeUnit::Microsecond),
        2e6.. => Ok(TimeUnit::Nanosecond),
        _ => Err(step),
    }
}

/// Rows whose times tell the unit of a clock.
const CLOCK_ROWS: usize = 64;

/// The median step from one row's time to the next one's, of whole numbers that grow.
fn median_step(head: &[u8], rows_start: usize, separator: u8, at: usize) -> Option<f64> {
    // The last line of the head may be cut off.
    let lines = lines(head, rows_start, 1).filter(|line| line.next < head.len()).take(CLOCK_ROWS);
    let time = |line: LayoutLine<'_>| parse_field(fields(line.text, separator).get(at)?).ok();
    let times: Vec<f64> = lines.filter_map(time).collect();
    if times.iter().any(|time| time.fract() != 0.0) {
        return None;
    }
    let steps = times.windows(2).map(|pair| pair[1] - pair[0]);
    let mut steps: Vec<f64> = steps.filter(|step| *step > 0.0).collect();
    upper_median(&mut steps)
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
    if !whole && first.next == head.len() && !head.ends_with(b"\n") {
        return Err(source.error_at(first.number, PlacedProblem::LineTooLong(head.len())));
    }
    let format = match mapping.format {
        Some(format) => format,
        None if source.as_table().is_some() => LogFormat::Csv,
        None if first.text.starts_with(b"%") => LogFormat::Telemetry,
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

/// Telemetry: the last line with `|` among those that start with `%` names the columns.
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

/// Separated values: names if the first line is mostly not numbers, or else a known layout.
fn separated_header(
    source: &LogSource,
    head: &[u8],
    first: &LayoutLine<'_>,
    mapping: &Mapping,
) -> Result<Header, LogError> {
    let table_names = source.as_whole_table().and_then(Table::names);
    let separator = if source.as_whole_table().is_some() { b',' } else { separator(first.text) };
    let fields = |line: &LayoutLine<'_>| fields(line.text, separator);
    let has_commas = separator != b',';
    let is_numeric = |fields: &[Vec<u8>]| {
        let is_number = |field: &&Vec<u8>| {
            is_number(field)
                || (has_commas && is_number(&with_points(field)))
                || parse_date(field).is_ok()
        };
        2 * fields.iter().filter(is_number).count() >= fields.len()
    };
    let found = fields(first);
    let has_names = table_names.is_some() || !is_numeric(&found);
    let format = mapping.format.unwrap_or(LogFormat::Csv);
    let rows_start = if has_names { first.next } else { first.start };
    let mut header = Header {
        separator,
        has_decimal_commas: has_commas && has_decimal_commas(head, first, separator),
        ..Header::new(format, Vec::new(), rows_start, first.number)
    };
    let named_above = (!has_names).then(|| names_in_comment(head, first, separator, found.len()));
    let are_named = has_names || named_above.as_ref().is_some_and(Option::is_some);
    let is_of_layout = |(format, names): &&(LogFormat, &[&str])| match mapping.format {
        Some(wanted) => *format == wanted,
        None => !are_named && names.len() == found.len(),
    };
    if let Some(&(format, names)) = NAMELESS.iter().find(is_of_layout) {
        if names.len() != found.len() {
            let (expected, found) = (names.len(), found.len());
            let problem = PlacedProblem::LayoutMismatch { format, expected, found };
            return Err(source.error_at(first.number, problem));
        }
        let names = names.iter().map(|&name| name.to_owned()).collect();
        return Ok(Header { format, names, ..header });
    }
    if let Some((line, names)) = named_above.flatten() {
        return Ok(Header { names, names_line: line, ..header });
    }
    if has_names {
        let are_units_below = table_names.is_none();
        header.units = source.as_whole_table().map(Table::units).unwrap_or_default();
        header.names = table_names.unwrap_or_else(|| texts(&found));
        // A line of units is one of texts above one of numbers.
        let mut below = lines(head, first.next, first.number + 1);
        if let (true, Some(line)) = (are_units_below, below.next())
            && let units = fields(&line)
            && units.len() == header.names.len()
            && !units.iter().any(|field| is_number(field) || is_number(&with_points(field)))
            && below.next().is_some_and(|third| is_numeric(&fields(&third)))
        {
            header.units = texts(&units);
            header.rows_start = line.next;
        }
        return Ok(header);
    }
    // Numbers in an unknown order are of use only to someone who says which is which.
    if mapping.sensors.is_none() && mapping.wrench.is_none() && mapping.time.is_none() {
        let problem = PlacedProblem::UnknownLayout(found.len());
        return Err(source.error_at(first.number, problem));
    }
    let names = (1..=found.len()).map(|i| format!("column {i}")).collect();
    Ok(Header { names, ..header })
}

/// Names of as many columns in the comment above the first row, as NumPy's `savetxt` writes them, and
/// its line.
fn names_in_comment(
    head: &[u8],
    first: &LayoutLine<'_>,
    separator: u8,
    columns: usize,
) -> Option<(u64, Vec<String>)> {
    let comment = head[..first.start].trim_ascii_end().rsplit(|&byte| byte == b'\n').next()?;
    let comment = comment.trim_ascii().strip_prefix(b"#")?;
    let names = texts(&fields(comment, separator));
    let is_name = |name: &String| !name.is_empty() && !is_number(name.as_bytes());
    (columns > 1 && names.len() == columns && names.iter().all(is_name))
        .then(|| (line_ends(&head[..first.start]), names))
}

/// How many rows are looked at for decimal commas.
const LOOKED_AT: usize = 16;

/// Whether some field of the first rows is a number once its comma is a point, and none else.
fn has_decimal_commas(head: &[u8], first: &LayoutLine<'_>, separator: u8) -> bool {
    let is_decimal = |field: &Vec<u8>| {
        field.contains(&b',') && !is_number(field) && is_number(&with_points(field))
    };
    lines(head, first.start, first.number)
        .take(LOOKED_AT)
        .any(|line| fields(line.text, separator).iter().any(is_decimal))
}

/// The columns of formats that do not name them.
const TRAINING: [&str; 15] =
    ["time", "s1", "s2", "s3", "s4", "s5", "s6", "s7", "s8", "Fx", "Fy", "Fz", "Mx", "My", "Mz"];
const REFERENCE: [&str; 12] =
    ["column 1", "column 2", "time", "Fx", "Fy", "Fz", "Mx", "My", "Mz", "ax", "ay", "az"];
const NAMELESS: [(LogFormat, &[&str]); 2] =
    [(LogFormat::Training, &TRAINING), (LogFormat::Reference, &REFERENCE)];
const CONSOLE: [&str; 9] = ["s1", "s2", "s3", "s4", "s5", "s6", "s7", "s8", "time_us"];

/// The fields of one line, quotes removed.
fn fields(line: &[u8], separator: u8) -> Vec<Vec<u8>> {
    if !line.contains(&b'"') {
        return line.split(|&b| b == separator).map(<[u8]>::to_vec).collect();
    }
    quoted_fields(line, separator).iter().map(<[u8]>::to_vec).collect()
}

fn texts(fields: &[Vec<u8>]) -> Vec<String> {
    fields.iter().map(|field| String::from_utf8_lossy(field).trim().to_owned()).collect()
}

/// The separator that a line has most of, outside quotes; a comma where there is none.
fn separator(line: &[u8]) -> u8 {
    let candidates = *b",;\t|";
    let mut counts = [0_usize; 4];
    let mut quoted = false;
    for byte in line {
        quoted ^= *byte == b'"';
        if let Some(i) = candidates.iter().position(|c| c == byte).filter(|_| !quoted) {
            counts[i] += 1;
        }
    }
    // Commas may be decimal ones where another separator stands between the numbers.
    let other = (1..4).filter(|&i| counts[i] > 0).max_by_key(|&i| (counts[i], 4 - i));
    match other {
        Some(i) if counts[0] <= counts[i] + 1 => candidates[i],
        _ => b',',
    }
}

fn is_number(field: &[u8]) -> bool {
    matches!(parse_field(field), Ok(_) | Err(FieldProblem::NotFinite))
}

/// Whether some line reports a received payload, `SRC: 0x2052 |  [69, 20, …]`.
fn is_console(head: &[u8]) -> bool {
    // Most logs say so nowhere, which is known sooner than line by line.
    memchr::memmem::find(head, b"SRC:").is_some()
        && (head.starts_with(b"SRC: ")
            || head.split(|&b| b == b'\n').any(|line| console::payload(line).is_some()))
}

/// The first byte that no text has: a control character other than white space.
fn binary_byte(head: &[u8]) -> Option<(usize, u8)> {
    let control =
        |b: u8| (b < 0x20 && !b.is_ascii_whitespace() && b != 0x0b && b != 0x1b) || b == 0x7f;
    // Without a way out within a part, parts are looked at with vectors.
    const PART: usize = 512;
    let has_control = |part: &[u8]| part.iter().fold(false, |any, &b| any | control(b));
    let start = PART * head.chunks(PART).position(has_control)?;
    let at = start + head[start..].iter().position(|&b| control(b))?;
    Some((at, head[at]))
}

/// A line of the head.
#[derive(Clone, Copy)]
struct LayoutLine<'a> {
    text: &'a [u8],
    start: usize,
    next: usize,
    number: u64,
}

/// The lines from `start` on that are neither blank nor comments, counted from `number`.
fn lines(head: &[u8], start: usize, number: u64) -> impl Iterator<Item = LayoutLine<'_>> {
    let mut next = start;
    let line = move |number| {
        let start = next;
        let rest = head.get(start..).filter(|rest| !rest.is_empty())?;
        let end = memchr(b'\n', rest).map_or(head.len(), |at| start + at);
        next = (end + 1).min(head.len());
        Some(LayoutLine { text: head[start..end].trim_ascii(), start, next, number })
    };
    let is_text = |line: &LayoutLine<'_>| !line.text.is_empty() && !is_comment(line.text);
    (number..).map_while(line).filter(is_text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clocks_from_1970_tell_their_unit_and_others_do_not() {
        for (first, unit) in [
            ("1762506123.5", Some(TimeUnit::Second)),
            ("1762506123500", Some(TimeUnit::Millisecond)),
            ("1762506123500123", Some(TimeUnit::Microsecond)),
            ("1762506123500123456", Some(TimeUnit::Nanosecond)),
            ("0.01", None),
            ("10000", None),
            ("x", None),
        ] {
            assert_eq!(epoch_unit(first.as_bytes()), unit, "{first}");
        }
    }

    #[test]
    fn whole_numbers_tell_their_unit_by_their_steps() {
        let head = |step: u64| -> String {
            (0..40)
                .map(|row| format!("{},7\n", if row > 20 { row - 20 } else { row } * step))
                .collect()
        };
        let unit = |text: &str| median_step(text.as_bytes(), 0, b',', 0).map(unit_by_step);
        for (step, expected) in [
            (1, Ok(TimeUnit::Second)),
            (60, Ok(TimeUnit::Second)),
            (500, Err(500.0)),
            (10_000, Ok(TimeUnit::Microsecond)),
            (1_000_000, Err(1e6)),
            (10_000_000, Ok(TimeUnit::Nanosecond)),
        ] {
            assert_eq!(unit(&head(step)), Some(expected), "{step}");
        }
        assert_eq!(unit("1000.5,7\n12000.5,7\n24000.5,7\n"), None, "fractions are of seconds");
        assert_eq!(unit("x,7\n"), None);
    }

    #[test]
    fn the_separator_is_what_stands_between_the_fields() {
        for (line, expected) in [
            ("a,b,c", b','),
            ("a;b;c", b';'),
            ("a\tb\tc", b'\t'),
            ("1,5;2,5;3,5", b';'),
            ("alone", b','),
            ("\"a;b;c;d\",e,f", b','),
        ] {
            assert_eq!(separator(line.as_bytes()), expected, "{line}");
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
