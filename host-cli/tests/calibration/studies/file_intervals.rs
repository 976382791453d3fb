//! 95 % intervals hold on new files of motion, though neighbouring rows are alike and files few.

use std::fs;
use std::path::{Path, PathBuf};

use calibration::dynamics::DynamicsRule;
use calibration::fit::{FitOptions, ModelRule};
use calibration::uncertainty::CoefficientCovariance;
use log_file::{Log, Mapping, ReadOptions};
use shell_data::wrench::PerAxis;
use shellcal::workflow::fit::FitData;
use system_tests::real_recording;

use super::prediction_intervals::coverage;
use crate::lag_and_memory::log;

/// Returns the share of rows within their intervals, by a plain fit to other files.
fn shares(train: &[PathBuf], test: &[PathBuf]) -> PerAxis<f64> {
    let open = |paths: &[PathBuf]| -> Vec<Log> {
        paths.iter().map(|path| Log::open(path, &Mapping::default()).unwrap()).collect()
    };
    let options = FitOptions {
        model: ModelRule::Auto,
        dynamics: DynamicsRule::AUTO,
        ..FitOptions::default()
    };
    let (train, test) = (open(train), open(test));
    let mut data =
        FitData::read(&train, &test, (&options, false), &ReadOptions::default()).unwrap();
    let fitted = data.fit(&options).unwrap();
    let covariance = fitted.calibration.covariance.as_ref().unwrap();
    let CoefficientCovariance::Groups { groups, .. } = covariance.coefficients else {
        panic!("rows of a file are not independent");
    };
    assert!(groups as usize > 2 * train.len(), "{groups} blocks");
    // With the memory terms and at the time of the readings.
    let mut readings = vec![Vec::new(); fitted.calibration.columns()];
    let mut loads = PerAxis::<Vec<f64>>::default();
    for (_, block) in fitted.tested.blocks() {
        let columns = block.rows.readings.iter().chain(&block.rows.wrench);
        let all = readings.iter_mut().chain(&mut loads);
        all.zip(columns).for_each(|(all, column)| all.extend_from_slice(column));
    }
    let shares = coverage(&fitted.calibration, &readings, &loads);
    println!("{groups} blocks: {shares:.3?}");
    shares
}

#[test]
fn intervals_hold_on_other_files_of_a_sensor_whose_readings_wander() {
    let dir = tempfile::tempdir().unwrap();
    let write = |seeds: std::ops::Range<u64>| -> Vec<PathBuf> {
        let file = |seed| {
            log(dir.path(), &format!("{seed}.csv"), seed, 3.0);
            dir.path().join(format!("{seed}.csv"))
        };
        seeds.map(file).collect()
    };
    let shares = shares(&write(1..7), &write(7..17));
    // Readings wander over some 34 times in ten files, so the observed share of 95 % has a standard
    // deviation of 1.2 %. With a new block, one of 37 or more, coverage is up to 2.6 % larger.
    assert!(shares.iter().all(|share| (0.925..=0.985).contains(share)), "{shares:?}");
}

/// Each file of another lab's sensor by a fit to the others, and the validation file by all.
#[test]
#[ignore = "needs the recordings"]
fn intervals_hold_on_each_file_of_another_labs_sensor() {
    let recorded = |end: &str| -> Vec<PathBuf> {
        let entries = fs::read_dir(real_recording("others/coinft")).unwrap();
        let mut paths: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
        paths.retain(|path: &PathBuf| is_named(path, end));
        paths.sort();
        paths
    };
    let (train, validation) = (recorded("train.csv.gz"), recorded("val.csv.gz"));
    // All errors are a quarter to a half smaller here than on held-out files.
    let of_validation = shares(&train, &validation);
    assert!(of_validation.iter().all(|share| (0.92..=0.997).contains(share)), "{of_validation:?}");
    let mut all = PerAxis::<f64>::default();
    for held_out in 0..train.len() {
        let mut others = train.clone();
        let own = others.remove(held_out);
        let of_file = shares(&others, &[own]);
        all.iter_mut().zip(of_file).for_each(|(all, of)| *all += of / train.len() as f64);
    }
    assert!(all.iter().all(|share| (0.92..=0.99).contains(share)), "{all:?}");
}

fn is_named(path: &Path, end: &str) -> bool {
    path.to_string_lossy().ends_with(end)
}
