//! `shellcal trial` and `shellcal batch`: errors and results.

use std::fs;
use std::path::Path;
use std::process::Output;

use serde_json::Value;
use shellcal::workflow::synthetic_trials::write_log;
use simulation::synthetic_log::TrialLayout;
use simulation::virtual_robot::{ChannelForces, TrialSettings, VirtualTrial};
use system_tests::program;

const HEADER: &str = "file,condition,t_enter_s,t_exit_s";
const CALIBRATION: &str = "../calibration-data/synthetic-train.csv";

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Writes a fast trial of some three seconds; returns its window.
fn write_trial(path: &Path, seed: u64, layout: TrialLayout, missing: f64) -> [f64; 2] {
    let condition = ChannelForces { specific_resistance: 15.0, ..ChannelForces::PAPER[4] };
    let settings = TrialSettings { missing, ..TrialSettings::new(condition, seed) };
    let trial = VirtualTrial::new(settings).unwrap();
    write_log(&mut fs::File::create(path).unwrap(), &trial, layout).unwrap();
    trial.window_s
}

/// A calibration, and logs `1.txt` to `N.txt`; returns the windows.
fn folder(logs: u64) -> (tempfile::TempDir, Vec<[f64; 2]>) {
    let dir = tempfile::tempdir().unwrap();
    let train = fs::canonicalize(CALIBRATION).unwrap();
    fs::copy(train, dir.path().join("train.csv")).unwrap();
    program::succeed(dir.path(), "fit --model cubic train.csv --output cal.json");
    let windows = (1..=logs)
        .map(|seed| {
            let path = dir.path().join(format!("{seed}.txt"));
            write_trial(&path, seed, TrialLayout::Full, 0.0)
        })
        .collect();
    (dir, windows)
}

fn batch(dir: &Path, rows: &str, arguments: &str) -> Output {
    fs::write(dir.join("m.csv"), format!("{HEADER}\n{rows}")).unwrap();
    program::output(dir, &format!("batch m.csv {arguments}"))
}

/// Changes every row of a log, by its fields and its number from 0.
fn rewrite(dir: &Path, from: &str, to: &str, change: impl Fn(usize, &mut Vec<String>)) {
    let text = fs::read_to_string(dir.join(from)).unwrap();
    let mut row = 0;
    let lines = text.lines().map(|line| {
        if line.starts_with('%') {
            return line.to_owned();
        }
        let mut fields: Vec<String> = line.split(',').map(str::to_owned).collect();
        change(row, &mut fields);
        row += 1;
        fields.join(",")
    });
    fs::write(dir.join(to), lines.collect::<Vec<_>>().join("\n")).unwrap();
}

#[test]
fn shares_of_a_manifest_are_the_whole_one_after_the_other() {
    let (dir, windows) = folder(3);
    let dir = dir.path();
    let row = |log: usize, condition: &str| {
        let [enter, exit] = windows[log - 1];
        format!("{log}.txt,{condition},{enter},{exit}\n")
    };
    // The last trial overlaps the first, which another share has.
    let rows = [row(1, "a"), row(2, "b"), "none.txt,b,1,2\n".to_owned(), row(3, "a"), row(1, "b")];
    let options = "--calibration cal.json --csv";
    let whole = batch(dir, &rows.concat(), &format!("{options} whole"));
    assert_eq!(whole.status.code(), Some(1));
    let shares: Vec<Output> = (1..=3)
        .map(|k| batch(dir, &rows.concat(), &format!("{options} parts --shard {k}/3")))
        .collect();
    let codes = shares.iter().map(|share| share.status.code());
    assert_eq!(codes.collect::<Vec<_>>(), [Some(0), Some(1), Some(1)]);
    let told = |output: &Output| {
        let lines = said(output).lines().map(str::to_owned).collect::<Vec<_>>();
        lines.into_iter().filter(|line| line.starts_with("error: m.csv:")).collect::<Vec<_>>()
    };
    assert_eq!(shares.iter().flat_map(told).collect::<Vec<_>>(), told(&whole));
    assert!(
        said(&shares[2]).contains("m.csv:6:9: `1.txt`: overlaps the trial of line 2"),
        "{}",
        said(&shares[2])
    );
    for table in ["trials", "strides"] {
        let mut names: Vec<_> = fs::read_dir(dir.join("parts").join(table))
            .unwrap()
            .map(|f| f.unwrap().path())
            .collect();
        names.sort();
        let parts: Vec<String> =
            names.iter().map(|name| fs::read_to_string(name).unwrap()).collect();
        let of_first = parts[0].lines();
        let others = parts[1..].iter().flat_map(|part| part.lines().skip(1));
        let together: Vec<&str> = of_first.chain(others).collect();
        let expected = fs::read_to_string(dir.join(format!("whole/{table}.csv"))).unwrap();
        assert_eq!(together, expected.lines().collect::<Vec<_>>(), "{table}");
    }
    assert!(!dir.join("parts/conditions").exists());
    for wrong in ["0/3", "4/3", "3", "1/100000", "a/b"] {
        let output = batch(dir, &rows.concat(), &format!("{options} parts --shard {wrong}"));
        assert_eq!(output.status.code(), Some(2));
        assert!(said(&output).contains("such as `3/100`"), "{}", said(&output));
    }
}

#[test]
fn a_dead_channel_is_reported_and_has_no_interval() {
    let (dir, windows) = folder(1);
    let dir = dir.path();
    let [enter, exit] = windows[0];
    let text = fs::read_to_string(dir.join("1.txt")).unwrap();
    let header = text.lines().find(|line| line.contains("S5")).unwrap();
    let column = header.split('|').position(|name| name.trim() == "S5").unwrap();
    rewrite(dir, "1.txt", "dead.txt", |_, fields| fields[column] = "1695".to_owned());
    let command = format!("--enter {enter} --exit {exit} --calibration cal.json --json");
    let evaluate = |log: &str| {
        let output = program::output(dir, &format!("trial {log} {command}"));
        let result: Value = serde_json::from_slice(&output.stdout).unwrap();
        (said(&output), result["drag_energy_95_j"].clone())
    };
    let (sound, interval) = evaluate("1.txt");
    assert!(!sound.contains("channel 5") && interval.is_object(), "{sound} {interval}");
    let (dead, interval) = evaluate("dead.txt");
    assert!(dead.contains("channel 5 reads 1695 in every frame of the window"), "{dead}");
    assert!(interval.is_null(), "{interval}");
    let converted = program::output(dir, "convert cal.json dead.txt -o out.csv");
    assert!(said(&converted).contains("`S5` reads 1695 in every frame"), "{}", said(&converted));
}

#[test]
fn a_log_under_two_names_is_one_log() {
    let (dir, windows) = folder(1);
    let dir = dir.path();
    fs::create_dir(dir.join("m")).unwrap();
    let [enter, exit] = windows[0];
    let rows = format!("1.txt,a,{enter},{exit}\nm/../1.txt,a,{enter},{exit}\n");
    let output = batch(dir, &rows, "--calibration cal.json --as csv");
    assert!(said(&output).contains("overlaps the trial of line 2"), "{}", said(&output));
    // CSV tables name their quantity.
    let printed = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(printed.contains("\nquantity,condition,n,"), "{printed}");
    assert!(printed.contains("\ndrag energy (mJ) per trial,a,1,"), "{printed}");
}

#[test]
fn a_bad_trial_is_reported_with_its_position_and_the_others_are_finished() {
    let (dir, windows) = folder(1);
    let dir = dir.path();
    let [enter, exit] = windows[0];
    rewrite(dir, "1.txt", "back.txt", |row, fields| {
        if row == 1500 {
            fields[0] = "1000".to_owned();
        }
    });
    for copy in ["a.txt", "b.txt", "c.txt"] {
        fs::copy(dir.join("1.txt"), dir.join(copy)).unwrap();
    }
    let (early, late) = (enter + 0.1, exit - 0.1);
    let cases = [
        (format!("1.txt,x,{enter},{exit}"), None),
        (
            format!("1.txt,x,{early},{late}"),
            Some("3:9: `1.txt`: overlaps the trial of line 2: the same log from"),
        ),
        ("gone.txt,x,1,2".to_owned(), Some("4:1: cannot read `gone.txt`: No such file")),
        ("1.txt,y,2,1".to_owned(), Some("5:11: the exit at `1` s is not after the entry at `2` s")),
        (
            "a.txt,x,1,99".to_owned(),
            Some(
                "6:11: `a.txt`: the window from `1` to `99` s is not within the log, which runs from `0.000302` to",
            ),
        ),
        (
            "b.txt,x,-1,2".to_owned(),
            Some("7:9: `b.txt`: the window from `-1` to `2` s is not within the log"),
        ),
        ("back.txt,x,1,1.4".to_owned(), Some("8:1: `back.txt`: the clock jumps back from")),
        (
            "c.txt,x,1,soon".to_owned(),
            Some("9:11: `t_exit_s` is `soon`, expected a time in s or `auto`"),
        ),
    ];
    let rows: Vec<&str> = cases.iter().map(|(row, _)| row.as_str()).collect();
    let output = batch(dir, &rows.join("\n"), "-c cal.json --json");
    let said = said(&output);
    assert_eq!(output.status.code(), Some(1), "{said}");
    for (row, message) in &cases {
        if let Some(message) = message {
            assert!(said.contains(&format!("error: m.csv:{message}")), "{row}: {said}");
        }
    }
    assert!(said.contains("error: 7 of 8 trials could not be evaluated"), "{said}");
    let document: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(document["trials"].as_array().unwrap().len(), 1);
    assert_eq!(document["failures"].as_array().unwrap().len(), 7);
    assert_eq!(document["failures"][1]["line"], 4);
}

#[test]
fn impossible_numbers_are_reported_with_their_position() {
    let (dir, windows) = folder(1);
    let [enter, exit] = windows[0];
    let rows = format!("1.txt,x,{enter},{exit},0\n");
    fs::write(dir.path().join("m.csv"), format!("{HEADER},velocity_m_s\n{rows}")).unwrap();
    let output = program::output(dir.path(), "batch m.csv -c cal.json");
    assert_eq!(output.status.code(), Some(1));
    assert!(said(&output).contains("`velocity_m_s` is `0`, expected a positive number"));
    let one = format!("trial 1.txt --enter {enter} --exit {exit}");
    for (arguments, message) in [
        ("--tare 100000 -c cal.json", "frames to tare on, `100000` wanted"),
        (
            "--lowpass 600 -c cal.json",
            "cutoff `600` Hz is not between 0 and half the sampling rate",
        ),
    ] {
        let output = program::output(dir.path(), &format!("{one} {arguments}"));
        assert_eq!(output.status.code(), Some(2), "{arguments}");
        assert!(said(&output).contains(message), "{arguments}: {}", said(&output));
    }
    let output = program::output(dir.path(), "trial 1.txt --enter 1 --exit 99 -c cal.json");
    assert!(said(&output).contains("hint: times are in s on the log's clock"), "{}", said(&output));
}

#[test]
fn mistyped_conditions_and_columns_get_a_suggestion() {
    let (dir, windows) = folder(1);
    let dir = dir.path();
    let [enter, exit] = windows[0];
    let middle = 0.5 * (enter + exit);
    let parts: Vec<String> = [("free", enter), ("free", enter + 0.2), ("fere", enter + 0.4)]
        .map(|(name, from)| format!("1.txt,{name},{from},{}", from + 0.15))
        .to_vec();
    let rows = parts.join("\n");
    let output = batch(dir, &rows, "-c cal.json");
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));
    assert!(said(&output).contains("warning: m.csv:4:7: condition `fere`, did you mean `free`?"));
    let trial = format!("file = \"1.txt\"\nt_enter_s = {enter}\nt_exit_s = {middle}\n");
    let manifest =
        format!("conditions = [\"free\", \"3\"]\n[[trial]]\ncondition = \"fere\"\n{trial}");
    fs::write(dir.join("m.toml"), manifest).unwrap();
    let output = program::output(dir, "batch m.toml -c cal.json");
    assert_eq!(output.status.code(), Some(1));
    let expected = "`fere` is none of the conditions, did you mean `free`?";
    assert!(said(&output).contains(expected), "{}", said(&output));
    let output = batch(dir, &rows, "-c cal.json --reference fre");
    assert_eq!(output.status.code(), Some(2));
    assert!(said(&output).contains("did you mean `free`?"));
    fs::write(
        dir.join("m.csv"),
        format!("file,conditon,t_enter_s,t_exit_s\n1.txt,a,{enter},{middle}"),
    )
    .unwrap();
    let output = program::output(dir, "batch m.csv");
    assert_eq!(output.status.code(), Some(2));
    assert!(
        said(&output).contains("m.csv:1:6: unknown column `conditon`, did you mean `condition`?")
    );
}

#[test]
fn missing_columns_of_a_log_are_left_out_and_reported() {
    let (dir, _) = folder(0);
    let dir = dir.path();
    let window = write_trial(&dir.join("full.txt"), 5, TrialLayout::Full, 0.0);
    write_trial(&dir.join("legs.txt"), 5, TrialLayout::WithoutSensors, 0.0);
    write_trial(&dir.join("shell.csv"), 5, TrialLayout::WithoutTelemetry, 0.0);
    rewrite(dir, "full.txt", "flat.txt", |_, fields| fields[15] = "0".to_owned());
    let text = fs::read_to_string(dir.join("full.txt")).unwrap();
    fs::write(dir.join("unnamed.txt"), text.replace("VBatt", "Volts")).unwrap();
    let rows: Vec<String> = ["full.txt", "legs.txt", "shell.csv", "flat.txt", "unnamed.txt"]
        .map(|file| format!("{file},x,{},{}", window[0], window[1]))
        .to_vec();
    let output = batch(dir, &rows.join("\n"), "-c cal.json --json");
    let said = said(&output);
    assert_eq!(output.status.code(), Some(0), "{said}");
    let document: Value = serde_json::from_slice(&output.stdout).unwrap();
    let trials = document["trials"].as_array().unwrap();
    let has = |trial: usize, key: &str| !trials[trial][key].is_null();
    let keys = ["drag_energy_j", "electrical_energy_j", "specific_resistance", "strides"];
    let expected = [
        [true; 4],
        [false, true, true, true],
        [true, false, false, false],
        [true, false, false, true],
        [true, false, false, true],
    ];
    for (trial, expected) in expected.into_iter().enumerate() {
        assert_eq!(keys.map(|key| has(trial, key)), expected, "{}", trials[trial]["file"]);
    }
    for message in [
        "warning: m.csv:3: the log has no sensor columns: forces and drag energy are left out",
        "m.csv:4: the log has no right motor duty, no left motor duty, no right back EMF, no left back EMF, no battery: electrical energy and specific resistance are left out",
        "m.csv:5: the battery reads no voltage in ",
    ] {
        assert!(said.contains(message), "{message}: {said}");
    }
    assert_eq!(trials[1]["electrical_energy_j"], trials[0]["electrical_energy_j"]);
    assert_eq!(trials[3]["drag_energy_j"], trials[0]["drag_energy_j"]);
}

#[test]
fn results_by_time_hardly_change_with_a_tenth_of_the_rows_missing() {
    let (dir, _) = folder(0);
    let dir = dir.path();
    let window = write_trial(&dir.join("full.txt"), 5, TrialLayout::Full, 0.0);
    write_trial(&dir.join("holes.txt"), 5, TrialLayout::Full, 0.1);
    let rows = ["full.txt", "holes.txt"].map(|f| format!("{f},x,{},{}", window[0], window[1]));
    let output = batch(dir, &rows.join("\n"), "-c cal.json --json");
    assert!(said(&output).contains("rows are missing; all is computed by time, not by row"));
    let document: Value = serde_json::from_slice(&output.stdout).unwrap();
    let value = |trial: usize, key: &str| document["trials"][trial][key].as_f64().unwrap();
    assert_eq!(value(0, "strides"), value(1, "strides"));
    for key in ["drag_mean_n", "electrical_energy_j", "specific_resistance"] {
        // Power changes from row to row by about its own size: without 200 of 2000 rows, the mean has an
        // error of 1/√200 of that, times their share.
        let ratio = value(1, key) / value(0, key);
        assert!((ratio - 1.0).abs() < 0.01, "{key}: {ratio}");
    }
}

#[test]
fn results_are_the_same_bytes_for_any_number_of_threads() {
    let (dir, windows) = folder(6);
    let dir = dir.path();
    let rows: Vec<String> = (windows.iter().enumerate())
        .map(|(i, [enter, exit])| format!("{}.txt,{},{enter},{exit}", i + 1, i % 2))
        .collect();
    let mut first: Option<Vec<Vec<u8>>> = None;
    for threads in [1, 2, 5] {
        let out = format!(
            "-c cal.json --reference 0 --csv csv --parquet pq --traces tr --json --threads {threads}"
        );
        let output = batch(dir, &rows.join("\n"), &out);
        assert!(output.status.success(), "{}", said(&output));
        let files = [
            "csv/trials.csv",
            "csv/strides.csv",
            "csv/conditions.csv",
            "pq/trials.parquet",
            "pq/strides.parquet",
            "tr/1.2.csv",
            "tr/6.7.csv",
        ];
        let mut bytes: Vec<Vec<u8>> =
            files.iter().map(|file| fs::read(dir.join(file)).unwrap()).collect();
        bytes.push(output.stdout);
        match &first {
            None => first = Some(bytes),
            Some(first) => assert!(*first == bytes, "{threads} threads"),
        }
    }
    let trials = String::from_utf8(first.unwrap().swap_remove(0)).unwrap();
    let header =
        "file,condition,t_enter_s,t_exit_s,duration_s,velocity_m_s,rows,fresh_frames,drag_mean_n,";
    assert!(trials.starts_with(header), "{trials}");
    let files: Vec<&str> =
        trials.lines().skip(1).map(|line| line.split(',').next().unwrap()).collect();
    assert_eq!(files, ["1.txt", "2.txt", "3.txt", "4.txt", "5.txt", "6.txt"]);
}

/// Compares the tables of Parquet with those of CSV, in common packages.
const CHECK: &str = r#"
import csv, polars, pyarrow.parquet
for name in ["trials", "strides", "conditions"]:
    rows = list(csv.DictReader(open(f"csv/{name}.csv")))
    for table in [polars.read_parquet(f"pq/{name}.parquet"), pyarrow.parquet.read_table(f"pq/{name}.parquet")]:
        columns = table.to_dict(as_series=False) if isinstance(table, polars.DataFrame) else table.to_pydict()
        assert list(columns) == list(rows[0]), list(columns)
        for column, values in columns.items():
            texts = [row[column] for row in rows]
            of = lambda text, value: text if isinstance(value, str) else float(text) if text else None
            assert values == [of(text, value) for text, value in zip(texts, values)], column
strides = polars.read_parquet("pq/strides.parquet")
first = strides["t_start_s"].min()
assert polars.scan_parquet("pq/strides.parquet").filter(polars.col("t_start_s") <= first).collect().height > 0
print("checked", strides.height)
"#;

#[test]
#[ignore = "needs a Python with packages that read tables and bags"]
fn python_packages_read_the_tables() {
    let (dir, windows) = folder(2);
    let dir = dir.path();
    let rows: Vec<String> = (windows.iter().enumerate())
        .map(|(i, [enter, exit])| format!("{}.txt,{i},{enter},{exit}", i + 1))
        .collect();
    let output = batch(dir, &rows.join("\n"), "-c cal.json --csv csv --parquet pq");
    assert!(output.status.success(), "{}", said(&output));
    let checked = program::python().args(["-c", CHECK]).current_dir(dir).output().unwrap();
    assert!(checked.status.success(), "{}", String::from_utf8_lossy(&checked.stderr));
    let strides = fs::read_to_string(dir.join("csv/strides.csv")).unwrap().lines().count() - 1;
    assert_eq!(String::from_utf8_lossy(&checked.stdout).trim(), format!("checked {strides}"));
}

#[test]
fn a_manifest_in_toml_with_auto_and_exclude_is_taken() {
    let (dir, windows) = folder(2);
    let [enter, exit] = windows[0];
    let text = format!(
        "conditions = [\"3 cm\"]\n[[trial]]\nfile = \"1.txt\"\ncondition = \"3 cm\"\nt_enter_s = {enter}\n\
         t_exit_s = {exit}\nmass_kg = 0.1\n\n[[trial]]\nfile = \"2.txt\"\ncondition = \"3 cm\"\n\
         t_enter_s = \"auto\"\nt_exit_s = \"auto\"\nexclude = true\n"
    );
    fs::write(dir.path().join("m.toml"), text).unwrap();
    let document = program::json(dir.path(), "batch m.toml -c cal.json --json");
    assert_eq!(
        (&document["excluded"], document["trials"].as_array().unwrap().len()),
        (&1.into(), 1)
    );
    let row = &document["trials"][0];
    let value = |key: &str| row[key].as_f64().unwrap();
    let resistance = value("mean_power_w") / (0.1 * 9.81 * 0.28 / (exit - enter));
    // A handful of roundings.
    assert!((value("specific_resistance") / resistance - 1.0).abs() < 1e-12);
    assert!(row["checksum"].as_str().unwrap().starts_with("xxh128:"));
}

#[test]
fn statistics_of_a_table_are_printed_for_every_column() {
    let dir = tempfile::tempdir().unwrap();
    fs::write(dir.path().join("t.csv"), "cond,eta\na,1\na,2\na,3\nb,5\nb,9\n").unwrap();
    let output = program::output(dir.path(), "stats t.csv --reference a");
    let printed = String::from_utf8(output.stdout.clone()).unwrap();
    assert!(output.status.success() && printed.starts_with("eta by cond\n"), "{printed}");
    assert!(printed.contains("minus a"), "{printed}");
    let output = program::output(dir.path(), "stats t.csv --reference A");
    assert_eq!(output.status.code(), Some(2));
    assert!(said(&output).contains("did you mean `a`?"));
}

/// The numbers at the start of a document's remarks with this code, added up.
fn remarked(document: &Value, code: &str) -> u64 {
    let own = match document.get("code").and_then(Value::as_str) {
        Some(found) if found == code => {
            let text = document["text"].as_str().unwrap();
            text.split(' ').next().unwrap().parse().unwrap()
        }
        _ => 0,
    };
    let within: u64 = match document {
        Value::Array(values) => values.iter().map(|value| remarked(value, code)).sum(),
        Value::Object(values) => values.values().map(|value| remarked(value, code)).sum(),
        _ => 0,
    };
    own + within
}

#[test]
fn the_report_names_the_rows_whose_readings_cannot_be_trusted() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    program::run(dir, "synth trials trials --per-condition 1", 0);
    program::run(dir, "synth train --rows 5000 -o train.csv", 0);
    program::run(dir, "fit --model cubic train.csv -o cal.json", 0);
    // One reading of one row is at the end of the converter: at 3 s, in the window.
    let log = dir.join("trials/free-1.txt");
    let text = fs::read_to_string(&log).unwrap();
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    let time_us = |line: &String| line.split(',').next()?.parse::<u64>().ok();
    let at = lines.iter().position(|line| time_us(line) > Some(3_000_000)).unwrap();
    let mut fields: Vec<String> = lines[at].split(',').map(str::to_owned).collect();
    let third = fields.len() - 6;
    fields[third] = "4095".to_owned();
    let time_s = time_us(&lines[at]).unwrap() as f64 / 1e6;
    lines[at] = fields.join(",");
    fs::write(&log, lines.join("\n") + "\n").unwrap();

    program::run(dir, "report trials/manifest.csv --calibration cal.json -o report.html", 0);
    let page = fs::read_to_string(dir.join("report.html")).unwrap();
    let section =
        page.split("<h2 id=\"doubtful\">").nth(1).unwrap().split("</section>").next().unwrap();
    let what = format!("{time_s:.3} s: `s3` is 4095, an end of the converter");
    let row = section
        .split("<tr>")
        .find(|row| row.contains(&what))
        .unwrap_or_else(|| panic!("{section}"));
    assert!(row.contains("free-1.txt") && row.contains(&(at + 1).to_string()), "{row}");
    // As many as the remarks count: readings at the end of the converter are out of range, too.
    let document = program::json(dir, "batch trials/manifest.csv --calibration cal.json --json");
    assert_eq!(remarked(&document, "saturated"), 1);
    let counted = format!("{} frames in the windows", remarked(&document, "out_of_range"));
    assert!(section.contains(&counted), "{counted}: {section}");
    program::run(dir, "report trials/manifest.csv -o energies.html", 0);
    let page = fs::read_to_string(dir.join("energies.html")).unwrap();
    assert!(!page.contains("id=\"doubtful\""));
}

#[test]
fn settings_beside_the_logs_of_a_manifest_are_used() {
    let (dir, windows) = folder(1);
    let dir = dir.path();
    let [enter_s, exit_s] = windows[0];
    fs::create_dir(dir.join("data")).unwrap();
    fs::rename(dir.join("1.txt"), dir.join("data/1.txt")).unwrap();
    fs::copy(dir.join("data/1.txt"), dir.join("2.txt")).unwrap();
    // Two channels exchanged: other forces.
    let settings = "sensors = \"S3,S2,S1,S4,S5,S6,S7,S8\"\n";
    fs::write(dir.join("data/shellcal.toml"), settings).unwrap();
    let alone = format!("trial data/1.txt --enter {enter_s} --exit {exit_s} -c cal.json --json");
    let drag = |row: &Value| row["drag_mean_n"].as_f64().unwrap();
    let expected = drag(&program::json(dir, &alone));
    assert_ne!(expected, drag(&program::json(dir, &format!("{alone} --no-config"))));
    let row = |file: &str| format!("{file},x,{enter_s},{exit_s}\n");
    let command = "-c cal.json --json";
    let output = batch(dir, &row("data/1.txt"), command);
    let document: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(drag(&document["trials"][0]), expected, "{}", said(&output));
    program::run(dir, "report m.csv -c cal.json", 0);
    // A log without settings, and one with others.
    let two = row("data/1.txt") + &row("2.txt");
    let asked = said(&batch(dir, &two, command));
    assert!(asked.contains("not beside `2.txt`") && asked.contains("`--no-config`"), "{asked}");
    assert!(program::run(dir, "report m.csv -c cal.json", 2).contains("not beside `2.txt`"));
    fs::write(dir.join("shellcal.toml"), "lowpass = 5\n").unwrap();
    let asked = said(&batch(dir, &two, command));
    assert!(asked.contains("settings in `shellcal.toml` and in `data/shellcal.toml`"), "{asked}");
    assert!(batch(dir, &two, &format!("{command} --no-config")).status.success());
}

#[test]
fn numbers_of_a_manifest_in_other_units_are_reported() {
    let (dir, windows) = folder(1);
    let dir = dir.path();
    let [enter_s, exit_s] = windows[0];
    let mean_m_s = 0.28 / (exit_s - enter_s);
    let warnings = |velocity_m_s: f64, mass_kg: f64| {
        let row = format!(
            "{HEADER},velocity_m_s,mass_kg\n1.txt,x,{enter_s},{exit_s},{velocity_m_s},{mass_kg}\n"
        );
        fs::write(dir.join("m.csv"), row).unwrap();
        program::run(dir, "batch m.csv", 0)
    };
    let said = warnings(100.0 * mean_m_s, 87.0);
    assert!(said.contains("m.csv:2: the velocity is") && said.contains("check its unit"), "{said}");
    assert!(
        said.contains(
            "the mass is 87 kg in the manifest, but the mass in the profile is 0.0870 kg"
        ),
        "{said}"
    );
    // A robot that stops on its way, and one with a payload.
    let said = warnings(3.0 * mean_m_s, 0.3);
    assert!(!said.contains("unit"), "{said}");
}
