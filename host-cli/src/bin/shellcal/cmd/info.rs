//! `shellcal info`: what a log is, before anything is computed from it.

use calibration::fit::{FitOptions, Workers, find_outliers};
use log_file::summary::{ColumnSummary, LogSummary};
use log_file::{Column, FORMATS, FileKind, Log, LogError, LogFormat, Meaning, Wanted, read_logs};
use serde::{Serialize, Serializer};
use shellcal::workflow::outliers::{NamedOutliers, OutlierReport};

use super::mapping::MappingArgs;
use crate::files::InputPath;
use crate::printer::{Printer, TableColumn};
use crate::tables::{or_dash, shown};

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  shellcal info run3.txt
  shellcal info recordings/*.csv.gz --json")]
pub(crate) struct InfoArgs {
    /// Logs, plain or gzip
    #[arg(required = true, value_name = "FILE")]
    files: Vec<InputPath>,

    #[command(flatten)]
    mapping: MappingArgs,
}

impl InfoArgs {
    pub(crate) fn run(&self, printer: &Printer) -> anyhow::Result<()> {
        let mapping = self.mapping.mapping();
        let mut infos = Vec::new();
        for file in &self.files {
            let log = Log::open(file, &mapping)?;
            infos.push(summary(&log, &self.mapping, printer)?);
        }
        printer.finish(&infos, |printer| {
            if infos.len() > 1 {
                print_overview(&infos, printer)?;
            }
            if infos.len() > FILES_IN_FULL && !printer.is_verbose() {
                printer.note(
                    "`--verbose` describes each of them, and so does `info` with fewer files",
                );
                return Ok(());
            }
            infos.iter().enumerate().try_for_each(|(i, info)| {
                if i > 0 || infos.len() > 1 {
                    printer.line("")?;
                }
                info.print(printer)
            })
        })
    }
}

/// Of more files than this only the overview is printed.
const FILES_IN_FULL: usize = 5;

/// A line for each log.
fn print_overview(infos: &[Info], printer: &Printer) -> anyhow::Result<()> {
    let gaps = |time: &TimeInfo| (time.gaps + time.backward_steps).to_string();
    let columns: [TableColumn<'_, &Info>; 8] = [
        ("file", &|info| info.file.clone()),
        ("rows", &|info| info.rows.to_string()),
        ("bad", &|info| info.skipped_rows.to_string()),
        ("seconds", &|info| or_dash(info.time.as_ref().map(|time| time.duration_s), 1)),
        ("Hz", &|info| or_dash(info.time.as_ref().and_then(|time| time.median_rate_hz), 1)),
        ("gaps", &|info| shown(info.time.as_ref(), gaps)),
        ("columns with a note", &|info| {
            info.columns.iter().filter(|column| !column.note().is_empty()).count().to_string()
        }),
        ("outliers", &|info| info.outliers.len().to_string()),
    ];
    printer.records(&columns, infos)
}

fn summary(log: &Log, args: &MappingArgs, printer: &Printer) -> anyhow::Result<Info> {
    let wanted = Wanted {
        time: log.has_time(),
        readings: log.channels() > 0,
        wrench: log.has_wrench(),
        ..Wanted::default()
    };
    let mut summary = LogSummary::default();
    let read = printer.scan(log, args.read_options(), |read| {
        log.read(&wanted, &read, std::mem::take, |block| {
            summary.add(&block);
            Ok::<(), LogError>(())
        })
    })?;
    // Without a calibration there is nothing to judge rows by, and nothing to say.
    let found = log.has_wrench().then(|| outliers(log, args).ok()).flatten();
    found.iter().for_each(|found| printer.remarks(found.remarks()));
    let (has_readings, columns) = (log.channels() > 0, log.columns().iter().enumerate());
    Ok(Info {
        file: log.path().display().to_string(),
        format: log.table_kind().map_or(format_name(log.format()), FileKind::key),
        compressed: log.compression().is_some(),
        bytes: log.bytes(),
        rows: summary.rows,
        skipped_rows: read.skipped_rows,
        repeated_rows: has_readings.then_some(summary.repeated_rows),
        repeats_are_stale: log.repeats_are_stale(),
        fresh_rate_hz: summary.fresh_rate_hz().filter(|_| has_readings),
        time: TimeInfo::new(&summary),
        columns: columns.map(|(at, column)| ColumnInfo::new(at, column, &summary)).collect(),
        outliers: found.map_or_else(Vec::new, |found| found.report()),
        title: log.kind(),
        compression: log.compression(),
    })
}

/// Suspicious rows, by the cubic model.
fn outliers(log: &Log, args: &MappingArgs) -> anyhow::Result<NamedOutliers> {
    let wanted = Wanted { readings: true, wrench: true, ..Wanted::default() };
    let log = std::slice::from_ref(log);
    let rows = read_logs(log, &wanted, &args.read_options())?;
    let workers = Workers::new(args.threads.map_or(0, usize::from));
    let found = find_outliers(&rows, &FitOptions { workers, ..FitOptions::default() })?;
    Ok(NamedOutliers::new(found, log, &rows))
}

/// What is said about a log; the field names are those of the JSON document.
#[derive(Debug, Serialize)]
struct Info {
    file: String,
    format: &'static str,
    compressed: bool,
    bytes: u64,
    rows: u64,
    skipped_rows: u64,
    repeated_rows: Option<u64>,
    repeats_are_stale: bool,
    fresh_rate_hz: Option<f64>,
    time: Option<TimeInfo>,
    columns: Vec<ColumnInfo>,
    /// Suspicious rows, by a fit to the others.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    outliers: Vec<OutlierReport>,
    #[serde(skip)]
    title: String,
    #[serde(skip)]
    compression: Option<&'static str>,
}

#[derive(Debug, Serialize)]
struct TimeInfo {
    start_s: f64,
    end_s: f64,
    duration_s: f64,
    median_rate_hz: Option<f64>,
    median_interval_s: Option<f64>,
    jitter_s: Option<f64>,
    gaps: u64,
    missing_rows: u64,
    longest_interval_s: Option<f64>,
    longest_interval_start_s: Option<f64>,
    longest_interval_row: Option<u64>,
    backward_steps: u64,
    first_backward_row: Option<u64>,
    equal_times: u64,
}

#[derive(Debug)]
struct ColumnInfo {
    column: usize,
    name: String,
    meaning: Option<String>,
    values: Option<ColumnSummary>,
    /// Only readings can saturate.
    is_reading: bool,
}

impl Serialize for ColumnInfo {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let limits = |of: &ColumnSummary| {
            let [at_0, at_4095, at_65535] = of.rows_at_ends().map(|(_, rows)| rows);
            document! {
                rows_at_0: at_0,
                rows_at_4095: at_4095,
                rows_at_65535: at_65535,
                rows_at_max: of.rows_at_max,
                pinned_at_max: of.is_pinned_at_max(),
                // How many values there are, where the channel is almost constant.
                quiet_values?: of.quiet_values(),
            }
        };
        let values = |of: &ColumnSummary| {
            document! {
                min: of.min,
                mean: of.mean(),
                max: of.max,
                sd: of.sd(),
                constant: of.is_constant(),
                ..limits: self.is_reading.then(|| limits(of)),
            }
        };
        let column = document! {
            column: self.column,
            name: &self.name,
            meaning: &self.meaning,
            ..values: self.values.as_ref().map(values),
        };
        column.serialize(serializer)
    }
}

impl Info {
    fn print(&self, printer: &Printer) -> anyhow::Result<()> {
        let packed = self.compression.map_or_else(String::new, |name| format!(", {name}"));
        printer.line(format!("{}: {}{packed}", self.file, self.title))?;
        let mut rows = format!("  rows      {}", self.rows);
        if let Some(repeated) = self.repeated_rows {
            let share = 100.0 * repeated as f64 / self.rows as f64;
            rows += &format!(", {repeated} ({share:.1} %) with the readings of the row before");
        }
        printer.line(rows)?;
        if self.skipped_rows > 0 {
            printer.line(format!("  skipped   {} bad rows", self.skipped_rows))?;
        }
        if let Some(time) = &self.time {
            time.print(printer)?;
        }
        if let (true, Some(rate)) = (self.repeats_are_stale, self.fresh_rate_hz) {
            printer
                .line(format!("  fresh     {rate:.2} frames per second (repeats are not new)"))?;
        }
        let (used, unused): (Vec<_>, Vec<_>) =
            self.columns.iter().partition(|column| column.meaning.is_some());
        if !unused.is_empty() {
            let names: Vec<_> = unused.iter().map(|column| column.name.as_str()).collect();
            printer.line(format!("  unused    {}", names.join(", ")))?;
        }
        let header = ["column", "taken for", "min", "mean", "max", "sd", "note"];
        let rows = used.into_iter().map(ColumnInfo::row);
        printer.table(&header, rows)
    }
}

impl TimeInfo {
    fn new(summary: &LogSummary) -> Option<Self> {
        let timing = &summary.timing;
        let gaps = timing.gaps();
        Some(Self {
            start_s: timing.start_s?,
            end_s: timing.end_s?,
            duration_s: timing.duration_s()?,
            median_rate_hz: timing.median_rate_hz(),
            median_interval_s: timing.median_interval_s(),
            jitter_s: timing.jitter_s(),
            gaps: gaps.count,
            missing_rows: gaps.missing_rows,
            longest_interval_s: timing.longest.map(|longest| longest.length_s),
            longest_interval_start_s: timing.longest.map(|longest| longest.start_s),
            longest_interval_row: timing.longest.map(|longest| longest.row + 1),
            backward_steps: timing.backward_steps,
            first_backward_row: timing.first_backward_row.map(|row| row + 1),
            equal_times: timing.equal_times,
        })
    }

    fn print(&self, printer: &Printer) -> anyhow::Result<()> {
        printer.line(format!(
            "  time      {:.6} s to {:.6} s, {:.3} s",
            self.start_s, self.end_s, self.duration_s
        ))?;
        if let (Some(rate), Some(interval), Some(jitter)) =
            (self.median_rate_hz, self.median_interval_s, self.jitter_s)
        {
            let (interval, jitter) = (interval * 1e3, jitter * 1e3);
            printer.line(format!(
                "  rate      {rate:.2} Hz (median interval {interval:.3} ms, jitter {jitter:.3} ms)"
            ))?;
        }
        if let (Some(length), Some(start), Some(row)) = (
            self.longest_interval_s.filter(|_| self.gaps > 0),
            self.longest_interval_start_s,
            self.longest_interval_row,
        ) {
            printer.line(format!(
                "  gaps      {} (about {} rows missing), the longest {:.3} ms at {start:.6} s, \
                 before row {row}",
                self.gaps,
                self.missing_rows,
                length * 1e3
            ))?;
        }
        if let Some(row) = self.first_backward_row {
            let steps = self.backward_steps;
            printer.line(format!(
                "  backward  time runs backwards {steps} times, first at row {row}"
            ))?;
        }
        if self.equal_times > 0 {
            printer.line(format!("  equal     {} rows have the time before", self.equal_times))?;
        }
        Ok(())
    }
}

impl ColumnInfo {
    fn new(position: usize, column: &Column, summary: &LogSummary) -> Self {
        let values = match column.meaning {
            Meaning::Sensor(channel) => summary.readings.get(channel),
            Meaning::Load(axis, _) => summary.wrench.get(axis.index()),
            _ => None,
        };
        Self {
            column: position + 1,
            name: column.name.clone(),
            meaning: column.meaning.in_words(),
            values: values.cloned(),
            is_reading: matches!(column.meaning, Meaning::Sensor(_)),
        }
    }

    fn row(&self) -> Vec<String> {
        let meaning = self.meaning.clone().unwrap_or_default();
        let mut cells = vec![format!("{} {}", self.column, self.name), meaning];
        let Some(values) = &self.values else { return cells };
        let decimals = if self.is_reading { 2 } else { 4 };
        let figures = [values.min, values.mean(), values.max, values.sd()];
        cells.extend(figures.map(|value| format!("{value:.decimals$}")));
        cells.push(self.note());
        cells
    }

    fn note(&self) -> String {
        let Some(values) = &self.values else { return String::new() };
        let mut notes = Vec::new();
        if values.is_constant() {
            notes.push("constant".to_owned());
        }
        if self.is_reading {
            let few = values.quiet_values();
            notes.extend(few.map(|values| format!("almost constant: {values} values")));
            let ends = values.rows_at_ends().into_iter().filter(|(_, rows)| *rows > 0);
            notes.extend(ends.map(|(end, rows)| format!("saturated: {rows} rows at {end}")));
            if values.is_pinned_at_max() && ![4095.0, 65535.0].contains(&values.max) {
                notes.push(format!("pinned: {} rows at its maximum", values.rows_at_max));
            }
        }
        notes.join(", ")
    }
}

fn format_name(format: LogFormat) -> &'static str {
    FORMATS.iter().find(|(.., known)| *known == format).map_or("", |(name, ..)| name)
}
