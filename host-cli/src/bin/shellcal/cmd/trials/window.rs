//! `shellcal window`: when the robot was in the channel.

use figures::trial::window_figure;
use log_file::Log;
use shellcal::workflow::trial::{TrialJob, WindowSearch, search_window};
use trial::{GOOD_CONFIDENCE, NoWindow, Proposal, TraceExtent, TrialOptions};

use super::evaluation::EvaluationArgs;
use crate::cmd::figure_size::FigureSize;
use crate::files::{InputPath, OutputPath};
use crate::printer::{Outcome, Printer, TableColumn};

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

    /// Draw the drag and what was found in it, as SVG, PDF or PNG; of one log
    #[arg(long, value_name = "FILE")]
    plot: Option<OutputPath>,

    #[command(flatten)]
    figure_size: FigureSize,

    #[command(flatten)]
    evaluation: EvaluationArgs,
}

/// What was found in a log.
type LogWindow = (String, Result<Proposal, NoWindow>);

impl WindowArgs {
    pub(crate) fn run(&self, printer: &Printer) -> anyhow::Result<Outcome> {
        let equipment = self.evaluation.equipment()?;
        anyhow::ensure!(
            equipment.calibration.is_some(),
            "without a calibration there is no drag to find a window in: name one with `--calibration`"
        );
        anyhow::ensure!(
            self.plot.is_none() || self.logs.len() == 1,
            "`--plot` draws one log, and there are {}",
            self.logs.len()
        );
        let mut plot = self.figure_size.create(self.plot.as_ref(), printer)?;
        let options = self.evaluation.options(&equipment, TraceExtent::Log);
        let mut found = Vec::new();
        for path in &self.logs {
            let log = Log::open(path, &equipment.mapping)?;
            let read = self.evaluation.read_options();
            let job = TrialJob { log: &log, instrument: equipment.instrument(), options, read };
            let WindowSearch { time_s, drag_n, proposal } = search_window(&job)?;
            let name = path.display().to_string();
            if let Some(plot) = plot.take() {
                plot.draw(|size| window_figure(size, &name, &time_s, &drag_n, proposal.as_ref()))?;
            }
            found.push((name, proposal));
        }
        let forces = options.forces.with_delay(false);
        self.evaluation.note_forces(printer, &TrialOptions { forces, ..options });
        let documents = found.iter().map(|(log, proposal)| {
            document! {
                log: log,
                ..proposal: proposal.as_ref().ok(),
                // Whether it can be used without a look at it.
                good: proposal.as_ref().is_ok_and(Proposal::is_good),
                // Why no window was found.
                reason: proposal.as_ref().err().map(NoWindow::to_string),
            }
        });
        printer.finish(&documents.collect::<Vec<_>>(), |printer| print(printer, &found))?;
        let refused = found.iter().any(|(_, proposal)| proposal.is_err());
        Ok(if refused { Outcome::CheckFailed } else { Outcome::Done })
    }
}

fn print(printer: &Printer, found: &[LogWindow]) -> anyhow::Result<()> {
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
        printer.records(&columns, proposed)?;
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
    Ok(())
}
