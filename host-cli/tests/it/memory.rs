//! `fit --memory`: whether logs are read once or twice changes the time and nothing else.

use std::fs;
use std::path::Path;

use system_tests::program;

/// What a fit wrote, and what it said.
fn fit(dir: &Path, memory: &str) -> (String, String) {
    let arguments = format!("fit train.csv --test test.csv --verbose {memory} --output cal.json");
    let output = program::output(dir, &arguments);
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(0), "{said}");
    (fs::read_to_string(dir.join("cal.json")).unwrap(), said)
}

#[test]
fn rows_that_are_kept_and_rows_that_are_read_again_give_the_same_calibration() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    // Some 28 bytes for each row in memory: 1.1 MB of training rows, 1.7 MB of all.
    program::run(dir, "synth train --rows 40000 --layout peer --output train.csv", 0);
    program::run(dir, "synth test --rows 20000 --layout peer --output test.csv", 0);
    let (kept, said) = fit(dir, "");
    assert!(!said.contains("read twice"), "{said}");
    for (memory, allowed) in [("--memory 0", "0 MB"), ("--memory 1", "1 MB")] {
        let (read_again, said) = fit(dir, memory);
        assert!(kept == read_again, "{memory}");
        assert!(said.contains("read twice") && said.contains(allowed), "{said}");
    }
    let (kept_again, said) = fit(dir, "--memory 2");
    assert!(kept == kept_again);
    assert!(!said.contains("read twice"), "{said}");
}
