//! `shellcal trial --find-window`: the time of the robot in the channel.

use figures::trial::window_figure;
use log_file::Log;
use shellcal::workflow::trial::{WindowSearch, search_window};
use trial::{GOOD_CONFIDENCE, NoWindow, Proposal, TraceExtent};

use super::trial::TrialArgs;
use crate::printer::{Outcome, Printer, TableColumn};

type LogWindow = (String, Result<Proposal, NoWindow>);

impl TrialArgs {
    pub(super) fn propose(&self, printer: &Printer) -> anyhow::Result<Outcome> {
        let mut equipment = self.evaluation.equipment(TraceExtent::Log, printer)?;
        // Find windows in drag that was filtered without delay, regardless of the options.
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
                good: proposal.as_ref().is_ok_and(Proposal::is_good),
                // The reason why no window was found.
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
            Ok(proposal) if proposal.confidence < GOOD_CONFIDENCE => printer.warning(format!(
                "{log}: the confidence is below {GOOD_CONFIDENCE}: look at it with `--plot`"
            )),
            Ok(proposal) if !proposal.is_good() => printer
                .warning(format!("{log}: entry or exit is uncertain: look at it with `--plot`")),
            Ok(_) => {}
            Err(reason) => printer.warning(format!("{log}: {reason}")),
        }
    }
}
