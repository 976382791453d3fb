//! `shellcal stream` of a log: complete files, reported failures, and commands with any bytes.

use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Command, Stdio};

use serde_json::Value;
use system_tests::program::{self, refused, succeed};
use tempfile::TempDir;

fn folder(rows: usize) -> TempDir {
    let dir = tempfile::tempdir().unwrap();
    succeed(&dir, &format!("synth zero --rows {rows} -o log.csv"));
    dir
}

fn read(dir: &TempDir, name: &str) -> String {
    fs::read_to_string(dir.path().join(name)).unwrap()
}

#[cfg(unix)]
fn into(dir: &Path, arguments: &str, path: &str) -> (Option<i32>, String) {
    let output = fs::OpenOptions::new().write(true).open(path).unwrap();
    let mut run = program::command(dir);
    let output = run.args(arguments.split_whitespace()).stdout(output).output().unwrap();
    (output.status.code(), String::from_utf8(output.stderr).unwrap())
}

#[test]
fn the_file_name_decides_the_format() {
    let dir = folder(120);
    succeed(&dir, "stream log.csv --speed 1000 -o rows.csv -o rows.jsonl");
    let (csv, json) = (read(&dir, "rows.csv"), read(&dir, "rows.jsonl"));
    assert!(csv.starts_with("t_s,index,host_s,"), "{csv}");
    assert_eq!((csv.lines().count(), json.lines().count()), (121, 120));
    let first: Value = serde_json::from_str(json.lines().next().unwrap()).unwrap();
    assert!(csv.lines().nth(1).unwrap().starts_with(&first["t_s"].to_string()));
    succeed(&dir, "stream log.csv --speed 1000 --encoding json -o rows-2.csv");
    assert!(read(&dir, "rows-2.csv").starts_with('{'));
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_ends_a_command_and_keeps_the_written_part() {
    let dir = folder(400);
    let (_, said) = program::ended(&dir, "stream log.csv --speed 1000 -o /dev/full", 2);
    assert!(said.contains("cannot write `/dev/full`: 0 rows, "), "{said}");
    assert!(said.contains(" lost: No space left"), "{said}");
    for (arguments, expected) in [
        ("stream log.csv --speed 1000", "cannot write standard output: 0 rows, "),
        ("--help", "cannot write standard output: No space left"),
        ("help fit", "cannot write standard output: No space left"),
        ("info log.csv", "No space left"),
    ] {
        let (code, said) = into(dir.path(), arguments, "/dev/full");
        assert_eq!(code, Some(2), "{arguments}: {said}");
        assert!(said.contains(expected), "{arguments}: {said}");
    }
    // A file may not grow beyond 16 KiB, as on a full disk.
    let limit = "trap '' XFSZ; ulimit -f 32; exec \"$0\" stream log.csv --speed 1000 -o rows.csv";
    let mut run = Command::new("sh");
    run.args(["-c", limit]).arg(env!("CARGO_BIN_EXE_shellcal"));
    let output = run.current_dir(dir.path()).output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{said}");
    let rows = read(&dir, "rows.csv");
    assert!(rows.is_empty() || rows.ends_with('\n'), "it ends within a row: {rows}");
    let held = rows.lines().count().saturating_sub(1);
    let expected = format!("cannot write `rows.csv`: {held} rows, ");
    assert!(said.contains(&expected), "{expected}: {said}");
}

#[test]
fn a_rate_that_no_filter_has_is_refused() {
    let dir = folder(60);
    let said = refused(&dir, "stream log.csv --rate 1e-6");
    assert!(said.contains("a rate in Hz from 0.1"), "{said}");
}

#[test]
fn commands_are_lines_of_any_bytes_and_do_not_hold_up_rows() {
    let dir = folder(100_000);
    let mut run = program::command(dir.path());
    run.args(["stream", "log.csv", "--until-eof"]);
    let run = run.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = run.spawn().unwrap();
    let mut input = child.stdin.take().unwrap();
    let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
    input.write_all(b"\xff\xfe\x1b[31m\nma\xffrk\n").unwrap();
    input.write_all(&b"mark\n".repeat(550)).unwrap();
    let mut marks = || -> Vec<String> {
        let row: Value = serde_json::from_str(&lines.next().unwrap().unwrap()).unwrap();
        row["flags"].as_str().unwrap().split(' ').map(str::to_owned).collect()
    };
    let first = std::iter::repeat_with(&mut marks).find(|marks| marks[0] == "mark1").unwrap();
    // Fewer marks than arrive in this burst are obeyed in five seconds.
    assert!(!first.iter().any(|mark| mark == "mark500"), "{first:?}");
    let mut all = std::iter::repeat_with(&mut marks);
    assert!(all.any(|marks| marks.iter().any(|mark| mark == "mark550")));
    drop(input);
    let said = program::finish(child, "stream", 0);
    assert!(said.matches("is no command").count() == 2 && !said.contains('\x1b'), "{said}");
}

#[cfg(unix)]
#[test]
fn devices_and_pipes_are_refused_at_once() {
    let dir = folder(60);
    let fifo = |name: &str| Command::new("mkfifo").arg(dir.path().join(name)).status().unwrap();
    assert!(fifo("pipe").success());
    let said = refused(&dir, "doctor pipe");
    assert!(said.contains("it is not a regular file"), "{said}");
    let settings = dir.path().join("shellcal.toml");
    assert!(fifo("shellcal.toml").success());
    let said = refused(&dir, "info log.csv");
    assert!(said.contains("cannot read `shellcal.toml`"), "{said}");
    fs::remove_file(&settings).unwrap();
    std::os::unix::fs::symlink("nowhere", &settings).unwrap();
    let said = refused(&dir, "info log.csv");
    assert!(said.contains("cannot read `shellcal.toml`"), "{said}");
    fs::remove_file(&settings).unwrap();
    fs::create_dir(&settings).unwrap();
    let said = refused(&dir, "info log.csv");
    assert!(said.contains("cannot read `shellcal.toml`"), "{said}");
    succeed(&dir, "info log.csv --no-config");
}

#[test]
fn errors_of_the_command_line_are_escaped() {
    let dir = tempfile::tempdir().unwrap();
    for word in ["--\u{1b}]0;title\u{7}", "fi\u{1b}[31mt", "\u{202e}tif"] {
        let output = program::command(dir.path()).arg(word).output().unwrap();
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(!said.contains(['\u{1b}', '\u{7}', '\u{202e}']), "{said:?}");
    }
}
