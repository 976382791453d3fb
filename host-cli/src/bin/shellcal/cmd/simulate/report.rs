//! What `shellcal simulate` says of a channel: tables and warnings.

use beam_channel::Model;
use simulation::channel_study::{BeamRow, ChannelSummary, DrawStatistics, MonteCarlo, beam_rows};

use super::quantity::{cm, percent};
use crate::printer::{Printer, TableColumn};
use crate::tables::{NOTHING, or_dash};

/// What was found of a channel, and how sure that is.
pub(super) type ChannelStudy = (ChannelSummary, Option<MonteCarlo>);

/// "5–6", and both walls where they differ.
fn contacts(least: Option<[u32; 2]>, greatest: Option<[u32; 2]>) -> String {
    let (Some(least), Some(greatest)) = (least, greatest) else { return NOTHING.to_owned() };
    let wall = |i: usize| match (least[i], greatest[i]) {
        (least, greatest) if least == greatest => format!("{least}"),
        (least, greatest) => format!("{least}–{greatest}"),
    };
    if wall(0) == wall(1) { wall(0) } else { format!("{}, {}", wall(0), wall(1)) }
}

pub(super) fn print_channels(printer: &Printer, studies: &[ChannelStudy]) -> anyhow::Result<()> {
    let columns: [TableColumn<'_, &ChannelSummary>; 7] = [
        ("width (cm)", &|of| cm(of.width_m)),
        ("deflection (cm)", &|of| cm(of.deflection_m)),
        ("beams per side", &|of| contacts(of.min_contacts, of.max_contacts)),
        ("mean drag (N)", &|of| or_dash(of.mean_drag_n, 4)),
        ("minimum (N)", &|of| or_dash(of.minimum_drag_n, 4)),
        ("peak (N)", &|of| or_dash(of.peak_drag_n, 4)),
        ("energy (mJ)", &|of| format!("{:.3}", 1e3 * of.energy_j)),
    ];
    printer.records(&columns, studies.iter().map(|(summary, _)| summary))
}

pub(super) fn print_uncertainty(printer: &Printer, studies: &[ChannelStudy]) -> anyhow::Result<()> {
    let with = || studies.iter().filter_map(|(summary, of)| Some((summary, of.as_ref()?)));
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
            let statistics: [fn(&DrawStatistics) -> f64; 4] =
                [|of| of.median, |of| of.low, |of| of.high, |of| of.sd];
            let mut row = vec![format!("{} cm: {name}", cm(summary.width_m))];
            row.extend(statistics.map(|of| {
                or_dash(interval.as_ref().map(|interval| scale * of(interval)), decimals)
            }));
            rows.push(row);
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

pub(super) fn warn(printer: &Printer, summary: &ChannelSummary) {
    let ChannelSummary { width_m, deflection_m, ref remarks, .. } = *summary;
    for remark in remarks {
        printer.warning(format!("channel of {} cm: {remark}", cm(width_m)));
    }
    // Half the width of the body, and what is left on either side of it.
    let (half_m, gap_m) = (deflection_m + width_m / 2.0, -deflection_m);
    if gap_m > half_m {
        printer.warning(format!(
            "channel of {} cm: the body passes {} cm away from the beams; lengths without a unit are in m",
            cm(width_m),
            cm(gap_m)
        ));
    }
}

/// The forces of a channel on the body at one position.
pub(super) fn print_beams(printer: &Printer, model: &Model, x_m: f64) -> anyhow::Result<()> {
    let total = model.total(x_m);
    printer.line("")?;
    printer.line(format!(
        "channel of {} cm, body at {} cm: drag {:.5} N, Fy {:.5} N, Mz {:.6} N·m",
        cm(model.setup().channel.width_m),
        cm(x_m),
        0.0 - total.fx_n,
        total.fy_n,
        total.mz_nm
    ))?;
    let columns: [TableColumn<'_, BeamRow>; 6] = [
        ("beam", &|beam| format!("{} {}", beam.wall, beam.beam)),
        ("base (cm)", &|beam| cm(beam.base_m)),
        ("φ (°)", &|beam| format!("{:.2}", beam.phi_rad.to_degrees())),
        ("Δθ (°)", &|beam| format!("{:.2}", beam.deflection_rad.to_degrees())),
        ("Fx (N)", &|beam| format!("{:.6}", beam.fx_n)),
        ("Fy (N)", &|beam| format!("{:.6}", beam.fy_n)),
    ];
    printer.records(&columns, beam_rows(model, x_m))
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
