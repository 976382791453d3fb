//! `shellcal eval` with limits: exit code 0 only if all requested axes are compared, and are within their limits.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use shell_data::wrench::{Axes, Axis, force_at};
use simulation::sensor_model::{SensorModel, SensorParameters};
use system_tests::program::{self, refused, succeed};
use tempfile::TempDir;

const DATA: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../calibration-data");

fn cut(text: &str, is_kept: impl Fn(&str) -> bool) -> String {
    let header: Vec<&str> = text.lines().next().unwrap().split(',').collect();
    let mut out = String::new();
    for line in text.lines() {
        let fields = line.split(',').zip(&header).filter(|(_, name)| is_kept(name));
        let fields: Vec<&str> = fields.map(|(field, _)| field).collect();
        let _ = writeln!(out, "{}", fields.join(","));
    }
    out
}

fn write_axes(dir: &Path, name: &str, text: &str, axes: Axes) {
    let is_kept = |column: &str| {
        let of = Axis::ALL.into_iter().find(|axis| axis.column() == column);
        of.is_none_or(|axis| axes.contains(axis))
    };
    fs::write(dir.join(name), cut(text, is_kept)).unwrap();
}

/// Makes `cal.json` of all axes; returns its training and its test log, cut short.
fn folder() -> (TempDir, String, String) {
    let dir = tempfile::tempdir().unwrap();
    let read = |name: &str| -> String {
        let text = fs::read_to_string(Path::new(DATA).join(name)).unwrap();
        text.lines().take(301).fold(String::new(), |all, line| all + line + "\n")
    };
    let (train, test) = (read("synthetic-train.csv"), read("synthetic-test.csv"));
    fs::write(dir.path().join("train.csv"), &train).unwrap();
    fs::write(dir.path().join("test.csv"), &test).unwrap();
    succeed(dir.path(), "fit train.csv --model linear --covariance none -o cal.json");
    (dir, train, test)
}

fn subsets() -> impl Iterator<Item = Axes> {
    (1..64_u8)
        .map(|bits| Axis::ALL.into_iter().filter(|axis| bits >> axis.index() & 1 == 1).collect())
}

/// Some subsets of axes in log and calibration; a test of the library covers all.
#[test]
fn a_limit_compares_every_axis_that_it_is_for_or_fails() {
    let (dir, train, test) = folder();
    let dir = dir.path();
    let forces: Axes = Axis::ALL.into_iter().filter(|axis| !axis.is_moment()).collect();
    let moments = Axes::ALL.without(forces);
    let calibrations = [Axes::ALL, forces, moments, [Axis::Fx, Axis::Mz].into_iter().collect()];
    for (at, calibrated) in calibrations.into_iter().enumerate() {
        write_axes(dir, "some.csv", &train, calibrated);
        let name = format!("cal-{at}.json");
        succeed(dir, &format!("fit some.csv --model linear --covariance none -o {name}"));
        for (position, measured) in subsets().enumerate().filter(|(position, _)| position % 4 == at)
        {
            write_axes(dir, "log.csv", &test, measured);
            // Far above any error, so that only missing data decide.
            let gates = [
                ("--max-rms 1e9", forces),
                ("--max-rms-moment 1e9", moments),
                ("--max-rms 1e9 --max-rms-moment 1e9", Axes::ALL),
            ];
            for (gate, asked) in &gates[if position % 8 == at { 0..3 } else { 2..3 }] {
                let asked = *asked;
                let expected = match () {
                    _ if !calibrated.contain(asked) => 2,
                    _ if calibrated.and(measured).is_empty() => 2,
                    _ if !measured.contain(asked) => 1,
                    _ => 0,
                };
                let said = program::run(dir, &format!("eval {name} log.csv {gate} -q"), expected);
                let absent = asked.without(measured);
                match expected {
                    1 => assert!(
                        said.contains(&format!("not compared: {absent}, which `log.csv`")),
                        "{said}"
                    ),
                    2 => assert!(
                        said.contains("cannot be compared") || said.contains("no column"),
                        "{said}"
                    ),
                    _ => assert!(!said.contains("not compared"), "{said}"),
                }
            }
        }
    }
}

#[test]
fn axes_that_are_left_out_by_name_are_not_missed() {
    let (dir, _, test) = folder();
    let dir = dir.path();
    fs::write(dir.join("f3.csv"), cut(&test, |name| !["mx_nm", "my_nm", "mz_nm"].contains(&name)))
        .unwrap();
    // A column with a misspelt name is missing.
    fs::write(dir.join("slip.csv"), test.replacen("my_nm", "mi_nm", 1)).unwrap();
    fs::write(dir.join("unit.csv"), test.replacen("my_nm", "my_n_", 1)).unwrap();
    let cases = [
        ("f3.csv --max-rms-moment 1e-9", 1, "not compared: Mx, My, Mz, which `f3.csv`"),
        ("f3.csv --max-rms 1e9", 0, ""),
        ("slip.csv --max-rms-moment 1e9", 1, "not compared: My, which `slip.csv`"),
        ("slip.csv --max-rms-moment 1e9 --axes mx,mz", 0, ""),
        ("unit.csv --max-rms-moment 1e9", 2, "the unit `n_` of its moment is not understood"),
        ("test.csv f3.csv --max-rms-moment 1e9", 1, "not compared: Mx, My, Mz, which `f3.csv`"),
        ("f3.csv --axes fx,mx", 1, "not compared: Mx, which `f3.csv`"),
        ("f3.csv --axes fx,fy", 0, ""),
        ("test.csv --axes fz --max-rms 1e9", 0, ""),
        ("test.csv --axes fz --max-rms 1e-9", 1, "the RMS error of `Fz`"),
        ("test.csv --axes fz --max-rms-moment 1", 2, "the limit of the moments is for none"),
        ("test.csv --axes fq", 2, "fq"),
        ("test.csv --max-rms=inf", 2, "finite"),
        ("test.csv --max-rms=1e400", 2, "finite"),
        ("test.csv --max-rms=nan", 2, "finite"),
        ("test.csv --max-rms-moment=-1", 2, "not negative"),
    ];
    for (arguments, code, expected) in cases {
        let said = program::run(dir, &format!("eval cal.json {arguments} -q"), code);
        assert!(said.contains(expected), "{arguments}: {said}");
    }
    let json = program::json(dir, "eval cal.json f3.csv --axes fx,fy --json");
    assert_eq!(json["axes"], serde_json::json!(["fx_n", "fy_n"]));
}

/// Regression test: a load whose square overflows made an error of NaN, which passed.
#[test]
fn loads_that_no_sensor_measures_are_wrong_rows() {
    let (dir, _, test) = folder();
    let dir = dir.path();
    let mut lines: Vec<String> = test.lines().map(str::to_owned).collect();
    let fx = lines[0].split(',').position(|name| name == "fx_n").unwrap();
    let mut fields: Vec<&str> = lines[5].split(',').collect();
    fields[fx] = "1e200";
    lines[5] = fields.join(",");
    fs::write(dir.join("huge.csv"), lines.join("\n") + "\n").unwrap();
    for command in ["eval cal.json huge.csv", "fit huge.csv", "fit huge.csv --partial part.json"] {
        let error = refused(dir, command);
        assert!(error.contains("line 6") && error.contains("a load of at most 1e15"), "{error}");
    }
    let found = program::run(dir, "doctor huge.csv", 1);
    assert!(found.contains("a load of at most 1e15"), "{found}");
    succeed(dir, "eval cal.json huge.csv --skip-bad-rows");
}

/// A log of the shipped data's unit: 200 unloaded rows, labelled `zero`, and 200 under a mass that
/// hangs from a point (mm), labelled `weight`.
pub(crate) fn hung(mass_kg: f64, point_mm: [f64; 3]) -> String {
    let unit = SensorParameters::nominal().unit(1);
    let mut sensor = SensorModel::new(&unit, 5).unwrap();
    let mut text = String::from("t_s,s1,s2,s3,s4,s5,s6,s7,s8,group\n");
    let weight = force_at([0.0, 0.0, -9.80665 * mass_kg], point_mm.map(|mm| 1e-3 * mm));
    for row in 0..400 {
        let (load, label) = if row < 200 { ([0.0; 6], "zero") } else { (weight, "weight") };
        let time_s = 0.01 * f64::from(row);
        let readings = sensor.sample(time_s, &load).readings;
        let readings: Vec<String> = readings.iter().map(ToString::to_string).collect();
        let _ = writeln!(text, "{time_s:.2},{},{label}", readings.join(","));
    }
    text
}

/// Makes `cal.json`, `morning.csv` (200 rows `zero`, 200 `weight`) and off-axis `lever.csv`.
fn morning() -> TempDir {
    let (dir, train, _) = folder();
    fs::write(dir.path().join("forces.csv"), cut(&train, |name| !name.ends_with("_nm"))).unwrap();
    succeed(&dir, "fit forces.csv --model linear -o forces.json");
    succeed(&dir, "fit train.csv --model linear --cv -o cal.json");
    let morning = hung(0.2, [0.0, 0.0, 40.0]);
    fs::write(dir.path().join("morning.csv"), &morning).unwrap();
    fs::write(dir.path().join("light.csv"), hung(1e-4, [0.0, 0.0, 40.0])).unwrap();
    fs::write(dir.path().join("lever.csv"), hung(0.2, [30.0, 0.0, 40.0])).unwrap();
    let bad = |line: &str| match line.strip_suffix(",weight") {
        Some(row) => format!("x{row},weight\n"),
        None => format!("{line}\n"),
    };
    fs::write(dir.path().join("bad.csv"), morning.lines().map(bad).collect::<String>()).unwrap();
    dir
}

/// Writes `loads.csv`, a table of loads with these lines.
fn loads(dir: &TempDir, lines: &str) {
    let header = "group,mass_g,x_mm,y_mm,z_mm,azimuth_deg,elevation_deg";
    fs::write(dir.path().join("loads.csv"), format!("{header}\n{lines}")).unwrap();
}

#[test]
fn a_load_that_was_not_weighed_does_not_pass() {
    let dir = morning();
    let (zero, weight) = ("zero,0,,,,,\n", "weight,200,0,0,40,0,-90\n");
    let lever = "weight,200,30,0,40,0,-90\n";
    let cases = [
        (format!("{zero}{weight}"), "cal.json loads.csv morning.csv", 0, ""),
        (
            format!("{zero}{weight}ghost,99900,0,0,40,0,-90\n"),
            "cal.json loads.csv morning.csv",
            1,
            "not compared: load `ghost` (line 4: 99.9 kg at (0, 0, 40) mm, down), which no row is at",
        ),
        (
            format!("nought,0,,,,,\n{weight}"),
            "cal.json loads.csv morning.csv",
            1,
            "not compared: load `nought` (line 2: no load), which no row is at",
        ),
        (
            format!("{zero}{weight}"),
            "cal.json loads.csv bad.csv --skip-bad-rows=all",
            1,
            "not compared: load `weight`",
        ),
        (
            format!("{zero}{lever}"),
            "forces.json loads.csv lever.csv",
            1,
            "not compared: My of load `weight`",
        ),
        (format!("{zero}{lever}"), "forces.json loads.csv lever.csv --axes fx,fy,fz", 0, ""),
        (
            format!("{zero}{lever}"),
            "cal.json loads.csv morning.csv",
            1,
            "My of load `weight` differ by more than is to be expected",
        ),
        // A weight within the errors would pass even if it did not hang.
        (
            format!("{zero}{}", weight.replace("200", "0.1")),
            "cal.json loads.csv light.csv",
            1,
            "not compared: Fx, Fy, Fz, Mx, My, Mz of load `weight`, which is too light",
        ),
        (format!("{zero}{weight}"), "forces.json loads.csv morning.csv --axes mx", 1, "Mx of load"),
    ];
    for (lines, arguments, code, expected) in cases {
        loads(&dir, &lines);
        let (_, said) = program::ended(&dir, &format!("check {arguments} --group group -q"), code);
        assert!(said.contains(expected), "{arguments}: {said}");
        assert_eq!(said.is_empty(), code == 0, "{arguments}: {said}");
    }
    let certificate = "report cal.json --certificate --weights loads.csv --weights-log morning.csv \
                       --group group -o cal.html -q";
    let refit = "fit morning.csv --loads loads.csv --from cal.json --group group -q";
    let ghost = "ghost,99900,0,0,40,0,-90\n";
    for (lines, missing) in [
        (format!("{zero}{weight}{ghost}"), "not compared: load `ghost`"),
        (format!("{zero}{weight}nought,0,,,,,\n"), "not compared: load `nought`"),
    ] {
        loads(&dir, &lines);
        for command in [certificate, refit] {
            let (_, said) = program::ended(&dir, command, 1);
            assert!(said.contains(missing), "{command}: {said}");
        }
        let html = fs::read_to_string(dir.path().join("cal.html")).unwrap();
        assert!(html.contains(missing), "{html}");
    }
}

#[test]
fn a_reader_that_goes_away_is_no_success_of_a_check() {
    let dir = morning();
    loads(&dir, "zero,0,,,,,\nweight,500,0,0,40,0,-90\n");
    fs::write(dir.path().join("flat.csv"), "s1,s2,s3,s4,s5,s6,s7,s8\n").unwrap();
    let certificate = "report cal.json --certificate --weights loads.csv --weights-log morning.csv \
                       --group group -o cal.html";
    for (command, code) in [
        ("eval cal.json test.csv --max-rms 1e-9", 1),
        ("eval cal.json test.csv --max-rms 1e-9 --json", 1),
        ("eval cal.json test.csv --max-rms 1e9", 0),
        ("doctor flat.csv", 1),
        ("fit train.csv --model linear --cv --max-rms 1e-9", 1),
        ("fit train.csv --model linear --cv --max-rms 1e-9 --json", 1),
        ("check cal.json loads.csv morning.csv --group group", 1),
        (certificate, 1),
    ] {
        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        let mut run = program::command(dir.path());
        let run = run.args(command.split_whitespace()).stdout(writer);
        let output = run.output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{command}: {said}");
    }
}

/// Regression test: errors on held-out rows hid those on the test logs.
#[test]
fn a_limit_is_for_held_out_rows_and_for_test_logs() {
    let (dir, train, _) = folder();
    let fx = train.split(',').position(|name| name == "fx_n").unwrap();
    let moved = |(at, line): (usize, &str)| {
        let mut fields: Vec<String> = line.split(',').map(str::to_owned).collect();
        if at > 0 {
            fields[fx] = (fields[fx].parse::<f64>().unwrap() + 50.0).to_string();
        }
        fields.join(",") + "\n"
    };
    let far: String = train.lines().enumerate().map(moved).collect();
    fs::write(dir.path().join("far.csv"), far).unwrap();
    let fit = "fit train.csv --model linear --cv --max-rms 10 -q";
    succeed(&dir, fit);
    succeed(&dir, &format!("{fit} --test test.csv"));
    let (_, said) = program::ended(&dir, &format!("{fit} --test far.csv"), 1);
    assert!(said.contains("the RMS error of `Fx` on the test logs is 50"), "{said}");
    let (_, said) = program::ended(&dir, &format!("{fit} --test test.csv far.csv"), 1);
    assert!(said.contains("on the test logs"), "{said}");
    let (_, said) = program::ended(&dir, &fit.replace(" 10 ", " 1e-9 "), 1);
    assert!(said.contains("on rows that were held out"), "{said}");
}

#[test]
fn a_row_of_hundreds_is_no_comparison() {
    let (dir, _, test) = folder();
    let bad = |(at, line): (usize, &str)| match at {
        0 | 1 => format!("{line}\n"),
        _ => line.replacen(',', ",x", 1) + "\n",
    };
    let text: String = test.lines().enumerate().map(bad).collect();
    fs::write(dir.path().join("bad.csv"), text).unwrap();
    let eval = "eval cal.json bad.csv --skip-bad-rows=all --max-rms 1e9 -q";
    let (_, said) = program::ended(&dir, eval, 1);
    let expected = "not compared: `bad.csv`, of which 1 of 300 rows are left; at least 30 tell";
    assert!(said.contains(expected), "{said}");
    succeed(&dir, &eval.replace(" --max-rms 1e9", ""));
}
