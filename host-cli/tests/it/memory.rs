//! `fit --memory`: logs whose rows take more are read once, and their errors come from sums; read twice, they
//! give what rows in memory give.

use std::fs;
use std::io::Write;
use std::path::Path;

use flate2::Compression;
use flate2::write::GzEncoder;
use serde_json::Value;
use system_tests::program;

/// What a fit wrote, printed, and said.
fn fit(dir: &Path, train: &str, options: &str) -> (String, Value, String) {
    let arguments =
        format!("fit {train} --test test.csv --verbose --json {options} --output cal.json");
    let output = program::output(dir, &arguments);
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(0), "{said}");
    let printed = serde_json::from_slice(&output.stdout).unwrap();
    (fs::read_to_string(dir.join("cal.json")).unwrap(), printed, said)
}

/// Some 28 bytes for each row in memory: 1.1 MB of training rows, 1.7 MB of all. With a column of groups
/// where `layout` says so.
fn recordings(dir: &Path, layout: &str) {
    program::run(dir, &format!("synth train --rows 40000 {layout} --output train.csv"), 0);
    program::run(dir, &format!("synth test --rows 20000 {layout} --output test.csv"), 0);
}

const NO_GROUPS: &str = "--layout peer";

#[test]
fn rows_that_are_kept_and_rows_that_are_read_again_give_the_same_calibration() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    recordings(dir, NO_GROUPS);
    let (kept, _, said) = fit(dir, "train.csv", "");
    assert!(!said.contains("read"), "{said}");
    for (memory, allowed) in [("--memory 0", "0 MB"), ("--memory 1", "1 MB")] {
        for asked in ["--residuals", "--outliers report", "--plot fit.svg"] {
            let (read_again, _, said) = fit(dir, "train.csv", &format!("{memory} {asked}"));
            assert!(kept == read_again, "{memory} {asked}");
            assert!(said.contains("read twice") && said.contains(allowed), "{said}");
        }
    }
    let (kept_again, _, said) = fit(dir, "train.csv", "--memory 2");
    assert!(kept == kept_again);
    assert!(!said.contains("read"), "{said}");
}

/// All numbers of a document, by their places.
fn numbers(document: &Value, place: &str, found: &mut Vec<(String, f64)>) {
    match document {
        Value::Number(number) => found.push((place.to_owned(), number.as_f64().unwrap())),
        Value::Array(values) => {
            for (at, value) in values.iter().enumerate() {
                numbers(value, &format!("{place}/{at}"), found);
            }
        }
        Value::Object(fields) => {
            for (name, value) in fields {
                numbers(value, &format!("{place}/{name}"), found);
            }
        }
        _ => {}
    }
}

/// What the sums tell is what the rows tell. The bounds: both round some 40,000 squares, and of the errors'
/// distribution every row in a few is counted, whose quantiles scatter by a hundredth.
#[test]
fn a_log_that_is_read_once_has_the_same_errors_but_for_the_largest() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    for layout in [NO_GROUPS, ""] {
        recordings(dir, layout);
        let (kept, of_kept, _) = fit(dir, "train.csv", "");
        let (once, of_once, said) = fit(dir, "train.csv", "--memory 0");
        assert!(said.contains("read once") && said.contains("`--residuals`"), "{said}");
        let reason = of_once["train_residuals_left_out"].as_str().unwrap();
        assert!(reason.contains("`--memory` allows 0 MB"), "{reason}");
        assert!(of_kept["train_residuals_left_out"].is_null());
        let [kept, once] = [kept, once].map(|text| serde_json::from_str::<Value>(&text).unwrap());
        assert_eq!(kept["coefficients"], once["coefficients"]);
        assert_eq!(kept["sources"], once["sources"]);
        assert!(kept["sources"][0]["rows"] == 40_000, "{}", kept["sources"]);
        let [of_kept, of_once] = [kept, once].map(|document| {
            let mut found = Vec::new();
            numbers(&document, "", &mut found);
            found
        });
        let is_largest = |place: &str| place.contains("/train/") && place.ends_with("/max");
        let expected: Vec<_> = of_kept.iter().filter(|(place, _)| !is_largest(place)).collect();
        assert_eq!(of_kept.len(), expected.len() + 6);
        assert_eq!(of_once.len(), expected.len());
        for ((place, value), (_, expected)) in of_once.iter().zip(expected) {
            let tolerance = match place {
                place if place.contains("/shape/") => 0.1 * expected.abs(),
                // The mean of errors of newtons, which is zero but for rounding.
                place if place.contains("/train/") && place.ends_with("/bias") => 1e-12,
                _ => 1e-9 * expected.abs(),
            };
            assert!((value - expected).abs() <= tolerance, "{place}: {value} for {expected}");
        }
    }
}

#[test]
fn a_log_that_is_read_once_may_be_compressed_and_be_one_of_several() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    recordings(dir, NO_GROUPS);
    program::run(dir, "synth train --rows 3000 --seed 5 --layout peer --output more.csv", 0);
    let text = fs::read(dir.join("train.csv")).unwrap();
    let mut packed = GzEncoder::new(Vec::new(), Compression::fast());
    packed.write_all(&text).unwrap();
    fs::write(dir.join("train.csv.gz"), packed.finish().unwrap()).unwrap();
    let (_, plain, _) = fit(dir, "train.csv more.csv", "--memory 0");
    let (_, compressed, said) = fit(dir, "train.csv.gz more.csv", "--memory 0");
    assert!(said.contains("read once"), "{said}");
    assert_eq!(plain["train"], compressed["train"]);
    assert_eq!(plain["rows"], 43_000);
    // A copy is told, though its rows are not kept.
    fs::copy(dir.join("train.csv"), dir.join("copy.csv")).unwrap();
    let said = program::refused(dir, "fit train.csv copy.csv --memory 0");
    assert!(said.contains("copy.csv"), "{said}");
}
