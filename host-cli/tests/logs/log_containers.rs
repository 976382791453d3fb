//! One recording in every kind of file, written by popular programs
//! (`crates/log-file/fuzz/make_seeds.py`): the same coefficients, bit for bit.

use std::path::{Path, PathBuf};

use log_file::{ColumnRef, Log, LogError, Mapping, ReadOptions, Wanted};
use shell_data::block::Block;
use system_tests::program;
use system_tests::random::Random;

fn seeds() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../crates/log-file/fuzz/seeds")
}

fn plain() -> PathBuf {
    seeds().join("text/plain.csv")
}

fn rows(path: &Path, threads: usize) -> Result<(Block, Option<String>), LogError> {
    let log = Log::open(path, &Mapping::default())?;
    let wanted = Wanted {
        time: true,
        readings: true,
        wrench: true,
        groups: log.has_groups(),
        others: Vec::new(),
        ..Wanted::default()
    };
    let options = ReadOptions { threads, checksum: true, ..ReadOptions::default() };
    let mut whole = Block::default();
    let summary =
        log.with_chunk_bytes(700).read(&wanted, &options, std::mem::take, |mut block| {
            whole.rows += block.rows;
            whole.time_s.append(&mut block.time_s);
            for (columns, more) in
                [(&mut whole.readings, block.readings), (&mut whole.wrench, block.wrench)]
            {
                columns.resize_with(more.len(), Vec::new);
                columns.iter_mut().zip(more).for_each(|(column, more)| column.extend(more));
            }
            for (label, rows) in block.groups {
                match whole.groups.last_mut() {
                    Some((last, count)) if *last == label => *count += rows,
                    _ => whole.groups.push((label, rows)),
                }
            }
            Ok::<_, LogError>(())
        })?;
    Ok((whole, summary.checksum))
}

#[test]
fn fits_of_the_same_recording_have_the_same_coefficients() {
    let dir = tempfile::tempdir().unwrap();
    let coefficients = |path: &Path| {
        let output = dir.path().join("calibration.json");
        let ran = program::command(dir.path())
            .arg("fit")
            .arg(path)
            .args(["--model", "linear", "-o"])
            .arg(&output)
            .output();
        let ran = ran.unwrap();
        assert!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stderr));
        let document: serde_json::Value =
            serde_json::from_slice(&std::fs::read(&output).unwrap()).unwrap();
        std::fs::remove_file(&output).unwrap();
        document["coefficients"].to_string()
    };
    let expected = coefficients(&plain());
    assert!(expected.len() > 6 * 9 * 8, "{expected}");
    for name in [
        "text/german_utf16.csv",
        "parquet/polars_zstd.parquet",
        "matlab/vectors.mat",
        "hdf5/gzip_shuffle.h5",
        "hdf5/matlab73.mat",
        "numpy/matrix.npy",
        "xlsx/workbook.xlsx",
        "ods/pandas.ods",
        "mcap/zstd.mcap",
    ] {
        assert_eq!(coefficients(&seeds().join(name)), expected, "{name}");
    }
}

/// The RMS of training errors equals that of least squares on standardised columns in NumPy; Fx to Mz in N and N·mm.
#[test]
#[cfg_attr(not(real_data), ignore = "SHELLCAL_REAL_DATA does not name the recordings")]
fn a_matrix_of_another_lab_is_fitted_as_it_is() {
    let data = system_tests::real_recording("others/fingertip/data.mat");
    let dir = tempfile::tempdir().unwrap();
    for (model, expected) in [
        ("linear", [1.3250, 1.1075, 1.2491, 8.530, 10.878, 3.905]),
        ("cubic", [1.1255, 0.6711, 0.8827, 5.693, 7.156, 2.801]),
        ("quadratic", [0.7041, 0.4003, 0.5543, 2.938, 4.175, 1.451]),
    ] {
        let mut fit = program::command(dir.path());
        fit.arg("fit").arg(&data).args(["--sensors", "1-8", "--wrench", "9-14"]);
        fit.args(["--moment-unit", "mN·m", "--model", model, "-o"]).arg(format!("{model}.json"));
        assert!(fit.output().unwrap().status.success(), "{model}");
        let document = std::fs::read(dir.path().join(format!("{model}.json"))).unwrap();
        let document: serde_json::Value = serde_json::from_slice(&document).unwrap();
        for (axis, expected) in expected.iter().enumerate() {
            let rms = document["diagnostics"]["train"][axis]["rms"].as_f64().unwrap();
            let (rms, digit) = if axis < 3 { (rms, 1e-4) } else { (1e3 * rms, 1e-3) };
            // The tolerance is half of the last digit given.
            assert!((rms - expected).abs() <= 0.5001 * digit, "{model} {axis}: {rms}, {expected}");
        }
    }
}

/// Matrices by name and by shape: the same numbers.
#[test]
fn matrices_are_readings_and_wrench_by_their_names_or_their_shapes() {
    let path = seeds().join("hdf5/by_shape.h5");
    let (by_shape, _) = rows(&path, 1).unwrap();
    let names = |name: &str, count: usize| -> Vec<ColumnRef> {
        (1..=count).map(|column| ColumnRef::Name(format!("{name}{column}"))).collect()
    };
    let wrench: Vec<_> = names("ft", 6).into_iter().map(Some).collect();
    let mapping = Mapping {
        sensors: Some(vec![ColumnRef::Name("cells".to_owned())]),
        wrench: wrench.try_into().ok(),
        ..Mapping::default()
    };
    let log = Log::open(&path, &mapping).unwrap();
    assert_eq!((log.channels(), log.axes().iter().count()), (8, 6));
    assert_eq!(by_shape.readings.len(), 8);
    let path = seeds().join("hdf5/gzip.h5");
    let of_group = Mapping { table: Some("run".to_owned()), ..Mapping::default() };
    assert_eq!(Log::open(&path, &of_group).unwrap().channels(), 8);
}

/// Recordings of a capacitive sensor yield the same as published and as CSV with all digits.
#[test]
#[cfg_attr(not(real_data), ignore = "SHELLCAL_REAL_DATA does not name the recordings")]
fn published_hdf5_recordings_equal_those_of_their_csv() {
    let name = "others/coinft/CFT24_calibrationData_20251219_110601_train";
    let open = |extension: &str| {
        let path = system_tests::real_recording(&format!("{name}.{extension}"));
        Log::open(&path, &Mapping::default()).unwrap()
    };
    let rows = |log: Log| {
        let wanted = Wanted { readings: true, wrench: true, ..Wanted::default() };
        log_file::read_dataset(&[(&log, wanted)], &ReadOptions::default()).unwrap()
    };
    let [hdf5, csv] = ["h5", "csv.gz"].map(|extension| {
        let data = rows(open(extension));
        let mut columns = vec![Vec::new(); 18];
        for (_, block) in data.blocks() {
            let of_block = block.rows.readings.iter().chain(&block.rows.wrench);
            columns.iter_mut().zip(of_block).for_each(|(all, more)| all.extend_from_slice(more));
        }
        columns
    });
    assert_eq!((hdf5.len(), hdf5[0].len()), (18, 2676));
    assert!(hdf5 == csv);
}

/// Each of a thousand files with bytes changed, removed or repeated is read or refused.
#[test]
fn damaged_hdf5_files_are_refused_without_a_panic() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("damaged.h5");
    let mut random = Random(29);
    let seeds: Vec<Vec<u8>> = std::fs::read_dir(seeds().join("hdf5"))
        .unwrap()
        .map(|entry| std::fs::read(entry.unwrap().path()).unwrap())
        .collect();
    let mut refused = 0;
    for _ in 0..1000 {
        let mut bytes = seeds[random.below(seeds.len() as u64) as usize].clone();
        for _ in 0..=random.below(8) {
            let at = random.below(bytes.len() as u64) as usize;
            let count = (random.below(8) as usize + 1).min(bytes.len() - at);
            match random.below(4) {
                0 => bytes[at..at + count].fill(0xff),
                1 => bytes[at] ^= 1 << random.below(8),
                2 => drop(bytes.drain(at..at + count)),
                _ => bytes[at..at + count].iter_mut().for_each(|it| *it = random.below(256) as u8),
            }
        }
        std::fs::write(&path, &bytes).unwrap();
        refused += u32::from(rows(&path, 1).is_err());
    }
    assert!((100..1000).contains(&refused), "{refused}");
}

/// Ends of a MATLAB 5 file's variables: 128 bytes of header, then a kind, a length, and the bytes.
fn ends_of_variables(bytes: &[u8]) -> Vec<usize> {
    let mut ends = vec![128];
    while let Some(tag) = bytes.get(ends[ends.len() - 1]..).and_then(|rest| rest.get(4..8)) {
        let length = u32::from_le_bytes(tag.try_into().unwrap()) as usize;
        ends.push(ends[ends.len() - 1] + 8 + length);
    }
    ends
}

#[test]
fn files_cut_anywhere_are_errors_that_name_them() {
    let dir = tempfile::tempdir().unwrap();
    for folder in
        ["parquet", "matlab", "hdf5", "numpy", "ods", "xlsx", "mcap", "rosbag", "sqlite", "tdms"]
    {
        for entry in std::fs::read_dir(seeds().join(folder)).unwrap() {
            let path = entry.unwrap().path();
            let bytes = std::fs::read(&path).unwrap();
            // A truncated recording has all rows up to its end.
            let ends_early = ["mcap", "rosbag", "tdms"].contains(&folder);
            // MATLAB files do not state the number of variables: a file cut between two of them looks complete.
            let ends = if folder == "matlab" { ends_of_variables(&bytes) } else { Vec::new() };
            let lengths = (16..bytes.len()).step_by(bytes.len() / 60 + 1);
            for length in lengths.chain((!ends_early).then_some(bytes.len() - 1)) {
                let cut = dir.path().join(path.file_name().unwrap());
                std::fs::write(&cut, &bytes[..length]).unwrap();
                match rows(&cut, 1) {
                    Err(error) => {
                        let said = error.to_string();
                        assert!(said.contains(&cut.display().to_string()), "{said}");
                    }
                    Ok((rows, _)) => assert!(
                        (ends_early || ends.contains(&length)) && rows.rows <= 24,
                        "{} of {length} bytes",
                        path.display()
                    ),
                }
            }
        }
    }
}

/// Every chunk lists its channels again: two topics without forces, three thousand times.
#[test]
fn topics_that_are_not_read_are_counted_once() {
    let bytes = std::fs::read(seeds().join("mcap/none.mcap")).unwrap();
    // An opcode, a length, and content; texts follow their length (MCAP's specification).
    let channel = |id: u16| {
        let topic = if id.is_multiple_of(2) { "/tf" } else { "/image" };
        let mut body = [id.to_le_bytes(), [0; 2]].concat();
        for text in [topic, "cdr"] {
            body.extend((text.len() as u32).to_le_bytes());
            body.extend(text.as_bytes());
        }
        body.extend([0; 4]);
        [&[4][..], &(body.len() as u64).to_le_bytes(), &body].concat()
    };
    let magic = 8;
    let header = 9 + u64::from_le_bytes(bytes[magic + 1..magic + 9].try_into().unwrap()) as usize;
    let mut long = bytes[..magic + header].to_vec();
    long.extend((0..6000).flat_map(|number| channel(50_000 + number)));
    long.extend(&bytes[magic + header..]);
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("long.mcap");
    std::fs::write(&path, &long).unwrap();
    let expected = rows(&seeds().join("mcap/none.mcap"), 1).unwrap();
    assert_eq!(rows(&path, 1).unwrap().0, expected.0);
}

#[test]
fn faults_are_named_by_row_and_column() {
    let dir = tempfile::tempdir().unwrap();
    let said = |name: &str, bytes: &[u8], flags: &[&str]| {
        let path = dir.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        let ran = program::command(dir.path()).arg("info").arg(&path).args(flags).output().unwrap();
        assert_eq!(ran.status.code(), Some(2), "{name}");
        String::from_utf8(ran.stderr).unwrap().replace(&path.display().to_string(), "FILE")
    };
    let seed = |name: &str| std::fs::read(seeds().join(name)).unwrap();
    // A double in the third row becomes NaN. The file has rows of 15 doubles after a header of 128 bytes.
    let mut npy = seed("numpy/matrix.npy");
    let at = 128 + 8 * (2 * 15 + 9);
    npy[at..at + 8].copy_from_slice(&f64::NAN.to_le_bytes());
    let complaint = said("a.npy", &npy, &[]);
    assert!(complaint.contains("`FILE`, row 3: column 10 (`Fx`)"), "{complaint}");
    let complaint = said("a.mat", &seed("matlab/vectors.mat"), &["--table", "forces"]);
    assert!(complaint.contains("`forces`; it has `t`, `s`"), "{complaint}");
    let complaint = said("a.h5", &seed("hdf5/gzip.h5"), &["--table", "forces"]);
    assert!(complaint.contains("`forces`; it has `run/Fx`, `run/Fy`"), "{complaint}");
    let complaint = said("b.h5", &seed("hdf5/gzip.h5")[..900], &[]);
    assert!(complaint.contains("a damaged HDF5 file"), "{complaint}");
    // The size is changed from 24 rows of 8 to more than any memory holds.
    let sides = |rows: u64| [rows.to_le_bytes(), 8_u64.to_le_bytes()].concat();
    let mut claims = seed("hdf5/by_shape.h5");
    let found: Vec<usize> =
        (0..claims.len()).filter(|&at| claims[at..].starts_with(&sides(24))).collect();
    found.iter().for_each(|&at| claims[at..at + 16].copy_from_slice(&sides(1 << 40)));
    let complaint = said("c.h5", &claims, &[]);
    assert!(complaint.contains("`cells` takes 70368744177664 bytes, more than"), "{complaint}");
    let complaint = said("a.mcap", &seed("mcap/none.mcap"), &["--table", "/x"]);
    assert!(complaint.contains("`/x`; it has `/readings`, `/wrench`"), "{complaint}");
    let complaint = said("a.xlsx", &seed("xlsx/workbook.xlsx"), &["--table", "x"]);
    assert!(complaint.contains("without a sheet `x`; it has `Sheet`"), "{complaint}");
    // These formats have a single table.
    for (name, of) in [("a.parquet", "parquet/groups.parquet"), ("a.npy", "numpy/matrix.npy")] {
        let complaint = said(name, &seed(of), &["--table", "x"]);
        assert!(complaint.contains("is a single table, and has none called `x`"), "{complaint}");
        assert!(complaint.contains("leave out `--table`"), "{complaint}");
    }
    let matlab = seed("matlab/matrix.mat");
    let complaint = said("b.mat", &matlab[..100], &[]);
    assert!(complaint.contains("its header of 128 bytes is cut off"), "{complaint}");
    let complaint = said("b.mat", &matlab[..128], &[]);
    assert!(complaint.contains("no matrix or vector of real numbers"), "{complaint}");
    assert!(!complaint.contains("--table"), "{complaint}");
    // A column that is given by its position has no similar names to suggest.
    let complaint = said("c.npy", &seed("numpy/matrix.npy"), &["--sensors", "40-41"]);
    assert!(complaint.contains("no columns `column 40`, `column 41`"), "{complaint}");
    assert!(!complaint.contains("did you mean"), "{complaint}");
    for (name, start, what) in [
        ("a.csv", &b"CDF\x01"[..], "is a netCDF-3 file"),
        ("a.json", b"[\n {\"t\": 1}]", "is a list in JSON"),
        ("a.txt", b"header:\n  stamp:\n", "is YAML of messages as ROS prints them"),
        ("a.log", b"(1700000000.012345) can0 123#00FF\n", "is a log of a CAN bus (candump)"),
        ("a.xml", b"<?xml version=\"1.0\"?>", "is an XML document"),
        ("a.pickle", b"\x80\x04\x95\0", "is a Python pickle"),
        ("a.csv.xz", b"\xfd7zXZ\0\0", "is compressed with xz"),
    ] {
        let complaint = said(name, start, &[]);
        assert!(complaint.contains(what) && complaint.contains("hint:"), "{complaint}");
    }
}

#[test]
fn standard_input_is_a_log() {
    use std::io::Write;
    let info = |path: &str, input: &[u8]| {
        let mut command = program::command(Path::new("."));
        command.args(["info", path, "--json"]).stdin(std::process::Stdio::piped());
        let mut child = command.stdout(std::process::Stdio::piped()).spawn().unwrap();
        child.stdin.take().unwrap().write_all(input).unwrap();
        let output = child.wait_with_output().unwrap();
        assert!(output.status.success());
        String::from_utf8(output.stdout).unwrap()
    };
    for path in [plain(), seeds().join("parquet/snappy.parquet")] {
        let path = path.display().to_string();
        let by_name = info(&path, b"").replace(&path, "-");
        assert_eq!(info("-", &std::fs::read(&path).unwrap()), by_name);
    }
}
