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

/// Share of the errors by which they may differ: forces and loads are straight between rows.
const SAME: f64 = 0.02;

fn numbers(path: &Path, name: &str) -> Vec<f64> {
    column(path, name).iter().map(|field| field.parse().unwrap()).collect()
}

/// Root mean square of forces minus the loads of a table, straight between its rows, at some times.
/// No load is known after the last row.
fn rms_by_time(table: &Path, times_s: &[f64], forces: &[f64], axis: &str) -> f64 {
    let (known_s, loads) = (numbers(table, "t_s"), numbers(table, axis));
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
    let times_s = numbers(&out, "t_s");
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

    // Forces of a trial keep the rows' times: they are straight between moments at 0.7 and 0.3 of a
    // row, which averages independent errors, to no less than the root of 0.7² + 0.3².
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

/// The lag is a sixth of a row. Without a clock in the logs, forces are taken between rows, which
/// also averages some noise; with the clock of their rate, errors by time are those of `eval`.
#[test]
#[ignore = "needs the recordings"]
fn rows_of_another_labs_sensor_err_by_time_as_eval_says() {
    const RATE_HZ: f64 = 66.9;
    let source = real_recording("others/coinft");
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    let mut names: Vec<_> = fs::read_dir(source).unwrap().map(|it| it.unwrap().path()).collect();
    names.retain(|path| path.to_string_lossy().ends_with(".csv.gz"));
    names.sort();
    for (at, path) in names.iter().enumerate() {
        let log = read_log(path).unwrap();
        let channels = log.readings.len();
        let name = |at: usize| format!("s{}", at + 1);
        let names: Vec<String> = (0..channels).map(name).chain(AXES.map(str::to_owned)).collect();
        let mut text = format!("t_s,{}\n", names.join(","));
        for row in 0..log.rows {
            let values = log.readings.iter().chain(&log.wrench).map(|column| column[row]);
            let values: Vec<String> = values.map(|value| value.to_string()).collect();
            text += &format!("{},{}\n", row as f64 / RATE_HZ, values.join(","));
        }
        fs::write(dir.join(format!("{at}.csv")), text).unwrap();
    }
    let test = names.len() - 1;
    let train: Vec<String> = (0..test).map(|at| format!("{at}.csv")).collect();
    let fit = format!("fit {} --model cubic --lag auto -o cal.json", train.join(" "));
    program::succeed(dir, &fit);
    let evaluated = program::json(dir, &format!("eval cal.json {test}.csv --json"));
    let table = dir.join(format!("{test}.csv"));
    assert_same(&converted(dir, "cal.json", &table), &rms(&evaluated["all"]["errors"]), "convert");
}
