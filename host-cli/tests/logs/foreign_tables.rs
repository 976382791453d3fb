//! Binary files of other programs, in `SHELLCAL_REAL_DATA`, whose layouts were once misread.

use std::path::PathBuf;

use log_file::{ColumnRef, Log, LogError, Mapping, ReadOptions, Wanted};
use shell_data::block::Block;
use system_tests::real_recording;

fn case(name: &str) -> PathBuf {
    real_recording(&format!("../cases/{name}"))
}

fn open(name: &str, mapping: &Mapping) -> Result<(Log, Block), LogError> {
    let log = Log::open(&case(name), mapping)?;
    let wanted = Wanted {
        time: log.has_time(),
        readings: log.channels() > 0,
        wrench: log.has_wrench(),
        groups: log.has_groups(),
        ..Wanted::default()
    };
    let (block, _) = log.read_whole(&wanted, &ReadOptions::default())?;
    Ok((log, block))
}

/// Returns rows, channels, last time, and groups.
fn shape(name: &str) -> (usize, usize, Option<f64>, usize) {
    let (log, block) = open(name, &Mapping::default()).unwrap_or_else(|error| panic!("{error}"));
    let mut groups: Vec<&String> = block.groups.iter().map(|(group, _)| group).collect();
    groups.sort();
    groups.dedup();
    (block.rows, log.channels(), block.time_s.last().copied(), groups.len())
}

/// Expected shapes are from h5py 3.16, SciPy and openpyxl.
#[test]
#[cfg_attr(not(real_data), ignore = "SHELLCAL_REAL_DATA does not name the recordings")]
fn files_of_other_programs_are_read_as_their_libraries_read_them() {
    for (name, expected) in [
        ("matlab-struct.mat", (80, 8, Some(7.9), 0)),
        ("matlab-time-along-columns.mat", (80, 8, Some(7.9), 0)),
        ("hdf5-transposed.h5", (400, 8, Some(3.99), 0)),
        ("netcdf-time-units.nc", (400, 8, Some(3.99), 0)),
        ("workbook-elapsed-time.xlsx", (60, 8, Some(5.9), 0)),
        ("workbook-side-notes.xlsx", (40, 2, None, 0)),
        ("workbook-empty-first-sheet.xlsx", (40, 2, None, 0)),
    ] {
        assert_eq!(shape(name), expected, "{name}");
    }
    assert_eq!(shape("matlab-text-group.mat").3, 125);
    for (name, rows) in [
        ("hdf5-twelve-bits.h5", 60),
        ("hdf5-time-one-short.h5", 59),
        ("hdf5-soft-link.h5", 60),
        ("hdf5-units.h5", 60),
    ] {
        let (found, channels, last, groups) = shape(name);
        assert_eq!((found, channels), (rows, 8), "{name}");
        assert!(last.is_some() && groups > 1, "{name}: {last:?}, {groups}");
    }
}

#[test]
#[cfg_attr(not(real_data), ignore = "SHELLCAL_REAL_DATA does not name the recordings")]
fn units_of_data_sets_are_read_like_units_of_columns() {
    let (_, found) = open("hdf5-units.h5", &Mapping::default()).unwrap();
    let (_, expected) = open("hdf5-units-same-as.csv", &Mapping::default()).unwrap();
    assert_eq!(found.wrench, expected.wrench);
    assert_eq!(found.readings, expected.readings);
}

#[test]
#[cfg_attr(not(real_data), ignore = "SHELLCAL_REAL_DATA does not name the recordings")]
fn lists_of_one_length_are_columns() {
    let columns = |name: &str, count: usize| -> Vec<ColumnRef> {
        (1..=count).map(|at| ColumnRef::Name(format!("observation.{name}{at}"))).collect()
    };
    let wrench = columns("wrench", 6);
    let mapping = Mapping {
        sensors: Some(columns("state", 8)),
        wrench: Some(std::array::from_fn(|axis| Some(wrench[axis].clone()))),
        ..Mapping::default()
    };
    let (log, block) = open("parquet-lists.parquet", &mapping).unwrap();
    assert_eq!((block.rows, log.channels(), block.wrench.len()), (80, 8, 6));
    // Expected values are the minimum and maximum in the column's statistics, from pyarrow.
    let all = || block.readings.iter().flatten().copied();
    assert_eq!(all().fold(f64::INFINITY, f64::min), 1002.0);
    assert_eq!(all().fold(0.0, f64::max), 2997.0);
}

#[test]
#[cfg_attr(not(real_data), ignore = "SHELLCAL_REAL_DATA does not name the recordings")]
fn messages_are_in_the_order_in_which_they_were_logged() {
    for name in ["mcap-out-of-order.mcap", "mcap-frozen-stamp.mcap"] {
        let (log, block) = open(name, &Mapping::default()).unwrap();
        assert!(block.time_s.is_sorted(), "{name}");
        assert!(block.time_s[block.rows - 1] > block.time_s[0] + 2.9, "{name}");
        assert!(!log.notes().is_empty(), "{name}");
    }
}

#[test]
#[cfg_attr(not(real_data), ignore = "SHELLCAL_REAL_DATA does not name the recordings")]
fn unsupported_files_are_named_by_kind() {
    for (name, expected) in [
        ("plate.c3d", "a C3D motion capture file"),
        ("hdf5-libver-latest.h5", "a layout of HDF5 2.0"),
        ("hdf5-two-unlimited.h5", "can grow along two sides"),
    ] {
        let error = open(name, &Mapping::default()).map(drop).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    }
}
