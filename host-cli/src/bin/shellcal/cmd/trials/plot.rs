//! `shellcal plot`: one figure.

use clap::Subcommand;
use figures::Figure;
use figures::trial::{box_figure, drag_lift_figure, phase_figure, stack_figure};
use log_file::Log;
use shellcal::workflow::figures::{passage, reduce_trace, some_strides, title};
use shellcal::workflow::selection::TimeWindow;
use shellcal::workflow::trial::evaluate_in_window;
use trial::{TraceExtent, Trial, TrialRow};

use super::evaluation::{self, EvaluationArgs, TitleArg};
use super::trial::WindowTimes;
use crate::cmd::frames::parse_window;
use crate::cmd::outputs::{FigureFile, FigureSize};
use crate::files::{InputPath, OutputPath};
use crate::printer::{Outcome, Printer};

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  shellcal plot drag run3.txt --enter 4.2 --exit 8.9 --calibration calibration.json --output drag.svg
  shellcal plot telemetry run3.txt --calibration calibration.json --between 5:6 --output run3.png
  shellcal plot boxes manifest.csv --calibration calibration.json --output boxes.svg

`shellcal batch --figures DIR` makes all of them.")]
pub(crate) struct PlotArgs {
    #[command(subcommand)]
    kind: PlotKind,
}

#[derive(Debug, Subcommand)]
enum PlotKind {
    /// Drag and lift against time, with shaded times of entering, leaving and fully inside
    Drag(OneArgs),
    /// Fx, Fy, Fz, leg angles and power against time
    Telemetry(OneArgs),
    /// Drag and lift against the phase of the leg by condition, with the spread of strides
    Phase(ManyArgs),
    /// Box plots by condition: drag energy, electrical energy, specific resistance
    Boxes(ManyArgs),
}

#[derive(Debug, clap::Args)]
struct OneArgs {
    /// Log of the trial, plain or gzip
    #[arg(value_name = "LOG")]
    log: InputPath,

    #[command(flatten)]
    times: WindowTimes,

    /// Show the range between two times, in s on the log's clock [default: the whole log; for telemetry, ten
    /// strides]
    #[arg(long, value_name = "START:END", value_parser = parse_window)]
    between: Option<TimeWindow>,

    #[command(flatten)]
    drawing: DrawingArgs,
}

#[derive(Debug, clap::Args)]
struct ManyArgs {
    /// Table of trials: CSV or `.toml`
    #[arg(value_name = "MANIFEST")]
    manifest: InputPath,

    #[command(flatten)]
    drawing: DrawingArgs,
}

/// The figure, and the evaluation of trials for it.
#[derive(Debug, clap::Args)]
struct DrawingArgs {
    #[command(flatten)]
    titled: TitleArg,

    /// File to write: `.svg`, `.pdf` or `.png`
    #[arg(long, short, value_name = "FILE")]
    output: OutputPath,

    #[command(flatten)]
    figure_size: FigureSize,

    #[command(flatten)]
    evaluation: EvaluationArgs,
}

impl PlotArgs {
    pub(crate) fn run(&self, printer: &Printer) -> anyhow::Result<Outcome> {
        match &self.kind {
            PlotKind::Drag(args) => args.run(printer, false).map(Outcome::from),
            PlotKind::Telemetry(args) => args.run(printer, true).map(Outcome::from),
            PlotKind::Phase(args) => args.run(printer, true),
            PlotKind::Boxes(args) => args.run(printer, false),
        }
    }
}

impl OneArgs {
    fn run(&self, printer: &Printer, telemetry: bool) -> anyhow::Result<()> {
        let DrawingArgs { output, figure_size, evaluation: args, titled } = &self.drawing;
        let (plot, size) = (figure_size.open(output, printer)?, figure_size.size);
        let equipment = args.equipment(TraceExtent::Log, printer)?;
        let log = Log::open(&self.log, &equipment.mapping)?;
        let name = self.log.display().to_string();
        let trial = Trial::from_window(name, (f64::NAN, f64::NAN));
        let result = evaluate_in_window(&equipment.job(&log), trial, self.times.ends())?.result;
        equipment.note_forces(printer);
        let (row, trace) = (&result.row, result.trace.unwrap_or_default());
        let title = titled.title.clone().unwrap_or_else(|| title(row));
        let passage = passage(row, &equipment.profile);
        let between = self.between.map(|window| [window.start_s, window.end_s]);
        let figure = match telemetry {
            true => {
                let range_s = between.unwrap_or_else(|| some_strides(row, &trace));
                stack_figure(size, &title, &trace, &passage, range_s)
            }
            false => {
                anyhow::ensure!(
                    !trace.wrench[0].is_empty(),
                    "there are no forces to draw: the log has no sensors, or no calibration was given"
                );
                let shown = match between {
                    Some([from_s, to_s]) => trace.within(from_s, to_s),
                    None => trace,
                };
                drag_lift_figure(size, &title, &shown, &passage)
            }
        };
        self.drawing.write(printer, plot, figure, Some(row))
    }
}

impl ManyArgs {
    fn run(&self, printer: &Printer, phase: bool) -> anyhow::Result<Outcome> {
        let DrawingArgs { output, figure_size, evaluation: args, titled } = &self.drawing;
        let (plot, size) = (figure_size.open(output, printer)?, figure_size.size);
        let equipment = args.equipment(TraceExtent::Log, printer)?;
        let path = &self.manifest;
        let manifest = evaluation::read(path, printer)?;
        let keep = |_, result: &mut _| {
            reduce_trace(result, &equipment.profile, false);
            Ok(())
        };
        let options = equipment.batch_options();
        let batch = equipment.evaluate(printer, (path, &manifest), options, keep);
        let failures = evaluation::tell_failures(printer, path, &batch);
        let title = |usual: &str| titled.title.clone().unwrap_or_else(|| usual.to_owned());
        let figure = if phase {
            if let Some(note) = equipment.slow_filter(&batch) {
                printer.warning(note);
            }
            let phases = batch.phases();
            anyhow::ensure!(!phases.is_empty(), "no trial has strides with forces to draw");
            phase_figure(size, &title("Drag and lift over a stride"), &phases)
        } else {
            // Intervals are not drawn, so any seed will do.
            let conditions = batch.statistics(None, 1);
            anyhow::ensure!(!conditions.is_empty(), "no trial could be evaluated");
            box_figure(size, &title("Energies and specific resistance"), &conditions)
        };
        let outcome = printer.decide(failures.is_empty());
        self.drawing.write(printer, plot, figure, None)?;
        Ok(outcome)
    }
}

impl DrawingArgs {
    fn write(
        &self,
        printer: &Printer,
        plot: FigureFile,
        figure: Figure,
        row: Option<&TrialRow>,
    ) -> anyhow::Result<()> {
        plot.draw(|_| figure)?;
        let window = row.map(|row| [row.t_enter_s, row.t_exit_s]);
        let document = serde_json::json!({ "file": self.output, "window_s": window });
        printer.finish(&document, |printer| {
            printer.note(format!("figure in `{}`", self.output.display()));
        })
    }
}
