//! `convert --keep` and `--all-rows`: further columns of a log are copied unchanged.

use std::fs;
use std::path::Path;

use log_file::{Log, LogError, Mapping, ReadOptions, Wanted};
use system_tests::program;

/// A calibration, and a log with a text column and a column with gaps.
fn folder() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    program::run(dir.path(), "synth train --rows 400 --seed 8 -o plain.csv", 0);
    program::run(dir.path(), "fit plain.csv --model linear --covariance rows -o cal.json", 0);
    let plain = fs::read_to_string(dir.path().join("plain.csv")).unwrap();
    let mut log = String::new();
    for (row, line) in plain.lines().enumerate() {
        log += &match row {
            0 => format!("{line},surface,supply_v,knob\n"),
            _ => format!("{line},{},{},{}\n", surface(row), supply(row), row % 7),
        };
    }
    fs::write(dir.path().join("log.csv"), log).unwrap();
    dir
}

/// Returns a text, some with quotes, separators or letters beyond ASCII.
fn surface(row: usize) -> &'static str {
    ["carpet", "\"gravel, wet\"", "Fließ", ""][row / 50 % 4]
}

fn supply(row: usize) -> &'static str {
    if row.is_multiple_of(100) { "3.7" } else { "" }
}

/// Returns text columns of a file, as the program's own readers read them.
fn texts(path: &Path, names: &[&str]) -> Vec<Vec<String>> {
    let log = Log::open(path, &Mapping::default()).unwrap();
    let position =
        |name: &&str| log.columns().iter().position(|column| column.name == *name).unwrap();
    let wanted = Wanted { texts: names.iter().map(position).collect(), ..Wanted::default() };
    let mut texts = vec![Vec::new(); names.len()];
    let one = ReadOptions { threads: 1, ..ReadOptions::default() };
    log.read(&wanted, &one, std::mem::take, |block| {
        for (column, runs) in texts.iter_mut().zip(block.texts) {
            column.extend(runs.into_iter().flat_map(|(text, rows)| vec![text; rows]));
        }
        Ok::<_, LogError>(())
    })
    .unwrap();
    texts
}

#[test]
fn texts_are_copied_into_every_kind_of_file() {
    let dir = folder();
    let dir = dir.path();
    let named = |row: usize| surface(row).trim_matches('"').to_owned();
    let expected: Vec<String> = (1..=400).map(named).collect();
    let supplies: Vec<String> = (1..=400).map(|row| supply(row).to_owned()).collect();
    for flags in ["--no-lowpass", "--lowpass 2"] {
        for extension in ["csv", "parquet"] {
            let out = format!("out.{extension}");
            program::run(dir, &format!("convert cal.json log.csv --keep all -o {out} {flags}"), 0);
            let found = texts(&dir.join(&out), &["surface", "supply_v"]);
            assert_eq!(found, [&expected[..], &supplies[..]], "{extension} {flags}");
        }
    }
    // Numeric columns stay numbers. They keep their name unless an output column has it.
    let text = fs::read_to_string(dir.join("out.csv")).unwrap();
    let header: Vec<&str> = text.lines().next().unwrap().split(',').collect();
    assert!(header.contains(&"knob") && header.contains(&"log_fx_n"), "{header:?}");
    assert_eq!(header[header.len() - 3..], ["surface", "supply_v", "flags"]);
    // A text is a row of characters in MATLAB, a field in NumPy, and a field of a message in a recording.
    for extension in ["mat", "npy", "mcap"] {
        let out = format!("out.{extension}");
        program::run(dir, &format!("convert cal.json log.csv --keep surface,knob -o {out}"), 0);
        let bytes = fs::read(dir.join(&out)).unwrap();
        let has = |text: &str| memchr::memmem::find(&bytes, text.as_bytes()).is_some();
        assert!(has("surface") && (extension != "mcap" || has("gravel, wet")));
    }
    let said = program::run(dir, "convert cal.json log.csv --keep surfaces", 2);
    assert!(said.contains("`surfaces`") && said.contains("`surface`"), "{said}");
}

/// Each reading is repeated three times, as in telemetry faster than its sensor. The comparison of
/// all commands shows that a tare does not depend on repeats either.
#[test]
fn all_rows_keeps_every_row_and_the_forces() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    program::run(dir, "synth train --rows 300 --seed 9 -o plain.csv", 0);
    program::run(dir, "fit plain.csv --model linear --covariance rows -o cal.json", 0);
    let plain = fs::read_to_string(dir.join("plain.csv")).unwrap();
    let mut log = String::new();
    for (row, line) in plain.lines().enumerate() {
        let (_, rest) = line.split_once(',').unwrap();
        if row == 0 {
            log += &format!("{line}\n");
            continue;
        }
        for repeat in 0..3 {
            log += &format!("{},{rest}\n", (3 * (row - 1) + repeat) as f64 / 100.0);
        }
    }
    fs::write(dir.join("log.csv"), log).unwrap();
    for flags in ["--no-lowpass", "--lowpass 2", "--lowpass 2 --causal"] {
        let convert = |rows: &str, out: &str| {
            let command = format!("convert cal.json log.csv -o {out} {rows} --no-tare {flags}");
            program::succeed(dir, &command);
            let text = fs::read_to_string(dir.join(out)).unwrap();
            text.lines().skip(1).map(str::to_owned).collect::<Vec<String>>()
        };
        let all = convert("--all-rows", "all.csv");
        let fresh = convert("--fresh", "fresh.csv");
        assert_eq!((all.len(), fresh.len()), (900, 300), "{flags}");
        let times: Vec<f64> =
            all.iter().map(|row| row.split(',').next().unwrap().parse().unwrap()).collect();
        assert!(times.iter().enumerate().all(|(row, time)| *time == row as f64 / 100.0));
        let kept: Vec<&String> = all.iter().step_by(3).collect();
        assert_eq!(kept, fresh.iter().collect::<Vec<_>>(), "{flags}");
    }
}
