//! Tables and warnings of `shellcal simulate`.

use simulation::channel_study::ChannelSummary;

use super::args::cm;
use crate::printer::{Printer, TableColumn};
use crate::tables::{NOTHING, or_dash};

/// A range such as "5–6", for both walls if they differ.
fn contacts(least: Option<[u32; 2]>, greatest: Option<[u32; 2]>) -> String {
    let (Some(least), Some(greatest)) = (least, greatest) else { return NOTHING.to_owned() };
    let wall = |i: usize| match (least[i], greatest[i]) {
        (least, greatest) if least == greatest => format!("{least}"),
        (least, greatest) => format!("{least}–{greatest}"),
    };
    if wall(0) == wall(1) { wall(0) } else { format!("{}, {}", wall(0), wall(1)) }
}

pub(super) fn print_channels(printer: &Printer, channels: &[ChannelSummary]) {
    let columns: [TableColumn<'_, &ChannelSummary>; 7] = [
        ("width (cm)", &|of| cm(of.width_m)),
        ("deflection (cm)", &|of| cm(of.deflection_m)),
        ("beams per side", &|of| contacts(of.min_contacts, of.max_contacts)),
        ("mean drag (N)", &|of| or_dash(of.mean_drag_n, 4)),
        ("minimum (N)", &|of| or_dash(of.minimum_drag_n, 4)),
        ("peak (N)", &|of| or_dash(of.peak_drag_n, 4)),
        ("energy (mJ)", &|of| format!("{:.3}", 1e3 * of.energy_j)),
    ];
    printer.records(&columns, channels)
}

pub(super) fn warn(printer: &Printer, summary: &ChannelSummary) {
    let ChannelSummary { width_m, deflection_m, ref remarks, .. } = *summary;
    for remark in remarks {
        printer.warning(format!("channel of {} cm: {remark}", cm(width_m)));
    }
    // Half the width of the body, and the gap on either side of it.
    let (half_m, gap_m) = (deflection_m + width_m / 2.0, -deflection_m);
    if gap_m > half_m {
        printer.warning(format!(
            "channel of {} cm: the body passes {} cm away from the beams; lengths without a unit are in m",
            cm(width_m),
            cm(gap_m)
        ));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn walls_are_distinguished_only_where_they_differ() {
        let said = |least, greatest| contacts(Some(least), Some(greatest));
        assert_eq!(said([4, 4], [5, 5]), "4–5");
        assert_eq!(said([5, 4], [5, 5]), "5, 4–5");
        assert_eq!(contacts(None, None), "–");
    }
}
