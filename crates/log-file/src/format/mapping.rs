//! The user's specification of log properties that cannot be recognised.

use super::choice::RowCondition;
pub use super::column_name::{ColumnRef, parse_column};
use crate::parse::date::DateOrder;
use shell_data::ColumnNames;
use shell_data::unit::{Quantity, Unit};
use shell_data::wrench::{Axis, PerAxis};
pub use shell_data::{MomentUnit, TimeUnit};
use std::fmt;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LogFormat {
    /// Robot telemetry of the lab: `%` header lines; the last one names the columns.
    Telemetry,
    Csv,
    /// Training file of the lab, without a header: time, eight sensors, six wrench columns.
    ///
    /// Moments are in N·m unless [`Mapping::moment_unit`] says otherwise. In the lab's recording, they vary by 0.04 and
    /// the forces by 0.16 N: a lever of a quarter of a metre if the unit is N·m, but of a quarter of a millimetre if it
    /// is mN·m. The lab's later matrices yield mN·m: numbers some 150 times as large.
    Training,
    /// File of the reference sensor: two ignored columns, time, six wrench columns, three accelerations.
    Reference,
    /// Console log of the lab's base station, with payloads received from the original SkinProc board.
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

#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mapping {
    /// The matrix, sheet or topic to read, if the file can contain several.
    pub table: Option<String>,
    pub format: Option<LogFormat>,
    /// The line, from 1, that names the columns.
    pub header_line: Option<u64>,
    /// Number of lines to ignore at the start of a text.
    pub skip_lines: Option<u64>,
    pub sensors: Option<Vec<ColumnRef>>,
    /// The wrench columns, in the order Fx … Mz; `None` for an axis that the log lacks.
    pub wrench: Option<PerAxis<Option<ColumnRef>>>,
    pub time: Option<ColumnRef>,
    /// Unit of the time column, which overrides the name.
    pub time_unit: Option<TimeUnit>,
    /// The column with the group (pose, session, trial) of each row.
    pub group: Option<ColumnRef>,
    /// Unit of the moment columns, which overrides the names.
    pub moment_unit: Option<MomentUnit>,
    /// Units by axis, by `force`, `moment` or `time`, or by column name; they override the log.
    pub units: Vec<(String, String)>,
    /// Units for columns without a unit from the log or the user.
    pub usual_units: Vec<(String, String)>,
    pub rows: Vec<RowCondition>,
    pub excluded_groups: Vec<String>,
    /// Default columns, used if the log has them and the fields above specify no columns.
    pub usual: Option<ColumnNames>,
}

pub const FORMATS: [(&str, &str, LogFormat); 5] = [
    ("telemetry", "Robot telemetry with `%` header lines", LogFormat::Telemetry),
    ("csv", "Separated values, names in the first line", LogFormat::Csv),
    ("training", "No header: time, eight sensors, six wrench columns", LogFormat::Training),
    (
        "reference",
        "Reference sensor: two columns to drop, time, six wrench columns, three accelerations",
        LogFormat::Reference,
    ),
    ("console", "Base-station console with received payloads", LogFormat::Console),
];

pub const TIME_UNITS: [(&str, &str, TimeUnit); 4] = [
    ("s", "", TimeUnit::Second),
    ("ms", "", TimeUnit::Millisecond),
    ("us", "", TimeUnit::Microsecond),
    ("ns", "", TimeUnit::Nanosecond),
];

/// The largest position in a range, so that a typing error does not request 10⁹ columns.
const MAX_POSITION: usize = 4096;

/// Parses names and positions separated by commas; `2-9` stands for the positions 2 to 9.
///
/// # Errors
/// Errors of [`parse_column`], and an error for a range that is empty or goes beyond position 4096.
pub fn parse_columns(text: &str) -> Result<Vec<ColumnRef>, String> {
    let mut columns = Vec::new();
    for item in text.split(',') {
        let ends = item.split_once('-').map(|(a, b)| (a.trim().parse(), b.trim().parse()));
        match ends {
            Some((Ok(first), Ok(last))) => {
                if !(1..=last).contains(&first) || last > MAX_POSITION {
                    return Err(format!(
                        "`{item}` is not a range of positions from 1 to {MAX_POSITION}"
                    ));
                }
                columns.extend((first..=last).map(ColumnRef::Position));
            }
            _ => columns.push(parse_column(item)?),
        }
    }
    Ok(columns)
}

/// Parses six columns, the name of a matrix with six columns, or columns by axis: `fx=a,fz=b`.
///
/// # Errors
/// Errors of [`parse_columns`], a number of columns other than six, and an unknown or repeated axis.
pub fn parse_wrench(text: &str) -> Result<PerAxis<Option<ColumnRef>>, String> {
    let items: Vec<&str> = text.split(',').collect();
    if !items.iter().any(|item| named_axis(item).is_some()) {
        let columns = parse_columns(text)?;
        let found = columns.len();
        let columns = match columns.as_slice() {
            [ColumnRef::Name(matrix)] => {
                (1..=6).map(|column| ColumnRef::Name(format!("{matrix}{column}"))).collect()
            }
            _ => columns,
        };
        let six = columns.into_iter().map(Some).collect::<Vec<_>>().try_into();
        return six.map_err(|_| {
            format!("{found} columns, expected all six (Fx to Mz), or their axes: `fx=a,fz=b`")
        });
    }
    let mut columns: PerAxis<Option<ColumnRef>> = PerAxis::default();
    for item in &items {
        let (axis, column) =
            named_axis(item).ok_or_else(|| format!("`{item}`: expected an axis, as in `fx=a`"))?;
        if columns[axis.index()].replace(parse_column(column)?).is_some() {
            return Err(format!("`{}` has two columns", axis.name()));
        }
    }
    Ok(columns)
}

const TELEMETRY: [Quantity; 5] =
    [Quantity::Angle, Quantity::Share, Quantity::Voltage, Quantity::Current, Quantity::Power];

/// Parses units of columns: `fx=lbf`, `force=kN,moment=N·mm`, `time=min`.
///
/// # Errors
/// A message about the unit or its key.
pub fn parse_units(text: &str) -> Result<Vec<(String, String)>, String> {
    let unit = |item: &str| {
        let (of, unit) = item
            .rsplit_once('=')
            .ok_or_else(|| format!("`{item}`: expected a column and its unit, as in `fx=lbf`"))?;
        let (of, unit) = (of.trim(), unit.trim());
        let axis = Axis::ALL.into_iter().find(|axis| axis.name().eq_ignore_ascii_case(of));
        let quantities = match (of.to_ascii_lowercase().as_str(), axis) {
            ("force", _) => vec![Quantity::Force],
            ("moment", _) => vec![Quantity::Moment],
            ("time", _) => vec![Quantity::Time],
            (_, Some(axis)) => vec![Quantity::of_axis(axis)],
            _ => vec![Quantity::Force, Quantity::Moment, Quantity::Time],
        };
        let is_order = || quantities == [Quantity::Time] && DateOrder::from_option(unit).is_some();
        let is_unit = |&quantity: &Quantity| Unit::parse(unit, quantity).is_some();
        match quantities.iter().any(is_unit) || is_order() {
            true => Ok((of.to_owned(), unit.to_owned())),
            false if TELEMETRY.iter().any(is_unit) => Err(format!(
                "`{unit}` is no unit of `{of}`; those of telemetry are in the robot's profile (`--profile`), such as \
                 `battery = {{ unit = \"mV\" }}` under `[columns]`"
            )),
            false => {
                let understood: Vec<_> = quantities.iter().map(|it| it.understood()).collect();
                Err(format!("`{unit}` is no unit of `{of}`; understood: {}", understood.join(", ")))
            }
        }
    };
    text.split(',').map(unit).collect()
}

/// Returns the order of day and month that the units of the time state.
fn date_order(units: &[(String, String)]) -> Option<DateOrder> {
    let orders = units.iter().rev().filter(|(of, _)| of.eq_ignore_ascii_case("time"));
    orders.filter_map(|(_, unit)| DateOrder::from_option(unit)).next()
}

fn named_axis(item: &str) -> Option<(Axis, &str)> {
    let (name, column) = item.split_once('=')?;
    let axis = Axis::ALL.into_iter().find(|axis| axis.name().eq_ignore_ascii_case(name.trim()))?;
    Some((axis, column))
}

impl Mapping {
    pub(crate) fn names_columns(&self) -> bool {
        let wrench = self.wrench.iter().flatten().flatten();
        let columns = self.sensors.iter().flatten().chain(wrench).chain(&self.time);
        columns.chain(&self.group).any(|column| matches!(column, ColumnRef::Name(_)))
    }

    /// Returns the user's order of day and month in dates, or the usual one.
    pub(crate) fn date_order(&self) -> Option<DateOrder> {
        date_order(&self.units).or_else(|| date_order(&self.usual_units))
    }

    /// Returns the specification for a log with these column names, with the usual columns filled in. A usual unit is
    /// used only together with its usual columns.
    pub(crate) fn for_columns(&self, names: &[String]) -> Self {
        let mut mapping = self.clone();
        let Some(usual) = mapping.usual.take() else { return mapping };
        let has = |column: &String| names.contains(column);
        mapping.usual_units = usual.units;
        mapping.sensors = mapping.sensors.or_else(|| {
            let sensors = usual.sensors.filter(|all| all.iter().all(has))?;
            Some(sensors.into_iter().map(ColumnRef::Name).collect())
        });
        if mapping.wrench.is_none()
            && let Some(wrench) = usual.wrench.filter(|all| all.iter().flatten().all(has))
        {
            mapping.wrench = Some(wrench.map(|column| column.map(ColumnRef::Name)));
            mapping.moment_unit = mapping.moment_unit.or(usual.moment_unit);
        }
        if mapping.time.is_none()
            && let Some(time) = usual.time.filter(has)
        {
            mapping.time = Some(ColumnRef::Name(time));
            mapping.time_unit = mapping.time_unit.or(usual.time_unit);
        }
        mapping.group = mapping.group.or_else(|| usual.group.filter(has).map(ColumnRef::Name));
        mapping
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_names_places_and_ranges() {
        let columns = parse_columns("a,3, s-1 ,5-7").unwrap();
        let name = |name: &str| ColumnRef::Name(name.to_owned());
        let position = ColumnRef::Position;
        assert_eq!(
            columns,
            [name("a"), position(3), name("s-1"), position(5), position(6), position(7)]
        );
    }

    #[test]
    fn impossible_places_are_refused() {
        for text in ["0", "", "a,,b", "0-3", "5-2", "1-1000000000"] {
            assert!(parse_columns(text).is_err(), "{text}");
        }
    }

    #[test]
    fn a_wrench_has_six_columns_or_names_its_axes() {
        assert!(parse_wrench("1-5").unwrap_err().contains("5 columns, expected all six"));
        let six = parse_wrench("1-6").unwrap();
        assert_eq!(six[5], Some(ColumnRef::Position(6)));
        let six = parse_wrench("ft").unwrap();
        assert_eq!(six[5], Some(ColumnRef::Name("ft6".to_owned())));
        let two = parse_wrench("Fz=up, fx=3").unwrap();
        let name = ColumnRef::Name("up".to_owned());
        assert_eq!(two, [Some(ColumnRef::Position(3)), None, Some(name), None, None, None]);
        assert!(parse_wrench("fx=a,b").unwrap_err().contains("`b`: expected an axis"));
        assert!(parse_wrench("fx=a,FX=b").unwrap_err().contains("`Fx` has two columns"));
        assert!(parse_wrench("fx=").is_err());
        // A key that is not an axis is part of a name.
        assert!(parse_wrench("a=1,b,c,d,e,f").is_ok());
    }
}
