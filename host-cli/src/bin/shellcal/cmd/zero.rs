//! What an unloaded sensor says: `shellcal drift`, how its zero moves, and `shellcal noise`, how much it scatters.

use std::path::Path;

use figures::{Chart, ChartMark, Figure, PlotAxis, Series, Size, Spacing, trace_figure};
use forces::drift::{Drift, Trend};
use forces::stationary::{FALSE_ALARMS, ZeroChange, largest_change};
use log_file::{ColumnRef, parse_column};
use shellcal::workflow::drift::{DriftSummary, drift};
use shellcal::workflow::noise::{NoiseSummary, Scatter, noise};
use shellcal::workflow::remark::{moved_zero, used_rows};
use shellcal::workflow::selection::TimeWindow;

use super::frames::{FrameArgs, parse_window};
use super::mapping::{EditedArg, MappingArgs};
use super::outputs::FigureArgs;
use crate::files::InputPath;
use crate::printer::Printer;
use crate::tables::{axis_row, decimals, number_row};

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  shellcal drift unloaded.csv
  shellcal drift run3.csv --calibration calibration.json --plot drift.svg
  shellcal drift oven.csv --calibration calibration.json --temperature 10")]
pub(crate) struct DriftArgs {
    /// Logs of a sensor that is at rest and unloaded at the start and now and then, of any format
    #[arg(required = true, value_name = "LOG")]
    logs: Vec<InputPath>,

    /// Calibration file, for the zero of forces and moments beside that of the readings
    #[arg(long, short, value_name = "CAL")]
    calibration: Option<InputPath>,

    /// The column of temperature: its name or position [default: `temperature_c`, if there is one]
    #[arg(long, value_name = "COLUMN", value_parser = parse_column)]
    temperature: Option<ColumnRef>,

    #[command(flatten)]
    figure: FigureArgs,

    #[command(flatten)]
    edited: EditedArg,

    #[command(flatten)]
    frames: FrameArgs,

    #[command(flatten)]
    mapping: MappingArgs,
}

impl DriftArgs {
    pub(crate) fn run(&self, printer: &Printer) -> anyhow::Result<()> {
        let mut plot = self.figure.create_of_one(&self.logs, printer)?;
        let file = self.calibration.as_ref().map(|path| self.edited.read(path)).transpose()?;
        let calibration = self.calibration.as_ref().zip(file.as_ref());
        let logs = self.mapping.open(&self.logs, &[], calibration, printer)?;
        let mut drifts = Vec::new();
        for log in &logs {
            let name = log.path().display().to_string();
            let summary = printer.scan(log, self.mapping.read_options(), |read| {
                let calibration = file.as_ref().map(|file| &file.calibration);
                drift(log, calibration, self.temperature.as_ref(), self.frames.rows(log), &read)
            })?;
            if let Some(plot) = plot.take() {
                plot.draw(|size| figure(size, &name, &summary))?;
            }
            drifts.push((name, summary));
        }
        let documents = drifts.iter().map(|(log, summary)| {
            document! {
                log,
                // Whether a tare at the start holds to the end.
                tare_holds: moved(summary).is_none(),
                ..summary: summary,
            }
        });
        printer.finish(&documents.collect::<Vec<_>>(), |printer| {
            drifts.iter().for_each(|(log, summary)| print(printer, log, summary))
        })
    }
}

/// The quantities, each with its name, its unit and how many decimals it is shown with.
fn quantities(summary: &DriftSummary) -> Vec<(String, &'static str, usize, &Drift)> {
    let axes = summary
        .axes
        .iter()
        .flatten()
        .map(|(axis, drift)| (axis.name().to_owned(), axis.unit(), decimals(*axis), drift));
    let channels = summary.channels.iter().enumerate();
    axes.chain(channels.map(|(i, drift)| (format!("s{}", i + 1), "counts", 2, drift))).collect()
}

/// What has moved most beyond its limit: among the axes, or among the channels without a calibration.
fn moved(summary: &DriftSummary) -> Option<(usize, ZeroChange)> {
    let judged = summary.axes.as_ref().map_or(summary.channels.len(), Vec::len);
    let all = quantities(summary);
    largest_change(all[..judged].iter().enumerate().map(|(i, (.., drift))| (i, drift.change)))
}

fn print(printer: &Printer, log: &str, summary: &DriftSummary) {
    let DriftSummary { rests, first_s, last_s, .. } = *summary;
    printer.line(format!(
        "{log}: {rests} stretches at rest, the first about {first_s:.1} s, the last about {last_s:.1} s"
    ));
    let quantities = quantities(summary);
    let has_trend = quantities.iter().any(|(.., drift)| drift.per_degree.is_some());
    let mut header = vec!["zero of", "change", "noise", "wander", "per minute", "± SE"];
    if has_trend {
        header.extend(["per degree", "± SE"]);
    }
    let rows = quantities.iter().map(|(name, unit, decimals, drift)| {
        let decimals = *decimals;
        let shown = |value: f64| format!("{value:.decimals$}");
        let ZeroChange { change, noise, .. } = drift.change;
        let mut row = vec![format!("{name} ({unit})")];
        row.extend([change, noise, drift.wander].map(shown));
        let Trend { slope, standard_error, .. } = drift.per_s;
        row.extend([60.0 * slope, 60.0 * standard_error].map(shown));
        if has_trend {
            let figures = drift.per_degree.map(|at| [at.slope, at.standard_error].map(shown));
            row.extend(figures.unwrap_or_default());
        }
        row
    });
    printer.table(&header, rows);
    match summary.temperature {
        Some([low, high]) if has_trend => {
            // Whether time or temperature follows the zeros better.
            let drifts = quantities.iter().map(|(.., drift)| drift);
            let pairs = drifts.filter_map(|drift| Some((drift.per_s, drift.per_degree?)));
            let better = pairs.clone().filter(|(time, of)| of.residual_rms < time.residual_rms);
            printer.line(format!(
                "temperature {low:.2} to {high:.2}: a line against it is closer to the zeros than one against time in \
                 {} of {}",
                better.count(),
                pairs.count()
            ));
        }
        Some([at, _]) => printer.line(format!("temperature {at:.2} throughout")),
        None => {}
    }
    printer.line(match moved(summary) {
        None => "a tare at the start holds to the end: no zero moves beyond its noise".to_owned(),
        Some((i, ZeroChange { change, noise, .. })) => {
            let (name, unit, decimals, _) = &quantities[i];
            format!(
                "a tare at the start does not hold: the zero of {name} moves by {change:.decimals$} {unit}, \
                 with a noise of {noise:.decimals$}; `--tare rests` follows it"
            )
        }
    });
    printer.note(format!(
        "a zero that stands still is said to move in {} % of logs at most",
        100.0 * FALSE_ALARMS
    ));
}

fn figure(size: Size, name: &str, summary: &DriftSummary) -> Figure {
    let title = format!("{name}: zero at rest, less that at the start");
    if summary.axes.is_some() {
        return trace_figure(size, &title, &summary.trace);
    }
    let series: Vec<Series> = summary
        .channel_changes
        .iter()
        .cloned()
        .enumerate()
        .map(|(i, points)| Series { label: format!("s{}", i + 1), points, mark: ChartMark::Line })
        .collect();
    let values = || series.iter().flat_map(|series| series.points.iter().map(|point| point.1));
    let (low, high) = (values().fold(0.0, f64::min), values().fold(0.0, f64::max));
    let x = PlotAxis::new("time", "s", Spacing::Linear, summary.first_s, summary.last_s);
    let y = PlotAxis::new("change of the zero", "counts", Spacing::Linear, low, high);
    Chart { title, x, y, series }.figure(size)
}

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  shellcal noise calibration.json unloaded.csv
  shellcal noise calibration.json run3.txt --window 0:0.1")]
pub(crate) struct NoiseArgs {
    /// Calibration file
    #[arg(value_name = "CAL")]
    calibration: InputPath,

    /// Logs of the unloaded sensor, plain or gzip
    #[arg(required = true, value_name = "LOG")]
    logs: Vec<InputPath>,

    /// Use only what lies between two times, in s on the log's clock
    #[arg(long, value_name = "START:END", value_parser = parse_window)]
    window: Option<TimeWindow>,

    #[command(flatten)]
    edited: EditedArg,

    #[command(flatten)]
    frames: FrameArgs,

    #[command(flatten)]
    mapping: MappingArgs,
}

impl NoiseArgs {
    pub(crate) fn run(&self, printer: &Printer) -> anyhow::Result<()> {
        let file = self.edited.read(&self.calibration)?;
        let calibration = Some((&self.calibration, &file));
        let logs = self.mapping.open(&self.logs, &[], calibration, printer)?;
        let mut noises = Vec::new();
        for (path, log) in self.logs.iter().zip(&logs) {
            let summary = printer.scan(log, self.mapping.read_options(), |read| {
                noise(log, &file.calibration, self.frames.rows(log), self.window, &read)
            })?;
            let counts = [summary.rows, summary.repeated_rows, summary.skipped_rows];
            printer.remarks([used_rows(path, summary.rows_used, counts)]);
            printer.remarks(summary.zero.as_ref().and_then(|zero| moved_zero(path, zero)));
            noises.push((path, summary));
        }
        let documents = noises.iter().map(|(log, of)| document! { log: log, ..summary: of });
        printer.finish(&documents.collect::<Vec<_>>(), |printer| {
            noises.iter().for_each(|(log, summary)| print_noise(printer, log, summary))
        })
    }
}

fn print_noise(printer: &Printer, log: &Path, summary: &NoiseSummary) {
    printer.line(format!("{}: noise of {} frames", log.display(), summary.frames));
    let values = |scatter: &Scatter| [scatter.rms, scatter.peak_to_peak, scatter.mean];
    let axes = summary.axes.iter().map(|(axis, scatter)| axis_row(*axis, values(scatter)));
    let channels = summary.channels.iter().enumerate();
    let channels =
        channels.map(|(i, scatter)| number_row(format!("s{} (counts)", i + 1), values(scatter), 2));
    printer.table(&["quantity", "RMS", "peak to peak", "mean"], axes.chain(channels))
}
