//! Groups found in logs that name none; test rows from the poses of the training.

use std::fmt::Write as _;
use std::fs;

use serde_json::Value;
use system_tests::program::{ended, refused};
use system_tests::random::Random;
use system_tests::real_recording;
use tempfile::TempDir;

/// Time, four readings, the wrench, the pose.
type Row = (f64, [f64; 4], [f64; 6], usize);

/// Poses of different lengths, with noise of the reference. Each pose shifts the readings at
/// random, so the same load has other readings in another pose.
fn poses(seed: u64, poses: usize, noise: f64) -> Vec<Row> {
    let mut random = Random(seed);
    let (mut rows, mut time): (Vec<Row>, f64) = (Vec::new(), 0.0);
    for pose in 0..poses {
        let load: [f64; 6] = std::array::from_fn(|_| 4.0 * random.unit() - 2.0);
        let strayed: [f64; 4] = std::array::from_fn(|_| 20.0 * random.normal());
        for _ in 0..100 + random.below(300) {
            time += 0.01;
            let reading = |channel: usize| {
                let z = load[channel] + 0.3 * load[channel + 2] + 0.1 * load[channel].powi(2);
                (1000.0 + 150.0 * z + strayed[channel] + 2.0 * random.normal()).round()
            };
            let readings = [0, 1, 2, 3].map(reading);
            let wrench = load.map(|load| load + noise * random.normal());
            rows.push((time, readings, wrench, pose));
        }
    }
    rows
}

fn text(rows: &[Row], last: &str) -> String {
    let mut text = format!("t_s,s1,s2,s3,s4,fx_n,fy_n,fz_n,mx_nm,my_nm,mz_nm{last}\n");
    for (time, readings, wrench, pose) in rows {
        write!(text, "{time:.2}").unwrap();
        readings.iter().for_each(|reading| write!(text, ",{reading}").unwrap());
        wrench.iter().for_each(|load| write!(text, ",{load:.5}").unwrap());
        let pose = if last.is_empty() { String::new() } else { format!(",{pose}") };
        writeln!(text, "{pose}").unwrap();
    }
    text
}

fn fit(dir: &TempDir, arguments: &str) -> (Value, String) {
    let model = if arguments.contains("--model") { "" } else { "--model cubic" };
    let (printed, said) = ended(dir, &format!("fit --json --verbose {arguments} {model}"), 0);
    (serde_json::from_str(&printed).unwrap(), said)
}

const NOISES: [f64; 2] = [0.0, 0.01];

#[test]
fn a_log_of_poses_gets_the_figures_of_its_group_column_to_the_last_digit() {
    let dir = tempfile::tempdir().unwrap();
    for noise in NOISES {
        let rows = poses(47, 47, noise);
        fs::write(dir.path().join("named.csv"), text(&rows, ",pose")).unwrap();
        fs::write(dir.path().join("plain.csv"), text(&rows, "")).unwrap();
        for options in [
            "--cv -o c.json",
            "--cv=7 --model quadratic --threads 3",
            "--cv --model auto -o c.json",
        ] {
            let (named, _) = fit(&dir, &format!("named.csv {options}"));
            let (plain, talk) = fit(&dir, &format!("plain.csv {options}"));
            assert!(talk.contains("found 47 plateaus of constant load"), "{talk}");
            let found = &plain["groups_found"];
            assert_eq!((&found["found"], &found["groups"]), (&"plateaus".into(), &47.into()));
            assert!(named.get("groups_found").is_none());
            assert!(plain["cross_validation"]["grouped"][0]["rms"].as_f64() > Some(0.0));
            for figures in
                ["cross_validation", "selection", "weighing", "model", "solver", "intervals"]
            {
                assert_eq!(named[figures], plain[figures], "noise {noise}, {options}: {figures}");
            }
            // The rest of the covariance is not compared: it comes from errors on training rows,
            // and the last digits of their sums depend on the blocks.
            assert_eq!(named["covariance"]["groups"], plain["covariance"]["groups"]);
        }
    }
}

#[test]
fn poses_do_not_depend_on_threads_and_more_logs_are_held_out_by_file_unless_asked() {
    let dir = tempfile::tempdir().unwrap();
    for (name, seed) in [("a.csv", 3), ("b.csv", 4)] {
        fs::write(dir.path().join(name), text(&poses(seed, 12, 0.01), "")).unwrap();
    }
    let report = |arguments: &str| {
        let (mut report, _) = fit(&dir, &format!("a.csv b.csv {arguments}"));
        report.as_object_mut().unwrap().remove("time_s");
        report
    };
    let one = report("--cv=plateau --threads 1");
    assert_eq!(one["cross_validation"]["groups"], 24);
    assert_eq!(one["groups_found"]["groups"], 24);
    assert_eq!(one, report("--cv=plateau --threads 4"), "not the same for any number of threads");
    assert_eq!(report("--cv")["cross_validation"]["groups"], 2);
}

#[test]
fn groups_can_be_the_values_of_any_column() {
    let dir = tempfile::tempdir().unwrap();
    let rows = poses(5, 30, 0.0);
    fs::write(dir.path().join("named.csv"), text(&rows, ",pose")).unwrap();
    fs::write(dir.path().join("plain.csv"), text(&rows, "")).unwrap();
    let (named, _) = fit(&dir, "named.csv --cv");
    let (by_load, _) = fit(&dir, "plain.csv --cv --group fz_n");
    assert_eq!(named["cross_validation"], by_load["cross_validation"]);
    assert_eq!(by_load["rows"], rows.len());
    let said = refused(dir.path(), "fit --model cubic plain.csv --cv --group t_s");
    assert!(said.contains("more than `2000` groups"), "{said}");
}

#[test]
fn recordings_between_jumps_of_the_clock_are_held_out_where_there_are_no_poses() {
    let dir = tempfile::tempdir().unwrap();
    let mut random = Random(8);
    let mut rows = Vec::new();
    for recording in 0..4 {
        let phase = 6.0 * random.unit();
        for row in 0..500 {
            let t = f64::from(row) * 0.01;
            let load: [f64; 6] =
                std::array::from_fn(|axis| (phase + (1.0 + axis as f64) * t).sin());
            let readings =
                [0, 1, 2, 3].map(|i| (1000.0 + 200.0 * load[i] + random.normal()).round());
            rows.push((t, readings, load, recording));
        }
    }
    fs::write(dir.path().join("named.csv"), text(&rows, ",session")).unwrap();
    fs::write(dir.path().join("plain.csv"), text(&rows, "")).unwrap();
    let (plain, talk) = fit(&dir, "plain.csv --cv");
    assert!(
        talk.contains("found 4 recordings between jumps of the clock, 500 rows each"),
        "{talk}"
    );
    assert_eq!(plain["cross_validation"], fit(&dir, "named.csv --cv").0["cross_validation"]);
    // Uninterrupted motion is held out by blocks of time.
    fs::write(dir.path().join("one.csv"), text(&rows[..500], "")).unwrap();
    let (one, talk) = fit(&dir, "one.csv --cv");
    assert!(talk.contains("found 40 blocks of time, 12 to 13 rows"), "{talk}");
    assert_eq!(one["verdict"]["unseen_rows"], "held_out");
    let said = refused(dir.path(), "fit --model cubic one.csv --cv=plateau");
    assert!(said.contains("plateaus of constant load"), "{said}");
}

#[test]
fn test_rows_of_poses_that_were_trained_on_earn_a_warning_in_any_order() {
    let dir = tempfile::tempdir().unwrap();
    let mut rows = poses(21, 30, 0.0);
    let write = |name: &str, rows: &[Row]| {
        fs::write(dir.path().join(name), text(rows, "")).unwrap();
    };
    let share = |arguments: &str| {
        let (report, talk) = fit(&dir, arguments);
        let share = report["test_share_on_training_plateaus"].as_f64();
        assert_eq!(share > Some(0.1), talk.contains("the test set leaks"));
        share
    };
    let split = |rows: &[Row]| -> (Vec<Row>, Vec<Row>) {
        let numbered = rows.iter().copied().enumerate();
        let (test, train): (Vec<_>, Vec<_>) = numbered.partition(|(row, _)| row % 5 == 0);
        let rows = |part: Vec<(usize, Row)>| part.into_iter().map(|(_, row)| row).collect();
        (rows(train), rows(test))
    };
    let (train, test) = split(&rows);
    write("train.csv", &train);
    write("test.csv", &test);
    assert!(share("train.csv --test test.csv") > Some(0.95));
    let mut random = Random(2);
    for last in (1..rows.len()).rev() {
        rows.swap(last, random.below(last as u64 + 1) as usize);
    }
    let (train, test) = split(&rows);
    write("shuffled.csv", &train);
    write("rest.csv", &test);
    assert!(share("shuffled.csv --test rest.csv") > Some(0.95));
    // Other poses, and the same loads set up again.
    write("others.csv", &poses(22, 10, 0.0));
    assert_eq!(share("train.csv --test others.csv"), Some(0.0));
    let again = test
        .iter()
        .map(|&(t, readings, load, pose)| (t, readings.map(|reading| reading + 40.0), load, pose));
    write("again.csv", &again.collect::<Vec<_>>());
    assert!(share("train.csv --test again.csv") < Some(0.05));
    write("noisy.csv", &poses(21, 30, 0.01));
    assert_eq!(share("noisy.csv --test test.csv"), None);
}

#[test]
#[cfg_attr(not(real_data), ignore = "SHELLCAL_REAL_DATA does not name the recordings")]
fn the_poses_of_a_real_sensor_are_found_without_their_column() {
    let dir = tempfile::tempdir().unwrap();
    let path = real_recording("others/photointerrupters/poses.csv");
    let named = fs::read_to_string(&path).unwrap();
    let without = |line: &str| line.rsplit_once(',').map_or("", |(rest, _)| rest).to_owned() + "\n";
    fs::write(dir.path().join("named.csv"), &named).unwrap();
    fs::write(dir.path().join("plain.csv"), named.lines().map(without).collect::<String>())
        .unwrap();
    for options in ["--model linear --cv", "--model auto --cv=10", "--model physics --cv=4"] {
        let (named, _) = fit(&dir, &format!("named.csv {options}"));
        let (plain, _) = fit(&dir, &format!("plain.csv {options}"));
        assert_eq!(plain["groups_found"]["groups"], 32);
        assert_eq!(named["cross_validation"], plain["cross_validation"]);
        assert_eq!(named["selection"], plain["selection"]);
    }
}
