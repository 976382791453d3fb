//! How the errors of a calibration are printed, by `fit` and `eval` alike.

use calibration::quality::{AxisQuality, significant};
use calibration_file::Diagnostics;
use shell_data::wrench::{Axes, Axis, PerAxis};

use crate::printer::Printer;
use crate::tables::shown;

/// One row of the table: RMS, max and R² of every set side by side, and the unit.
pub(super) fn table_row(axis: Axis, sets: &[&PerAxis<AxisQuality>]) -> Vec<String> {
    let figures: [fn(&AxisQuality) -> String; 3] = [
        |quality| significant(quality.rms, 4),
        |quality| shown(quality.max, |max| significant(max, 4)),
        |quality| shown(quality.r_squared, r_squared),
    ];
    let mut row = vec![axis.name().to_owned()];
    for figure in figures {
        row.extend(sets.iter().map(|set| figure(&set[axis.index()])));
    }
    row.push(axis.unit().to_owned());
    row
}

/// The table of errors on training and test rows.
pub(super) fn print_errors(
    printer: &Printer,
    diagnostics: &Diagnostics,
    axes: Axes,
) -> anyhow::Result<()> {
    let sets: Vec<&PerAxis<AxisQuality>> =
        [Some(&diagnostics.train), diagnostics.test.as_ref()].into_iter().flatten().collect();
    let mut header = vec!["axis"];
    for (train, test) in
        [("RMS train", "RMS test"), ("max train", "max test"), ("R² train", "R² test")]
    {
        header.extend([train, test].iter().take(sets.len()));
    }
    header.push("unit");
    let rows = axes.iter().map(|axis| table_row(axis, &sets));
    printer.table(&header, rows)
}

/// R² down to the digit that tells it from 1.
fn r_squared(value: f64) -> String {
    if value < 0.9999 { format!("{value:.4}") } else { format!("{value:.7}") }
}

/// The forces, and the moments, of some axes in their order, each as `text` has it, with the unit after them.
pub(super) fn by_unit(
    values: &[(Axis, f64)],
    text: impl Fn(Axis, f64) -> String,
) -> impl Iterator<Item = String> {
    values.chunk_by(|(a, _), (b, _)| a.unit() == b.unit()).map(move |group| {
        let texts: Vec<String> = group.iter().map(|&(axis, value)| text(axis, value)).collect();
        format!("{} {}", texts.join(" "), group[0].0.unit())
    })
}

/// Values of axes in one line, as `Fx 0.12 N, Fy 0.3 N`, or without their units.
pub(super) fn in_line(axes: Axes, values: &PerAxis<f64>, with_units: bool) -> String {
    let value = |axis: Axis| {
        let unit = if with_units { format!(" {}", axis.unit()) } else { String::new() };
        format!("{} {}{unit}", axis.name(), significant(values[axis.index()], 3))
    };
    axes.iter().map(value).collect::<Vec<_>>().join(", ")
}
