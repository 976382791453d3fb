//! One recording in every kind of file that is read, written by the programs that people use
//! (`fuzz/make_seeds.py`): the same rows, bit for bit.

#![allow(clippy::disallowed_methods, reason = "tests read files")]

use std::path::{Path, PathBuf};

use log_file::{Log, LogError, Mapping, ReadOptions, Wanted};
use shell_data::block::Block;

/// The folders of the files.
const FOLDERS: [&str; 8] = ["text", "packed", "parquet", "matlab", "hdf5", "numpy", "xlsx", "mcap"];

fn seeds() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/seeds")
}

/// All files, but for the one that the others are compared with.
fn files() -> Vec<PathBuf> {
    let entries =
        FOLDERS.iter().flat_map(|folder| std::fs::read_dir(seeds().join(folder)).unwrap());
    let mut files: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    files.retain(|path| !path.ends_with("text/plain.csv"));
    files.sort();
    assert!(files.len() > 24, "{files:?}");
    files
}

fn rows(path: &Path, threads: usize) -> Result<(Block, Option<String>), LogError> {
    let log = Log::open(path, &Mapping::default())?;
    let wanted = Wanted {
        time: true,
        readings: true,
        wrench: true,
        groups: log.has_groups(),
        ..Wanted::default()
    };
    let options = ReadOptions { threads, checksum: true, ..ReadOptions::default() };
    let (mut whole, summary) = log.with_chunk_bytes(700).read_whole(&wanted, &options)?;
    let mut groups: Vec<(String, usize)> = Vec::new();
    for (label, rows) in std::mem::take(&mut whole.groups) {
        match groups.last_mut() {
            Some((last, count)) if *last == label => *count += rows,
            _ => groups.push((label, rows)),
        }
    }
    Ok((Block { groups, ..whole }, summary.checksum))
}

#[test]
fn a_recording_has_the_same_rows_in_every_kind_of_file() {
    let (expected, _) = rows(&seeds().join("text/plain.csv"), 1).unwrap();
    assert_eq!((expected.rows, expected.groups.len()), (24, 4));
    for path in files() {
        let name = path.display();
        let (found, checksum) = rows(&path, 1).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(found.readings, expected.readings, "{name}");
        assert_eq!(found.wrench, expected.wrench, "{name}");
        if !found.groups.is_empty() {
            assert_eq!(found.groups, expected.groups, "{name}");
        }
        // Dates begin in 2026, recordings when they were logged; the rest are the same seconds.
        let start_s = match found.time_s[0] {
            0.0 => 0.0,
            // `date -u -d 2026-11-22T10:00:00 +%s`
            1_795_341_600.0 => 1_795_341_600.0,
            1_700_000_000.0 => 1_700_000_000.0,
            other => panic!("{name} begins at {other} s"),
        };
        for (time, expected) in found.time_s.iter().zip(&expected.time_s) {
            // A double near 1.8e9 s is good to 2⁻²² s.
            let tolerance_s = if start_s == 0.0 { 0.0 } else { 2.4e-7 };
            assert!((time - start_s - expected).abs() <= tolerance_s, "{name}: {time}");
        }
        let of_file = log_file::checksum::of(&std::fs::read(&path).unwrap());
        assert_eq!(checksum, Some(of_file), "{name}");
        for threads in [2, 5] {
            assert_eq!(rows(&path, threads).unwrap().0, found, "{name}, {threads} threads");
        }
    }
}
