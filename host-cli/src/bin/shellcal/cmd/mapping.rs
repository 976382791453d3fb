//! Options of every command that reads logs or calibrations: the columns of logs, how they are read, and the
//! verification of checksums.

use std::io::BufRead;
use std::path::Path;

use calibration_file::{CalibrationFile, CalibrationFileError, PartialFit, PartialStream};
use log_file::{
    ColumnRef, FORMATS, Log, LogFormat, Mapping, MomentUnit, ReadOptions, RowCondition, TIME_UNITS,
    TimeUnit, parse_column, parse_columns, parse_condition, parse_units, parse_wrench,
};
use shell_data::ColumnNames;
use shell_data::wrench::PerAxis;

use super::choices::one_of;
use crate::files::InputPath;
use crate::printer::Printer;

/// Meanings of the columns of a log, if their names do not tell.
#[derive(Clone, Debug, Default, clap::Args)]
#[command(next_help_heading = "Reading logs")]
pub(crate) struct MappingArgs {
    /// Format of the log files [default: detected]
    #[arg(long, value_name = "FORMAT", value_parser = one_of(&FORMATS))]
    pub(crate) format: Option<LogFormat>,

    /// Matrix of a MATLAB or HDF5 file, sheet of a workbook or topic of a recording to read [default: the
    /// longest matrices, the first sheet, all topics]
    #[arg(long, value_name = "NAME")]
    pub(crate) table: Option<String>,

    /// Number of the text line that names the columns [default: detected]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub(crate) header_line: Option<u64>,

    /// Skip this many lines at the start of a text [default: detected]
    #[arg(long, value_name = "N")]
    pub(crate) skip_lines: Option<u64>,

    /// Sensor columns in channel order: names or positions, `a,b,c` or `2-9`, or the name of a matrix
    #[arg(long, value_name = "COLUMNS", value_parser = parse_columns)]
    pub(crate) sensors: Option<ColumnList>,

    /// Wrench columns: names or positions of all six in the order Fx to Mz, or of some, `fx=a,fz=b`, or the
    /// name of a matrix
    #[arg(long, value_name = "COLUMNS", value_parser = parse_wrench)]
    pub(crate) wrench: Option<WrenchColumns>,

    /// Time column: name or position
    #[arg(long, value_name = "COLUMN", value_parser = parse_column)]
    pub(crate) time: Option<ColumnRef>,

    /// Unit of the time column, overriding its name
    #[arg(long, value_name = "UNIT", value_parser = one_of(&TIME_UNITS))]
    pub(crate) time_unit: Option<TimeUnit>,

    /// Column with a row's group (pose, session, trial): name or position
    #[arg(long, value_name = "COLUMN", value_parser = parse_column)]
    pub(crate) group: Option<ColumnRef>,

    /// Read only rows with this value of a column: `name=A`, `name!=A`, `load<2`, `load>2`; several must all
    /// hold
    #[arg(long = "where", value_name = "COLUMN=VALUE", value_parser = parse_condition)]
    pub(crate) conditions: Vec<RowCondition>,

    /// Leave out the rows of a group
    #[arg(long, value_name = "GROUP")]
    pub(crate) exclude_group: Vec<String>,

    /// Unit of the moment columns, overriding their names
    #[arg(long, value_name = "UNIT", value_parser = one_of(&MOMENT_UNITS))]
    pub(crate) moment_unit: Option<MomentUnit>,

    /// Units of columns, overriding the log: `fx=lbf`, `force=kN,moment=N·mm`, `time=min`
    #[arg(long, value_name = "COLUMN=UNIT", value_parser = parse_units)]
    pub(crate) unit: Vec<UnitList>,

    /// Leave out invalid rows, and report their number: up to a tenth of a log, or `all`
    #[arg(long, value_name = "all", num_args = 0..=1, require_equals = true, default_missing_value = "few",
        value_parser = ["few", "all"], hide_possible_values = true)]
    pub(crate) skip_bad_rows: Option<String>,

    /// Number of threads [default: one per core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub(crate) threads: Option<u16>,
}

impl MappingArgs {
    pub(crate) fn mapping(&self) -> Mapping {
        Mapping {
            table: self.table.clone(),
            format: self.format,
            header_line: self.header_line,
            skip_lines: self.skip_lines,
            sensors: self.sensors.clone(),
            wrench: self.wrench.clone(),
            time: self.time.clone(),
            time_unit: self.time_unit,
            group: self.group.clone(),
            moment_unit: self.moment_unit,
            units: self.unit.concat(),
            rows: self.conditions.clone(),
            excluded_groups: self.exclude_group.clone(),
            ..Mapping::default()
        }
    }

    /// The specified columns for logs that are read with this calibration, if any.
    pub(crate) fn mapping_for(&self, calibration: Option<&CalibrationFile>) -> Mapping {
        let usual = calibration.and_then(|file| file.origin.columns.clone());
        Mapping { usual, ..self.mapping() }
    }

    /// Opens logs that are read with a calibration, each with its wrench file if an option names such files.
    /// Reports the columns that were recognised from the calibration.
    pub(crate) fn open(
        &self,
        logs: &[InputPath],
        wrenches: &[InputPath],
        calibration: Option<(&InputPath, &CalibrationFile)>,
        printer: &Printer,
    ) -> anyhow::Result<Vec<Log>> {
        let mapping = self.mapping_for(calibration.map(|(_, file)| file));
        let logs = open_logs(logs, ("--wrench-from", wrenches), &mapping)?;
        logs.iter().filter_map(interleaving).for_each(|said| printer.warning(said));
        logs.iter().filter_map(cut_off).for_each(|said| printer.warning(said));
        logs.iter().filter_map(replaced_wrench).for_each(|said| printer.warning(said));
        let Some((from, _)) = calibration else { return Ok(logs) };
        for log in &logs {
            let (taken, log, from) = (log.usual_columns(&mapping), log.path(), from.display());
            if !taken.is_empty() {
                let taken = taken.join(", ");
                printer.detail(format!("`{}`: {taken} as `{from}` remembers", log.display()));
            }
        }
        Ok(logs)
    }

    pub(crate) fn specified(&self, train: &[Log]) -> Option<ColumnNames> {
        let mapping = self.mapping();
        let names = train.first().map(|log| log.specified(&mapping));
        names.filter(|names| !names.is_empty())
    }

    pub(crate) fn read_options(&self) -> ReadOptions<'static> {
        ReadOptions {
            threads: self.threads.map_or(0, usize::from),
            skip_bad_rows: self.skip_bad_rows.is_some(),
            largest_bad_share: (self.skip_bad_rows.as_deref() != Some("all"))
                .then_some(ReadOptions::FEW_BAD_ROWS),
            ..ReadOptions::default()
        }
    }
}

/// Companion files of logs, which contain their wrench.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = "Reading logs")]
pub(crate) struct CompanionArgs {
    /// Take the wrench from these files, one for each log to fit to or to compare, row by row
    #[arg(long, value_name = "FILE", num_args = 1..)]
    pub(crate) wrench_from: Vec<InputPath>,
}

/// `--edited`, for every command that uses a calibration or partial fits.
#[derive(Clone, Copy, Debug, Default, clap::Args)]
pub(crate) struct EditedArg {
    /// Accept a calibration or partial fit that was edited: its checksum is not verified
    #[arg(long)]
    edited: bool,
}

impl EditedArg {
    pub(crate) fn read(self, path: &Path) -> Result<CalibrationFile, CalibrationFileError> {
        if self.edited { CalibrationFile::read_edited(path) } else { CalibrationFile::read(path) }
    }

    /// Reads a calibration that is going to be used, and warns if its fit said that it should not be.
    pub(crate) fn usable(
        self,
        path: &Path,
        printer: &Printer,
    ) -> Result<CalibrationFile, CalibrationFileError> {
        let file = self.read(path)?;
        if let Some(verdict) = file.not_ok() {
            printer.warning(format!("`{}`: its fit said: {verdict}", path.display()));
        }
        Ok(file)
    }

    pub(crate) fn partial(self, path: &Path) -> Result<PartialFit, CalibrationFileError> {
        if self.edited { PartialFit::read_edited(path) } else { PartialFit::read(path) }
    }

    pub(crate) fn partials<R: BufRead>(self, reader: R, name: &Path) -> PartialStream<R> {
        let partials = PartialStream::new(reader, name);
        if self.edited { partials.edited() } else { partials }
    }
}

/// A remark on a log whose rows alternate between several sensors.
pub(crate) fn interleaving(log: &Log) -> Option<String> {
    let found = log.interleaving()?;
    let (column, values) = (&found.column, found.values.join("`, `"));
    Some(format!(
        "`{}`: rows of several sensors alternate, by `{column}`: `{values}`; choose one with `--where '{column}={}'`",
        log.path().display(),
        found.values.first()?
    ))
}

/// A remark on a log whose file ends in the middle of its content.
pub(crate) fn cut_off(log: &Log) -> Option<String> {
    let text = || format!("`{}` is cut off: its last piece is left out", log.path().display());
    log.is_cut_off().then(text)
}

/// A remark on a log whose own wrench is not used.
pub(crate) fn replaced_wrench(log: &Log) -> Option<String> {
    let companion = log.companion().filter(|_| log.replaces_wrench())?;
    let (path, companion) = (log.path().display(), companion.display());
    Some(format!("`{path}` has a wrench as well; the one of `{companion}` is used"))
}

/// Opens logs, each with its wrench file if `option` names such files.
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

type WrenchColumns = PerAxis<Option<ColumnRef>>;

pub(crate) type ColumnList = Vec<ColumnRef>;

type UnitList = Vec<(String, String)>;

pub(super) const MOMENT_UNITS: [(&str, &str, MomentUnit); 2] = [
    ("N·m|nm|Nm|N.m", "N·m", MomentUnit::NewtonMetre),
    ("mN·m|mnm|mNm|mN.m|N·mm|Nmm|nmm|N.mm", "mN·m, the same as N·mm", MomentUnit::MillinewtonMetre),
];
