//! Trials of other robots: their profiles, and the sources of their power.

use std::fs;
use std::path::Path;

use serde_json::Value;
use system_tests::program;

fn write_log(dir: &Path, names: &str, row: impl Fn(f64) -> String) {
    let rows = (0..=300).map(|at| {
        let time_s = f64::from(at) / 100.0;
        // A turn of the leg takes half a second.
        format!("{time_s},{},{}\n", (4.0 * std::f64::consts::PI * time_s), row(time_s))
    });
    let text: String = std::iter::once(format!("t_s,leg,{names}\n")).chain(rows).collect();
    fs::write(dir.join("log.csv"), text).unwrap();
}

fn evaluate(dir: &Path, columns: &str) -> (Value, String) {
    let profile = format!(
        "base = \"velociroach\"\nname = \"tortoise\"\n[robot]\nmass_kg = 2.0\n[columns]\n\
         right_leg = {{ name = \"leg\", unit = \"rad\" }}\n{columns}"
    );
    fs::write(dir.join("robot.toml"), profile).unwrap();
    let command = "trial log.csv --enter 0.5 --exit 2.5 --profile robot.toml --json";
    let output = program::output(dir, command);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(matches!(output.status.code(), Some(0)), "{said}");
    let document: Value = serde_json::from_slice(&output.stdout).unwrap();
    let texts = document["remarks"].to_string();
    (document, texts)
}

#[test]
fn power_comes_from_the_available_columns() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    // 7.4 V and 500 mA for 2 s; and a power that rises by 1 W each second, from 0.5 to 2.5 s.
    let steady = |_| "7400,500".to_owned();
    for (names, row, columns, expected_j) in [
        (
            "U,I",
            &steady as &dyn Fn(f64) -> String,
            "battery = { name = \"U\", unit = \"mV\" }\ncurrent = { name = \"I\", unit = \"mA\" }\n",
            7.4 * 0.5 * 2.0,
        ),
        (
            "battery,power",
            &|time_s| format!("800,{time_s}"),
            "power = { unit = \"W\" }\n",
            (2.5 * 2.5 - 0.5 * 0.5) / 2.0,
        ),
    ] {
        write_log(dir, names, row);
        let (document, texts) = evaluate(dir, columns);
        let row = &document;
        let energy_j = row["electrical_energy_j"].as_f64().unwrap_or_else(|| panic!("{document}"));
        // Rounding of sums over 200 rows. The power is linear from row to row, as the integral assumes.
        assert!((energy_j / expected_j - 1.0).abs() < 1e-12, "{names}: {energy_j} J, {texts}");
        // P̄/(m·g·v̄) with l = 0.28 m of the base, in 2 s.
        let resistance = row["specific_resistance"].as_f64().unwrap();
        let expected = expected_j / 2.0 / (2.0 * 9.81 * 0.28 / 2.0);
        assert!((resistance / expected - 1.0).abs() < 1e-12, "{resistance}");
        assert_eq!(row["strides"], 4, "two turns a second for two seconds: {texts}");
    }
}

#[test]
fn units_that_are_not_known_are_asked_for_in_place_of_a_number() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let motors = "right_duty,left_duty,rbemf,lbemf,vbatt";
    write_log(dir, motors, |_| "2048,2048,0,0,3.7".to_owned());
    let command = "trial log.csv --enter 0.5 --exit 2.5 --json";
    let said = program::run(dir, command, 2);
    assert!(said.contains("reads 3.7") && said.contains("unit = \"V\""), "{said}");
    // Half duty at 3.7 V without back EMF, in two motors of 3.3 Ω.
    let (document, _) = evaluate(dir, "battery = { unit = \"V\" }\n");
    let power_w = document["mean_power_w"].as_f64().unwrap();
    assert!((power_w / (3.7 * 3.7 / 3.3) - 1.0).abs() < 1e-12, "{power_w}");
    for (columns, expected) in [
        ("battery = { unit = \"A\" }\n", "`battery` cannot be in `A`, expected `V` or `mV`"),
        ("batery = { unit = \"V\" }\n", "no column `batery`"),
        ("battery = { name = \"U\" }\n", "U"),
    ] {
        fs::write(dir.join("bad.toml"), format!("base = \"velociroach\"\n[columns]\n{columns}"))
            .unwrap();
        let said = program::run(dir, &format!("{command} --profile bad.toml"), 2);
        assert!(said.contains(expected), "{said}");
    }
}

#[test]
fn the_profile_that_is_printed_is_the_one_that_is_built_in() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    program::run(dir, "synth trial -o run.txt", 0);
    fs::write(dir.join("robot.toml"), program::output(dir, "info --robot").stdout).unwrap();
    let trial = "trial run.txt --enter 2.3 --exit 8.4 --json";
    let built_in = program::json(dir, trial);
    let read = program::json(dir, &format!("{trial} --profile robot.toml"));
    assert_eq!(read["profile"], built_in["profile"]);
}
