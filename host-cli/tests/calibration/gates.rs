//! `shellcal eval` with limits: exit 0 only where all that was asked for was compared and is below its limit.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use shell_data::wrench::{Axes, Axis};
use system_tests::program::{self, refused, succeed};
use tempfile::TempDir;

const DATA: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../calibration-data");

/// Some of the columns of a log, by name.
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

/// `cal.json` of all axes, its training and its test log cut short.
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

/// Subsets of axes in the log against calibrations of six and fewer; all of both are gone through in the library.
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
            // Far above any error, so that what is missing alone decides.
            let gates = [
                ("--max-rms 1e9", forces),
                ("--max-rms-moment 1e9", moments),
                ("--max-rms 1e9 --max-rms-moment 1e9", Axes::ALL),
            ];
            for (gate, asked) in &gates[if position % 8 == at { 0..3 } else { 2..3 }] {
                let asked = *asked;
                let expected = match () {
                    // Never, and nothing at all.
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
    // A misspelt name is a column that is missing.
    fs::write(dir.join("slip.csv"), test.replacen("my_nm", "my_n_", 1)).unwrap();
    let cases = [
        ("f3.csv --max-rms-moment 1e-9", 1, "not compared: Mx, My, Mz, which `f3.csv`"),
        ("f3.csv --max-rms 1e9", 0, ""),
        ("slip.csv --max-rms-moment 1e9", 1, "not compared: My, which `slip.csv`"),
        ("slip.csv --max-rms-moment 1e9 --axes mx,mz", 0, ""),
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

/// A load whose square is no number once made an error of NaN, which passed.
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
