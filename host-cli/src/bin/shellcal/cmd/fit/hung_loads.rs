//! Output of `shellcal fit --loads` on the loads.

use calibration::physics::uncertain_loads::{CorrectedLoad, LoadQuantity};
use calibration::quality::significant;
use load_table::{HungLoad, Pull};
use serde::Serialize;
use shellcal::workflow::hung_loads::HungReference;

use crate::printer::{Printer, TableColumn};

/// If the scatter, in units of the stated error, is above this, the stated errors are reported as
/// too small.
const TOO_SMALL: f64 = 1.5;

pub(super) fn document(hung: &HungReference) -> impl Serialize {
    let load = |(load, found): (&HungLoad, &CorrectedLoad)| {
        document! {
            group: load.group.clone(),
            line: load.line,
            stated: load.to_string(),
            // The corrected wrench, N and N·m.
            wrench: found.wrench,
            // Corrected minus stated value, with standard errors.
            force_correction_n: found.force_n,
            angle_correction_deg: <[f64; 2]>::from(found.angle_rad).map(f64::to_degrees),
            lever_correction_mm: found.lever_m.map(|metres| 1e3 * metres),
            // The part of the line that is probably wrong.
            suspicious: found.suspicious.map(name),
        }
    };
    let mounting = |(label, offset): (&String, &[f64; 3])| {
        document! {
            mounting: label.clone(),
            lever_offset_mm: offset.map(|metres| 1e3 * metres),
        }
    };
    let (loads, mountings) = (&hung.corrected.loads, &hung.corrected.mountings);
    document! {
        loads: hung.loads.iter().zip(loads).map(load).collect::<Vec<_>>(),
        mountings: hung.mountings.iter().zip(mountings).map(mounting).collect::<Vec<_>>(),
        // Scatter of sizes, directions and levers, in stated errors.
        scatter_in_stated_errors: hung.corrected.scatter,
        loads_without_readings: &hung.unread,
        rows_without_load: hung.unloaded_rows,
    }
}

fn name(quantity: LoadQuantity) -> &'static str {
    match quantity {
        LoadQuantity::Size => "size",
        LoadQuantity::Direction => "direction",
        LoadQuantity::Lever => "point",
    }
}

pub(super) fn print(printer: &Printer, hung: &HungReference) {
    let degrees = |radians: f64| format!("{:.1}", radians.to_degrees());
    let columns: [TableColumn<'_, (&HungLoad, &CorrectedLoad)>; 6] = [
        ("load", &|(load, _)| load.group.clone()),
        ("as stated", &|(load, _)| load.to_string()),
        ("size N", &|(_, found)| format!("{:+.3}", found.force_n.0)),
        ("angle °", &|(_, found)| <[f64; 2]>::from(found.angle_rad).map(degrees).join(" ± ")),
        ("point mm", &|(_, found)| millimetres(found.lever_m)),
        ("", &|(_, found)| {
            found.suspicious.map_or_else(String::new, |of| format!("{}?", name(of)))
        }),
    ];
    printer.records(&columns, hung.loads.iter().zip(&hung.corrected.loads));
    for (label, offset) in hung.mountings.iter().zip(&hung.corrected.mountings) {
        let offset = millimetres(*offset);
        printer.line(format!("mounting `{label}`: its levers are off by {offset} mm"));
    }
}

/// An offset along x, y and z, in mm.
fn millimetres(offset_m: [f64; 3]) -> String {
    offset_m.map(|metres| format!("{:+.1}", 1e3 * metres)).join(" ")
}

pub(super) fn tell_repeated(hung: &HungReference, printer: &Printer) {
    let (loads, distinct) = (hung.loads.len(), hung.distinct);
    if distinct < loads {
        printer.note(format!(
            "{distinct} different loads among {loads}: equal ones are held out together"
        ));
    }
}

pub(super) fn tell(hung: &HungReference, printer: &Printer) {
    for (load, found) in hung.suspicious() {
        printer.warning(warning(load, found));
    }
    for (scatter, quantity) in hung.corrected.scatter.iter().zip(LoadQuantity::ALL) {
        if *scatter > TOO_SMALL {
            let (name, times) = (name(quantity), significant(*scatter, 2));
            printer.note(format!("the {name} of loads scatters by {times} times the stated error"));
        }
    }
    if hung.unloaded_rows > 0 {
        printer.note(format!("left out {} rows at no load of the table", hung.unloaded_rows));
    }
    printer.note(
        "errors on held-out poses are against the loads as stated, whose own errors they include",
    );
}

pub(in crate::cmd) fn warning(load: &HungLoad, found: &CorrectedLoad) -> String {
    let (HungLoad { group, line, .. }, said) = (load, load.to_string());
    let of = format!("load `{group}` (line {line}: {said})");
    let instead = |pull: Pull| HungLoad { pull, ..load.clone() }.to_string();
    match (found.suspicious, load.pull) {
        (Some(LoadQuantity::Direction), Pull::Force { force_n, mass_kg, point_m, .. }) => {
            let (angle, error) = found.angle_rad;
            let pull = Pull::Force { force_n, mass_kg, point_m, direction: found.direction };
            format!(
                "{of} pulled {:.1}° ± {:.1}° off that direction, as {} would: a mistyped angle?",
                angle.to_degrees(),
                error.to_degrees(),
                instead(pull),
            )
        }
        (Some(LoadQuantity::Lever), _) => {
            let offset = millimetres(found.lever_m);
            format!("{of} pulled at a point off by {offset} mm: a mistyped lever?")
        }
        _ => {
            let (off, error) = found.force_n;
            format!("{of} pulled with {off:+.3} ± {error:.3} N more: another mass?")
        }
    }
}
