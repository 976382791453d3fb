//! `shellcal trial`: the results of single trials.

use log_file::Log;
use shellcal::workflow::trial::{TrialJob, evaluate_in_window};
use trial::tables::trace_table;
use trial::{TraceExtent, Trial};

use super::evaluation::EvaluationArgs;
use super::show;
use crate::cmd::outputs::FigureArgs;
use crate::files::{InputPath, OutputPath};
use crate::printer::{Outcome, Printer};

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  shellcal trial run3.txt --enter 4.2 --exit 8.9 --calibration calibration.json
  shellcal trial run3.txt --calibration calibration.json --trace run3.trace.csv
  shellcal trial *.txt --find-window --calibration calibration.json --json
  shellcal trial run3.txt --find-window --calibration calibration.json --plot window.svg

The confidence of a window that was found is the share of the slow variation of the drag that one passage through a
channel explains. Look at the figure where it is below 0.8; below 0.5 nothing is proposed, and the exit code is 1.
Velocity, mass and channel of a trial are the profile's, or those of its row in a manifest.")]
pub(crate) struct TrialArgs {
    /// Log of the trial, plain or gzip; with `--find-window` any number of them
    #[arg(required = true, value_name = "LOG")]
    pub(super) logs: Vec<InputPath>,

    #[command(flatten)]
    times: WindowTimes,

    /// Only propose when the robot enters and leaves the channel: onset and end of sustained drag
    #[arg(long, conflicts_with_all = ["enter", "trace"])]
    find_window: bool,

    /// Write the time series in the window, row by row, as CSV
    #[arg(long, value_name = "FILE")]
    trace: Option<OutputPath>,

    /// Extend the trace over the whole log
    #[arg(long, requires = "trace")]
    whole_log: bool,

    #[command(flatten)]
    pub(super) figure: FigureArgs,

    #[command(flatten)]
    pub(super) evaluation: EvaluationArgs,
}

/// Times of the robot in the channel.
#[derive(Clone, Copy, Debug, clap::Args)]
pub(super) struct WindowTimes {
    /// Time of entering the channel, on the log's clock [default: found in the drag]
    #[arg(long, value_name = "S", requires = "exit", allow_negative_numbers = true)]
    enter: Option<f64>,

    /// Time of leaving the channel
    #[arg(long, value_name = "S", requires = "enter", allow_negative_numbers = true)]
    exit: Option<f64>,
}

impl WindowTimes {
    /// Both ends, s.
    pub(super) fn ends(self) -> (Option<f64>, Option<f64>) {
        (self.enter, self.exit)
    }
}

impl TrialArgs {
    pub(crate) fn run(&self, printer: &Printer) -> anyhow::Result<Outcome> {
        if self.find_window {
            return self.propose(printer);
        }
        let [path] = self.logs.as_slice() else {
            anyhow::bail!("one log is evaluated; `shellcal batch` evaluates all of a manifest");
        };
        anyhow::ensure!(
            self.figure.plot.is_none(),
            "`--plot` is for `--find-window`; `shellcal plot` draws trials"
        );
        let trace = match (&self.trace, self.whole_log) {
            (None, _) => TraceExtent::Nothing,
            (Some(_), false) => TraceExtent::Window,
            (Some(_), true) => TraceExtent::Log,
        };
        let equipment = self.evaluation.equipment(trace, printer)?;
        let log = Log::open(path, &equipment.mapping)?;
        let trace_file = printer.create(self.trace.as_ref())?;
        let name = path.display().to_string();
        let trial = Trial::from_window(name.clone(), (f64::NAN, f64::NAN));
        let job = equipment.job(&log);
        let evaluated = printer.scan(&log, job.read, |read| {
            evaluate_in_window(&TrialJob { read, ..job }, trial, self.times.ends())
        })?;
        let result = &evaluated.result;
        if let (Some(file), Some(trace)) = (trace_file, &result.trace) {
            file.commit_with(&trace_table(trace).to_csv())?;
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
        })?;
        Ok(Outcome::Done)
    }
}
