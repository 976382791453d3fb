//! What the user specifies about a log that cannot be recognised.

use shell_data::ColumnNames;
use shell_data::wrench::{Axis, PerAxis};
pub use shell_data::{MomentUnit, TimeUnit};
use std::fmt;

/// The kinds of log that can be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LogFormat {
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

impl fmt::Display for LogFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            LogFormat::Telemetry => "robot telemetry",
            LogFormat::Csv => "CSV with a header",
            LogFormat::Training => "training CSV without a header",
            LogFormat::Reference => "reference sensor CSV",
            LogFormat::Console => "base-station console log",
        })
    }
}

/// A column as a user points to it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ColumnRef {
    /// By its name in the header.
    Name(String),
    /// By its position in the row; the first column is 1.
    Position(usize),
}

impl ColumnRef {
    /// The first `count` columns of a matrix in a MATLAB or HDF5 file.
    pub fn columns_of_matrix(name: &str, count: usize) -> Vec<Self> {
        (1..=count).map(|column| Self::Name(format!("{name}{column}"))).collect()
    }
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
    pub format: Option<LogFormat>,
    /// The sensor columns, in channel order.
    pub sensors: Option<Vec<ColumnRef>>,
    /// The wrench columns, of the axes that there are, in the order Fx … Mz.
    pub wrench: Option<PerAxis<Option<ColumnRef>>>,
    /// The time column.
    pub time: Option<ColumnRef>,
    /// The unit of the time column, whatever its name says.
    pub time_unit: Option<TimeUnit>,
    /// The column that names the group (pose, session, trial) of a row.
    pub group: Option<ColumnRef>,
    /// The unit of the moment columns, whatever their names say.
    pub moment_unit: Option<MomentUnit>,
    /// What is taken where nothing is specified above, if the log has such columns.
    pub usual: Option<ColumnNames>,
}

/// An axis and what is said of its column, in `fx=a`.
pub fn named_axis(item: &str) -> Option<(Axis, &str)> {
    let (name, column) = item.split_once('=')?;
    let axis = Axis::ALL.into_iter().find(|axis| axis.name().eq_ignore_ascii_case(name.trim()))?;
    Some((axis, column))
}

impl Mapping {
    /// What is specified for a log with columns of these names, the usual included. A unit belongs to its
    /// columns, and is taken with them only.
    pub(crate) fn for_columns(&self, names: &[String]) -> Self {
        let mut mapping = self.clone();
        let Some(usual) = mapping.usual.take() else { return mapping };
        let has = |column: &String| names.contains(column);
        let name = |column: String| ColumnRef::Name(column);
        if mapping.sensors.is_none()
            && let Some(sensors) = usual.sensors.filter(|all| all.iter().all(has))
        {
            mapping.sensors = Some(sensors.into_iter().map(name).collect());
        }
        if mapping.wrench.is_none()
            && let Some(wrench) = usual.wrench.filter(|all| all.iter().flatten().all(has))
        {
            mapping.wrench = Some(wrench.map(|column| column.map(name)));
            mapping.moment_unit = mapping.moment_unit.or(usual.moment_unit);
        }
        if mapping.time.is_none()
            && let Some(time) = usual.time.filter(has)
        {
            mapping.time = Some(name(time));
            mapping.time_unit = mapping.time_unit.or(usual.time_unit);
        }
        mapping.group = mapping.group.or_else(|| usual.group.filter(has).map(name));
        mapping
    }
}
