//! A fit does not depend on packing or threads, and takes no more memory than its rows.

use std::fs;
use std::io::Write;
use std::path::Path;

use calibration::fit::{CovarianceRule, Workers};
use calibration::solver::SolverKind;
use calibration::{Basis, FitOptions};
use flate2::Compression;
use flate2::write::GzEncoder;
use log_file::{Log, Mapping, ReadOptions, Wanted, read_dataset};
use shellcal::workflow::fit::fit;
use system_tests::program;

const NO_GROUPS: &str = "--layout peer";

fn fitted(dir: &Path, arguments: &str) -> (String, String) {
    let said = program::run(dir, &format!("fit --model cubic {arguments} --output cal.json"), 0);
    (fs::read_to_string(dir.join("cal.json")).unwrap(), said)
}

#[test]
fn solvers_give_the_same_bits_on_any_number_of_threads() {
    let dir = tempfile::tempdir().unwrap();
    program::run(dir.path(), "synth train --rows 12000 --output train.csv", 0);
    let log = || [Log::open(&dir.path().join("train.csv"), &Mapping::default()).unwrap()];
    for solver in SolverKind::ALL {
        let calibration = |threads: usize| {
            let options = FitOptions {
                model: Basis::Cubic.into(),
                solver,
                covariance: CovarianceRule::Rows,
                workers: Workers::new(threads),
                ..FitOptions::default()
            };
            fit(&log(), &[], &options).unwrap().calibration
        };
        let alone = calibration(1);
        for threads in [2, 5] {
            assert_eq!(calibration(threads), alone, "{} on {threads}", solver.name());
        }
    }
}

#[test]
fn a_compressed_log_equals_its_text_and_a_copy_is_reported() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    program::run(dir, &format!("synth train --rows 20000 {NO_GROUPS} --output train.csv"), 0);
    program::run(
        dir,
        &format!("synth train --rows 3000 --seed 5 {NO_GROUPS} --output more.csv"),
        0,
    );
    let text = fs::read(dir.join("train.csv")).unwrap();
    let mut packed = GzEncoder::new(Vec::new(), Compression::fast());
    packed.write_all(&text).unwrap();
    fs::write(dir.join("train.csv.gz"), packed.finish().unwrap()).unwrap();
    let document =
        |logs: &str| -> serde_json::Value { serde_json::from_str(&fitted(dir, logs).0).unwrap() };
    let (plain, compressed) = (document("train.csv more.csv"), document("train.csv.gz more.csv"));
    assert_eq!(plain["coefficients"], compressed["coefficients"]);
    assert_eq!(plain["diagnostics"], compressed["diagnostics"]);
    assert_eq!(plain["diagnostics"]["rows"], 23_000);
    fs::copy(dir.join("train.csv"), dir.join("copy.csv")).unwrap();
    let said = program::refused(dir, "fit --model cubic train.csv copy.csv");
    assert!(said.contains("copy.csv"), "{said}");
}

#[test]
fn rows_take_eight_bytes_a_number() {
    let dir = tempfile::tempdir().unwrap();
    program::run(
        dir.path(),
        &format!("synth train --rows 30000 {NO_GROUPS} --output train.csv"),
        0,
    );
    let log = Log::open(&dir.path().join("train.csv"), &Mapping::default()).unwrap();
    let wanted = Wanted { readings: true, wrench: true, ..Wanted::default() };
    let rows = read_dataset(&[(&log, wanted)], &ReadOptions::default()).unwrap();
    assert_eq!(rows.rows(), 30_000);
    let columns = rows.blocks().flat_map(|(_, block)| {
        block.rows.readings.iter().chain(&block.rows.wrench).map(Vec::capacity)
    });
    assert_eq!(columns.sum::<usize>(), 14 * 30_000);
}
