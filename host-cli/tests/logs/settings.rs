//! Options that are typed once: settings in the folder of the data, and column names that a calibration stores.

use std::fs;
use std::path::Path;

use serde_json::Value;
use system_tests::program;

const SENSORS: &str = "IR a,IR b,IR c,IR d,IR e,IR f,IR g,IR h";

/// A log with unknown columns, moments in N·mm and time in ms.
fn write_log(dir: &Path, name: &str, seed: u32) {
    program::run(dir, &format!("synth train --rows 400 --seed {seed} -o plain.csv"), 0);
    let text = fs::read_to_string(dir.join("plain.csv")).unwrap();
    let mut lines = text.lines();
    let names: Vec<&str> = lines.next().unwrap().split(',').collect();
    assert_eq!(
        names[..15].join(","),
        "t_s,s1,s2,s3,s4,s5,s6,s7,s8,fx_n,fy_n,fz_n,mx_nm,my_nm,mz_nm"
    );
    let mut log = format!("clock,{SENSORS},a1,a2,a3,b1,b2,b3\n");
    for line in lines {
        let mut fields: Vec<String> = line.split(',').take(15).map(str::to_owned).collect();
        for at in [0, 12, 13, 14] {
            fields[at] = (fields[at].parse::<f64>().unwrap() * 1e3).to_string();
        }
        log.push_str(&fields.join(","));
        log.push('\n');
    }
    fs::write(dir.join(name), log).unwrap();
}

const SETTINGS: &str = "sensors = [\"IR a\", \"IR b\", \"IR c\", \"IR d\", \"IR e\", \"IR f\", \"IR g\", \"IR h\"]\n\
                        wrench = \"a1,a2,a3,b1,b2,b3\"\nmoment-unit = \"N·mm\"\ntime = \"clock\"\n\
                        time-unit = \"ms\"\nlowpass = 5\n";

fn folder() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    fs::create_dir(dir.path().join("data")).unwrap();
    write_log(dir.path(), "data/train.csv", 5);
    write_log(dir.path(), "data/test.csv", 6);
    fs::write(dir.path().join("data/shellcal.toml"), SETTINGS).unwrap();
    dir
}

#[test]
fn units_of_the_command_line_are_added_to_those_of_the_file() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let rows: String = (0..40).map(|at| format!("{at},{at},5,6\n")).collect();
    fs::write(dir.join("log.csv"), format!("clock,fx,fy,mx\n{rows}")).unwrap();
    fs::write(dir.join("shellcal.toml"), "time = \"clock\"\nunit = \"force=kN,time=ms\"\n")
        .unwrap();
    let words = |options: &str| {
        let document = program::json(dir, &format!("info log.csv --json {options}"));
        let columns = document[0]["columns"].as_array().unwrap().clone();
        columns.iter().map(|of| of["meaning"].as_str().unwrap().to_owned()).collect::<Vec<_>>()
    };
    assert_eq!(words(""), ["time (ms)", "Fx (N, from kN)", "Fy (N, from kN)", "Mx (N·m)"]);
    let both = words("--unit fx=mN,moment=mNm");
    assert_eq!(both, ["time (ms)", "Fx (N, from mN)", "Fy (N, from kN)", "Mx (N·m, from mN·m)"]);
}

#[test]
fn settings_beside_the_data_are_options_of_every_command() {
    let dir = folder();
    let dir = dir.path();
    program::run(dir, "fit data/train.csv --model linear -o by_file.json", 0);
    let typed = [
        "fit",
        "data/train.csv",
        "--model",
        "linear",
        "-o",
        "typed.json",
        "--no-config",
        "--sensors",
        SENSORS,
        "--wrench",
        "a1,a2,a3,b1,b2,b3",
        "--moment-unit",
        "N·mm",
        "--time",
        "clock",
        "--time-unit",
        "ms",
    ];
    assert!(program::command(dir).args(typed).output().unwrap().status.success());
    let coefficients = |name: &str| -> Value {
        let text = fs::read_to_string(dir.join(name)).unwrap();
        serde_json::from_str::<Value>(&text).unwrap()["coefficients"].clone()
    };
    assert_eq!(coefficients("by_file.json"), coefficients("typed.json"));
    // The command line has precedence, and the source of each option is named.
    let said = program::run(
        dir,
        "convert by_file.json data/test.csv -o out.csv --verbose --no-lowpass",
        0,
    );
    assert!(
        said.contains("--sensors IR a,IR b") && said.contains("data/shellcal.toml`, line 1"),
        "{said}"
    );
    assert!(!said.contains("--lowpass 5"), "{said}");
    let said = program::run(dir, "convert by_file.json data/test.csv -o out.csv --verbose", 0);
    assert!(said.contains("--lowpass 5: from `data/shellcal.toml`, line 6"), "{said}");
    assert!(said.contains("5 Hz"), "{said}");
    program::run(dir, "fit --model cubic data/train.csv --no-config -o x.json", 2);
    fs::rename(dir.join("data/shellcal.toml"), dir.join("other.toml")).unwrap();
    program::run(dir, "fit data/train.csv --config other.toml --model linear -o moved.json", 0);
    assert_eq!(coefficients("moved.json"), coefficients("typed.json"));
}

#[test]
fn partial_fits_hand_on_the_columns_that_all_of_them_have() {
    let dir = folder();
    let dir = dir.path();
    for name in ["train", "test"] {
        let command = format!("fit data/{name}.csv --model linear --partial {name}.json");
        program::run(dir, &command, 0);
    }
    program::run(dir, "synth train --rows 400 --seed 7 -o other.csv", 0);
    program::run(dir, "fit other.csv --model linear --partial other.json", 0);
    for (parts, has_columns) in
        [("train.json test.json", true), ("test.json train.json", true), ("other.json", false)]
    {
        program::run(dir, &format!("merge {parts} -o merged.json"), 0);
        let text = fs::read_to_string(dir.join("merged.json")).unwrap();
        let merged: Value = serde_json::from_str(&text).unwrap();
        assert_eq!(merged["columns"]["sensors"][0] == "IR a", has_columns, "{parts}");
    }
    let said = program::run(dir, "merge train.json other.json test.json -o mixed.json", 2);
    assert!(said.contains("its column 1 is `s1`, expected `IR a`"), "{said}");
}

#[test]
fn a_calibration_remembers_the_columns_that_it_was_fitted_with() {
    let dir = folder();
    let dir = dir.path();
    program::run(dir, "fit data/train.csv --model linear --covariance rows -o cal.json", 0);
    fs::remove_file(dir.join("data/shellcal.toml")).unwrap();
    let errors = program::json(dir, "eval cal.json data/test.csv --json");
    let expected = {
        fs::write(dir.join("s.toml"), SETTINGS).unwrap();
        program::json(dir, "eval cal.json data/test.csv --json --config s.toml")
    };
    assert_eq!(errors, expected);
    let said = program::run(dir, "eval cal.json data/test.csv --verbose", 0);
    assert!(
        said.contains("`data/test.csv`: sensors, wrench, time as `cal.json` remembers"),
        "{said}"
    );
    // N·mm read as N·m would be a thousand times as large.
    assert!(errors["all"]["errors"][3]["rms"].as_f64().unwrap() < 0.1, "{errors}");
    program::run(dir, "synth train --rows 400 --seed 6 -o usual.csv", 0);
    let usual = program::json(dir, "eval cal.json usual.csv --json");
    let rms = |document: &Value| document["all"]["errors"][0]["rms"].as_f64().unwrap();
    assert!((rms(&usual) / rms(&errors) - 1.0).abs() < 1e-9, "the same recording: {usual}");
    // The user's column names are kept.
    let text = fs::read_to_string(dir.join("data/test.csv")).unwrap();
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    let mut fields: Vec<String> = lines[1].split(',').map(str::to_owned).collect();
    fields[2] = "4095".to_owned();
    lines[1] = fields.join(",");
    fs::write(dir.join("far.csv"), lines.join("\n") + "\n").unwrap();
    program::run(dir, "convert cal.json far.csv --no-lowpass --no-tare -o far_out.csv", 0);
    let out = fs::read_to_string(dir.join("far_out.csv")).unwrap();
    let flags = out.lines().nth(1).unwrap().rsplit(',').next().unwrap();
    assert!(flags.contains("IR_b:range"), "{flags}");
}

#[test]
fn faults_of_settings_are_reported_with_their_line() {
    let dir = folder();
    let dir = dir.path();
    for (settings, expected) in [
        (
            "lowpass = 5\nsensor = \"1-8\"\n",
            "shellcal.toml`, line 2: unknown key `sensor`; the nearest is `sensors`",
        ),
        ("calibration = \"id.json\"\n", "unknown key `calibration`; expected one of `format`,"),
        ("x = 1\n", "unknown key `x`; expected one of `format`,"),
        ("time_unit = \"s\"\n", "unknown key `time_unit`; the nearest is `time-unit`"),
        ("lowpass = \n", "shellcal.toml`, line 1"),
        ("lowpass = \"soft\"\n", "shellcal.toml`: invalid value 'soft' for '--lowpass"),
        ("tare = { n = 5 }\n", "line 1: `tare` is neither a text, a number nor a list"),
    ] {
        fs::write(dir.join("data/shellcal.toml"), settings).unwrap();
        program::run(dir, "synth train --rows 60 --seed 5 -o cal.csv", 0);
        program::run(dir, "fit cal.csv --model linear -o cal.json", 0);
        let said = program::run(dir, "convert cal.json data/test.csv -o out.csv", 2);
        assert!(said.contains(expected), "{said}");
    }
    assert!(!dir.join("out.csv").exists());
    fs::write(dir.join("data/shellcal.toml"), SETTINGS).unwrap();
    fs::copy(dir.join("data/shellcal.toml"), dir.join("shellcal.toml")).unwrap();
    let said = program::run(dir, "convert cal.json data/test.csv -o out.csv", 2);
    assert!(said.contains("say which are meant with `--config`"), "{said}");
    let said = program::run(
        dir,
        "fit --model cubic data/train.csv --no-config --sensors 2-9 --wrench a1,a2,a3,b1,b2,b33 -o x.json",
        2,
    );
    assert!(said.contains("hint: did you mean `b3` for `b33`?"), "{said}");
}
