//! All sets of instructions of this processor give the same bits.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use shell_data::instructions::{VARIABLE, available};
use system_tests::program;
use system_tests::random::Random;

/// Whole readings, and wrenches with all digits of a double, which are read in different ways.
fn write_log(path: &Path, seed: u64) {
    let mut random = Random(seed);
    let mut text = "t,s1,s2,s3,s4,s5,s6,s7,s8,fx,fy,fz,mx,my,mz\n".to_owned();
    for row in 0..3000 {
        write!(text, "{:.6}", f64::from(row) * 0.01).unwrap();
        for _ in 0..8 {
            write!(text, ",{}", 500 + random.below(3000)).unwrap();
        }
        for _ in 0..6 {
            write!(text, ",{}", random.normal()).unwrap();
        }
        text.push('\n');
    }
    fs::write(path, text).unwrap();
}

fn run(dir: &Path, instructions: &str, arguments: &str) -> (Option<i32>, String) {
    let mut command = program::command(dir);
    let output = command.env(VARIABLE, instructions).args(arguments.split(' ')).output().unwrap();
    (output.status.code(), String::from_utf8(output.stderr).unwrap())
}

#[test]
fn calibrations_and_forces_are_the_same_bits_with_any_instructions() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    write_log(&dir.join("full.csv"), 1);
    write_log(&dir.join("test.csv"), 2);
    program::run(dir, "synth train --rows 3000 --output short.csv", 0);
    let commands = [
        "fit --model cubic full.csv --test test.csv --quiet --output cubic.json",
        "fit short.csv --model poly3 --covariance rows --quiet --output poly3.json",
        "fit short.csv full.csv --model quadratic --solver tsqr --covariance rows --quiet --output qr.json",
        "fit short.csv --model physics --quiet --output physics.json",
        "convert poly3.json test.csv --quiet --output forces.csv",
    ];
    let outputs = ["cubic.json", "poly3.json", "qr.json", "physics.json", "forces.csv"];
    let mut first = None;
    for (name, _) in available() {
        for command in commands {
            let (code, said) = run(dir, name, command);
            assert_eq!(code, Some(0), "{name}: {command}: {said}");
        }
        let written = outputs.map(|file| fs::read_to_string(dir.join(file)).unwrap());
        let first = first.get_or_insert_with(|| written.clone());
        for (file, (found, expected)) in outputs.iter().zip(written.iter().zip(first)) {
            assert!(found == expected, "{file} is another with {name}");
        }
    }
}

#[test]
fn unknown_instruction_sets_are_refused_by_name() {
    let dir = tempfile::tempdir().unwrap();
    let (code, said) = run(dir.path(), "avx1024", "synth train --rows 10 --output short.csv");
    assert_eq!(code, Some(2), "{said}");
    assert!(
        said.contains(VARIABLE) && said.contains("`avx1024`") && said.contains("`none`"),
        "{said}"
    );
    assert!(!dir.path().join("short.csv").exists());
}
