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
fn a_negative_energy_is_reported() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let columns =
        "battery = { name = \"U\", unit = \"V\" }\ncurrent = { name = \"I\", unit = \"A\" }\n";
    let said = |current: &dyn Fn(f64) -> f64| {
        write_log(dir, "U,I", |time_s| format!("7.4,{}", current(time_s)));
        let (document, texts) = evaluate(dir, columns);
        (document["electrical_energy_j"].as_f64().unwrap(), texts)
    };
    let (energy_j, text) = said(&|_| 0.5);
    assert!(energy_j > 0.0 && !text.contains("negative_energy"), "{text}");
    // The wires are exchanged; or one reading in 2 s, for 10 ms, is a sentinel.
    for current in [&(|_| -0.5) as &dyn Fn(f64) -> f64, &|t| if t == 1.0 { -9999.0 } else { 0.5 }] {
        let (energy_j, text) = said(current);
        assert!(energy_j < 0.0 && text.contains("negative_energy"), "{energy_j} {text}");
    }
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
    // With the battery alone, duty and back EMF would be counts of another board.
    fs::write(
        dir.join("robot.toml"),
        "base = \"velociroach\"\n[columns]\nbattery = { unit = \"V\" }\n",
    )
    .unwrap();
    let said = program::run(dir, &format!("{command} --profile robot.toml"), 2);
    assert!(
        said.contains("unit of `right_duty`, `left_duty`, `right_back_emf`, `left_back_emf`"),
        "{said}"
    );
    // Half duty at 3.7 V without back EMF, in two motors of 3.3 Ω.
    let all = "battery = { unit = \"V\" }\nright_duty = { unit = \"counts\" }\nleft_duty = { unit = \"counts\" }\n\
               right_back_emf = { unit = \"V\" }\nleft_back_emf = { unit = \"V\" }\n";
    let (document, _) = evaluate(dir, all);
    let power_w = document["mean_power_w"].as_f64().unwrap();
    assert!((power_w / (3.7 * 3.7 / 3.3) - 1.0).abs() < 1e-12, "{power_w}");
    for (columns, expected) in [
        (
            "battery = { unit = \"A\" }\n",
            "`battery` cannot be in `A`, expected a unit of voltage (V, mV)",
        ),
        ("batery = { unit = \"V\" }\n", "no column `batery`"),
        ("battery = { name = \"U\" }\n", "U"),
    ] {
        fs::write(dir.join("bad.toml"), format!("base = \"velociroach\"\n[columns]\n{columns}"))
            .unwrap();
        let said = program::run(dir, &format!("{command} --profile bad.toml"), 2);
        assert!(said.contains(expected), "{said}");
    }
}

/// The duty, back EMF and battery of two motors of 3.3 Ω: 0.4·7.4·(7.4 − 3.7)/3.3 W each, for 2 s.
const MOTORS_J: f64 = 2.0 * 2.0 * 0.4 * 7.4 * 3.7 / 3.3;

#[test]
fn units_in_the_log_are_used() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let command = "trial log.csv --enter 0.5 --exit 2.5 --json";
    let names = |units: [&str; 6]| {
        let names = ["Right Leg Pos", "DCR", "DCL", "RBEMF", "LBEMF", "VBatt"];
        names.iter().zip(units).map(|(name, unit)| format!("{name}{unit}")).collect::<Vec<_>>()
    };
    let milli = [" (deg)", " (%)", " [%]", " (mV)", "_mV", " in mV"];
    let [degrees, volts] = ["40,40,3700,3700,7400", "0.4,0.4,3.7,3.7,7.4"];
    for (names, units, row) in [
        (names(milli.map(|unit| if unit.contains('(') { unit } else { " (mV)" })), "", degrees),
        (names([""; 6]), "s,deg,%,percent,mV,mV,millivolts\n", degrees),
        (names([""; 6]), "s,deg,1,1,V,V,volts\n", volts),
    ] {
        let names = names.join(",").replace("DCL (mV)", "DCL [%]");
        let rows: String = (0..=300)
            .map(|at| format!("{},{},{row}\n", f64::from(at) / 100.0, f64::from(at) * 7.2))
            .collect();
        fs::write(dir.join("log.csv"), format!("t_s,{names}\n{units}{rows}")).unwrap();
        let document = program::json(dir, command);
        let energy_j = document["electrical_energy_j"].as_f64().unwrap();
        // Rounding of sums over 200 rows.
        assert!((energy_j / MOTORS_J - 1.0).abs() < 1e-12, "{names}: {energy_j}");
        assert_eq!(document["strides"], 4, "{names}");
    }
    // The profile says what the log says, or nothing of it, or the trial is refused.
    for (name, unit, expected) in [
        ("I_mA", "", Ok(7.4 * 0.5 * 2.0)),
        ("I (mA)", ", unit = \"mA\"", Ok(7.4 * 0.5 * 2.0)),
        ("I (total)", ", unit = \"mA\"", Ok(7.4 * 0.5 * 2.0)),
        ("I (mA)", ", unit = \"A\"", Err("line 1: column `I (mA)` is in `mA`, but in `A`")),
        ("I (V)", ", unit = \"A\"", Err("line 1: column `I (V)` is in `V`, but in `A`")),
        ("I (counts)", ", unit = \"A\"", Err("is in `counts`, but in `A`")),
        (
            "I (knots)",
            "",
            Err("line 1: column `I (knots)`: the unit `knots` of its current is not"),
        ),
    ] {
        write_log(dir, &format!("{name},VBatt (mV)"), |_| "500,7400".to_owned());
        let columns = format!("current = {{ name = \"{name}\"{unit} }}\n");
        match expected {
            Ok(expected_j) => {
                let (document, texts) = evaluate(dir, &columns);
                let energy_j = document["electrical_energy_j"].as_f64().expect(&texts);
                assert!((energy_j / expected_j - 1.0).abs() < 1e-12, "{name}: {energy_j}");
            }
            Err(expected) => {
                let profile = format!("base = \"velociroach\"\n[columns]\n{columns}");
                fs::write(dir.join("robot.toml"), profile).unwrap();
                let said = program::run(dir, &format!("{command} --profile robot.toml"), 2);
                assert!(said.contains(expected), "{said}");
            }
        }
    }
    let said = program::run(dir, "info log.csv --unit current=mA", 2);
    assert!(said.contains("those of telemetry are in the robot's profile"), "{said}");
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

#[test]
fn a_clock_that_may_number_the_rows_is_asked_for_its_unit() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let rows: String = (0..3000).map(|row| format!("{row},1.5\n")).collect();
    fs::write(dir.join("log.csv"), format!("time,Power (W)\n{rows}")).unwrap();
    let trial = "trial log.csv --enter 0.5 --exit 2.5";
    let said = program::run(dir, trial, 2);
    assert!(said.contains("line 1: the time unit of column `time` is not known"), "{said}");
    assert!(said.contains("`--time-unit`"), "{said}");
    let document = program::json(dir, &format!("{trial} --time-unit ms --json"));
    // 1.5 W for 2 s; rounding of sums over 2000 rows.
    assert!((document["electrical_energy_j"].as_f64().unwrap() - 3.0).abs() < 1e-12, "{document}");
    program::run(dir, "trial log.csv --enter 500 --exit 2500 --unit time=s", 0);
    program::run(dir, "info log.csv", 0);
    // The name has the unit.
    for name in ["time_s", "Time_s", "timestamp_s"] {
        fs::write(dir.join("named.csv"), format!("{name},Power (W)\n{rows}")).unwrap();
        program::run(dir, "trial named.csv --enter 500 --exit 2500", 0);
    }
}
