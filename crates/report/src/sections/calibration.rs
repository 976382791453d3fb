//! What converted the readings.

use super::super::markup::{Column, table};
use super::super::units::{AxisUnits, axis_names};
use super::super::{CalibrationFacts, Report};
use super::parts::facts_table;
use calibration::quality::AxisQuality;
use shell_data::wrench::PerAxis;

pub(super) fn calibration(report: &Report<'_>) -> String {
    let Some(calibration) = &report.calibration else { return String::new() };
    let mut html = facts_table("The calibration", &calibration.facts);
    html += &errors_table(calibration);
    html + &sources_table(calibration)
}

/// What a calibration was made from.
pub(crate) fn sources_table(calibration: &CalibrationFacts<'_>) -> String {
    let sources = &calibration.sources;
    if sources.is_empty() {
        return String::new();
    }
    let columns = [
        Column::text("used to", sources.iter().map(|of| of.role)),
        Column::text("file", sources.iter().map(|of| &of.path)),
        Column::numbers("rows", sources.iter().map(|of| of.rows)),
        Column::long("checksum", sources.iter().map(|of| of.checksum.as_deref().unwrap_or(""))),
    ];
    table("What the calibration was made from", &columns)
}

/// The errors of each axis on training data, on groups that were held out, and on test data, as far as they
/// are known; forces in one unit, moments in another.
pub(crate) fn errors_table(calibration: &CalibrationFacts<'_>) -> String {
    let mut errors: Vec<(&str, PerAxis<Option<f64>>)> = Vec::new();
    let rms = |axes: &PerAxis<AxisQuality>| axes.map(|axis| Some(axis.rms));
    errors.extend(calibration.train.map(|train| ("RMS, training", rms(train))));
    let held_out = calibration.cross_validation.map(|of| of.grouped.map(|axis| Some(axis.rms)));
    errors.extend(held_out.map(|held_out| ("RMS, held out", held_out)));
    errors.extend(calibration.test.map(|test| ("RMS, test", rms(test))));
    let Some(on) = calibration.test.or(calibration.train) else { return String::new() };
    errors.push(("largest", on.map(|axis| axis.max)));
    errors.push(("bias", on.map(|axis| Some(axis.bias))));
    let axes = calibration.axes;
    let units =
        AxisUnits::new(|axis| errors.iter().filter_map(|(_, of)| of[axis.index()]).collect());
    let mut columns = vec![axis_names(axes)];
    columns
        .extend(errors.iter().map(|(name, of)| units.column(name, axes, |axis| of[axis.index()])));
    columns.push(Column::figures("R²", axes.iter().map(|axis| on[axis.index()].r_squared)));
    columns.push(units.units(axes));
    let of = if calibration.test.is_some() { "test" } else { "training" };
    let caption = format!(
        "Errors, predicted less measured; largest error, bias and R² are those of the {of} data"
    );
    table(&caption, &columns)
}
