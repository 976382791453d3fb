//! A reference with some axes: results equal those of six, and other axes are not mentioned.

use std::fs;
use std::path::Path;

use calibration_file::CalibrationFile;
use serde_json::Value;
use system_tests::program::{self, document, json};

/// Positions of the measured axes.
const PLACES: [usize; 2] = [0, 2];
const COLUMNS: [&str; 2] = ["fx_n", "fz_n"];

/// Writes `six.csv` with six axes and `two.csv` with two; twenty poses are enough for an interval.
fn logs(dir: &Path, seed: u32) -> [String; 2] {
    let [six, two] = ["six", "two"].map(|name| format!("{name}{seed}.csv"));
    program::run(dir, &format!("synth train --rows 4000 --seed {seed} -o {six}"), 0);
    let text = fs::read_to_string(dir.join(&six)).unwrap();
    let header: Vec<&str> = text.lines().next().unwrap().split(',').collect();
    let absent = ["fy_n", "mx_nm", "my_nm", "mz_nm"];
    let kept: Vec<usize> = (0..header.len()).filter(|&at| !absent.contains(&header[at])).collect();
    let line = |line: &str| -> String {
        let fields: Vec<&str> = line.split(',').collect();
        kept.iter().map(|&at| fields[at]).collect::<Vec<_>>().join(",") + "\n"
    };
    fs::write(dir.join(&two), text.lines().map(line).collect::<String>()).unwrap();
    [six, two]
}

fn axes() -> Value {
    COLUMNS.into_iter().collect()
}

/// Largest relative difference between triangular factors, whose rounding depends on columns and
/// vector width; exact sums have none.
const ROUNDING: f64 = 1e-11;

fn numbers(values: &Value) -> Vec<f64> {
    match values {
        Value::Array(values) => values.iter().flat_map(numbers).collect(),
        Value::Object(values) => values.values().flat_map(numbers).collect(),
        value => value.as_f64().into_iter().collect(),
    }
}

fn assert_same(found: &Value, expected: &Value, is_exact: bool, what: &str) {
    if is_exact {
        return assert_eq!(found, expected, "{what}");
    }
    let (found, expected) = (numbers(found), numbers(expected));
    assert_eq!(found.len(), expected.len(), "{what}");
    let largest = expected.iter().fold(0.0, |largest: f64, value| largest.max(value.abs()));
    for (found, expected) in found.iter().zip(&expected) {
        let error = (found - expected).abs() / largest;
        assert!(error <= ROUNDING, "{what}: {found} and {expected}");
    }
}

fn picked(values: &Value) -> Value {
    PLACES.iter().map(|&position| values[position].clone()).collect()
}

#[test]
fn a_fit_of_some_axes_equals_a_fit_of_six() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let [six, two] = logs(dir, 3);
    for (flags, is_exact) in [
        ("--model linear --covariance groups", true),
        ("--model linear --covariance rows", true),
        ("--model cubic --solver tsqr --covariance rows", false),
    ] {
        program::run(dir, &format!("fit {six} {flags} -o whole.json"), 0);
        program::run(dir, &format!("fit {two} {flags} -o part.json"), 0);
        program::run(dir, &format!("fit {six} {flags} --wrench fz=fz_n,Fx=fx_n -o named.json"), 0);
        let whole = document(dir, "whole.json");
        assert_eq!(whole["schema_version"], 4);
        let rows = whole["coefficients"].as_array().unwrap();
        let coefficients: Value = rows.iter().map(picked).collect();
        let residual = picked(&whole["covariance"]["residual"]);
        let residual: Value = residual.as_array().unwrap().iter().map(picked).collect();
        for name in ["named.json", "part.json"] {
            let part = document(dir, name);
            assert_eq!((&part["schema_version"], &part["axes"]), (&4.into(), &axes()));
            // A file with fewer columns is cut into other blocks. Solvers other than exact sums
            // scale features by a sample, which then has other rows.
            if name == "named.json" || is_exact {
                let what = format!("{name} {flags}");
                assert_same(&part["coefficients"], &coefficients, is_exact, &what);
                assert_same(&part["covariance"]["residual"], &residual, is_exact, &what);
                let factors = |of: &Value| of["covariance"]["coefficients"].clone();
                let (of_part, of_whole) = (factors(&part), factors(&whole));
                match of_whole.get("groups") {
                    Some(of) => assert_eq!(of_part["groups"]["factors"], picked(&of["factors"])),
                    None => assert_same(&of_part, &of_whole, is_exact, &what),
                }
            }
            let read = CalibrationFile::read(&dir.join(name)).unwrap();
            assert_eq!(read.to_json(), fs::read_to_string(dir.join(name)).unwrap());
        }
        let named = document(dir, "named.json");
        assert_eq!(named["columns"]["wrench"], axes());
        let train = |of: &Value| of["diagnostics"]["train"].clone();
        assert_same(&train(&named), &picked(&train(&whole)), is_exact, flags);
    }
    program::run(dir, &format!("fit {two} --model linear --partial part-sums.json --groups"), 0);
    program::run(dir, "merge part-sums.json -o merged.json", 0);
    program::run(dir, &format!("fit {two} --model linear -o part.json"), 0);
    let coefficients = |name: &str| document(dir, name)["coefficients"].clone();
    assert_eq!(coefficients("merged.json"), coefficients("part.json"));
    program::run(dir, &format!("fit {six} --model linear --partial six-sums.json --groups"), 0);
    let said = program::run(dir, "merge part-sums.json six-sums.json", 2);
    assert!(said.contains("it has the axes Fx, Fy, Fz, Mx, My, Mz, expected Fx, Fz"), "{said}");
}

#[test]
fn every_output_has_only_the_calibrated_axes() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let [six, two] = logs(dir, 4);
    let [six_test, two_test] = logs(dir, 5);
    let said = program::run(
        dir,
        &format!(
            "fit --model cubic {two} --test {two_test} --cv --covariance rows --verbose --plot fit.svg -o two.json"
        ),
        0,
    );
    assert!(
        said.contains("the logs have no Fy, Mx, My, Mz: the calibration is of Fx, Fz"),
        "{said}"
    );
    let rest = said.replace("the logs have no Fy, Mx, My, Mz", "");
    assert!([" Fy ", " Mx ", " My ", " Mz "].iter().all(|name| !rest.contains(name)), "{rest}");
    let named = "--wrench fx=fx_n,fz=fz_n";
    program::run(dir, &format!("fit --model linear {six} {named} -o cal.json"), 0);
    let figure = fs::read_to_string(dir.join("fit.svg")).unwrap();
    assert!(figure.contains(">Fz<") && !figure.contains(">Fy<"));
    let fitted = json(dir, &format!("fit {two} --test {two_test} --model auto --json"));
    for path in ["/axes", "/train", "/test", "/covariance/residual", "/covariance/residual/0"] {
        let values = fitted.pointer(path).and_then(Value::as_array).map(Vec::len);
        assert!(values.is_none_or(|count| count == 2), "{path}: {fitted}");
    }
    program::run(dir, &format!("fit --model linear {six} -o whole.json"), 0);
    let [part, whole] = ["cal.json", "whole.json"]
        .map(|cal| json(dir, &format!("eval {cal} {two_test} --json"))["all"]["errors"].clone());
    assert_eq!((part.as_array().unwrap().len(), &part), (2, &whole));
    // A limit on axes that are not compared fails: gates.rs.
    let said = program::run(dir, &format!("eval two.json {six_test}"), 0);
    assert!(said.contains("not compared: Fy, Mx, My, Mz"), "{said}");

    let frames = |cal: &str, extension: &str| {
        let flags = "--tare 20 --interval=90 --plot trace.svg";
        program::run(dir, &format!("convert {cal} {six_test} -o out.{extension} {flags}"), 0);
        dir.join(format!("out.{extension}"))
    };
    let text = |cal: &str| fs::read_to_string(frames(cal, "csv")).unwrap();
    let (part, whole) = (text("cal.json"), text("whole.json"));
    let names = "t_s,fx_n,fz_n,fx_se_n,fz_se_n,fx_lower_n,fz_lower_n,fx_upper_n,fz_upper_n,flags";
    assert_eq!(part.lines().next(), Some(names));
    let at: Vec<usize> = {
        let header: Vec<&str> = whole.lines().next().unwrap().split(',').collect();
        names.split(',').map(|name| header.iter().position(|h| *h == name).unwrap()).collect()
    };
    for (part, whole) in part.lines().zip(whole.lines()) {
        let whole: Vec<&str> = whole.split(',').collect();
        assert_eq!(part, at.iter().map(|&at| whole[at]).collect::<Vec<_>>().join(","));
    }
    let trace = fs::read_to_string(dir.join("trace.svg")).unwrap();
    assert!(trace.contains("Fx") && trace.contains("Mz"), "of six axes, drawn last");
    for extension in ["parquet", "mat", "npy"] {
        let path = frames("cal.json", extension);
        let said = program::run(dir, &format!("info {}", path.display()), 0);
        assert!(
            said.contains("fz_n") && !said.contains("fy_n") && !said.contains("mx_nm"),
            "{said}"
        );
    }
    let trace = fs::read_to_string(dir.join("trace.svg")).unwrap();
    assert!(trace.contains("Fx") && !trace.contains("Mz"));
    let noise = format!("info {six_test} --noise --calibration cal.json --json");
    let noise = json(dir, &noise)[0]["axes"].clone();
    assert_eq!(noise.as_object().unwrap().keys().collect::<Vec<_>>(), COLUMNS);
    let found = program::output(dir, &format!("doctor cal.json {two_test} --calibration cal.json"));
    let found = String::from_utf8(found.stdout).unwrap();
    assert!(found.contains("two5.csv"), "{found}");
    assert!([" Fy", " Mx", " My", " Mz"].iter().all(|name| !found.contains(name)), "{found}");
    program::run(dir, &format!("fit {two} --model linear --export-matrix matrix.csv"), 0);
    let matrix = fs::read_to_string(dir.join("matrix.csv")).unwrap();
    assert!(matrix.starts_with("feature,Fx_N,Fz_N\n"), "{matrix}");
    program::run(dir, "import matrix.csv -o imported.json", 0);
    assert_eq!(document(dir, "imported.json")["axes"], document(dir, "cal.json")["axes"]);
}

#[test]
fn commands_that_need_all_axes_refuse_fewer() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let [six, two] = logs(dir, 6);
    program::run(dir, &format!("fit --model cubic {six} --wrench fx=fx_n,my=my_nm -o cal.json"), 0);
    program::run(dir, "synth trials trials", 0);
    let cases = [
        (format!("fit {two} --model physics"), "the physics model needs all six axes"),
        (
            format!("fit --model cubic {six} {two}"),
            "has the axes Fx, Fz of the wrench, the logs before it have Fx",
        ),
        (format!("fit --model cubic {six} --test {two}"), "no columns `Fy`, `Mx`, `My`, `Mz`"),
        (format!("fit --model cubic {six} --wrench fx=fx_n,fx=fy_n"), "`Fx` has two columns"),
        (
            format!("fit --model cubic {six} --wrench fx_n,fz_n"),
            "2 columns, expected all six (Fx to Mz)",
        ),
        (format!("convert cal.json {six} -o out.mcap"), "all six axes of a wrench"),
        (format!("convert cal.json {six} --columns t,fy"), "the calibration gives Fx, My, not Fy"),
        (
            "batch trials/manifest.csv --calibration cal.json".to_owned(),
            "drag and lift are made of Fx and Fz: the calibration has no Fz",
        ),
        (format!("payload fit {two}"), ""),
    ];
    for (command, expected) in cases {
        let output = program::output(dir, &command);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(matches!(output.status.code(), Some(1 | 2)), "{command}: {said}");
        assert!(said.contains(expected), "{command}: {said}");
    }
    assert!(!dir.join("out.mcap").exists());
}

#[test]
fn the_report_of_forces_alone_is_silent_on_moments() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let [six, two] = logs(dir, 4);
    for (log, has_moments) in [(six, true), (two, false)] {
        program::run(dir, &format!("fit --model cubic {log} --report fit.html"), 0);
        let page = fs::read_to_string(dir.join("fit.html")).unwrap();
        assert_eq!(page.contains("Moments are about the origin"), has_moments, "{log}");
        assert_eq!(
            page.contains("Forces are along the axes of the reference"),
            !has_moments,
            "{log}"
        );
    }
}
