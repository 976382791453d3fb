//! Bad input: the message says what was expected, found and where; exit code 2 and a hint.

use std::io::Write;
use std::path::Path;
use std::process::Output;

use log_file::{Log, LogError, Mapping, ReadOptions, Wanted};
use system_tests::program;

fn file(bytes: &[u8]) -> tempfile::NamedTempFile {
    let mut file = tempfile::NamedTempFile::new().unwrap();
    file.write_all(bytes).unwrap();
    file
}

fn read(path: &Path, threads: usize) -> Result<(), LogError> {
    let log = Log::open(path, &Mapping::default())?;
    let wanted = Wanted {
        time: log.has_time(),
        readings: true,
        wrench: log.has_wrench(),
        groups: log.has_groups(),
        others: Vec::new(),
        ..Wanted::default()
    };
    let options = ReadOptions { threads, ..ReadOptions::default() };
    log.with_chunk_bytes(64).read(&wanted, &options, |_| (), |()| Ok::<(), LogError>(()))?;
    Ok(())
}

/// Returns the message about a file, without its path.
fn complaint(bytes: &[u8]) -> String {
    let file = file(bytes);
    let error = read(file.path(), 1).expect_err("a file with a fault").to_string();
    for threads in [2, 7] {
        assert_eq!(read(file.path(), threads).unwrap_err().to_string(), error);
    }
    error.replace(&file.path().display().to_string(), "FILE")
}

#[test]
fn each_fault_is_named_with_its_place() {
    let cases: &[(&str, &str)] = &[
        ("", "`FILE` is empty"),
        ("\n\r\n \n", "`FILE` is empty"),
        ("\u{feff}", "`FILE` is empty"),
        ("time,s1\n", "`FILE` has a header but no rows"),
        ("% time | S1\n", "`FILE` has a header but no rows"),
        ("# a remark\n", "`FILE` has a header but no rows"),
        ("time,s1\n1,2\n2,x\n", "`FILE`, line 3: column 2 (`s1`): expected a number, found `x`"),
        ("time,s1\n1,2\n2,\n", "`FILE`, line 3: column 2 (`s1`): expected a number, found nothing"),
        (
            "time,s1\n1,2\n\n2,NaN\n",
            "`FILE`, line 4: column 2 (`s1`): expected a finite number, found `NaN`",
        ),
        (
            "time,s1\n-inf,2\n",
            "`FILE`, line 2: column 1 (`time`): expected a finite number, found `-inf`",
        ),
        (
            "time,s1\n1,1e999\n",
            "`FILE`, line 2: column 2 (`s1`): expected a finite number, found `1e999`",
        ),
        ("time,s1,s2\n1,2,3\n1,2\n", "`FILE`, line 3: expected 3 columns, found 2"),
        ("time,s1\n1,2,3\n", "`FILE`, line 2: expected 2 columns, found 3"),
        ("s1,note,x\n1,a,b\n1,a\n", "`FILE`, line 3: expected 3 columns, found 2"),
        ("s1,note,x\n1,a,b,c\n", "`FILE`, line 2: expected 3 columns, found 4"),
        ("time,s1,s2\n1,2,3\n1,2\n1,2", "`FILE`, line 3: expected 3 columns, found 2"),
        ("time;s1\n1,5;x\n", "`FILE`, line 2: column 2 (`s1`): expected a number, found `x`"),
        (
            "time,s1\n2026-11-22T10:00:00,2\n7,2\n",
            "`FILE`, line 3: column 1 (`time`): expected a date and time such as \
             2026-03-01T12:00:00.25, found `7`",
        ),
        (
            "time,\"s1\"\n1,\"2\"\n1,\"x\"\n",
            "`FILE`, line 3: column 2 (`s1`): expected a number, found `x`",
        ),
        ("time,s1\n1,\"2\n2,3\n", "`FILE`, line 2: expected a closing quote on the same line"),
        ("time,s1,S1\n1,2,3\n", "`FILE`, line 1: columns 2 (`s1`) and 3 (`S1`) are both sensor 1"),
        (
            "time,Timestamp,s1\n1,2,3\n",
            "`FILE`, line 1: columns 1 (`time`) and 2 (`Timestamp`) are both time",
        ),
        ("time,s1,s3\n1,2,3\n", "`FILE`, line 1: no column `s2`; found `time`, `s1`, `s3`"),
        ("time,Fx\n1,2\n", "`FILE`, line 1: no column `s1 … (sensors)`; found `time`, `Fx`"),
        ("% hello\n1,2,3\n", "`FILE`: no `%` line names the columns, separated by `|`"),
        (
            "1,2,3\n4,5,6\n",
            "`FILE`, line 1: 3 columns and no header, expected 15 (time, 8 sensors, wrench) \
             or 12 (2 others, time, wrench, motion)",
        ),
        ("time,s1\n1,2\0\n", "`FILE` is not a text file: byte 11 is 0x00"),
        (
            "SRC: 0x2052 |  [69, 20, 1, 2]\n",
            "`FILE`, line 1: expected a scan of 22 bytes (0 to 255) with readings below 4096, found `69, 20, 1, 2`",
        ),
    ];
    for (text, expected) in cases {
        assert_eq!(complaint(text.as_bytes()), *expected, "{text:?}");
    }
}

#[test]
fn a_fault_far_down_a_file_is_found_at_its_line_with_any_number_of_threads() {
    let mut text = "time,s1\n".to_owned();
    for row in 0..5000 {
        text += &format!("{row},{}\n", if row == 4321 { "oops" } else { "7" });
        text += if row == 4800 { "too,many,columns\n" } else { "" };
    }
    let expected = "`FILE`, line 4323: column 2 (`s1`): expected a number, found `oops`";
    assert_eq!(complaint(text.as_bytes()), expected);
    let windows = text.replace('\n', "\r\n");
    assert_eq!(complaint(windows.as_bytes()), expected);
}

#[test]
fn a_gzip_file_that_is_cut_short_or_damaged_is_distinguished_from_a_bad_log() {
    let mut gzip = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    for row in 0..20_000 {
        if row == 0 {
            gzip.write_all(b"time,s1\n").unwrap();
        }
        writeln!(gzip, "{row},{}", row * 7919 % 4096).unwrap();
    }
    let whole = gzip.finish().unwrap();
    read(file(&whole).path(), 2).unwrap();
    for cut in [10, 1000, whole.len() / 2, whole.len() - 1] {
        let error = read(file(&whole[..cut]).path(), 2).unwrap_err();
        assert!(matches!(error, LogError::Unpacking { method: "gzip", .. }), "{cut}: {error}");
    }
    let mut damaged = whole;
    let middle = damaged.len() - 6;
    damaged[middle] ^= 0xff;
    let error = read(file(&damaged).path(), 2).unwrap_err();
    assert!(matches!(error, LogError::Unpacking { method: "gzip", .. }), "{error}");
}

#[test]
fn directories_and_missing_files_are_errors() {
    let dir = tempfile::tempdir().unwrap();
    for path in [dir.path().to_owned(), dir.path().join("missing.csv")] {
        let error = read(&path, 1).unwrap_err();
        assert!(matches!(error, LogError::Io { .. }), "{error}");
    }
}

#[test]
fn a_line_without_end_is_refused() {
    let mut text = b"time,s1\n1,2\n".to_vec();
    text.resize(3 << 20, b'7');
    assert_eq!(complaint(&text), "`FILE`, line 3: longer than 1048576 bytes");
    assert_eq!(complaint(&vec![b'7'; 3 << 20]), "`FILE`, line 1: longer than 65536 bytes");
}

fn info(bytes: &[u8], args: &[&str]) -> Output {
    let file = file(bytes);
    let mut command = program::command(Path::new("."));
    command.arg("info").arg(file.path()).args(args).output().unwrap()
}

#[test]
fn the_command_ends_with_2_and_a_hint() {
    for (text, hint) in [
        ("time,s1\n1,x\n", "`--skip-bad-rows`"),
        ("time,s1\n", "nothing was recorded"),
        ("time,time,s1\n1,2,3\n", "`--time 1` or `--time 2`"),
        ("1,2,3\n", "`--time 1 --sensors 2-3`"),
        // No column is a time, because the first one does not rise.
        ("5,2,3,1,1,1,1,1\n4,1,2,1,1,1,1,1\n", "`--sensors 1-2 --wrench 3-8`"),
        ("% hello\n1\n", "names the columns"),
        ("\u{1f}\u{1}", "logs are text"),
    ] {
        let output = info(text.as_bytes(), &[]);
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{text:?}");
        assert!(output.stdout.is_empty());
        assert!(stderr.starts_with("error: `"), "{stderr}");
        assert!(stderr.contains("\nhint: ") && stderr.contains(hint), "{text:?}: {stderr}");
    }
}

#[test]
fn bad_rows_are_left_out_on_request_and_counted() {
    let output = info(b"time,s1\n1,2\n1,x\n2,3\n", &["--skip-bad-rows", "--json"]);
    assert_eq!(output.status.code(), Some(0));
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((json[0]["rows"].as_u64(), json[0]["skipped_rows"].as_u64()), (Some(2), Some(1)));
}

#[test]
fn faults_among_decimal_commas_are_shown_as_the_file_has_them() {
    // A message shows a point as a point.
    for (field, expected) in [("1,5x", "found `1,5x`"), ("1.5x", "found `1.5x`")] {
        let text = format!("t_s;s1\n0,5;1,25\n1,5;{field}\n");
        let output = info(text.as_bytes(), &[]);
        let said = String::from_utf8(output.stderr).unwrap();
        assert!(said.contains("line 3") && said.contains(expected), "{said}");
    }
}

#[test]
fn suspicious_logs_are_reported() {
    let mut text = "time_us,s1,s2,s3,s4\n".to_owned();
    for row in 0..200 {
        let time = row * 1000 + if row >= 100 { 5000 } else { 0 };
        let time = if row == 150 { 3 } else { time };
        let wave = 2000 + (row * 37 % 500);
        text += &format!("{time},{wave},1234,{},{}\n", (wave * 2).min(4095), wave.min(2300));
    }
    let output = info(text.as_bytes(), &[]);
    let stdout = String::from_utf8(output.stdout).unwrap();
    for said in [
        "1000.00 Hz",
        "time runs backwards 1 times, first at row 151",
        "constant",
        "rows at 4095",
        "pinned: ",
    ] {
        assert!(stdout.contains(said), "{said}: {stdout}");
    }
    let json = info(text.as_bytes(), &["--json"]).stdout;
    let json: serde_json::Value = serde_json::from_slice(&json).unwrap();
    assert_eq!(json[0]["format"], "csv");
    assert_eq!(json[0]["time"]["median_rate_hz"], 1000.0);
    assert_eq!(json[0]["columns"][2]["constant"], true);
}
