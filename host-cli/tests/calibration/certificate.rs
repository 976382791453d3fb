//! `shellcal report CAL.json --certificate`: a calibration on one page, in the terms of the GUM.

use std::fs;

use calibration_file::CalibrationFile;
use report::{Certificate, Contribution, Heading};
use serde_json::Value;
use system_tests::program::{ended, json, refused, succeed};

use crate::gates::hung;

fn rows(html: &str, caption: &str) -> Vec<Vec<String>> {
    let table = html.split(&format!("<caption>{caption}")).nth(1).expect("the table is there");
    let body = table.split("<tbody>").nth(1).unwrap().split("</tbody>").next().unwrap();
    let text = |cell: &str| {
        let cell = cell.rsplit_once("<td").map_or("", |(_, cell)| cell);
        cell.split('>').nth(1).unwrap_or_default().to_owned()
    };
    let cells = |row: &str| -> Vec<String> {
        let cells: Vec<&str> = row.split("</td>").collect();
        cells[..cells.len() - 1].iter().map(|cell| text(cell)).collect()
    };
    body.split("</tr>").map(cells).filter(|row| !row.is_empty()).collect()
}

fn number(text: &str) -> f64 {
    text.replace('\u{2212}', "-").parse().unwrap_or_else(|_| panic!("`{text}` is no number"))
}

#[test]
fn a_certificate_states_what_is_known_and_what_is_missing() {
    let dir = tempfile::tempdir().unwrap();
    succeed(&dir, "synth train --rows 5000 -o train.csv");
    succeed(&dir, "synth zero --rows 6000 -o rest.csv");
    succeed(&dir, "fit train.csv --model cubic --cv --serial <b>7 -o cal.json");
    let said = json(&dir, "report cal.json --certificate -o little.html --json");
    let little = fs::read_to_string(dir.path().join("little.html")).unwrap();
    assert!(little.contains("&lt;b&gt;7") && !little.contains("<b>7"), "{little}");
    assert!(little.contains("drift of the zero, reference, of which nothing was stated"));
    // Only the error on held-out groups is known.
    let file: Value =
        serde_json::from_str(&fs::read_to_string(dir.path().join("cal.json")).unwrap()).unwrap();
    let held_out = &file["diagnostics"]["cross_validation"]["grouped"];
    let combined = |said: &Value, axis: usize| {
        said["combined_standard_uncertainty"][axis].as_f64().unwrap_or_else(|| panic!("{said}"))
    };
    for axis in 0..6 {
        assert_eq!(combined(&said, axis), held_out[axis]["rms"].as_f64().unwrap());
    }
    let command = "report cal.json --certificate --unloaded rest.csv --reference-error 0.05,0.001 -o cal.html --json";
    let said = json(&dir, command);
    let html = fs::read_to_string(dir.path().join("cal.html")).unwrap();
    let noise = json(&dir, "info rest.csv --noise --calibration cal.json --json");
    let budget = rows(&html, "Uncertainty budget");
    let of = |source: &str| budget.iter().find(|row| row[0].starts_with(source)).unwrap();
    let shown = number(&of("of which repeatability")[2]);
    let expected = noise[0]["axes"]["fx_n"]["rms"].as_f64().unwrap();
    let unit = if html.contains("Fx (mN)") { 1e3 } else { 1.0 };
    assert!((shown / (unit * expected) - 1.0).abs() < 5e-3, "{shown} {expected}");
    assert_eq!(number(&of("reference")[2]), unit * 0.05);
    // The first line includes repeatability.
    let sum =
        ["model and mounting", "drift of the zero", "reference"].map(|name| number(&of(name)[2]));
    let expected = sum.iter().map(|u| u * u).sum::<f64>().sqrt();
    let found = unit * combined(&said, 0);
    assert!((found / expected - 1.0).abs() < 1e-2, "{found} {expected} {budget:?}");
    // Welch and Satterthwaite: groups, a drift from few stationary intervals, a stated reference.
    let degrees = said["effective_degrees_of_freedom"][0].as_f64().unwrap();
    let first =
        |name: &str| (number(&of(name)[2]), of(name)[8].parse::<f64>().unwrap_or(f64::INFINITY));
    let parts = ["model and mounting", "drift of the zero", "reference"].map(first);
    let expected = found.powi(4) / parts.iter().map(|(u, nu)| u.powi(4) / nu).sum::<f64>();
    // The terms are fourth powers of numbers that are shown with three digits.
    assert!((degrees / expected - 1.0).abs() < 0.05, "{degrees} {expected}");
    let k = said["coverage_factor"][0].as_f64().unwrap();
    assert!((number(&of("expanded")[2]) / (k * found) - 1.0).abs() < 5e-3, "{budget:?}");
    assert!((1.95..2.2).contains(&k), "{k}");
    // A log with loads has no repeatability.
    let said = refused(&dir, "report cal.json --certificate --unloaded train.csv -o no.html");
    assert!(said.contains("`train.csv` is of a loaded sensor: Fx scatters by"), "{said}");
    // Nor has a log under a constant load, here 300 counts on the first channel.
    let (rest, s1) = (fs::read_to_string(dir.path().join("rest.csv")).unwrap(), 1);
    assert!(rest.starts_with("t_s,s1,"), "{rest}");
    let moved = |line: &str| {
        let mut fields: Vec<String> = line.split(',').map(str::to_owned).collect();
        if let Ok(reading) = fields[s1].parse::<f64>() {
            fields[s1] = (reading + 300.0).to_string();
        }
        fields.join(",") + "\n"
    };
    fs::write(dir.path().join("held.csv"), rest.lines().map(moved).collect::<String>()).unwrap();
    let said = refused(&dir, "report cal.json --certificate --unloaded held.csv -o no.html");
    assert!(said.contains("`held.csv` is of a loaded sensor, or its zero has moved"), "{said}");
    assert!(said.contains("the mean of F") && said.contains("take the load off"), "{said}");
    assert!(of("of which repeatability")[9].contains("off the calibrated zero"), "{budget:?}");
    assert!(html.contains("xxh128:"), "{html}");
}

/// `dof` and `reporting.k_factor` of GTC 1.5.1 for the sum of `ureal(0, u, df)`.
#[test]
fn effective_degrees_of_freedom_and_coverage_are_those_of_gtc() {
    let dir = tempfile::tempdir().unwrap();
    succeed(&dir, "synth train --rows 2000 -o train.csv");
    succeed(&dir, "fit train.csv --model linear -o cal.json");
    let file = CalibrationFile::read(&dir.path().join("cal.json")).unwrap();
    for (parts, degrees, k) in [
        (
            &[(0.3, Some(5.0)), (0.12, Some(7.0)), (0.05, None)][..],
            6.927_407_649_887_074,
            2.369_656_667_845_267,
        ),
        (
            &[(0.3, Some(8.0)), (0.12, Some(3.0)), (0.4, None)][..],
            64.632_088_903_681_53,
            1.997_353_449_732_648,
        ),
        (&[(0.0113, Some(5.0))][..], 5.0, 2.570_581_835_636_314),
    ] {
        let line = |&(standard, degrees_of_freedom): &(f64, Option<f64>)| Contribution {
            source: "",
            evaluation: "A",
            basis: String::new(),
            standard: Some([standard; 6]),
            degrees_of_freedom,
            is_part: false,
        };
        let certificate = Certificate {
            heading: Heading { title: "", made_by: "", date: "", command: "" },
            file: &file,
            name: "",
            checksum: "",
            budget: &parts.iter().map(line).collect::<Vec<_>>(),
            intervals: "",
            weights: &[],
            not_compared: &[],
        };
        // Rounding; the quantile is found by a search.
        let found = certificate.degrees_of_freedom()[4];
        assert!((found / degrees - 1.0).abs() < 1e-12, "{found} {degrees}");
        let found = certificate.coverage()[4];
        assert!((found / k - 1.0).abs() < 1e-9, "{found} {k}");
    }
}

#[test]
fn check_weights_are_certified_and_one_that_is_off_fails() {
    let dir = tempfile::tempdir().unwrap();
    succeed(&dir, "synth train --rows 8000 -o train.csv");
    succeed(&dir, "fit train.csv --model linear --cv -o cal.json");
    fs::write(dir.path().join("weights.csv"), hung(0.2, [0.0, 0.0, 40.0])).unwrap();
    let table = |mass: f64| {
        let header = "group,mass_g,x_mm,y_mm,z_mm,azimuth_deg,elevation_deg";
        let text = format!("{header}\nzero,0,,,,,\nweight,{mass},0,0,40,0,-90\n");
        fs::write(dir.path().join("loads.csv"), text).unwrap();
    };
    let command = "report cal.json --certificate --weights loads.csv --weights-log weights.csv --group group -o cal.html";
    table(200.0);
    succeed(&dir, command);
    table(500.0);
    let (_, said) = ended(&dir, command, 1);
    assert!(said.contains("differ by more than is to be expected"), "{said}");
    let html = fs::read_to_string(dir.path().join("cal.html")).unwrap();
    let weights = rows(&html, "Known weights");
    assert_eq!(weights.len(), 6, "{weights:?}");
    let fz = weights.iter().find(|row| row[1] == "Fz").unwrap();
    assert_eq!((fz[2].as_str(), fz[7].as_str()), ("\u{2212}4.90", "off"), "{fz:?}");
}

#[test]
fn inconsistent_inputs_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    succeed(&dir, "synth train --rows 2000 -o train.csv");
    succeed(&dir, "fit train.csv --model linear -o cal.json");
    for (arguments, expected) in [
        ("report cal.json --certificate --reference-error 1", "expected two numbers"),
        ("report cal.json --certificate --reference-error=-1,2", "expected two numbers"),
        ("report cal.json --certificate --weights loads.csv", "--weights-log"),
        ("report cal.json --unloaded train.csv", "--certificate"),
        ("report train.csv --certificate", "not valid JSON"),
        ("report cal.json --certificate --unloaded none.csv", "none.csv"),
    ] {
        let said = refused(&dir, arguments);
        assert!(said.contains(expected), "{arguments}: {said}");
    }
}
