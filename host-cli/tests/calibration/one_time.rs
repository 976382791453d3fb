//! With a reference that lags, every command gives forces of the same moment.

use std::fs;
use std::path::Path;

use calibration_file::CalibrationFile;
use log_file::{Log, Mapping, ReadOptions};
use serde_json::Value;
use shellcal::workflow::trial::{TrialJob, evaluate_in_window};
use system_tests::{program, real_recording};
use trial::{Instrument, Profile, TraceExtent, Trial, TrialOptions};

use crate::lag_and_memory::log;
use crate::recording::{column, read_log};

const AXES: [&str; 6] = ["fx_n", "fy_n", "fz_n", "mx_nm", "my_nm", "mz_nm"];

/// Allowed relative difference between the errors: forces and loads are interpolated linearly between rows.
const SAME: f64 = 0.02;

fn numbers(path: &Path, name: &str) -> Vec<f64> {
    column(path, name).iter().map(|field| field.parse().unwrap()).collect()
}

/// The times of a table's rows, or their numbers if it has no clock.
fn stamps(table: &Path) -> Vec<f64> {
    let text = fs::read_to_string(table).unwrap();
    match text.split(',').next() {
        Some(first @ ("t_s" | "row")) => numbers(table, first),
        _ => (0..text.lines().count() - 1).map(|row| row as f64).collect(),
    }
}

/// Root mean square difference between forces at some times and the loads of a table, interpolated linearly between
/// its rows. Times after its last row do not count.
fn rms_by_time(table: &Path, times_s: &[f64], forces: &[f64], axis: &str) -> f64 {
    let (known_s, loads) = (stamps(table), numbers(table, axis));
    let load = |time_s: f64| {
        let after = known_s.partition_point(|known| *known <= time_s).clamp(1, known_s.len() - 1);
        let (start, end) = (known_s[after - 1], known_s[after]);
        let share = ((time_s - start) / (end - start)).clamp(0.0, 1.0);
        loads[after - 1] + share * (loads[after] - loads[after - 1])
    };
    let is_known = |(time_s, _): &(&f64, &f64)| **time_s <= known_s[known_s.len() - 1];
    let both = times_s.iter().zip(forces).filter(is_known);
    let errors: Vec<f64> = both.map(|(time_s, force)| (force - load(*time_s)).powi(2)).collect();
    (errors.iter().sum::<f64>() / errors.len() as f64).sqrt()
}

fn rms(axes: &Value) -> Vec<f64> {
    axes.as_array().unwrap().iter().map(|of| of["rms"].as_f64().unwrap()).collect()
}

fn assert_same(found: &[f64], expected: &[f64], what: &str) {
    for (found, expected) in found.iter().zip(expected) {
        assert!((found / expected - 1.0).abs() < SAME, "{what}: {found} {expected}");
    }
}

fn converted(dir: &Path, calibration: &str, table: &Path) -> Vec<f64> {
    let (log, out) = (table.display(), dir.join("out.csv"));
    let plain = "--no-tare --no-lowpass --all-rows -o out.csv";
    program::succeed(dir, &format!("convert {calibration} {log} {plain}"));
    let times_s = stamps(&out);
    let of = |axis| rms_by_time(table, &times_s, &numbers(&out, axis), axis);
    AXES.map(of).to_vec()
}

#[test]
fn a_lag_is_made_up_for_alike_in_every_command() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    for (seed, name) in (1..).zip(["a.csv", "b.csv", "test.csv"]) {
        log(dir, name, seed, 0.0);
    }
    let plain = "--model linear --memory-terms 0.4 -o";
    program::succeed(dir, &format!("fit a.csv b.csv {plain} lag.json --lag 3.5"));
    program::succeed(dir, &format!("fit a.csv b.csv {plain} none.json --lag 0"));
    let evaluated = program::json(dir, "eval lag.json test.csv --json");
    let expected = rms(&evaluated["all"]["errors"]);
    let test = dir.join("test.csv");
    assert_same(&converted(dir, "lag.json", &test), &expected, "convert");

    let compared = program::json(dir, "eval lag.json test.csv --against none.json --json");
    let of = |axis: &Value| axis["rms"][0].as_f64().unwrap();
    let compared: Vec<f64> = compared["axes"].as_array().unwrap().iter().map(of).collect();
    assert_same(&compared, &expected, "compare");

    // Forces of a trial keep the rows' times: they are interpolated from neighbours with the weights 0.7 and
    // 0.3, which averages independent errors, to no less than the root of 0.7² + 0.3².
    let file = CalibrationFile::read(&dir.join("lag.json")).unwrap();
    let profile = Profile::velociroach();
    let forces = forces::ForceOptions::RAW;
    let options = TrialOptions { forces, trace: TraceExtent::Log, ..TrialOptions::default() };
    let opened = Log::open(&test, &Mapping::default()).unwrap();
    let instrument = Instrument { profile: &profile, calibration: Some(&file.calibration) };
    let job = TrialJob { log: &opened, instrument, options, read: ReadOptions::default() };
    let trial = Trial::from_window("test.csv".to_owned(), (f64::NAN, f64::NAN));
    let found = evaluate_in_window(&job, trial, (Some(1.0), Some(18.0))).unwrap();
    let trace = found.result.trace.unwrap();
    let of = |axis: usize| rms_by_time(&test, &trace.t_s, &trace.wrench[axis], AXES[axis]);
    for (found, expected) in [0, 1, 2, 3, 4, 5].map(of).iter().zip(&expected) {
        let share = found / expected;
        assert!((0.7..1.0 + SAME).contains(&share), "trial: {found} {expected}");
    }

    program::succeed(dir, "convert lag.json test.csv --no-tare --no-lowpass -o out.mcap");
    program::succeed(dir, "info out.mcap");
    let (_, said) = program::ended(dir, "convert lag.json test.csv --no-lowpass -o out.csv", 0);
    assert!(said.contains("t_s is the time of the readings + 3.50 ms"), "{said}");
}

/// Without a clock, row numbers are the times. `convert` adds the lag to the number of each force's row, so a join by
/// this number gives the errors of `eval`.
#[test]
fn a_lag_in_rows_is_made_up_for_in_the_numbers_of_the_rows() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    for (seed, name) in (1..).zip(["a.csv", "b.csv", "test.csv"]) {
        log(dir, name, seed, 0.0);
        let text = fs::read_to_string(dir.join(name)).unwrap();
        let rows = text.lines().map(|row| row.split_once(',').unwrap().1);
        fs::write(dir.join(name), rows.collect::<Vec<_>>().join("\n") + "\n").unwrap();
    }
    program::succeed(dir, "fit a.csv b.csv --model linear --memory-terms 80 --lag 0.6 -o lag.json");
    let evaluated = program::json(dir, "eval lag.json test.csv --json");
    let expected = rms(&evaluated["all"]["errors"]);
    let test = dir.join("test.csv");
    assert_same(&converted(dir, "lag.json", &test), &expected, "convert");
    assert_eq!(stamps(&dir.join("out.csv"))[..2], [0.6, 1.6]);
    let (_, said) = program::ended(dir, "convert lag.json test.csv -o out.npy", 0);
    assert!(said.contains("`row` is the row of the readings, from 0, + 0.600 rows"), "{said}");

    // Without the numbers forces are moved to the rows, as they are in recordings, which need times.
    let (_, said) = program::ended(dir, "convert lag.json test.csv --columns fx -o fx.csv", 0);
    assert!(said.contains("forces are moved by 0.600 rows"), "{said}");
    let said = program::refused(dir, "convert lag.json test.csv -o out.mcap");
    assert!(said.contains("needs time"), "{said}");
}

#[test]
fn calibrations_that_differ_by_rounding_are_alike() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    log(dir, "a.csv", 1, 1.0);
    // Two solvers give one answer, except for its last bits.
    program::succeed(dir, "fit a.csv --model linear -o first.json");
    program::succeed(dir, "fit a.csv --model linear --solver tsqr -o second.json");
    let found = program::json(dir, "eval first.json a.csv --against second.json --json");
    for axis in found["axes"].as_array().unwrap() {
        assert!(axis["better"].is_null(), "{axis}");
    }
}

/// The lag of this sensor is 0.3 rows. Its logs have no clock: joined by row number, or by time after a clock is added,
/// converted forces have the errors of `eval`.
#[test]
#[ignore = "needs the recordings"]
fn rows_of_another_labs_sensor_err_by_time_as_eval_says() {
    const RATE_HZ: f64 = 66.9;
    let source = real_recording("others/coinft");
    let mut paths: Vec<_> = fs::read_dir(source).unwrap().map(|it| it.unwrap().path()).collect();
    paths.retain(|path| path.to_string_lossy().ends_with(".csv.gz"));
    paths.sort();
    let logs: Vec<_> = paths.iter().map(|path| read_log(path).unwrap()).collect();
    for has_clock in [true, false] {
        let folder = tempfile::tempdir().unwrap();
        let dir = folder.path();
        for (at, log) in logs.iter().enumerate() {
            let channels = (1..=log.readings.len()).map(|at| format!("s{at}"));
            let clock = has_clock.then(|| "t_s".to_owned()).into_iter();
            let names = clock.chain(channels).chain(AXES.map(str::to_owned));
            let mut text = names.collect::<Vec<_>>().join(",") + "\n";
            for row in 0..log.rows {
                let clock = has_clock.then_some(row as f64 / RATE_HZ).into_iter();
                let values = log.readings.iter().chain(&log.wrench).map(|column| column[row]);
                let values: Vec<_> = clock.chain(values).map(|value| value.to_string()).collect();
                text += &(values.join(",") + "\n");
            }
            fs::write(dir.join(format!("{at}.csv")), text).unwrap();
        }
        let test = logs.len() - 1;
        let train: Vec<String> = (0..test).map(|at| format!("{at}.csv")).collect();
        let fit = format!("fit {} --model cubic --lag auto -o cal.json", train.join(" "));
        program::succeed(dir, &fit);
        let evaluated = program::json(dir, &format!("eval cal.json {test}.csv --json"));
        let table = dir.join(format!("{test}.csv"));
        let expected = rms(&evaluated["all"]["errors"]);
        assert_same(&converted(dir, "cal.json", &table), &expected, "convert");
    }
}
