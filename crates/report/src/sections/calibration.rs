use super::super::markup::{Column, facts_table, figure, table};
use super::super::units::{AxisUnits, axis_names};
use calibration::quality::AxisQuality;
use calibration_file::{CalibrationFile, Role};
use shell_data::wrench::PerAxis;

pub(super) fn calibration((name, file): (&str, &CalibrationFile)) -> String {
    facts_table("The calibration", &facts(name, file)) + &errors_table(file) + &sources_table(file)
}

pub(crate) fn facts(name: &str, file: &CalibrationFile) -> Vec<(&'static str, String)> {
    let CalibrationFile { calibration, origin } = file;
    let mut facts = vec![
        ("file", name.to_owned()),
        ("made by", origin.made_by.clone()),
        ("date", origin.date.clone()),
        ("model", calibration.name()),
    ];
    facts.extend(origin.sensor_serial.clone().map(|serial| ("sensor", serial)));
    if let Some(solver) = &origin.solver {
        facts.push(("solver", format!("{}, ridge {}", solver.name.name(), figure(solver.ridge))));
    }
    if let Some(diagnostics) = &origin.diagnostics {
        facts.push(("rows fitted", diagnostics.rows.to_string()));
        facts.push(("rank", diagnostics.rank.to_string()));
        facts.push(("condition number", figure(diagnostics.condition)));
    }
    facts
}

pub(crate) fn sources_table(file: &CalibrationFile) -> String {
    let sources = &file.origin.sources;
    if sources.is_empty() {
        return String::new();
    }
    let role = |role: Role| match role {
        Role::Train => "fit",
        Role::Test => "test",
        Role::Wrench => "give the wrench",
        Role::Matrix => "import",
        Role::Calibration => "bring up to date",
    };
    let columns = [
        Column::text("used to", sources.iter().map(|of| role(of.role))),
        Column::text("file", sources.iter().map(|of| of.path.display())),
        Column::numbers("rows", sources.iter().map(|of| of.rows)),
        Column::long("checksum", sources.iter().map(|of| of.checksum.as_deref().unwrap_or(""))),
    ];
    table("What the calibration was made from", &columns)
}

/// Errors on training data, held-out groups and test data, as far as known; forces share one unit,
/// moments another.
pub(crate) fn errors_table(file: &CalibrationFile) -> String {
    let Some(known) = &file.origin.diagnostics else { return String::new() };
    let mut errors: Vec<(&str, PerAxis<Option<f64>>)> = Vec::new();
    let rms = |axes: &PerAxis<AxisQuality>| axes.map(|axis| Some(axis.rms));
    errors.push(("RMS, training", rms(&known.train)));
    let held_out = known.cross_validation.as_ref();
    let held_out = held_out.map(|of| of.grouped.map(|axis| Some(axis.rms)));
    errors.extend(held_out.map(|held_out| ("RMS, held out", held_out)));
    errors.extend(known.test.as_ref().map(|test| ("RMS, test", rms(test))));
    let on = known.test.as_ref().unwrap_or(&known.train);
    errors.push(("largest", on.map(|axis| axis.max)));
    errors.push(("bias", on.map(|axis| Some(axis.bias))));
    let axes = file.calibration.axes;
    let units =
        AxisUnits::new(|axis| errors.iter().filter_map(|(_, of)| of[axis.index()]).collect());
    let mut columns = vec![axis_names(axes)];
    columns
        .extend(errors.iter().map(|(name, of)| units.column(name, axes, |axis| of[axis.index()])));
    columns.push(Column::figures("R²", axes.iter().map(|axis| on[axis.index()].r_squared)));
    columns.push(units.units(axes));
    let of = if known.test.is_some() { "test" } else { "training" };
    let caption = format!(
        "Errors, predicted less measured; largest error, bias and R² are those of the {of} data"
    );
    table(&caption, &columns)
}
