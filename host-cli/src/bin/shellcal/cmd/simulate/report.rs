//! What is said of channels.

use std::collections::BTreeMap;

use beam_channel::{Angle, Model, Normal, Setup};
use serde::Serialize;
use simulation::channel_study::{
    BeamRow, ChannelSummary, DrawStatistics, MonteCarlo, Parameter, SweepRow, beam_rows,
};

use super::quantity::{cm, percent};
use crate::printer::{Printer, TableColumn};
use crate::tables::{NOTHING, or_dash};

/// What all channels have in common, for `--json`.
pub(super) fn setup(setup: &Setup) -> impl Serialize + use<> {
    let common = Parameter::ALL.into_iter().filter(|of| of.name != Parameter::WIDTH.name);
    let parameters = common.map(|of| (of.column(), of.get(setup)));
    document! {
        parameters: parameters.collect::<BTreeMap<_, _>>(),
        beams: setup.channel.beams,
        torsional_stiffness_nm_rad: setup.beam.torsional_stiffness(),
        as_printed: setup.rules.normal == Normal::AsPrinted,
        true_angle: setup.rules.angle == Angle::True,
        moment_balance?: (setup.rules.normal == Normal::MomentBalance).then_some(true),
    }
}

/// "5–6", and both walls where they differ.
fn contacts(least: Option<[u32; 2]>, greatest: Option<[u32; 2]>) -> String {
    let (Some(least), Some(greatest)) = (least, greatest) else { return NOTHING.to_owned() };
    let wall = |i: usize| match (least[i], greatest[i]) {
        (least, greatest) if least == greatest => format!("{least}"),
        (least, greatest) => format!("{least}–{greatest}"),
    };
    if wall(0) == wall(1) { wall(0) } else { format!("{}, {}", wall(0), wall(1)) }
}

pub(super) fn print_channels(printer: &Printer, reports: &[ChannelReport]) -> anyhow::Result<()> {
    let columns: [TableColumn<'_, &ChannelSummary>; 7] = [
        ("width (cm)", &|of| cm(of.width_m)),
        ("deflection (cm)", &|of| cm(of.deflection_m)),
        ("beams per side", &|of| contacts(of.min_contacts, of.max_contacts)),
        ("mean drag (N)", &|of| or_dash(of.mean_drag_n, 4)),
        ("minimum (N)", &|of| or_dash(of.minimum_drag_n, 4)),
        ("peak (N)", &|of| or_dash(of.peak_drag_n, 4)),
        ("energy (mJ)", &|of| format!("{:.3}", 1e3 * of.energy_j)),
    ];
    printer.records(&columns, reports.iter().map(|report| &report.summary))
}

pub(super) fn print_uncertainty(
    printer: &Printer,
    reports: &[ChannelReport],
) -> anyhow::Result<()> {
    let with = || reports.iter().filter_map(|r| Some((&r.summary, r.uncertainty.as_ref()?)));
    let Some((_, first)) = with().next() else { return Ok(()) };
    let mut rows = Vec::new();
    for (summary, result) in with() {
        let figures = [
            ("mean drag (N)", result.mean_drag_n, 1.0, 4),
            ("minimum (N)", result.minimum_drag_n, 1.0, 4),
            ("peak (N)", result.peak_drag_n, 1.0, 4),
            ("energy (mJ)", result.energy_j, 1e3, 3),
        ];
        for (name, interval, scale, decimals) in figures {
            let figure = |of: fn(&DrawStatistics) -> f64| {
                or_dash(interval.as_ref().map(|interval| scale * of(interval)), decimals)
            };
            rows.push(vec![
                format!("{} cm: {name}", cm(summary.width_m)),
                figure(|interval| interval.median),
                figure(|interval| interval.low),
                figure(|interval| interval.high),
                figure(|interval| interval.sd),
            ]);
        }
    }
    printer.line("")?;
    printer.line(format!(
        "{} draws; intervals hold {} % of them",
        first.draws,
        percent(first.level)
    ))?;
    printer.table(&["channel", "median", "from", "to", "s.d."], rows)?;
    for (summary, result) in with() {
        for (count, what) in [
            (result.refused, "make no sense or jam, and are left out"),
            (result.without_plateau, "have no plateau, and count for the energy alone"),
        ] {
            if count > 0 {
                let (width, draws) = (cm(summary.width_m), result.draws);
                printer.warning(format!("channel of {width} cm: {count} of {draws} draws {what}"));
            }
        }
    }
    Ok(())
}

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn walls_are_told_apart_only_where_they_differ() {
        let said = |least, greatest| contacts(Some(least), Some(greatest));
        assert_eq!(said([4, 4], [5, 5]), "4–5");
        assert_eq!(said([5, 4], [5, 5]), "5, 4–5");
        assert_eq!(contacts(None, None), "–");
    }
}
