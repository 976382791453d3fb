//! Binary files of the libraries that define the formats, with columns of any type (`library_files.py`): the program
//! reads the values that pyarrow, NumPy, SciPy, h5py and openpyxl read, bit for bit, or refuses the column by its name.
//!
//! `SHELLCAL_LIBRARY_FILES` sets the number of files.

use std::collections::BTreeMap;
use std::fs;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::thread;

use log_file::{ColumnRef, Log, LogError, Mapping, ReadOptions, Wanted};
use serde::Deserialize;
use system_tests::program;

const FILES: &str = "SHELLCAL_LIBRARY_FILES";

/// Forms of columns and files that are refused on purpose, as the messages name them.
const REFUSED: [&str; 24] = [
    ", expected one of rows and columns",
    "a MATLAB 4 file",
    "an Arrow or Feather file",
    "an archive of NumPy arrays",
    "an array of structs",
    "cells that are not texts",
    "complex numbers",
    "compressed with Brotli",
    "compressed with scale-offset",
    "more than two sides",
    "no numbers",
    "no numbers and no texts",
    "records of several fields",
    "references",
    "type binary",
    "type decimal",
    "type time of day",
    "type `<M8[Y]`",
    "type `<c16`",
    "type `<f16`",
    "type `<m8[ms]`",
    "type `|O`",
    "type `|V5`",
    "values of an unusual type",
];

#[derive(Deserialize)]
struct Described {
    file: String,
    columns: Vec<Expected>,
    refused: Vec<Refused>,
    /// Line number of the first row in an equivalent text.
    first_line: u64,
    /// Number of the first row in messages.
    first_row: u64,
}

#[derive(Deserialize)]
struct Expected {
    name: String,
    /// Position, from 1, in a file without names.
    at: Option<usize>,
    /// Bits of the doubles in hexadecimal; `None` for missing values and for numbers that are not finite.
    values: Vec<Option<String>>,
    is_time: bool,
    /// The largest error of a time in s.
    within: f64,
}

#[derive(Deserialize)]
struct Refused {
    /// Empty if the whole file is refused.
    name: String,
    form: String,
}

impl Expected {
    fn reference(&self) -> ColumnRef {
        self.at.map_or_else(|| ColumnRef::Name(self.name.clone()), ColumnRef::Position)
    }

    fn is_at(&self, row: usize, found: f64) -> bool {
        let bits = self.values[row].as_ref().map(|bits| u64::from_str_radix(bits, 16).unwrap());
        bits.is_some_and(|bits| {
            let is_near = (found - f64::from_bits(bits)).abs() <= self.within;
            found.to_bits() == bits || self.within > 0.0 && is_near
        })
    }
}

/// Reads columns, of which one may be a time; returns the rows' lines, and the values in the order of the columns.
fn read(
    path: &Path,
    columns: &[&Expected],
    skip_bad_rows: bool,
) -> Result<(Vec<u64>, Vec<Vec<f64>>), LogError> {
    let time = columns.iter().find(|column| column.is_time).map(|column| column.reference());
    let numbers: Vec<ColumnRef> =
        columns.iter().filter(|column| !column.is_time).map(|column| column.reference()).collect();
    let mapping = Mapping {
        sensors: (!numbers.is_empty()).then(|| numbers.clone()),
        time: time.clone(),
        ..Mapping::default()
    };
    // Parts are small, so that most files have several.
    let log = Log::open(path, &mapping)?.with_chunk_bytes(2000);
    let others = log.column_positions(&numbers)?;
    let wanted = Wanted { time: time.is_some(), others, ..Wanted::default() };
    let options = ReadOptions { skip_bad_rows, ..ReadOptions::default() };
    let (mut lines, mut values) = (Vec::new(), vec![Vec::new(); columns.len()]);
    log.read(
        &wanted,
        &options,
        |block| block.clone(),
        |block| {
            lines.extend((0..block.rows).map(|row| block.lines.line(row)));
            let mut others = block.others.into_iter();
            for (column, values) in columns.iter().zip(&mut values) {
                values.extend(match column.is_time {
                    true => block.time_s.clone(),
                    false => others.next().unwrap(),
                });
            }
            Ok::<_, LogError>(())
        },
    )?;
    Ok((lines, values))
}

/// Compares columns that are read together; returns the number of equal values.
fn compare(
    path: &Path,
    columns: &[&Expected],
    first_line: u64,
    first_row: u64,
) -> Result<usize, String> {
    let rows = columns[0].values.len();
    let gaps = |row: usize| columns.iter().filter(move |column| column.values[row].is_none());
    let expected: Vec<usize> = (0..rows).filter(|row| gaps(*row).next().is_none()).collect();
    let first_gap = (0..rows).find(|row| gaps(*row).next().is_some());
    let found = match (read(path, columns, false), first_gap) {
        (Ok(found), _) => found,
        (Err(error), None) => return Err(error.to_string()),
        (Err(error), Some(row)) => {
            // An unreadable value is an invalid row, named with the column.
            let said = error.to_string();
            let row_number = row as u64 + first_row;
            let is_named = gaps(row).any(|column| said.contains(&column.name));
            if !is_named || !said.contains(&format!("row {row_number}")) {
                return Err(format!("row {row_number} has a gap, but: {said}"));
            }
            if expected.is_empty() {
                return Ok(0);
            }
            read(path, columns, true).map_err(|error| error.to_string())?
        }
    };
    let (lines, values) = found;
    let rows_read: Vec<usize> = lines.iter().map(|line| (line - first_line) as usize).collect();
    // Blank rows of a sheet are left out, but are not invalid.
    if rows_read != expected {
        return Err(format!("{} rows, expected {}", rows_read.len(), expected.len()));
    }
    for (column, values) in columns.iter().zip(&values) {
        for (&row, &found) in expected.iter().zip(values) {
            if !column.is_at(row, found) {
                let wanted = column.values[row].as_ref().unwrap();
                let wanted = f64::from_bits(u64::from_str_radix(wanted, 16).unwrap());
                return Err(format!("`{}`, row {row}: {found:?}, not {wanted:?}", column.name));
            }
        }
    }
    Ok(expected.len() * columns.len())
}

/// Tries to read a column that is refused; returns the message.
fn refusal(path: &Path, name: &str) -> Option<String> {
    let column = match name {
        "" => ColumnRef::Position(1),
        name => ColumnRef::Name(name.to_owned()),
    };
    let mapping = Mapping { sensors: Some(vec![column]), ..Mapping::default() };
    let read = Log::open(path, &mapping).and_then(|log| {
        let wanted = Wanted { readings: true, ..Wanted::default() };
        log.read_whole(&wanted, &ReadOptions { skip_bad_rows: true, ..ReadOptions::default() })
    });
    read.err().map(|error| format!("{error}"))
}

fn check(path: &Path, described: &Described) -> Result<usize, String> {
    let Described { columns, refused, first_line, first_row, .. } = described;
    let compare = |columns: &[&Expected]| compare(path, columns, *first_line, *first_row);
    let mut equal = 0;
    for column in columns {
        equal += compare(&[column]).map_err(|what| format!("`{}` alone: {what}", column.name))?;
    }
    let (times, mut together): (Vec<&Expected>, Vec<_>) =
        columns.iter().partition(|column| column.is_time);
    together.extend(times.first());
    if together.len() > 1 {
        equal += compare(&together)?;
    }
    for Refused { name, form } in refused {
        if !REFUSED.contains(&form.as_str()) {
            return Err(format!("`{form}` is not in the list of refused forms"));
        }
        let said = refusal(path, name).ok_or_else(|| format!("`{name}` ({form}) is read"))?;
        if !said.contains(form) || !said.contains(name) {
            return Err(format!("`{name}` ({form}): {said}"));
        }
    }
    Ok(equal)
}

/// Numbers of files by their extension, number of equal values, and faults.
#[derive(Default)]
struct Outcome {
    files: BTreeMap<String, usize>,
    equal: usize,
    faults: Vec<String>,
}

/// Writes `count` files from number `first` on and checks each while Python writes the next.
fn write_and_check(folder: &Path, first: usize, count: usize) -> Outcome {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/logs/library_files.py");
    let mut writer = program::python()
        .arg(script)
        .arg(folder)
        .args([first.to_string(), count.to_string()])
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut outcome = Outcome::default();
    for line in BufReader::new(writer.stdout.take().unwrap()).lines() {
        let described: Described = serde_json::from_str(&line.unwrap()).unwrap();
        let path: PathBuf = folder.join(&described.file);
        match check(&path, &described) {
            Ok(equal) => outcome.equal += equal,
            Err(what) => outcome.faults.push(format!("{}: {what}", described.file)),
        }
        let extension = path.extension().unwrap().to_string_lossy().into_owned();
        *outcome.files.entry(extension).or_default() += 1;
        fs::remove_file(path).unwrap();
    }
    assert!(writer.wait().unwrap().success());
    outcome
}

#[test]
#[ignore = "needs a Python with packages that read tables and bags"]
fn binary_files_are_read_as_their_libraries_read_them() {
    let count = std::env::var(FILES).map_or(500, |count| count.parse().unwrap());
    let folder = tempfile::tempdir().unwrap();
    let workers = thread::available_parallelism().map_or(1, usize::from).min(count);
    let starts: Vec<usize> = (0..=workers).map(|worker| worker * count / workers).collect();
    let outcomes: Vec<Outcome> = thread::scope(|scope| {
        let run = |range: &[usize]| {
            let (first, end) = (range[0], range[1]);
            let folder = folder.path();
            scope.spawn(move || write_and_check(folder, first, end - first))
        };
        let running: Vec<_> = starts.windows(2).map(run).collect();
        running.into_iter().map(|worker| worker.join().unwrap()).collect()
    });
    let mut all = Outcome::default();
    for outcome in outcomes {
        outcome
            .files
            .into_iter()
            .for_each(|(of, files)| *all.files.entry(of).or_default() += files);
        all.equal += outcome.equal;
        all.faults.extend(outcome.faults);
    }
    println!("{count} files {:?}, {} equal values", all.files, all.equal);
    assert!(all.faults.is_empty(), "{} faults:\n{}", all.faults.len(), all.faults.join("\n"));
    // With fewer equal values, the files would be so unusual that hardly anything is compared.
    assert!(all.equal > 1000 * count, "{}", all.equal);
}
