//! `shellcal convert`: conversion of logs of readings to tables of wrenches.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use anyhow::{bail, ensure};
use calibration::uncertainty::HIGHEST_LEVEL;
use calibration_file::payload_file::PayloadFile;
use clap::builder::TypedValueParser;
use figures::{WrenchTrace, trace_figure};
use forces::{FrameChange, NoFrameChange, RowRule};
use log_file::{ColumnRef, Log, Meaning, parse_columns};
use output_file::AtomicFile;
use shell_data::hint::Hint;
use shell_data::wrench::Axis;
use shellcal::workflow::convert::{
    Conversion, ConvertOptions, DEFAULT_FRAME_ID, FrameMount, OutputFormat, OutputPlan,
    RecordingFrame, TableColumns, convert, table_name,
};

use super::choices::number_in;
use super::frames::{ForceArgs, FrameArgs};
use super::mapping::{ColumnList, EditedArg, MappingArgs};
use super::outputs::FigureArgs;
use super::payload::load::MotionArgs;
use crate::files::{InputPath, OutputLocation, OutputPath, create_folder};
use crate::printer::Printer;
use crate::tables::axis_row;

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  shellcal convert calibration.json run3.txt -o run3.csv
  shellcal convert calibration.json run3.txt --interval=99
  shellcal convert calibration.json run3.txt --tare-time 0:0.2 --lowpass 20
  shellcal convert calibration.json run*.txt --output-dir wrenches")]
pub(crate) struct ConvertArgs {
    /// Calibration file
    #[arg(value_name = "CAL")]
    calibration: InputPath,

    #[command(flatten)]
    edited: EditedArg,

    /// Logs in any supported format; `-` for standard input
    #[arg(required = true, value_name = "LOG")]
    logs: Vec<InputPath>,

    /// Write the table of one log to a file: .csv, .parquet, .mat, .npy, .mcap, or `-`
    /// [default: standard output, as CSV]
    #[arg(long, short, value_name = "FILE", conflicts_with = "output_dir")]
    output: Option<OutputPath>,

    /// Write a table `NAME.wrench.csv` for each log into a directory
    #[arg(long, value_name = "DIR")]
    output_dir: Option<OutputLocation>,

    /// Carry other columns of the log along: names or positions, or `all` except time, readings and group.
    /// Numbers, or texts without surrounding blanks; a column with an empty field is text
    #[arg(long, value_name = "COLUMNS", value_parser = parse_columns)]
    keep: Option<ColumnList>,

    /// Give wrenches in another frame: its origin in m and rotations in degrees about its own x, then y, then
    /// z (ATI's tool transform), or the old axes that become its x, y and z; several are applied in order
    #[arg(long, value_name = "X,Y,Z,RX,RY,RZ|AXES", value_parser = frame_change, allow_hyphen_values = true)]
    frame: Vec<FrameChange>,

    /// Name of the frame of reference in MCAP recordings
    #[arg(long, value_name = "NAME", default_value = DEFAULT_FRAME_ID)]
    frame_id: String,

    /// Parent of that frame, and its pose there in m and rad, published on `/tf_static` in MCAP recordings
    #[arg(long, value_name = "NAME[:X,Y,Z,ROLL,PITCH,YAW]")]
    mount: Option<FrameMount>,

    /// Columns to write, of t, fx, fy, fz, mx, my, mz, se (standard errors), flags [default: all available]
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = COLUMNS)]
    columns: Option<Vec<String>>,

    /// Add both ends of the prediction interval that contains this percentage of true values [default level:
    /// 95]. With a low-pass the width is that before filtering, which is conservative
    #[arg(long, value_name = "PERCENT", num_args = 0..=1, require_equals = true, default_missing_value = "95",
        value_parser = level())]
    interval: Option<f64>,

    #[command(flatten)]
    figure: FigureArgs,

    #[command(flatten)]
    forces: ForceArgs,

    /// Refuse a log whose tare is loaded or not quiet, judged by the training data of the calibration
    /// [default: warn]
    #[arg(long, help_heading = "Taring")]
    strict: bool,

    /// Subtract weight and, with accelerations, inertia of the sensor's payload, before tare and low-pass: a
    /// file of `shellcal payload fit`
    #[arg(long, value_name = "PAYLOAD", help_heading = "Motion")]
    payload: Option<InputPath>,

    #[command(flatten)]
    motion: MotionArgs,

    #[command(flatten)]
    frames: FrameArgs,

    /// Highest reading of the converter, to flag saturation [default: the end of the smallest usual
    /// converter, of 12 bits or more, that gives the calibration's readings]
    #[arg(long, value_name = "COUNTS")]
    full_scale: Option<f64>,

    #[command(flatten)]
    mapping: MappingArgs,
}

const COLUMNS: [&str; 9] = ["t", "fx", "fy", "fz", "mx", "my", "mz", "se", "flags"];

impl ConvertArgs {
    pub(crate) fn run(&self, printer: &Printer) -> anyhow::Result<()> {
        let targets = self.targets(printer)?;
        let file = self.edited.usable(&self.calibration, printer)?;
        let from = Some((&self.calibration, &file));
        let logs = self.mapping.open(&self.logs, &[], from, printer)?;
        let (calibration, diagnostics) = (file.calibration, file.origin.diagnostics);
        let payload = self.payload.as_ref().map(|path| PayloadFile::read(path)).transpose()?;
        ensure!(
            payload.is_some() || !self.motion.is_given(),
            "`--motion`, `--orientation` and `--accelerations` are of use with `--payload` only"
        );
        let mut plot = self.figure.create_of_one(&self.logs, printer)?;

        let mut conversions = Vec::new();
        for (log, target) in logs.iter().zip(targets) {
            let mut trace = plot.is_some().then(WrenchTrace::default);
            let read = self.mapping.read_options();
            let load =
                |file| self.motion.load(file, log, &calibration, &read, self.mapping.time_unit);
            let load = payload.as_ref().map(load).transpose()?;
            let usual = ConvertOptions::new(log, &calibration);
            let options = ConvertOptions {
                load,
                frame: self.frame.clone(),
                rows: self.frames.rows(log),
                forces: self.forces.options(RowRule::Time),
                columns: self.columns(usual.columns),
                converter: calibration.converter(self.full_scale),
            };
            let mut plan = OutputPlan::default();
            (plan.keep_texts, plan.keep) = self.kept(log)?;
            let mut out = match &target {
                None => AtomicFile::stdout(),
                Some(path) => {
                    plan.format = self.format(path)?;
                    printer.files.create(path)?
                }
            };
            let summary = printer.scan(log, read, |read| {
                let of = Conversion { log, calibration: &calibration, options: &options, read };
                convert(&of, &plan, &mut out, trace.as_mut())
            })?;
            if let Some(text) = summary.tare_doubt(log.path(), diagnostics.as_ref()) {
                // The tare is probably loaded or not quiet.
                ensure!(
                    !self.strict,
                    "{text}; take frames at rest with `--tare-time`, or keep the zero of the calibration with `--no-tare`"
                );
                printer.warning(text);
            }
            out.commit()?;
            if let (Some(trace), Some(plot)) = (trace, plot.take()) {
                let name = log.path().file_name().unwrap_or_default().to_string_lossy();
                plot.draw(|size| trace_figure(size, &name, &trace))?;
            }
            printer.remarks(summary.remarks(log.path()));
            self.motion.report(printer, log, &summary);
            if let (Some(path), false) = (&target, printer.json()) {
                printer.line(format!("{} -> {}", log.path().display(), path.display()));
                let axes = summary.axes.iter();
                let rows = axes.map(|(axis, of)| axis_row(*axis, [of.min, of.mean, of.max]));
                printer.table(&["axis", "min", "mean", "max"], rows);
            }
            conversions.push(document! {
                log: log.path().display().to_string(),
                output: target.map(|path| path.display().to_string()),
                ..summary: summary,
            });
        }
        printer.finish(&conversions, |_| ())
    }

    fn format(&self, path: &Path) -> anyhow::Result<OutputFormat> {
        let frame = RecordingFrame { id: self.frame_id.clone(), mount: self.mount.clone() };
        Ok(OutputFormat::from_path(path, &frame)?)
    }

    /// The output file for each log, `None` for the standard output. Conflicts are found here, before any work.
    fn targets(&self, printer: &Printer) -> anyhow::Result<Vec<Option<PathBuf>>> {
        let count = self.logs.len();
        let file = self.output.as_ref().filter(|file| file.as_os_str() != "-");
        let targets: Vec<Option<PathBuf>> = match (file, &self.output_dir) {
            (Some(file), None) if count == 1 => {
                self.format(file)?;
                vec![Some(file.to_path_buf())]
            }
            (None, None) if count == 1 => vec![None],
            (_, Some(directory)) => {
                create_folder(directory)?;
                self.logs.iter().map(|log| Some(directory.join(table_name(log)))).collect()
            }
            _ => bail!("`{count}` logs need `--output-dir` for their tables"),
        };
        ensure!(
            !printer.json() || targets != [None],
            "`--json` needs `--output` or `--output-dir`: the table would go to the same place"
        );
        // Files in a directory are not named on the command line.
        if self.output_dir.is_some() {
            targets.iter().flatten().try_for_each(|path| printer.files.announce(path))?;
        }
        targets.iter().flatten().try_for_each(|path| printer.files.probe(path))?;
        Ok(targets)
    }

    /// The positions of the text columns, and of the numeric columns, that are carried along.
    fn kept(&self, log: &Log) -> anyhow::Result<(Vec<usize>, Vec<usize>)> {
        let Some(columns) = &self.keep else { return Ok(Default::default()) };
        let is_all = matches!(columns.as_slice(), [ColumnRef::Name(name)] if name == "all");
        let mut positions = match log.column_positions(columns) {
            Err(_) if is_all => {
                let is_other = |at: &usize| {
                    !matches!(log.columns()[*at].meaning, Meaning::Time(_) | Meaning::Sensor(_))
                };
                (0..log.columns().len()).filter(is_other).collect()
            }
            positions => positions?,
        };
        let mut seen = HashSet::new();
        positions.retain(|&position| seen.insert(position));
        let are_texts = log.are_texts(&positions, &self.mapping.read_options())?;
        let (texts, numbers): (Vec<_>, Vec<_>) =
            positions.into_iter().zip(are_texts).partition(|(_, is_text)| *is_text);
        let of = |columns: Vec<(usize, bool)>| columns.into_iter().map(|(at, _)| at).collect();
        Ok((of(texts), of(numbers)))
    }

    fn columns(&self, all: TableColumns) -> TableColumns {
        match &self.columns {
            None => TableColumns { interval: self.interval, ..all },
            Some(columns) => {
                let [time, axes @ .., standard_errors, flags] =
                    COLUMNS.map(|column| columns.iter().any(|asked| asked == column));
                let axes = Axis::ALL.into_iter().filter(|axis| axes[axis.index()]).collect();
                TableColumns { time, axes, standard_errors, interval: self.interval, flags }
            }
        }
    }
}

fn frame_change(text: &str) -> Result<FrameChange, String> {
    text.parse().map_err(|error: NoFrameChange| {
        format!("{error}: expected {}", error.hint().unwrap_or_default())
    })
}

/// Parser for a percentage, converted to a share.
fn level() -> impl TypedValueParser<Value = f64> {
    /// [`HIGHEST_LEVEL`] in percent.
    const HIGHEST: f64 = 100.0 * HIGHEST_LEVEL;
    number_in(1.0..=HIGHEST, "expected a percentage from 1 to 99.9").map(|percent| percent / 100.0)
}
