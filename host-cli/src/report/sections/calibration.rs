//! What converted the readings.

use super::super::markup::{Cell, table};
use super::super::{CalibrationSource, Report};
use super::parts::facts_table;
use calibration::quality::AxisQuality;
use shell_data::wrench::{Axes, Axis, PerAxis};

pub(super) fn calibration(report: &Report<'_>) -> String {
    let Some(calibration) = &report.calibration else { return String::new() };
    let mut html = facts_table("The calibration", &calibration.facts);
    if let Some(train) = calibration.train {
        html += &quality_table("Errors on the training data", train, calibration.axes);
    }
    if let Some(test) = calibration.test {
        html += &quality_table("Errors on test data", test, calibration.axes);
    }
    if !calibration.sources.is_empty() {
        let header = [("file", true), ("rows", false), ("checksum", true)];
        let row = |source: &CalibrationSource| {
            vec![
                Cell::Text(source.path.clone()),
                Cell::from(source.rows),
                Cell::Long(source.checksum.clone().unwrap_or_default()),
            ]
        };
        let rows: Vec<Vec<Cell>> = calibration.sources.iter().map(row).collect();
        html += &table("What the calibration was made from", &header, &rows);
    }
    html
}

fn quality_table(caption: &str, qualities: &PerAxis<AxisQuality>, axes: Axes) -> String {
    let header = [
        ("axis", true),
        ("RMS", false),
        ("max", false),
        ("bias", false),
        ("R²", false),
        ("unit", false),
    ];
    let row = |(axis, quality): (Axis, AxisQuality)| {
        vec![
            Cell::from(axis.name()),
            Cell::from(quality.rms),
            Cell::from(quality.max),
            Cell::from(quality.bias),
            Cell::from(quality.r_squared),
            Cell::Figure(axis.unit().to_owned()),
        ]
    };
    let rows: Vec<_> = axes.values(qualities).into_iter().map(row).collect();
    table(caption, &header, &rows)
}
