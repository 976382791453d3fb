//! What is said of one channel.

use beam_channel::Model;
use serde::Serialize;
use simulation::channel_study::{BeamRow, ChannelSummary, MonteCarlo, SweepRow, beam_rows};

use super::format::cm;
use crate::printer::{Printer, TableColumn};

/// One channel.
#[derive(Debug, Serialize)]
pub(super) struct ChannelReport {
    #[serde(flatten)]
    pub(super) summary: ChannelSummary,
    /// The beams that touch at the position asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) at: Option<Position>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) uncertainty: Option<MonteCarlo>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) positions: Option<Vec<SweepRow>>,
}

/// The body at one position.
#[derive(Debug, Serialize)]
pub(super) struct Position {
    x_m: f64,
    drag_n: f64,
    fy_n: f64,
    mz_nm: f64,
    beams: Vec<BeamRow>,
}

impl ChannelReport {
    pub(super) fn new(model: &Model, at: Option<f64>) -> Self {
        let at = at.map(|x_m| {
            let total = model.total(x_m);
            Position {
                x_m,
                drag_n: 0.0 - total.fx_n,
                fy_n: total.fy_n,
                mz_nm: total.mz_nm,
                beams: beam_rows(model, x_m).collect(),
            }
        });
        Self { summary: ChannelSummary::new(model), at, uncertainty: None, positions: None }
    }

    pub(super) fn warn(&self, printer: &Printer) {
        for remark in &self.summary.remarks {
            printer.warning(format!("channel of {} cm: {remark}", cm(self.summary.width_m)));
        }
        // Half the width of the body, and what is left on either side of it.
        let ChannelSummary { width_m, deflection_m, .. } = self.summary;
        let (half_m, gap_m) = (deflection_m + width_m / 2.0, -deflection_m);
        if gap_m > half_m {
            printer.warning(format!(
                "channel of {} cm: the body passes {} cm away from the beams; lengths without a unit are in m",
                cm(width_m),
                cm(gap_m)
            ));
        }
    }

    /// The forces at the position asked for, if one was.
    pub(super) fn print_beams(&self, printer: &Printer) -> anyhow::Result<()> {
        let Some(Position { x_m, drag_n, fy_n, mz_nm, beams }) = &self.at else { return Ok(()) };
        printer.line("")?;
        printer.line(format!(
            "channel of {} cm, body at {} cm: drag {drag_n:.5} N, Fy {fy_n:.5} N, Mz {mz_nm:.6} N·m",
            cm(self.summary.width_m),
            cm(*x_m)
        ))?;
        let columns: [TableColumn<'_, &BeamRow>; 6] = [
            ("beam", &|beam| format!("{} {}", beam.wall, beam.beam)),
            ("base (cm)", &|beam| cm(beam.base_m)),
            ("φ (°)", &|beam| format!("{:.2}", beam.phi_rad.to_degrees())),
            ("Δθ (°)", &|beam| format!("{:.2}", beam.deflection_rad.to_degrees())),
            ("Fx (N)", &|beam| format!("{:.6}", beam.fx_n)),
            ("Fy (N)", &|beam| format!("{:.6}", beam.fy_n)),
        ];
        printer.records(&columns, beams)
    }
}
