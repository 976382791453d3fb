//! The flags of every command that reads logs: what their columns are, and how they are read.

use calibration_file::CalibrationFile;
use clap::ValueEnum;
use log_file::{ColumnRef, Log, LogFormat, Mapping, MomentUnit, ReadOptions, TimeUnit, named_axis};
use shell_data::ColumnNames;
use shell_data::wrench::{Axis, PerAxis};

use super::choices::one_of;
use crate::files::InputPath;
use crate::printer::Printer;

/// What the columns of a log are, where their names do not say.
#[derive(Clone, Debug, Default, clap::Args)]
#[command(next_help_heading = "Reading logs")]
pub(crate) struct MappingArgs {
    /// What kind of file the logs are [default: recognised]
    #[arg(long, value_name = "FORMAT", value_parser = one_of(&FORMATS))]
    pub(crate) format: Option<LogFormat>,

    /// Which matrix of a MATLAB or HDF5 file, sheet of a workbook or topic of a recording to read
    /// [default: the longest matrices, the first sheet, all topics]
    #[arg(long, value_name = "NAME")]
    pub(crate) table: Option<String>,

    /// Sensor columns in channel order: names or positions, `a,b,c` or `2-9`, or the name of a matrix
    #[arg(long, value_name = "COLUMNS", value_parser = parse_columns)]
    pub(crate) sensors: Option<ColumnList>,

    /// The wrench columns: names or positions of all six in the order Fx to Mz, or of some, `fx=a,fz=b`, or
    /// the name of a matrix
    #[arg(long, value_name = "COLUMNS", value_parser = parse_wrench)]
    pub(crate) wrench: Option<WrenchColumns>,

    /// The time column: its name or position
    #[arg(long, value_name = "COLUMN", value_parser = parse_column)]
    pub(crate) time: Option<ColumnRef>,

    /// The unit of the time column, whatever its name says
    #[arg(long, value_name = "UNIT", value_parser = one_of(&TIME_UNITS))]
    pub(crate) time_unit: Option<TimeUnit>,

    /// The column that names a row's group (pose, session, trial): its name or position
    #[arg(long, value_name = "COLUMN", value_parser = parse_column)]
    pub(crate) group: Option<ColumnRef>,

    /// The unit of the moment columns, whatever their names say
    #[arg(long, value_name = "UNIT")]
    pub(crate) moment_unit: Option<MomentUnitArg>,

    /// Leave out rows that are wrong, and say how many
    #[arg(long)]
    pub(crate) skip_bad_rows: bool,

    /// How many threads to use [default: one per core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub(crate) threads: Option<u16>,
}

impl MappingArgs {
    /// What the user says about the columns.
    pub(crate) fn mapping(&self) -> Mapping {
        Mapping {
            table: self.table.clone(),
            format: self.format,
            sensors: self.sensors.clone().map(|ColumnList(columns)| columns),
            wrench: self.wrench.clone().map(|WrenchColumns(columns)| columns),
            time: self.time.clone(),
            time_unit: self.time_unit,
            group: self.group.clone(),
            moment_unit: self.moment_unit.map(MomentUnit::from),
            usual: None,
        }
    }

    /// What the user says about the columns of logs that a calibration is for.
    pub(crate) fn mapping_for(&self, calibration: &CalibrationFile) -> Mapping {
        Mapping { usual: calibration.origin.columns.clone(), ..self.mapping() }
    }

    /// The columns of training logs that the user names, if any.
    pub(crate) fn specified(&self, train: &[Log]) -> Option<ColumnNames> {
        let mapping = self.mapping();
        let names = train.first().map(|log| log.specified(&mapping));
        names.filter(|names| !names.is_empty())
    }

    /// How to read.
    pub(crate) fn read_options(&self) -> ReadOptions<'static> {
        ReadOptions {
            threads: self.threads.map_or(0, usize::from),
            skip_bad_rows: self.skip_bad_rows,
            ..ReadOptions::default()
        }
    }
}

/// Says which columns of logs are those that a calibration remembers.
pub(crate) fn tell_remembered(
    printer: &mut Printer,
    calibration: &InputPath,
    mapping: &Mapping,
    logs: &[Log],
) {
    for log in logs {
        let taken = log.usual_columns(mapping);
        if !taken.is_empty() {
            let (taken, from) = (taken.join(", "), calibration.display());
            printer.detail(format!("`{}`: {taken} as `{from}` remembers", log.path().display()));
        }
    }
}

/// Opens logs, each with the file of its wrench where `option` names such files.
pub(crate) fn open_logs(
    logs: &[InputPath],
    (option, wrenches): (&str, &[InputPath]),
    mapping: &Mapping,
) -> anyhow::Result<Vec<Log>> {
    if wrenches.is_empty() {
        return Ok(logs.iter().map(|log| Log::open(log, mapping)).collect::<Result<_, _>>()?);
    }
    anyhow::ensure!(
        wrenches.len() == logs.len(),
        "`{option}` names {} files for {} logs, expected one for each, in their order",
        wrenches.len(),
        logs.len()
    );
    let open =
        |(log, wrench): (&InputPath, &InputPath)| Log::open_with_companion(log, wrench, mapping);
    Ok(logs.iter().zip(wrenches).map(open).collect::<Result<_, _>>()?)
}

/// The columns of the wrench, by axis.
#[derive(Clone, Debug)]
pub(crate) struct WrenchColumns(PerAxis<Option<ColumnRef>>);

/// A list of columns.
#[derive(Clone, Debug)]
pub(crate) struct ColumnList(Vec<ColumnRef>);

impl ColumnList {
    /// The columns.
    pub(crate) fn references(&self) -> &[ColumnRef] {
        &self.0
    }

    /// Whether the list is this word alone.
    pub(crate) fn is_word(&self, word: &str) -> bool {
        matches!(self.0.as_slice(), [ColumnRef::Name(name)] if name == word)
    }
}

/// Kinds of log.
pub(crate) const FORMATS: [(&str, &str, LogFormat); 5] = [
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

/// Units of time.
pub(crate) const TIME_UNITS: [(&str, &str, TimeUnit); 4] = [
    ("s", "", TimeUnit::Second),
    ("ms", "", TimeUnit::Millisecond),
    ("us", "", TimeUnit::Microsecond),
    ("ns", "", TimeUnit::Nanosecond),
];

#[derive(Clone, Copy, Debug, ValueEnum)]
pub(crate) enum MomentUnitArg {
    /// N·m
    #[value(name = "N·m", aliases = ["nm", "Nm", "N.m"])]
    NewtonMetre,
    /// mN·m, the same as N·mm
    #[value(name = "mN·m", aliases = ["mnm", "mNm", "mN.m", "N·mm", "Nmm", "nmm", "N.mm"])]
    MillinewtonMetre,
}

impl From<MomentUnitArg> for MomentUnit {
    fn from(unit: MomentUnitArg) -> Self {
        match unit {
            MomentUnitArg::NewtonMetre => MomentUnit::NewtonMetre,
            MomentUnitArg::MillinewtonMetre => MomentUnit::MillinewtonMetre,
        }
    }
}

/// A number is a position, anything else a name.
pub(crate) fn parse_column(text: &str) -> Result<ColumnRef, String> {
    match (text.trim(), text.trim().parse()) {
        ("", _) => Err("expected the name or position of a column".to_owned()),
        (_, Ok(0)) => Err("the first column is 1".to_owned()),
        (_, Ok(position)) => Ok(ColumnRef::Position(position)),
        (name, Err(_)) => Ok(ColumnRef::Name(name.to_owned())),
    }
}

/// Names and positions separated by commas; `2-9` is the positions 2 to 9.
pub(crate) fn parse_columns(text: &str) -> Result<ColumnList, String> {
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
    Ok(ColumnList(columns))
}

/// Six columns, the name of a matrix of six, or `fx=a,fz=b`: columns of axes that are named.
pub(crate) fn parse_wrench(text: &str) -> Result<WrenchColumns, String> {
    let items: Vec<&str> = text.split(',').collect();
    let named: Vec<(Axis, &str)> = items.iter().filter_map(|item| named_axis(item)).collect();
    if named.is_empty() {
        let ColumnList(columns) = parse_columns(text)?;
        let found = columns.len();
        let columns = match columns.as_slice() {
            [ColumnRef::Name(matrix)] => ColumnRef::columns_of_matrix(matrix, 6),
            _ => columns,
        };
        let six = columns.into_iter().map(Some).collect::<Vec<_>>().try_into();
        return six.map(WrenchColumns).map_err(|_| {
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
    Ok(WrenchColumns(columns))
}

/// Keeps a slip of the finger from asking for 10⁹ columns.
const MAX_POSITION: usize = 4096;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_names_places_and_ranges() {
        let ColumnList(columns) = parse_columns("a,3, s-1 ,5-7").unwrap();
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
        let WrenchColumns(six) = parse_wrench("1-6").unwrap();
        assert_eq!(six[5], Some(ColumnRef::Position(6)));
        let WrenchColumns(six) = parse_wrench("ft").unwrap();
        assert_eq!(six[5], Some(ColumnRef::Name("ft6".to_owned())));
        let WrenchColumns(two) = parse_wrench("Fz=up, fx=3").unwrap();
        let name = ColumnRef::Name("up".to_owned());
        assert_eq!(two, [Some(ColumnRef::Position(3)), None, Some(name), None, None, None]);
        assert!(parse_wrench("fx=a,b").unwrap_err().contains("`b`: expected an axis"));
        assert!(parse_wrench("fx=a,FX=b").unwrap_err().contains("`Fx` has two columns"));
        assert!(parse_wrench("fx=").is_err());
        // What only looks like an axis is a name as any other.
        assert!(parse_wrench("a=1,b,c,d,e,f").is_ok());
    }
}
