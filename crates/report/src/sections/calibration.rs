//! What converted the readings.

use super::super::markup::{TableCell, long, table};
use super::super::units::ColumnUnit;
use super::super::{CalibrationFacts, CalibrationSource, Report};
use super::parts::facts_table;
use calibration::quality::AxisQuality;
use shell_data::wrench::{Axis, PerAxis};

pub(super) fn calibration(report: &Report<'_>) -> String {
    let Some(calibration) = &report.calibration else { return String::new() };
    let mut html = facts_table("The calibration", &calibration.facts);
    html += &errors_table(calibration);
    html + &sources_table(calibration)
}

/// What a calibration was made from.
pub(crate) fn sources_table(calibration: &CalibrationFacts<'_>) -> String {
    if calibration.sources.is_empty() {
        return String::new();
    }
    let header = ["used to", "file", "rows", "checksum"];
    let row = |of: &CalibrationSource| {
        let checksum = long(of.checksum.as_deref().unwrap_or_default());
        vec![of.role.into(), of.path.as_str().into(), of.rows.into(), checksum]
    };
    let rows = calibration.sources.iter().map(row);
    table("What the calibration was made from", &header, rows)
}

/// The errors of each axis on training data, on groups that were held out, and on test data, as far as they
/// are known; forces in one unit, moments in another.
pub(crate) fn errors_table(calibration: &CalibrationFacts<'_>) -> String {
    let mut columns: Vec<(&str, PerAxis<Option<f64>>)> = Vec::new();
    let rms = |axes: &PerAxis<AxisQuality>| axes.map(|axis| Some(axis.rms));
    columns.extend(calibration.train.map(|train| ("RMS, training", rms(train))));
    let held_out = calibration.cross_validation.map(|of| of.grouped.map(|axis| Some(axis.rms)));
    columns.extend(held_out.map(|held_out| ("RMS, held out", held_out)));
    columns.extend(calibration.test.map(|test| ("RMS, test", rms(test))));
    let Some(on) = calibration.test.or(calibration.train) else { return String::new() };
    columns.push(("largest", on.map(|axis| axis.max)));
    columns.push(("bias", on.map(|axis| Some(axis.bias))));
    let scales = scales(|axis| columns.iter().filter_map(|(_, of)| of[axis.index()]).collect());
    let mut header = vec!["axis"];
    header.extend(columns.iter().map(|(name, _)| *name));
    header.extend(["R²", "unit"]);
    let row = |axis: Axis| {
        let scale = &scales[axis.index() / 3];
        let mut row = vec![TableCell::from(axis.name())];
        row.extend(columns.iter().map(|(_, of)| TableCell::Figure(scale.value(of[axis.index()]))));
        row.push(TableCell::from(on[axis.index()].r_squared));
        row.push(TableCell::Text(scale.unit.clone()));
        row
    };
    let of = if calibration.test.is_some() { "test" } else { "training" };
    let caption = format!(
        "Errors, predicted less measured; largest error, bias and R² are those of the {of} data"
    );
    table(&caption, &header, calibration.axes.iter().map(row))
}

/// The unit of forces and that of moments that suit some figures.
pub(crate) fn scales(of: impl Fn(Axis) -> Vec<f64>) -> [ColumnUnit; 2] {
    [&Axis::ALL[..3], &Axis::ALL[3..]]
        .map(|axes| ColumnUnit::new(axes[0].unit(), axes.iter().flat_map(|&axis| of(axis))))
}
