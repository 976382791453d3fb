//! `shellcal doctor` names planted faults, and finds none in sound set-ups. Faults of files are
//! planted in the shipped recordings and in calibrations fitted to them, faults of boards in a fake
//! board on a pty. Unit tests of `board-link` and `doctor` plant faults of the system (permissions,
//! adapters).

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};
use system_tests::program::{self, refused, succeed};

use crate::sealed::sealed_value;

/// Runs the doctor: exit code, findings that are not fine with their severity, and stderr.
pub(crate) fn examine(dir: &Path, arguments: &str) -> (i32, Vec<(String, String)>, String) {
    let output = program::output(dir, &format!("--json doctor {arguments}"));
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    let code = output.status.code().unwrap();
    let report: Value = serde_json::from_slice(&output.stdout)
        .unwrap_or_else(|error| panic!("{arguments}: {error}; {said}"));
    let mut found = Vec::new();
    for one in report["examined"].as_array().unwrap() {
        for finding in one["findings"].as_array().unwrap() {
            let text = |name: &str| finding[name].as_str().unwrap().to_owned();
            if text("severity") != "fine" {
                assert!(!text("advice").is_empty(), "{finding}");
                found.push((text("check"), text("severity")));
            }
        }
    }
    let faults = found.iter().filter(|(_, severity)| severity == "fault").count();
    assert_eq!(code, i32::from(faults > 0), "{arguments}: {report}");
    assert_eq!(report["faults"], faults);
    (code, found, report.to_string())
}

fn assert_found(dir: &Path, arguments: &str, expected: &[(&str, &str)]) {
    let (_, found, report) = examine(dir, arguments);
    let found: Vec<_> = found.iter().map(|(c, s)| (c.as_str(), s.as_str())).collect();
    assert_eq!(found, expected, "{arguments}: {report}");
}

fn shipped(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../calibration-data").join(name)
}

struct Table {
    header: Vec<String>,
    rows: Vec<Vec<f64>>,
}

impl Table {
    fn shipped(name: &str) -> Self {
        Self::read(&shipped(name))
    }

    fn read(path: &Path) -> Self {
        let text = fs::read_to_string(path).unwrap();
        let mut lines = text.lines();
        let header: Vec<String> = lines.next().unwrap().split(',').map(str::to_owned).collect();
        let numeric = header.iter().filter(|name| *name != "group").count();
        let row = |line: &str| {
            line.split(',').take(numeric).map(|field| field.parse().unwrap()).collect()
        };
        Self { rows: lines.map(row).collect(), header: header[..numeric].to_vec() }
    }

    fn at(&self, name: &str) -> usize {
        self.header.iter().position(|column| column == name).unwrap()
    }

    fn change(mut self, name: &str, change: impl Fn(usize, f64) -> f64) -> Self {
        let at = self.at(name);
        for (index, row) in self.rows.iter_mut().enumerate() {
            row[at] = change(index, row[at]);
        }
        self
    }

    fn swap(mut self, first: &str, second: &str) -> Self {
        let (first, second) = (self.at(first), self.at(second));
        self.rows.iter_mut().for_each(|row| row.swap(first, second));
        self
    }

    fn without(mut self, names: &[&str]) -> Self {
        for name in names {
            let at = self.at(name);
            self.header.remove(at);
            self.rows.iter_mut().for_each(|row| _ = row.remove(at));
        }
        self
    }

    fn text(&self) -> String {
        let line = |row: &Vec<f64>| row.iter().map(f64::to_string).collect::<Vec<_>>().join(",");
        let rows: Vec<String> = self.rows.iter().map(line).collect();
        format!("{}\n{}\n", self.header.join(","), rows.join("\n"))
    }

    fn write(&self, dir: &Path, name: &str) {
        fs::write(dir.join(name), self.text()).unwrap();
    }
}

const WRENCH: [&str; 6] = ["fx_n", "fy_n", "fz_n", "mx_nm", "my_nm", "mz_nm"];

fn calibrate(dir: &Path) {
    let (train, test) = (shipped("synthetic-train.csv"), shipped("synthetic-test.csv"));
    let files = format!("{} --test {}", train.display(), test.display());
    succeed(dir, &format!("fit --model cubic {files} --output cal.json"));
}

#[test]
fn sound_logs_and_calibrations_are_sound() {
    let dir = tempfile::tempdir().unwrap();
    calibrate(dir.path());
    let logs = ["synthetic-train.csv", "synthetic-test.csv", "synthetic-zero.csv"];
    let logs = logs.map(|name| shipped(name).display().to_string()).join(" ");
    let (code, found, report) =
        examine(dir.path(), &format!("{logs} cal.json --calibration cal.json"));
    assert_eq!((code, found), (0, Vec::new()), "{report}");
    let said = succeed(dir.path(), "doctor cal.json");
    assert!(
        said.starts_with("cal.json\n  ok ") && said.ends_with("\nno problems found\n"),
        "{said}"
    );
}

#[test]
fn planted_faults_of_logs_are_found() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    calibrate(dir);
    let zero = || Table::shipped("synthetic-zero.csv").without(&WRENCH);
    let test = || Table::shipped("synthetic-test.csv");
    let found = |name: &str, table: &Table, expected: &[(&str, &str)]| {
        table.write(dir, name);
        assert_found(dir, name, expected);
    };
    let with_calibration = |name: &str, table: &Table, expected: &[(&str, &str)]| {
        table.write(dir, name);
        assert_found(dir, &format!("{name} --calibration cal.json"), expected);
    };

    // 1 A photointerrupter without a supply, 2 one that is not connected.
    found("dead.csv", &zero().change("s3", |_, _| 812.0), &[("channel-dead", "fault")]);
    found("open.csv", &zero().change("s3", |_, _| 4095.0), &[("channel-dead", "fault")]);
    // 3 A reflector too near: a third of the range is cut off, at the converter's end or before it.
    let near = |limit: f64| test().change("s5", move |_, s| (s * 2.0).min(limit));
    found("near.csv", &near(4095.0), &[("channel-saturated", "fault")]);
    found("supply.csv", &near(3300.0), &[("channel-saturated", "fault")]);
    // 4 A dark emitter: the converter's last digit.
    let dark = zero().change("s7", |row, _| 10.0 + (row % 3 == 0) as u8 as f64);
    found("dark.csv", &dark, &[("channel-quiet", "warning")]);
    // 5 One wire to two inputs.
    let mut shared = zero();
    shared.rows.iter_mut().for_each(|row| row[2] = row[5]);
    found("shared.csv", &shared, &[("channels-identical", "fault")]);
    // 6 Two plugs exchanged, with a reference and without.
    with_calibration("swap.csv", &test().swap("s1", "s2"), &[("channels-swapped", "fault")]);
    let unloaded = zero().swap("s2", "s7");
    with_calibration("swap0.csv", &unloaded, &[("channels-swapped", "fault")]);
    // 7 Losses: every tenth frame, 8 a clock that was set back, 9 one that is too coarse.
    let mut lossy = zero();
    let mut row = 0;
    lossy.rows.retain(|_| {
        row += 1;
        row % 10 != 0
    });
    found("lossy.csv", &lossy, &[("losses", "fault")]);
    let set = zero().change("t_s", |row, t| if row < 250 { t } else { t - 20.0 });
    found("set.csv", &set, &[("time-backward", "fault")]);
    // Concatenated training recordings are groups of a fit.
    let joined = test().change("t_s", |row, t| if row < 400 { t } else { t - 40.0 });
    found("joined.csv", &joined, &[("time-backward", "warning")]);
    let coarse = zero().change("t_s", |_, t| (t * 5.0).floor() / 5.0);
    found("coarse.csv", &coarse, &[("time-equal", "warning")]);
    // 10 Times of arrival in bursts, 11 no time at all.
    let bursts = zero().change("t_s", |row, t| t + [0.0, 0.04, -0.04, 0.03, -0.02][row % 5]);
    found("bursts.csv", &bursts, &[("jitter", "warning")]);
    found("timeless.csv", &zero().without(&["t_s"]), &[("no-time", "warning")]);
    // 12 Moments in mN·m under names in N·m.
    let milli = ["mx_nm", "my_nm", "mz_nm"]
        .into_iter()
        .fold(test(), |table, name| table.change(name, |_, moment| moment * 1000.0));
    found("milli.csv", &milli, &[("moment-unit", "fault")]);
    // 13 A line that was cut, 14 a log that is too short, 15 a file that is no log.
    let text = zero().text().replacen("\n2", "\nx2", 1);
    fs::write(dir.join("cut.csv"), text).unwrap();
    assert_found(dir, "cut.csv", &[("bad-rows", "fault"), ("losses", "warning")]);
    let mut short = zero();
    short.rows.truncate(30);
    found("short.csv", &short, &[("short", "warning")]);
    fs::write(dir.join("notes.txt"), "Sensor 7, 3 May.\nThe shell was off.\n").unwrap();
    assert_found(dir, "notes.txt", &[("unreadable", "fault")]);
    fs::write(dir.join("table.csv"), "speed,mass\n1,2\n3,4\n").unwrap();
    assert_found(dir, "table.csv", &[("no-values", "fault")]);
    // 16 Loads beyond those of the training, 17 another sensor's calibration.
    let beyond = (1..=8)
        .map(|channel| format!("s{channel}"))
        .fold(zero(), |table, name| table.change(&name, |_, s| s + 1600.0));
    beyond.write(dir, "beyond.csv");
    let (_, found_beyond, report) = examine(dir, "beyond.csv --calibration cal.json");
    assert!(found_beyond.contains(&("range".to_owned(), "fault".to_owned())), "{report}");
    succeed(dir, "synth test --rows 800 --unit-seed 9 --output other.csv");
    let (_, found_other, report) = examine(dir, "other.csv --calibration cal.json");
    assert!(found_other.iter().any(|(check, _)| check == "error"), "{report}");
    with_calibration("seven.csv", &zero().without(&["s8"]), &[("channels-other", "fault")]);
    // 18 A zero that creeps: by 100 counts, on channels of all kinds.
    succeed(dir, "synth zero --rows 2000 --output long.csv");
    let long = Table::read(&dir.join("long.csv")).without(&WRENCH);
    let creeping = ["s1", "s2", "s3", "s4"]
        .into_iter()
        .fold(long, |table, name| table.change(name, |row, s| s + (row as f64 * 0.05).round()));
    creeping.write(dir, "creep.csv");
    let (_, found_creep, report) = examine(dir, "creep.csv --calibration cal.json");
    assert!(found_creep.iter().any(|(check, _)| check == "drift"), "{report}");
}

#[test]
fn planted_faults_of_calibrations_are_found() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    calibrate(dir);
    let sound: Value = serde_json::from_slice(&fs::read(dir.join("cal.json")).unwrap()).unwrap();
    let found = |name: &str, change: &dyn Fn(&mut Value), expected: &[(&str, &str)]| {
        let mut document = sound.clone();
        change(&mut document);
        fs::write(dir.join(name), sealed_value(&document)).unwrap();
        assert_found(dir, name, expected);
    };
    // 19 A file that was cut short.
    let text = fs::read_to_string(dir.join("cal.json")).unwrap();
    fs::write(dir.join("half.json"), &text[..text.len() / 2]).unwrap();
    assert_found(dir, "half.json", &[("unreadable", "fault")]);
    // 20 Too few directions, 21 features that can hardly be told apart.
    let rank = |document: &mut Value| document["diagnostics"]["rank"] = json!(24);
    found("rank.json", &rank, &[("rank", "fault")]);
    let condition = |document: &mut Value| document["diagnostics"]["condition"] = json!(3e8);
    found("condition.json", &condition, &[("condition", "warning")]);
    // 22 Never tested, 23 three times the error on new data.
    let untested = |document: &mut Value| document["diagnostics"]["test"] = Value::Null;
    found("untested.json", &untested, &[("untested", "warning")]);
    let overfit = |document: &mut Value| {
        let rms = &mut document["diagnostics"]["test"][2]["rms"];
        *rms = json!(rms.as_f64().unwrap() * 3.0);
    };
    found("overfit.json", &overfit, &[("overfit", "fault")]);
    // 24 Trained on a channel at the end of its range, 25 on a dead one.
    let saturated = |document: &mut Value| document["valid_range"][3]["max"] = json!(4095.0);
    found("saturated.json", &saturated, &[("channel-saturated", "fault")]);
    let dead = |document: &mut Value| {
        document["valid_range"][3] = json!({ "min": 812.0, "max": 812.0 });
    };
    found("dead.json", &dead, &[("channel-dead", "fault")]);
    // 26 Four years old, 27 of the year after next: the program's date is in 2017 here.
    let of = |date: &'static str| move |document: &mut Value| document["date"] = json!(date);
    found("old.json", &of("2013-07-14T02:40:00Z"), &[("age", "warning")]);
    found("ahead.json", &of("2019-07-14T02:40:00Z"), &[("age", "warning")]);
    // 28 Without a covariance.
    let bare = |document: &mut Value| document["covariance"] = Value::Null;
    found("bare.json", &bare, &[("no-covariance", "warning")]);
    // 29 An imported matrix, whose errors are unknown.
    let mut matrix = "feature,Fx_N,Fy_N,Fz_N,Mx_mNm,My_mNm,Mz_mNm\n".to_owned();
    for channel in 1..=8 {
        matrix += &format!("s{channel}^1,1,2,3,4,5,6\n");
    }
    fs::write(dir.join("matrix.csv"), matrix).unwrap();
    succeed(dir, "import matrix.csv --output imported.json");
    let (_, imported, report) = examine(dir, "imported.json");
    let checks: Vec<_> = imported.iter().map(|(check, _)| check.as_str()).collect();
    assert_eq!(checks, ["no-diagnostics", "no-range", "no-covariance"], "{report}");
    // 30 An axis that was never loaded, 31 training data that were changed since.
    let flat = Table::shipped("synthetic-train.csv").change("mz_nm", |_, _| 0.0);
    flat.write(dir, "flat.csv");
    succeed(dir, "fit --model cubic flat.csv --output flat.json");
    let expected = [("untested", "warning"), ("axis-unloaded", "fault")];
    assert_found(dir, "flat.json", &expected);
    flat.change("t_s", |_, t| t + 1.0).write(dir, "flat.csv");
    let expected = [expected[0], expected[1], ("source-changed", "warning")];
    assert_found(dir, "flat.json", &expected);
}

#[test]
fn missing_files_are_errors() {
    let dir = tempfile::tempdir().unwrap();
    let said = refused(dir.path(), "doctor none.csv");
    assert!(said.contains("cannot read `none.csv`"), "{said}");
    let output = program::output(dir.path(), "doctor /dev/no-such-port");
    assert_eq!(output.status.code(), Some(1));
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(
        said.contains("port-missing") && said.contains("`shellcal board` lists the ports"),
        "{said}"
    );
}

#[test]
#[cfg_attr(not(real_data), ignore = "SHELLCAL_REAL_DATA does not name the recordings")]
fn findings_on_real_recordings_are_those_that_their_authors_would_agree_with() {
    let dir = tempfile::tempdir().unwrap();
    let others = |name: &str| system_tests::real_recording(&format!("others/{name}"));
    // Concatenated poses, one of which begins with rows of another.
    let poses = others("photointerrupters/poses.csv");
    let (code, found, report) = examine(dir.path(), &poses.display().to_string());
    assert_eq!(code, 0, "{report}");
    let jumps: Vec<_> = found.iter().filter(|(check, _)| check == "pose-jump").collect();
    assert_eq!(jumps.len(), 1, "{report}");
    assert!(report.contains("in pose `7` s"), "{report}");
    assert!(!found.iter().any(|(check, _)| check == "channel-saturated"), "{report}");
}
