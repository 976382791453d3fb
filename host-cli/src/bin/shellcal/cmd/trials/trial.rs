//! Single trials: `shellcal trial`, the results of one, and `shellcal window`, when the robot was in the channel.

use figures::trial::window_figure;
use log_file::Log;
use shellcal::workflow::trial::{TrialJob, WindowSearch, evaluate_in_window, search_window};
use trial::tables::{strides_table, trace_table};
use trial::{GOOD_CONFIDENCE, NoWindow, Proposal, TraceExtent, Trial};

use super::evaluation::EvaluationArgs;
use super::show;
use crate::cmd::outputs::FigureArgs;
use crate::files::{InputPath, OutputPath};
use crate::printer::{Outcome, Printer, TableColumn};

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  shellcal trial run3.txt --enter 4.2 --exit 8.9 --calibration calibration.json
  shellcal trial run3.txt --calibration calibration.json --trace run3.trace.csv
  shellcal trial run3.txt --enter 4.2 --exit 8.9 --mass 0.091")]
pub(crate) struct TrialArgs {
    /// Log of the trial, plain or gzip
    #[arg(value_name = "LOG")]
    log: InputPath,

    /// When the robot enters the channel, on the log's clock
    #[arg(long, value_name = "S", requires = "exit", allow_negative_numbers = true)]
    enter: Option<f64>,

    /// When it leaves
    #[arg(long, value_name = "S", requires = "enter", allow_negative_numbers = true)]
    exit: Option<f64>,

    /// Mean velocity, in m/s [default: channel length over the time in it]
    #[arg(long, value_name = "M/S", allow_negative_numbers = true)]
    velocity: Option<f64>,

    /// Mass, in kg [default: the profile's]
    #[arg(long, value_name = "KG", allow_negative_numbers = true)]
    mass: Option<f64>,

    /// Length of the channel, in m [default: the profile's]
    #[arg(long, value_name = "M", allow_negative_numbers = true)]
    channel_length: Option<f64>,

    /// Write what happened in the window, row by row, as CSV
    #[arg(long, value_name = "FILE")]
    trace: Option<OutputPath>,

    /// Let the trace run over the whole log
    #[arg(long, requires = "trace")]
    whole_log: bool,

    /// Write the strides as CSV
    #[arg(long, value_name = "FILE")]
    strides: Option<OutputPath>,

    #[command(flatten)]
    evaluation: EvaluationArgs,
}

impl TrialArgs {
    pub(crate) fn run(&self, printer: &Printer) -> anyhow::Result<()> {
        let trace = match (&self.trace, self.whole_log) {
            (None, _) => TraceExtent::Nothing,
            (Some(_), false) => TraceExtent::Window,
            (Some(_), true) => TraceExtent::Log,
        };
        let equipment = self.evaluation.equipment(trace)?;
        let log = Log::open(&self.log, &equipment.mapping)?;
        let trace_file = printer.create(self.trace.as_ref())?;
        let name = self.log.display().to_string();
        let trial = Trial {
            velocity_m_s: self.velocity,
            mass_kg: self.mass,
            channel_length_m: self.channel_length,
            ..Trial::from_window(name.clone(), (f64::NAN, f64::NAN))
        };
        let job = equipment.job(&log);
        let evaluated = printer.scan(&log, job.read, |read| {
            evaluate_in_window(&TrialJob { read, ..job }, trial, (self.enter, self.exit))
        })?;
        let result = &evaluated.result;
        if let (Some(file), Some(trace)) = (trace_file, &result.trace) {
            file.commit_with(&trace_table(trace).to_csv())?;
        }
        if let Some(path) = &self.strides {
            printer.files.write(path, &strides_table(std::iter::once(result)).to_csv())?;
        }
        equipment.note_forces(printer);
        show::diagnostics(printer, &[(name, result)]);
        let document = document! {
            ..result: result,
            checksum: &evaluated.checksum,
            options: equipment.options,
            profile: &equipment.profile,
        };
        printer.finish(&document, |printer| {
            show::trials(printer, &[result]);
            if !result.stride_rows.is_empty() {
                printer.line("");
                show::strides(printer, &result.stride_rows);
            }
        })
    }
}

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  shellcal window run3.txt --calibration calibration.json --plot window.svg
  shellcal window *.txt --calibration calibration.json --json

The confidence is the share of the slow variation of the drag that one passage through a channel explains. Look
at the figure where it is below 0.8; below 0.5 nothing is proposed, and the exit code is 1.")]
pub(crate) struct WindowArgs {
    /// Logs of trials, plain or gzip
    #[arg(required = true, value_name = "LOG")]
    logs: Vec<InputPath>,

    #[command(flatten)]
    figure: FigureArgs,

    #[command(flatten)]
    evaluation: EvaluationArgs,
}

/// What was found in a log.
type LogWindow = (String, Result<Proposal, NoWindow>);

impl WindowArgs {
    pub(crate) fn run(&self, printer: &Printer) -> anyhow::Result<Outcome> {
        let mut equipment = self.evaluation.equipment(TraceExtent::Log)?;
        // As windows are looked for, whatever was asked.
        equipment.options.forces = equipment.options.forces.with_delay(false);
        anyhow::ensure!(
            equipment.calibration.is_some(),
            "without a calibration there is no drag to find a window in: name one with `--calibration`"
        );
        let mut plot = self.figure.create_of_one(&self.logs, printer)?;
        let mut found = Vec::new();
        for path in &self.logs {
            let log = Log::open(path, &equipment.mapping)?;
            let WindowSearch { time_s, drag_n, proposal } = search_window(&equipment.job(&log))?;
            let name = path.display().to_string();
            if let Some(plot) = plot.take() {
                plot.draw(|size| window_figure(size, &name, &time_s, &drag_n, proposal.as_ref()))?;
            }
            found.push((name, proposal));
        }
        equipment.note_forces(printer);
        let documents = found.iter().map(|(log, proposal)| {
            document! {
                log,
                ..proposal: proposal.as_ref().ok(),
                // Whether it can be used without a look at it.
                good: proposal.as_ref().is_ok_and(Proposal::is_good),
                // Why no window was found.
                reason: proposal.as_ref().err().map(NoWindow::to_string),
            }
        });
        let outcome = printer.decide(found.iter().all(|(_, proposal)| proposal.is_ok()));
        printer.finish(&documents.collect::<Vec<_>>(), |printer| print(printer, &found))?;
        Ok(outcome)
    }
}

fn print(printer: &Printer, found: &[LogWindow]) {
    let columns: [TableColumn<'_, (&String, Proposal)>; 8] = [
        ("log", &|(log, _)| (*log).clone()),
        ("entry (s)", &|(_, found)| format!("{:.3}", found.t_enter_s)),
        ("± se", &|(_, found)| format!("{:.3}", found.t_enter_se_s)),
        ("exit (s)", &|(_, found)| format!("{:.3}", found.t_exit_s)),
        ("± se", &|(_, found)| format!("{:.3}", found.t_exit_se_s)),
        ("drag (N)", &|(_, found)| format!("{:.4}", found.drag_n)),
        ("± se", &|(_, found)| format!("{:.4}", found.drag_se_n)),
        ("confidence", &|(_, found)| format!("{:.2}", found.confidence)),
    ];
    let proposed = found.iter().filter_map(|(log, of)| Some((log, *of.as_ref().ok()?)));
    if proposed.clone().next().is_some() {
        printer.records(&columns, proposed);
    }
    for (log, proposal) in found {
        match proposal {
            Ok(proposal) if !proposal.is_good() => printer.warning(format!(
                "{log}: the confidence is below {GOOD_CONFIDENCE}: look at it with `--plot`"
            )),
            Ok(_) => {}
            Err(reason) => printer.warning(format!("{log}: {reason}")),
        }
    }
}
