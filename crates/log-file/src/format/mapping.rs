//! What the user specifies about a log that cannot be recognised.

pub use shell_data::MomentUnit;
use std::fmt;

/// The kinds of log that can be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// The lab's robot telemetry: `%` header lines, the last of which names the columns.
    Telemetry,
    /// Separated values with a header line.
    Csv,
    /// The lab's training file, without a header: time, eight sensors, six wrench columns.
    ///
    /// Moments are taken as N·m unless [`Mapping::moment_unit`] says otherwise. In the lab's own
    /// recording they vary by 0.04 where forces vary by 0.16 N: a lever of a quarter of a metre in
    /// N·m, of a quarter of a millimetre in mN·m. The matrices that the lab fitted later give
    /// moments in mN·m, which are some 150 times these figures, not about the same.
    Training,
    /// The reference sensor's file: two columns to drop, time, six wrench columns, three
    /// accelerations.
    Reference,
    /// The console of the lab's base station, with the payloads received from the original
    /// SkinProc board.
    Console,
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Format::Telemetry => "robot telemetry",
            Format::Csv => "CSV with a header",
            Format::Training => "training CSV without a header",
            Format::Reference => "reference sensor CSV",
            Format::Console => "base-station console log",
        })
    }
}

/// The unit of a time column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TimeUnit {
    /// s
    Second,
    /// ms
    Millisecond,
    /// µs
    Microsecond,
    /// ns
    Nanosecond,
}

impl TimeUnit {
    /// How many of this unit make a second.
    pub const fn per_second(self) -> f64 {
        match self {
            TimeUnit::Second => 1.0,
            TimeUnit::Millisecond => 1e3,
            TimeUnit::Microsecond => 1e6,
            TimeUnit::Nanosecond => 1e9,
        }
    }

    /// The symbol of the unit.
    pub const fn symbol(self) -> &'static str {
        match self {
            TimeUnit::Second => "s",
            TimeUnit::Millisecond => "ms",
            TimeUnit::Microsecond => "µs",
            TimeUnit::Nanosecond => "ns",
        }
    }
}

/// A column as a user points to it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ColumnRef {
    /// By its name in the header.
    Name(String),
    /// By its place in the row; the first column is 1.
    Position(usize),
}

impl fmt::Display for ColumnRef {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            ColumnRef::Name(name) => f.write_str(name),
            ColumnRef::Position(position) => write!(f, "column {position}"),
        }
    }
}

/// What the user specifies about a log; what is `None` is recognised from the file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mapping {
    /// The matrix, sheet or topic to read of a file that can hold several.
    pub table: Option<String>,
    /// The format of the file.
    pub format: Option<Format>,
    /// The sensor columns, in channel order.
    pub sensors: Option<Vec<ColumnRef>>,
    /// The six wrench columns, in the order Fx … Mz.
    pub wrench: Option<[ColumnRef; 6]>,
    /// The time column.
    pub time: Option<ColumnRef>,
    /// The unit of the time column, whatever its name says.
    pub time_unit: Option<TimeUnit>,
    /// The column that names the group (pose, session, trial) of a row.
    pub group: Option<ColumnRef>,
    /// The unit of the moment columns, whatever their names say.
    pub moment_unit: Option<MomentUnit>,
}
