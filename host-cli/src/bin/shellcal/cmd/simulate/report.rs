//! Tables of channels.

use std::collections::BTreeMap;

use beam_channel::{Angle, Normal, Setup};
use serde::Serialize;
use simulation::channel_study::{ChannelSummary, DrawStatistics, Parameter};

use super::channel::ChannelReport;
use super::format::{cm, percent};
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
