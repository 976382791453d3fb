//! How the verdict on a fit is printed.

use calibration::fit::{UnseenRows, Verdict};
use serde::Serialize;

use crate::document::document;
use crate::printer::Printer;

/// Prints the verdict, before all else.
pub(super) fn print_verdict(printer: &Printer, verdict: &Verdict) -> anyhow::Result<()> {
    verdict.lines().into_iter().try_for_each(|line| printer.line(line))?;
    printer.line("")
}

/// What `--json` prints of it.
pub(super) fn document(verdict: &Verdict) -> impl Serialize + use<> {
    let (axes, unseen) = (verdict.axes, verdict.unseen.as_ref().ok());
    let interval = verdict.interval.as_ref().ok();
    document! {
        // The same in words.
        text: verdict.lines(),
        // Errors on rows that were not used, N and N·m.
        unseen_rms?: unseen.map(|of| axes.of(&of.rms)),
        // The same over the range of the training loads.
        unseen_share_of_range?: unseen.map(|of| axes.of(&of.share_of_range)),
        unseen_rows?: unseen.map(|of| match of.on {
            UnseenRows::HeldOut { are_shuffled: false, .. } => "held_out",
            UnseenRows::HeldOut { are_shuffled: true, .. } => "held_out_of_shuffled_rows",
            UnseenRows::Test(_) => "test",
        }),
        // Half the width of what holds 95 % of single frames, N and N·m.
        interval_95?: interval.map(|of| axes.of(&of.half_width)),
        // The share of held-out rows within it, where they were counted.
        interval_95_held?: interval.and_then(|of| of.held).map(|held| axes.of(&held)),
        usable: verdict.is_usable(),
        // Axes whose error is about as large as the loads.
        useless_axes: verdict.useless.columns(),
    }
}
