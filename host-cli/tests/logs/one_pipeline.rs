//! One log, calibration and set of options: every command that shows forces gives the same bits.

use std::collections::HashMap;
use std::fs;
use std::path::Path;

use calibration_file::CalibrationFile;
use forces::{ForceOptions, LowPass, TareRule};
use log_file::{Log, Mapping, ReadOptions};
use shellcal::workflow::batch::{self, BatchOptions};
use shellcal::workflow::figures::reduce_trace;
use shellcal::workflow::synthetic_trials::write_log;
use shellcal::workflow::trial::{TrialJob, evaluate_in_window};
use simulation::synthetic_log::TrialLayout;
use simulation::virtual_robot::{ChannelForces, TrialSettings, VirtualTrial};
use system_tests::program::succeed;
use trial::manifest::Manifest;
use trial::{Instrument, Profile, Trace, TraceExtent, Trial, TrialOptions};

use crate::recording::{calibration, column, stream};

/// The bits of the wrench, by the bits of the time.
type Forces = HashMap<u64, [u64; 6]>;

const AXES: [&str; 6] = ["fx_n", "fy_n", "fz_n", "mx_nm", "my_nm", "mz_nm"];

fn of_table(path: &Path) -> Forces {
    let bits = |name: &str| -> Vec<u64> {
        let numbers = column(path, name).into_iter().map(|field| field.parse::<f64>().unwrap());
        numbers.map(f64::to_bits).collect()
    };
    let (times, axes) = (bits("t_s"), AXES.map(bits));
    let at = |(row, time): (usize, u64)| (time, std::array::from_fn(|axis| axes[axis][row]));
    times.into_iter().enumerate().map(at).collect()
}

fn of_trace(trace: &Trace) -> Forces {
    let wrench = |row: usize| std::array::from_fn(|axis| trace.wrench[axis][row].to_bits());
    trace.t_s.iter().enumerate().map(|(row, time)| (time.to_bits(), wrench(row))).collect()
}

fn assert_within(some: &Forces, all: &Forces, at_least: usize, what: &str) {
    assert!(some.len() >= at_least, "{what}: {} rows", some.len());
    for (time, wrench) in some {
        assert_eq!(Some(wrench), all.get(time), "{what} at {} s", f64::from_bits(*time));
    }
}

/// Returns the data of `plot` and `report` between two times.
fn of_library(
    folder: &Path,
    log: &str,
    window: (f64, f64),
    low_pass: LowPass,
    tare: TareRule,
) -> [Forces; 2] {
    let file = CalibrationFile::read(&folder.join("cal.json")).unwrap();
    let profile = Profile::velociroach();
    let instrument = Instrument { profile: &profile, calibration: Some(&file.calibration) };
    let forces = ForceOptions {
        low_pass: Some(low_pass),
        tare,
        low_pass_is_optional: false,
        ..ForceOptions::default()
    };
    let options = TrialOptions { forces, trace: TraceExtent::Log, ..TrialOptions::default() };
    let read = ReadOptions::default();
    let mapping = Mapping::default();

    let opened = Log::open(&folder.join(log), &mapping).unwrap();
    let job = TrialJob { log: &opened, instrument, options, read };
    let times = (Some(window.0), Some(window.1));
    let trial = Trial::from_window(log.to_owned(), (f64::NAN, f64::NAN));
    let plotted = evaluate_in_window(&job, trial, times).unwrap().result.trace.unwrap();

    let text = format!("file,condition,t_enter_s,t_exit_s\n{log},3 cm,{},{}\n", window.0, window.1);
    let manifest = Manifest::parse(&text, false).unwrap();
    let options =
        BatchOptions { trial: options, mapping: &mapping, read, shard: None, progress: None };
    let keep = |_, result: &mut _| {
        reduce_trace(result, &profile, true);
        Ok(())
    };
    let batch = batch::run(&manifest, folder, instrument, &options, keep);
    let reported = batch.trials[0].evaluated.result.trace.as_ref().unwrap();
    [of_trace(&plotted), of_trace(reported)]
}

/// Asserts that all commands that show the forces of a whole log agree with `convert` at each frame.
fn assert_all_agree(
    folder: &Path,
    log: &str,
    window: (f64, f64),
    low_pass: LowPass,
    rests: bool,
) -> Forces {
    let LowPass { cutoff_hz, order, zero_phase } = low_pass;
    let phase = if zero_phase { "" } else { "--causal" };
    let (tare, tared) = match rests {
        true => (TareRule::Rests { causal: !zero_phase }, "--tare rests"),
        false => (ForceOptions::default().tare, ""),
    };
    let filter = format!("--lowpass {cutoff_hz} --order {order} {phase} {tared}");
    let (enter, exit) = window;
    succeed(folder, &format!("convert cal.json {log} -o all.csv --all-rows {filter}"));
    succeed(folder, &format!("convert cal.json {log} -o fresh.csv --fresh {filter}"));
    let cal = "--calibration cal.json";
    let window_args = format!("--enter {enter} --exit {exit}");
    succeed(folder, &format!("trial {log} {window_args} {cal} {filter} --trace window.csv"));
    succeed(
        folder,
        &format!("trial {log} {window_args} {cal} {filter} --trace whole.csv --whole-log"),
    );
    let row = format!("file,condition,t_enter_s,t_exit_s\n{log},3 cm,{enter},{exit}\n");
    fs::write(folder.join("manifest.csv"), row).unwrap();
    succeed(folder, &format!("batch manifest.csv {cal} {filter} --traces traces"));

    let all = of_table(&folder.join("all.csv"));
    let stem = Path::new(log).file_stem().unwrap().to_str().unwrap();
    for (name, at_least) in [
        ("fresh.csv", 200),
        ("window.csv", 200),
        ("whole.csv", all.len()),
        (&format!("traces/{stem}.2.csv"), 200),
    ] {
        assert_within(&of_table(&folder.join(name)), &all, at_least, name);
    }
    let [plotted, reported] = of_library(folder, log, window, low_pass, tare);
    assert_within(&plotted, &all, all.len(), "plot");
    assert_within(&reported, &all, 200, "report");
    all
}

#[test]
fn every_command_gives_the_same_forces_of_a_recording() {
    let folder = tempfile::tempdir().unwrap();
    calibration(folder.path());
    // Single frames are lost, and once more than the filter's memory.
    let indices = (0..3000_u64).filter(|i| i % 17 != 5 && !(900..1300).contains(i));
    fs::write(folder.path().join("raw"), stream(indices)).unwrap();
    let record = |filter: &str| {
        succeed(
            folder.path(),
            &format!("record --replay raw -o log.csv --overwrite --calibration cal.json {filter}"),
        );
    };
    record("");
    for zero_phase in [true, false] {
        let low_pass = LowPass { zero_phase, ..LowPass::default() };
        assert_all_agree(folder.path(), "log.csv", (5.0, 20.0), low_pass, false);
        assert_all_agree(folder.path(), "log.csv", (5.0, 20.0), low_pass, true);
    }
    let slow = LowPass { cutoff_hz: 3.0, order: 2, zero_phase: false };
    for (low_pass, rests) in
        [(LowPass::default(), false), (LowPass::default(), true), (slow, false)]
    {
        let low_pass = LowPass { zero_phase: false, ..low_pass };
        let tare = if rests { "--tare rests" } else { "" };
        record(&format!("--lowpass {} --order {} {tare}", low_pass.cutoff_hz, low_pass.order));
        let all = assert_all_agree(folder.path(), "log.csv", (5.0, 20.0), low_pass, rests);
        let path = folder.path().join("log.csv");
        let flags = column(&path, "flags");
        assert!(flags.iter().enumerate().all(|(i, f)| f.contains("untared") == (i < 50)));
        assert!(flags.iter().enumerate().all(|(i, f)| f.contains("unfiltered") == (i < 50)));
        let mut recorded = of_table(&path);
        for time in &column(&path, "t_s")[..50] {
            recorded.remove(&time.parse::<f64>().unwrap().to_bits());
        }
        assert_within(&recorded, &all, 2000, "record");
    }
}

#[test]
fn rows_that_repeat_a_frame_change_no_force() {
    let folder = tempfile::tempdir().unwrap();
    calibration(folder.path());
    let settings = TrialSettings::new(ChannelForces::named("3 cm").unwrap(), 3);
    let trial = VirtualTrial::new(TrialSettings { missing: 0.1, ..settings }).unwrap();
    let mut file = fs::File::create(folder.path().join("run.txt")).unwrap();
    write_log(&mut file, &trial, TrialLayout::Full).unwrap();
    let [enter, exit] = trial.window_s;
    for zero_phase in [true, false] {
        let low_pass = LowPass { zero_phase, ..LowPass::default() };
        assert_all_agree(folder.path(), "run.txt", (enter, exit), low_pass, false);
        assert_all_agree(folder.path(), "run.txt", (enter, exit), low_pass, true);
    }
    let tare = |rows: &str| {
        let said = succeed(
            folder.path(),
            &format!("convert cal.json run.txt -o {}.csv {rows} --json", rows.trim_matches('-')),
        );
        let said: serde_json::Value = serde_json::from_str(&said).unwrap();
        said[0]["tare"].clone()
    };
    assert_eq!(tare("--all-rows"), tare("--fresh"));
}
