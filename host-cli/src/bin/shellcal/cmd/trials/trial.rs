//! `shellcal trial`: the results of one trial.

use log_file::Log;
use shellcal::workflow::trial::{TrialJob, WindowTimes, evaluate_in_window};
use trial::tables::{strides_table, trace_table};
use trial::{TraceExtent, Trial};

use super::evaluation::EvaluationArgs;
use super::show;
use crate::files::{InputPath, OutputPath};
use crate::printer::Printer;

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
        let equipment = self.evaluation.equipment()?;
        let trace = match (&self.trace, self.whole_log) {
            (None, _) => TraceExtent::Nothing,
            (Some(_), false) => TraceExtent::Window,
            (Some(_), true) => TraceExtent::Log,
        };
        let options = self.evaluation.options(&equipment, trace);
        let log = Log::open(&self.log, &equipment.mapping)?;
        let trace_file = printer.create(self.trace.as_ref())?;
        let name = self.log.display().to_string();
        let trial = Trial {
            velocity_m_s: self.velocity,
            mass_kg: self.mass,
            channel_length_m: self.channel_length,
            ..Trial::from_window(name.clone(), (f64::NAN, f64::NAN))
        };
        let window = WindowTimes { enter_s: self.enter, exit_s: self.exit };
        let evaluated = printer.scan(&log, self.evaluation.read_options(), |read| {
            let job = TrialJob { log: &log, instrument: equipment.instrument(), options, read };
            evaluate_in_window(&job, trial, window)
        })?;
        let result = &evaluated.result;
        if let (Some(file), Some(trace)) = (trace_file, &result.trace) {
            file.commit_with(&trace_table(trace).to_csv())?;
        }
        if let Some(path) = &self.strides {
            printer.files.write(path, &strides_table(std::iter::once(result)).to_csv())?;
        }
        self.evaluation.note_forces(printer, &options);
        show::diagnostics(printer, &[(name, result)]);
        let document = document! {
            ..result: result,
            checksum: &evaluated.checksum,
            options: options,
            profile: &equipment.profile,
        };
        printer.finish(&document, |printer| {
            show::trials(printer, &[result])?;
            if !result.stride_rows.is_empty() {
                printer.line("")?;
                show::strides(printer, &result.stride_rows)?;
            }
            Ok(())
        })
    }
}
