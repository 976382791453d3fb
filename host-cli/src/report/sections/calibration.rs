//! What converted the readings.

use super::super::Report;
use super::super::markup::{Cell, figure, table};
use super::facts_table;
use crate::calibration_file::CalibrationFile;
use calibration::quality::AxisQuality;
use shell_data::wrench::{Axis, PerAxis};

pub(super) fn calibration(report: &Report<'_>) -> String {
    let Some((path, file)) = report.calibration else { return String::new() };
    let mut html = String::new();
    let CalibrationFile { calibration, origin } = file;
    let mut facts = vec![
        ("file", path.to_owned()),
        ("made by", origin.made_by.clone()),
        ("date", origin.date.clone()),
        ("model", calibration.model().name()),
    ];
    if let Some(serial) = &origin.sensor_serial {
        facts.push(("sensor", serial.clone()));
    }
    if let Some(solver) = &origin.solver {
        facts.push(("solver", format!("{}, ridge {}", solver.name.name(), figure(solver.ridge))));
    }
    if let Some(diagnostics) = &origin.diagnostics {
        facts.push(("rows fitted", diagnostics.rows.to_string()));
        facts.push(("rank", diagnostics.rank.to_string()));
        facts.push(("condition number", figure(diagnostics.condition)));
    }
    html += &facts_table("The calibration", &facts);
    if let Some(diagnostics) = &origin.diagnostics {
        html += &quality_table("Errors on the training data", &diagnostics.train);
        if let Some(test) = &diagnostics.test {
            html += &quality_table("Errors on test data", test);
        }
    }
    if !origin.sources.is_empty() {
        let header = [("file", true), ("rows", false), ("checksum", true)];
        let rows: Vec<Vec<Cell>> = origin
            .sources
            .iter()
            .map(|source| {
                vec![
                    Cell::Text(source.path.display().to_string()),
                    Cell::from(source.rows),
                    Cell::Long(source.checksum.clone().unwrap_or_default()),
                ]
            })
            .collect();
        html += &table("What the calibration was made from", &header, &rows);
    }
    html
}

fn quality_table(caption: &str, axes: &PerAxis<AxisQuality>) -> String {
    let header = [
        ("axis", true),
        ("RMS", false),
        ("max", false),
        ("bias", false),
        ("R²", false),
        ("unit", false),
    ];
    let row = |(axis, quality): (Axis, &AxisQuality)| {
        vec![
            Cell::from(axis.name()),
            Cell::from(quality.rms),
            Cell::from(quality.max),
            Cell::from(quality.bias),
            Cell::from(quality.r_squared),
            Cell::Figure(axis.unit().to_owned()),
        ]
    };
    let rows: Vec<_> = Axis::ALL.into_iter().zip(axes).map(row).collect();
    table(caption, &header, &rows)
}
