//! `shellcal info`: description of a log before any computation with it, and of a sensor at rest in it.

mod drift;
mod noise;

use calibration::fit::{FitOptions, Workers, find_outliers};
use log_file::summary::{ColumnSummary, LogSummary, LogTiming};
use log_file::{
    Column, ColumnRef, FORMATS, FileKind, Log, LogError, LogFormat, Meaning, StatedUnit, Wanted,
    parse_column, read_logs,
};
use serde::Serialize;
use shellcal::workflow::outliers::NamedOutliers;
use shellcal::workflow::selection::TimeWindow;
use trial::{Profile, VELOCIROACH};

use super::frames::{FrameArgs, parse_window};
use super::mapping::{EditedArg, MappingArgs, interleaving};
use super::outputs::FigureArgs;
use crate::files::InputPath;
use crate::printer::Printer;
use crate::tables::{or_dash, shown};

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  shellcal info run3.txt
  shellcal info recordings/*.csv.gz --json
  shellcal info unloaded.csv --noise --calibration calibration.json
  shellcal info run3.csv --drift --calibration calibration.json --plot drift.svg
  shellcal info --robot > robot.toml")]
#[group(skip)]
#[command(group = clap::ArgGroup::new("at_rest").args(["noise", "drift"]))]
pub(crate) struct InfoArgs {
    /// Logs, plain or gzip
    #[arg(required_unless_present = "robot", value_name = "FILE")]
    files: Vec<InputPath>,

    /// Print the built-in robot profile, with the source of every constant; a template for the `--profile` of
    /// another robot
    #[arg(long, conflicts_with_all = ["files", "at_rest"])]
    robot: bool,

    /// Measure the noise of an unloaded sensor, in the whole log or between two times in s: RMS about the
    /// mean, per axis and channel
    #[arg(long, value_name = "START:END", num_args = 0..=1, require_equals = true, value_parser = parse_window, requires = "calibration", help_heading = AT_REST)]
    noise: Option<Option<TimeWindow>>,

    /// Report the drift of the zero of an unloaded sensor between stationary intervals, and whether a tare at
    /// the start holds to the end
    #[arg(long, help_heading = AT_REST)]
    drift: bool,

    /// Calibration file, to report forces and moments as well as readings
    #[arg(long, short, value_name = "CAL", requires = "at_rest", help_heading = AT_REST)]
    calibration: Option<InputPath>,

    /// Temperature column: name or position [default: `temperature_c`, if there is one]
    #[arg(long, value_name = "COLUMN", value_parser = parse_column, requires = "drift", help_heading = AT_REST)]
    temperature: Option<ColumnRef>,

    #[command(flatten, next_help_heading = AT_REST)]
    figure: FigureArgs,

    #[command(flatten)]
    edited: EditedArg,

    #[command(flatten)]
    frames: FrameArgs,

    #[command(flatten)]
    mapping: MappingArgs,
}

const AT_REST: &str = "A sensor at rest";

/// Number of files above which only the overview is printed.
const FILES_IN_FULL: usize = 5;

const OVERVIEW: [&str; 8] =
    ["file", "rows", "bad", "seconds", "Hz", "gaps", "columns with a note", "outliers"];

const COLUMNS: [&str; 7] = ["column", "taken for", "min", "mean", "max", "sd", "note"];

impl InfoArgs {
    pub(crate) fn run(&self, printer: &Printer) -> anyhow::Result<()> {
        if self.robot {
            let profile = Profile::velociroach();
            // Print the profile verbatim instead of line by line: it is a file.
            return printer.finish(&profile, |printer| printer.print(VELOCIROACH));
        }
        let is_at_rest = self.noise.is_some() || self.drift;
        anyhow::ensure!(
            is_at_rest || !self.frames.is_given(),
            "`--all-rows` and `--skip-repeats` are for `--noise` and `--drift`"
        );
        anyhow::ensure!(self.drift || self.figure.plot.is_none(), "`--plot` is for `--drift`");
        if !is_at_rest {
            return self.describe(printer);
        }
        let file = self.calibration.as_ref().map(|path| self.edited.read(path)).transpose()?;
        let calibration = self.calibration.as_ref().zip(file.as_ref());
        let logs = self.mapping.open(&self.files, &[], calibration, printer)?;
        match (self.noise, &file) {
            (Some(window), Some(file)) => self.report_noise(window, &logs, file, printer),
            _ => self.report_drift(&logs, file.as_ref(), printer),
        }
    }

    fn describe(&self, printer: &Printer) -> anyhow::Result<()> {
        let mapping = self.mapping.mapping();
        let (mut documents, mut overview, mut texts) = (Vec::new(), Vec::new(), Vec::new());
        for file in &self.files {
            let log = Log::open(file, &mapping)?;
            interleaving(&log).into_iter().for_each(|said| printer.warning(said));
            let scanned = ScannedLog::new(&log, &self.mapping, printer)?;
            documents.push(scanned.document());
            overview.push(scanned.overview());
            let rows: Vec<_> = scanned.columns().filter_map(|column| column.row()).collect();
            texts.push((scanned.lines(), rows));
        }
        printer.finish(&documents, |printer| {
            let count = texts.len();
            if count > 1 {
                printer.table(&OVERVIEW, overview);
            }
            if count > FILES_IN_FULL && !printer.is_verbose() {
                printer.note("`--verbose` describes each, and so does `info` with fewer files");
                return;
            }
            for (lines, rows) in texts {
                if count > 1 {
                    printer.line("");
                }
                lines.iter().for_each(|line| printer.line(line));
                printer.table(&COLUMNS, rows);
            }
        })
    }
}

fn outliers(log: &Log, args: &MappingArgs) -> anyhow::Result<NamedOutliers> {
    let wanted = Wanted { readings: true, wrench: true, ..Wanted::default() };
    let log = std::slice::from_ref(log);
    let rows = read_logs(log, &wanted, &args.read_options())?;
    let workers = Workers::new(args.threads.map_or(0, usize::from));
    let found = find_outliers(&rows, &FitOptions { workers, ..FitOptions::default() })?;
    Ok(NamedOutliers::new(found, log, &rows))
}

struct ScannedLog<'a> {
    log: &'a Log,
    summary: LogSummary,
    skipped_rows: u64,
    repeated_heads: u64,
    outliers: Option<NamedOutliers>,
}

struct ColumnInfo<'a> {
    number: usize,
    column: &'a Column,
    values: Option<&'a ColumnSummary>,
}

impl<'a> ScannedLog<'a> {
    fn new(log: &'a Log, args: &MappingArgs, printer: &Printer) -> anyhow::Result<Self> {
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
        // If no fit is possible, rows cannot be judged, and no message is needed.
        let outliers = log.has_wrench().then(|| outliers(log, args).ok()).flatten();
        outliers.iter().for_each(|found| printer.remarks(found.remarks()));
        let (skipped_rows, repeated_heads) = (read.skipped_rows, read.repeated_heads);
        Ok(Self { log, summary, skipped_rows, repeated_heads, outliers })
    }

    fn columns(&self) -> impl Iterator<Item = ColumnInfo<'_>> {
        (1..).zip(self.log.columns()).map(|(number, column)| {
            let values = match column.meaning {
                Meaning::Sensor(channel) => self.summary.readings.get(channel),
                Meaning::Load(axis, _) => self.summary.wrench.get(axis.index()),
                _ => None,
            };
            ColumnInfo { number, column, values }
        })
    }

    /// The number of duplicate rows, and new frames per second, of a log with readings.
    fn repeats(&self) -> Option<(u64, Option<f64>)> {
        let summary = &self.summary;
        (self.log.channels() > 0).then(|| (summary.repeated_rows, summary.fresh_rate_hz()))
    }

    fn document(&self) -> impl Serialize + use<> {
        let (log, format) = (self.log, self.log.format());
        let format = FORMATS.iter().find(|(.., known)| *known == format);
        let outliers = self.outliers.as_ref().map(NamedOutliers::report);
        let notes: Vec<String> = log.notes().into_iter().map(str::to_owned).collect();
        document! {
            file: log.path().display().to_string(),
            format: log.table_kind().map_or(format.map_or("", |(name, ..)| name), FileKind::key),
            compressed: log.compression().is_some(),
            bytes: log.bytes(),
            rows: self.summary.rows,
            skipped_rows: self.skipped_rows,
            repeated_rows: self.repeats().map(|(rows, _)| rows),
            repeats_are_stale: log.repeats_are_stale(),
            fresh_rate_hz: self.repeats().and_then(|(_, rate_hz)| rate_hz),
            time: timing(&self.summary.timing),
            columns: self.columns().map(|column| column.document()).collect::<Vec<_>>(),
            notes?: (!notes.is_empty()).then_some(notes),
            outliers?: outliers.filter(|found| !found.is_empty()),
        }
    }

    fn overview(&self) -> Vec<String> {
        let timing = &self.summary.timing;
        let gaps = timing.start_s.map(|_| timing.gaps().count + timing.backward_steps);
        let noted = self.columns().filter(|column| !column.note().is_empty());
        vec![
            self.log.path().display().to_string(),
            self.summary.rows.to_string(),
            self.skipped_rows.to_string(),
            or_dash(timing.duration_s(), 1),
            or_dash(timing.median_rate_hz(), 1),
            shown(gaps, |gaps| gaps.to_string()),
            noted.count().to_string(),
            self.outliers.as_ref().map_or(0, NamedOutliers::count).to_string(),
        ]
    }

    fn lines(&self) -> Vec<String> {
        let (log, rows) = (self.log, self.summary.rows);
        let packed = log.compression().map_or_else(String::new, |name| format!(", {name}"));
        let mut lines = vec![format!("{}: {}{packed}", log.path().display(), log.kind())];
        lines.extend(log.decisions().iter().map(|said| format!("  head      {said}")));
        let repeated = self.repeats().map_or_else(String::new, |(repeated, _)| {
            let share = 100.0 * repeated as f64 / rows as f64;
            format!(", {repeated} ({share:.1} %) repeat the previous readings")
        });
        lines.push(format!("  rows      {rows}{repeated}"));
        lines.extend(log.notes().into_iter().map(|note| format!("  note      {note}")));
        if self.repeated_heads > 0 {
            let heads = self.repeated_heads;
            lines.push(format!(
                "  note      names or units are repeated, passed over {heads} times"
            ));
        }
        if self.skipped_rows > 0 {
            lines.push(format!("  skipped   {} bad rows", self.skipped_rows));
        }
        lines.extend(lines_of_time(&self.summary.timing));
        let ends = self.summary.timing.start_s.zip(self.summary.timing.end_s);
        if let (Some((turn, event)), Some((start, end))) = (log.clock_turn(), ends)
            && (start..=end).contains(&turn)
        {
            lines.push(format!("  clock     unwrapped: {event} at {turn:.6} s"));
        }
        if let (true, Some((_, Some(rate)))) = (log.repeats_are_stale(), self.repeats()) {
            lines.push(format!("  fresh     {rate:.2} frames per second (repeats are not new)"));
        }
        let unused = log.columns().iter().filter(|column| column.in_words().is_none());
        let unused: Vec<&str> = unused.map(|column| column.name.as_str()).collect();
        lines.extend(line_of_units(log));
        if !unused.is_empty() {
            lines.push(format!("  unused    {}", unused.join(", ")));
        }
        lines
    }
}

/// Names the loads whose unit is a guess, because neither name nor file states it.
fn line_of_units(log: &Log) -> Option<String> {
    let is_guessed = |column: &&Column| {
        matches!(column.meaning, Meaning::Load(..)) && column.unit == StatedUnit::None
    };
    let guessed: Vec<&Column> = log.columns().iter().filter(is_guessed).collect();
    let names: Vec<&str> = guessed.iter().map(|column| column.name.as_str()).collect();
    let is_moment =
        |column: &&&Column| matches!(column.meaning, Meaning::Load(axis, _) if axis.is_moment());
    let moments = guessed.iter().filter(is_moment).count();
    let taken = match moments {
        _ if guessed.is_empty() || log.format() != LogFormat::Csv => return None,
        0 => "N",
        all if all == guessed.len() => "N·m",
        _ => "N and N·m",
    };
    Some(format!("  units     no unit, taken as {taken}: {}", names.join(", ")))
}

fn timing(timing: &LogTiming) -> Option<impl Serialize + use<>> {
    let (gaps, longest) = (timing.gaps(), timing.longest);
    timing.start_s.map(|start_s| {
        document! {
            start_s,
            timing.{end_s, backward_steps, equal_times},
            duration_s: timing.duration_s(),
            median_rate_hz: timing.median_rate_hz(),
            median_interval_s: timing.median_interval_s(),
            jitter_s: timing.jitter_s(),
            gaps: gaps.count,
            missing_rows: gaps.missing_rows,
            longest_interval_s: longest.map(|longest| longest.length_s),
            longest_interval_start_s: longest.map(|longest| longest.start_s),
            longest_interval_row: longest.map(|longest| longest.row + 1),
            first_backward_row: timing.first_backward_row.map(|row| row + 1),
        }
    })
}

fn lines_of_time(timing: &LogTiming) -> Vec<String> {
    let (Some(start), Some(end)) = (timing.start_s, timing.end_s) else { return Vec::new() };
    let mut lines = vec![format!("  time      {start:.6} s to {end:.6} s, {:.3} s", end - start)];
    let interval = timing.median_rate_hz().zip(timing.median_interval_s());
    if let (Some((rate, interval)), Some(jitter)) = (interval, timing.jitter_s()) {
        let (interval, jitter) = (interval * 1e3, jitter * 1e3);
        lines.push(format!(
            "  rate      {rate:.2} Hz (median interval {interval:.3} ms, jitter {jitter:.3} ms)"
        ));
    }
    let gaps = timing.gaps();
    if let Some(longest) = timing.longest.filter(|_| gaps.count > 0) {
        lines.push(format!(
            "  gaps      {} (about {} rows missing), the longest {:.3} ms at {:.6} s, before row {}",
            gaps.count,
            gaps.missing_rows,
            longest.length_s * 1e3,
            longest.start_s,
            longest.row + 1
        ));
    }
    if let Some(row) = timing.first_backward_row {
        let (steps, row) = (timing.backward_steps, row + 1);
        lines.push(format!("  backward  time runs backwards {steps} times, first at row {row}"));
    }
    if timing.equal_times > 0 {
        lines.push(format!("  equal     {} rows have the time before", timing.equal_times));
    }
    lines
}

impl ColumnInfo<'_> {
    /// Only readings can saturate.
    fn is_reading(&self) -> bool {
        matches!(self.column.meaning, Meaning::Sensor(_))
    }

    fn document(&self) -> impl Serialize + use<> {
        let limits = |of: &ColumnSummary| {
            let at_ends = of.rows_at_ends().into_iter();
            document! {
                rows_at_ends: at_ends.map(|(end, rows)| document! { end, rows }).collect::<Vec<_>>(),
                rows_at_max: of.rows_at_max,
                pinned_at_max: of.is_pinned_at_max(),
                // Number of distinct values, if the channel is almost constant.
                quiet_values?: of.quiet_values(),
            }
        };
        let values = |of: &ColumnSummary| {
            document! {
                of.{min, max},
                mean: of.mean(),
                sd: of.sd(),
                constant: of.is_constant(),
                ..limits: self.is_reading().then(|| limits(of)),
            }
        };
        document! {
            column: self.number,
            name: self.column.name.clone(),
            meaning: self.column.in_words(),
            ..values: self.values.map(values),
        }
    }

    fn row(&self) -> Option<Vec<String>> {
        let meaning = self.column.in_words()?;
        let mut cells = vec![format!("{} {}", self.number, self.column.name), meaning];
        if let Some(values) = self.values {
            let decimals = if self.is_reading() { 2 } else { 4 };
            let figures = [values.min, values.mean(), values.max, values.sd()];
            cells.extend(figures.map(|value| format!("{value:.decimals$}")));
            cells.push(self.note());
        }
        Some(cells)
    }

    fn note(&self) -> String {
        let Some(values) = self.values else { return String::new() };
        let mut notes = Vec::new();
        if values.is_constant() {
            notes.push("constant".to_owned());
        }
        if self.is_reading() {
            let few = values.quiet_values();
            notes.extend(few.map(|values| format!("almost constant: {values} values")));
            let ends = values.rows_at_ends();
            let is_end = ends.iter().any(|(end, _)| *end == values.max);
            notes.extend(ends.iter().map(|(end, rows)| format!("saturated: {rows} rows at {end}")));
            if values.is_pinned_at_max() && !is_end {
                notes.push(format!("pinned: {} rows at its maximum", values.rows_at_max));
            }
        }
        notes.join(", ")
    }
}
