//! How the verdict on a fit is printed.

use calibration::fit::{UnseenRows, Verdict};
use calibration_file::stored::{OfAxes, Stored};
use serde::Serialize;
use shell_data::wrench::Axis;

use crate::printer::Printer;

/// Prints the verdict, before all else.
pub(super) fn print_verdict(printer: &Printer, verdict: &Verdict) -> anyhow::Result<()> {
    verdict.lines().into_iter().try_for_each(|line| printer.line(line))?;
    printer.line("")
}

/// What `--json` prints of it.
#[derive(Serialize)]
pub(super) struct VerdictReport {
    /// The same in words.
    text: Vec<String>,
    /// Errors on rows that were not used, N and N·m.
    #[serde(skip_serializing_if = "Option::is_none")]
    unseen_rms: Option<OfAxes<f64>>,
    /// The same over the range of the training loads.
    #[serde(skip_serializing_if = "Option::is_none")]
    unseen_share_of_range: Option<Vec<Option<f64>>>,
    /// `held_out`, `held_out_of_shuffled_rows` or `test`.
    #[serde(skip_serializing_if = "Option::is_none")]
    unseen_rows: Option<&'static str>,
    /// Half the width of what holds 95 % of single frames, N and N·m.
    #[serde(skip_serializing_if = "Option::is_none")]
    interval_95: Option<OfAxes<f64>>,
    /// The share of held-out rows within it, where they were counted.
    #[serde(skip_serializing_if = "Option::is_none")]
    interval_95_held: Option<OfAxes<f64>>,
    usable: bool,
    /// Axes whose error is about as large as the loads.
    useless_axes: Vec<&'static str>,
}

impl From<&Verdict> for VerdictReport {
    fn from(verdict: &Verdict) -> Self {
        let (axes, unseen) = (verdict.axes, verdict.unseen.as_ref().ok());
        let interval = verdict.interval.as_ref().ok();
        Self {
            text: verdict.lines(),
            unseen_rms: unseen.map(|of| Stored::of(&of.rms, axes)),
            unseen_share_of_range: unseen.map(|of| axes.of(&of.share_of_range)),
            unseen_rows: unseen.map(|of| match of.on {
                UnseenRows::HeldOut { are_shuffled: false, .. } => "held_out",
                UnseenRows::HeldOut { are_shuffled: true, .. } => "held_out_of_shuffled_rows",
                UnseenRows::Test(_) => "test",
            }),
            interval_95: interval.map(|of| Stored::of(&of.half_width, axes)),
            interval_95_held: interval.and_then(|of| of.held).map(|held| Stored::of(&held, axes)),
            usable: verdict.is_usable(),
            useless_axes: verdict.useless.iter().map(Axis::column).collect(),
        }
    }
}
