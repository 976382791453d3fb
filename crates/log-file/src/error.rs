//! Errors in logs, with their positions.

use shared_proto::skinproc::SCAN_LEN;
use shell_data::hint::{Hint, quoted, suggest};
use shell_data::unit::Quantity;
use shell_data::wrench::Axis;
use std::fmt;
use std::io;
use std::path::PathBuf;

use table_file::{FileKind, TableError};

pub use crate::parse::field_problem::FieldProblem;
pub use crate::stream::companion::RowMismatch;

#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LogError {
    #[error("cannot read `{}`", path.display())]
    Io { path: PathBuf, source: io::Error },
    /// The file is compressed with `method` (gzip or zstd), but damaged or truncated.
    #[error("`{}` is a damaged {method} file", path.display())]
    Unpacking { path: PathBuf, method: &'static str, source: io::Error },
    #[error("`{}` is {problem}", path.display())]
    Table { path: PathBuf, problem: TableError },
    #[error("`{}` and `{}` beside it: {problem}", path.display(), companion.display())]
    RowMismatch { path: PathBuf, companion: PathBuf, problem: RowMismatch },
    /// An unsupported format: its name, and advice on converting it.
    #[error("`{}` is {what}, which is not read", path.display())]
    Foreign { path: PathBuf, what: &'static str, remedy: &'static str },
    /// A table was requested by name from a file that contains a single one.
    #[error("`{}` is a single table, and has none called `{wanted}`", path.display())]
    NoParts { path: PathBuf, wanted: String },
    #[error("`{}` is empty", .0.display())]
    Empty(PathBuf),
    #[error("`{}` has a header but no rows", .0.display())]
    NoRows(PathBuf),
    /// No row meets all conditions. `column` belongs to the condition that removes most rows; `found` are its values.
    #[error("no row of `{}` meets all conditions", path.display())]
    NoneChosen { path: PathBuf, column: String, found: Vec<String> },
    /// The value to exclude, such as a group, occurs in no row.
    #[error("`{}`: column `{column}` has no `{value}` to leave out", path.display())]
    NoneExcluded { path: PathBuf, column: String, value: String, found: Vec<String> },
    /// More rows are invalid than are skipped by default. `position` and `problem` describe the first invalid row.
    #[error(
        "`{}`: {skipped} of {rows} rows are wrong, {class}; the first at {position}: {problem}",
        path.display()
    )]
    ManyBadRows {
        path: PathBuf,
        skipped: u64,
        rows: u64,
        /// The feature that most invalid rows have in common, in words.
        class: String,
        position: LogPosition,
        problem: Box<RowProblem>,
    },
    /// A byte that does not occur in text, at `offset` in the uncompressed file.
    #[error("`{}` is not a text file: byte {offset} is 0x{byte:02x}", path.display())]
    Binary { path: PathBuf, offset: u64, byte: u8 },
    /// The `%` lines of a telemetry log do not name any columns.
    #[error("`{}`: no `%` line names the columns, separated by `|`", .0.display())]
    NoColumnNames(PathBuf),
    /// An error at a position: the line that names the columns, the first row, or an invalid row.
    #[error("`{}`, {position}: {problem}", path.display())]
    At { path: PathBuf, position: LogPosition, problem: PlacedProblem },
}

#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PlacedProblem {
    /// No line ends within the longest line that is read.
    #[error("longer than {0} bytes")]
    LineTooLong(usize),
    /// Lines end with a carriage return alone, which no program has written for decades.
    #[error("lines end with a carriage return and no line feed")]
    CarriageReturns,
    /// The rows have no header, and no known layout has as many columns. `time` is the probable time column, from 1:
    /// one with seconds since 1970, or the first if it rises.
    #[error(
        "{columns} columns and no header, expected 15 (time, 8 sensors, wrench) or 12 (2 others, time, \
         wrench, motion)"
    )]
    UnknownLayout { columns: usize, time: Option<usize> },
    /// No lines are rows of numbers, and the first line does not name known columns.
    #[error("this names no columns, and no rows of numbers follow")]
    NoTable,
    #[error("{format} has {expected} columns, found {found}")]
    LayoutMismatch { format: crate::format::mapping::LogFormat, expected: usize, found: usize },
    /// Required columns are missing; `found`: the existing ones.
    #[error(
        "no column{} {}; found {}",
        if missing.len() == 1 { "" } else { "s" },
        quoted(missing, ", "),
        if found.is_empty() { "none".to_owned() } else { quoted(found, ", ") }
    )]
    MissingColumns { missing: Vec<String>, found: Vec<String> },
    /// The file has the column, but the table leaves it out for the reason `why`.
    #[error("column `{column}` is left out: {why}")]
    LeftOutColumn { column: String, why: String },
    #[error("column `{column}`: the unit `{unit}` of its {} is not understood", quantity.name())]
    UnknownUnit { column: String, unit: String, quantity: Quantity },
    /// The robot's profile has another unit than the log.
    #[error("column `{column}` is in `{unit}`, but in `{expected}` according to the profile")]
    OtherUnit { column: String, unit: String, expected: String },
    /// One load has no unit, while another of the same kind has a unit other than N or N·m.
    #[error("column `{}` has no unit, and `{}` is in {unit}", columns[0], columns[1])]
    UnitOfSome { columns: Box<[String; 2]>, unit: String, is_moment: bool },
    /// The times are integers whose median `step` suits two units.
    #[error("the time unit of column `{column}` is not known; it grows by `{step}` a row")]
    UnclearTimeUnit { column: String, step: f64 },
    /// The point or comma in `number` may be a decimal mark or separate thousands.
    #[error("column `{column}`: the mark in `{number}` is decimal or between thousands")]
    UnclearMark { column: String, number: String },
    #[error("column `{column}`: the date `{date}` begins with its day or with its month")]
    UnclearDate { column: String, date: String },
    /// Two columns, given by their positions from 0, have the same meaning.
    #[error(
        "columns {} (`{}`) and {} (`{}`) are both {meaning}",
        columns[0] + 1, names[0], columns[1] + 1, names[1]
    )]
    DuplicateColumn { meaning: String, columns: [usize; 2], names: Box<[String; 2]> },
    #[error(transparent)]
    Row(#[from] RowProblem),
}

impl Hint for LogError {
    fn hint(&self) -> Option<String> {
        let text = match self {
            Self::Foreign { remedy, .. } => remedy,
            Self::NoParts { .. } => "leave out `--table`",
            Self::Table { problem: TableError::Choice { .. }, .. } => "choose with `--table NAME`",
            Self::Table { problem: TableError::Damaged { .. }, .. } => {
                "copy the file again, or write it again: it is cut short or damaged"
            }
            Self::Table {
                problem: TableError::Unsupported { kind: FileKind::Sqlite, .. }, ..
            } => {
                "export the table of a log: `sqlite3 -header -csv FILE 'SELECT * FROM TABLE' > log.csv`"
            }
            Self::Table { .. } => "write it again without that, or export it as CSV",
            Self::Unpacking { .. } => "copy the file again: it is cut short or damaged",
            Self::Empty(_) | Self::NoRows(_) => {
                "nothing was recorded, or the file was not copied to its end"
            }
            Self::ManyBadRows { .. } => {
                "look at that row; leave all such rows out with `--skip-bad-rows=all`"
            }
            Self::NoneChosen { column, found, .. } => {
                let values = few(found);
                return Some(format!(
                    "leave out a `--where` or `--exclude-group`; `{column}` has {values}"
                ));
            }
            Self::NoneExcluded { found, .. } => {
                return Some(format!("leave out one of its values: {}", few(found)));
            }
            Self::Binary { .. } => {
                "logs are text (also gzip, zstd) or tables in Parquet, MATLAB, NumPy, Excel, MCAP"
            }
            Self::NoColumnNames(_) => {
                "add the line that names the columns, `% time | … | S1 | …`, as the last `%` line"
            }
            Self::RowMismatch { problem: RowMismatch::Times { .. }, .. } => {
                "put both on one clock with `shellcal align`, or say whose time counts with `--time`"
            }
            Self::At { problem, .. } => return problem.hint(),
            _ => return None,
        };
        Some(text.to_owned())
    }
}

impl Hint for PlacedProblem {
    fn hint(&self) -> Option<String> {
        if let Self::MissingColumns { missing, found } = self
            && let Some(text) = nearest_columns(missing, found)
        {
            return Some(text);
        }
        let text = match self {
            Self::LineTooLong(_) => "this does not look like a log; are its line ends missing?",
            Self::CarriageReturns => {
                "give its lines the ends that others have: `tr '\\r' '\\n' < OLD > NEW`"
            }
            Self::UnknownLayout { columns, time } => return Some(by_number(*columns, *time)),
            Self::NoTable => {
                "say which line names the columns with `--header-line N`, or how many to pass with `--skip-lines N`"
            }
            Self::LayoutMismatch { .. } => "leave out `--format` to have it recognised",
            Self::MissingColumns { .. } => {
                "name the columns with `--sensors`, `--wrench`, `--time` or `--group`"
            }
            Self::LeftOutColumn { .. } => "save it as a vector or a matrix of real numbers",
            Self::UnknownUnit { column, quantity, .. } => {
                let understood = quantity.understood();
                return Some(match quantity {
                    Quantity::Force | Quantity::Moment | Quantity::Time => {
                        format!("say it with `--unit '{column}=UNIT'`: {understood}")
                    }
                    _ => format!(
                        "say it in the robot's profile, under `[columns]`: {understood}, or counts"
                    ),
                });
            }
            Self::OtherUnit { .. } => {
                "correct the unit in the profile, under `[columns]`, or in the log"
            }
            Self::UnclearTimeUnit { .. } => {
                "say it with `--time-unit` (days: `--unit time=d`), or in the name of the column (`t_ms`)"
            }
            Self::UnitOfSome { unit, is_moment, columns } => {
                let kind = if *is_moment { "moment" } else { "force" };
                let other = if *is_moment { "N·m" } else { "N" };
                return Some(format!(
                    "say the unit of all with `--unit {kind}={unit}`, or `--unit '{}={other}'`",
                    columns[0]
                ));
            }
            Self::UnclearMark { .. } => {
                "write the log again without marks between thousands; no other number tells"
            }
            Self::UnclearDate { .. } => {
                "say it with `--unit time=d/m/y` or `--unit time=m/d/y`; the times of a day \
                 are the same with both"
            }
            Self::DuplicateColumn { meaning, columns: [first, second], .. }
                if meaning == "time" =>
            {
                let [first, second] = [first, second].map(|at| format!("`--time {}`", at + 1));
                return Some(format!("say which is meant by its number: {first} or {second}"));
            }
            Self::DuplicateColumn { meaning, columns: [first, second], .. }
                if Axis::ALL.iter().any(|axis| axis.name() == meaning) && second - first < 6 =>
            {
                let axis = meaning.to_ascii_lowercase();
                let [first, second] = [first, second].map(|at| at + 1);
                return Some(format!(
                    "say each axis by the number of its column: `--wrench {axis}={first},…` or \
                     `{axis}={second},…`"
                ));
            }
            Self::DuplicateColumn { meaning, columns, .. } if meaning == "Fx" => {
                let six = columns.map(|at| format!("`--wrench {}-{}`", at + 1, at + 6));
                return Some(format!("say which are meant by their numbers: {}", six.join(" or ")));
            }
            Self::DuplicateColumn { .. } => {
                "say which one is meant with `--sensors`, `--wrench` or `--time`, by its number"
            }
            Self::Row(RowProblem::OtherNames(_)) => {
                "split the file above this line, and read both parts as two logs"
            }
            Self::Row(_) => "correct the line, or leave such rows out with `--skip-bad-rows`",
        };
        Some(text.to_owned())
    }
}

/// Lists the first of some values.
fn few(values: &[String]) -> String {
    const MOST: usize = 4;
    let listed = quoted(values.iter().take(MOST), ", ");
    match values.len() {
        0 => "no values".to_owned(),
        count if count > MOST => format!("{listed}, …"),
        _ => listed,
    }
}

fn by_number(columns: usize, time: Option<usize>) -> String {
    if time.is_none() && columns > 6 {
        let (last, wrench) = (columns - 6, columns - 5);
        return format!(
            "say which columns are which: `--sensors 1-{last} --wrench {wrench}-{columns}` or \
             `--sensors 1-{columns}`; none looks like a time"
        );
    }
    let time = time.unwrap_or(1);
    let (first, wrench) = (time + 1, columns.saturating_sub(5));
    let readings = format!("`--time {time} --sensors {first}-{columns}`");
    match columns {
        6 => "say what the columns are: `--wrench 1-6`, or `--sensors 1-6`".to_owned(),
        _ if columns <= first => {
            "say which columns are which: `--sensors`, `--wrench`, `--time`".to_owned()
        }
        _ if wrench < first => format!("say which columns are which: {readings}"),
        _ if wrench > first + 1 => format!(
            "say which columns are which: {readings}, `--time {time} --wrench {wrench}-{columns}`, or \
             `--time {time} --sensors {first}-{} --wrench {wrench}-{columns}`",
            wrench - 1
        ),
        _ => format!(
            "say which columns are which: {readings}, or `--time {time} --wrench {wrench}-{columns}`"
        ),
    }
}

fn nearest_columns(missing: &[String], found: &[String]) -> Option<String> {
    if let Some(name) = missing.iter().find(|name| found.contains(name)) {
        return Some(format!(
            "`{name}` is there, but was said to be something else: check `--sensors`, `--wrench` and `--time`"
        ));
    }
    // A column given by position is not similar to any name.
    let is_position = |name: &str| {
        name.strip_prefix("column ").is_some_and(|position| position.parse::<usize>().is_ok())
    };
    let nearest = |name: &String| {
        let like = suggest(name, found.iter().map(String::as_str))?;
        Some(format!("`{like}` for `{name}`"))
    };
    let missing = missing.iter().filter(|name| !is_position(name));
    let nearest: Vec<String> = missing.filter_map(nearest).collect();
    (!nearest.is_empty()).then(|| format!("did you mean {}?", nearest.join(", ")))
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LogPosition {
    /// A line of text, from 1.
    Line(u64),
    /// A row of a table, from 1.
    Row(u64),
    Names,
}

impl LogPosition {
    pub fn number(self) -> Option<u64> {
        match self {
            Self::Line(number) | Self::Row(number) => Some(number),
            Self::Names => None,
        }
    }
}

impl fmt::Display for LogPosition {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Line(line) => write!(f, "line {line}"),
            Self::Row(row) => write!(f, "row {row}"),
            Self::Names => f.write_str("its columns"),
        }
    }
}

#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RowProblem {
    /// A field does not suit its column, which is given by its position from 0.
    #[error("column {} (`{name}`): expected {problem}, found {}", column + 1, match problem {
        FieldProblem::Empty => "nothing".to_owned(),
        _ => format!("`{found}`"),
    })]
    Field { column: usize, name: String, problem: FieldProblem, found: String },
    #[error("expected {expected} columns, found {found}")]
    ColumnCount { expected: usize, found: usize },
    /// A line in the middle of a log names other columns than its head.
    #[error("the names of other columns than in line {0}: two logs were put together")]
    OtherNames(u64),
    #[error("expected a closing quote on the same line")]
    OpenQuote,
    /// A payload begins like a scan, but cannot be decoded.
    #[error("expected a scan of {SCAN_LEN} bytes (0 to 255) with readings below 4096, found `{0}`")]
    Payload(String),
}

impl RowProblem {
    /// Returns a feature that rows with this problem have in common, in words.
    pub(crate) fn class(&self) -> String {
        match self {
            Self::Field { name, .. } => format!("in column `{name}`"),
            Self::ColumnCount { found, .. } => format!("with {found} columns"),
            Self::OtherNames(_) => "with other names".to_owned(),
            Self::OpenQuote => "with an open quote".to_owned(),
            Self::Payload(_) => "with a damaged scan".to_owned(),
        }
    }
}
