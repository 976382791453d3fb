//! `shellcal stream` between a simulated board and its readers.

use std::collections::HashMap;
use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, Stdio};

use serde_json::Value;
use system_tests::program::{
    Recording, command, ended, finish, interrupt, refused, run, start, succeed, wait_for_rows,
};

use crate::simulated_board::Board;

const AXES: [&str; 6] = ["fx_n", "fy_n", "fz_n", "mx_nm", "my_nm", "mz_nm"];

fn calibration(dir: &Path) {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../calibration-data");
    let training = data.join("synthetic-train.csv");
    run(dir, &format!("fit {} --model cubic --output cal.json", training.display()), 0);
}

fn rows(path: &Path) -> Vec<Value> {
    let text = fs::read_to_string(path).unwrap();
    text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

fn bits(rows: &[Value]) -> HashMap<i64, [u64; 6]> {
    let wrench = |row: &Value| AXES.map(|axis| row[axis].as_f64().unwrap().to_bits());
    rows.iter().map(|row| (row["index"].as_i64().unwrap(), wrench(row))).collect()
}

fn talk(dir: &Path, arguments: &str) -> Child {
    let mut program = command(dir);
    program.args(arguments.split_whitespace());
    program.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

#[test]
fn rows_have_the_bits_of_the_log() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    calibration(dir);
    for how in ["", "--as-sampled"] {
        let board = Board::start(dir, "--seed 3");
        let arguments = format!("--calibration cal.json {how} --stream rows.jsonl");
        let (log, _) = board.record("log.csv", 300, &arguments);
        board.end();
        let streamed = rows(&dir.join("rows.jsonl"));
        let streamed_bits = bits(&streamed);
        let wrenches = log.table(AXES);
        // With alignment, the last three frames wait for later ones, or for the end.
        assert_eq!(streamed.len(), log.rows());
        assert!(log.rows() >= 300);
        let (index, times) = (log.numbers("index"), log.numbers("t_s"));
        let mut compared = 0;
        for (row, wrench) in wrenches.iter().enumerate() {
            let Some(found) = streamed_bits.get(&(index[row] as i64)) else { continue };
            assert_eq!(found, &wrench.map(f64::to_bits), "{how} frame {}", index[row]);
            compared += 1;
        }
        assert_eq!(compared, streamed.len());
        for (row, streamed) in streamed.iter().enumerate() {
            assert_eq!(streamed["t_s"].as_f64(), Some(times[row]));
            assert_eq!(streamed["row"].as_u64(), Some(row as u64));
            assert_eq!(streamed["flags"].as_str(), Some(log.text("flags")[row]));
            assert!(streamed["fx_se_n"].as_f64().unwrap() > 0.0);
        }
        fs::remove_file(dir.join("log.csv")).unwrap();
        fs::remove_file(dir.join("rows.jsonl")).unwrap();
    }
}

#[test]
fn a_log_streams_with_the_bits_of_convert() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    calibration(dir);
    succeed(dir, "synth zero --rows 400 -o log.csv");
    succeed(dir, "convert cal.json log.csv --causal --all-rows -o wrench.csv");
    succeed(dir, "stream log.csv --calibration cal.json --speed 1000 --encoding csv -o rows.csv");
    let (streamed, converted) =
        (Recording::read(&dir.join("rows.csv")), Recording::read(&dir.join("wrench.csv")));
    assert_eq!(streamed.rows(), 400);
    // Until tare and clock are known, rows have the calibration's forces alone.
    let bits = |recording: &Recording| -> Vec<[u64; 6]> {
        recording.table(AXES)[50..].iter().map(|wrench| wrench.map(f64::to_bits)).collect()
    };
    assert_eq!(bits(&streamed), bits(&converted));
    assert_eq!(streamed.numbers("t_s"), converted.numbers("t_s"));
    let errors = ["fx_se_n", "mz_se_nm"];
    let last = |recording: &Recording| recording.table(errors)[399];
    assert_eq!(last(&streamed), last(&converted));
    let printed = succeed(dir, "stream log.csv --speed 1000");
    let first: Value = serde_json::from_str(printed.lines().next().unwrap()).unwrap();
    assert!(first["fx_n"].is_number() && first.get("s8").is_none(), "{first}");
    assert_eq!(printed.lines().count(), 400);
}

#[test]
fn commands_come_by_the_standard_input() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    calibration(dir);
    let board = Board::start(dir, "--noise-scale 0 --load -");
    let arguments =
        "stream board --start --calibration cal.json --no-tare --no-lowpass --until-eof";
    let mut child = talk(dir, arguments);
    let mut input = child.stdin.take().unwrap();
    let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
    let mut next = || -> Value { serde_json::from_str(&lines.next().unwrap().unwrap()).unwrap() };
    let flag =
        |row: &Value, flag: &str| row["flags"].as_str().unwrap().split(' ').any(|it| it == flag);
    next();
    writeln!(input, "tare\nmark\nbark").unwrap();
    let mut seen = Vec::new();
    let tared = loop {
        let row = next();
        if flag(&row, "tared") {
            break row;
        }
        seen.push(row);
    };
    assert!(seen.iter().any(|row| flag(row, "mark1")));
    let fx = |row: &Value| row["fx_n"].as_f64().unwrap();
    // A step of the converter is about 0.005 N.
    assert!(fx(&tared).abs() < 0.02, "{tared}");
    assert!(seen.iter().all(|row| (fx(row) - fx(&seen[0])).abs() < 0.05));
    writeln!(input, "rate 10").unwrap();
    let times: Vec<f64> = (0..200).map(|_| next()["t_s"].as_f64().unwrap()).collect();
    let slow = times.windows(2).filter(|pair| (pair[1] - pair[0] - 0.1).abs() < 1e-3).count();
    assert!(slow >= 60, "{slow}");
    drop(input);
    let said = finish(child, arguments, 0);
    assert!(said.contains("`bark` is no command"), "{said}");
    board.end();
}

#[test]
fn inputs_that_cannot_be_streamed_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    calibration(dir);
    succeed(dir, "synth zero --rows 60 -o log.csv");
    let said = refused(dir, "record --replay log.csv -o -");
    assert!(said.contains("shellcal stream"), "{said}");
    for name in ["record --replay log.csv -o run.mcap", "stream log.csv -o run.mcap"] {
        let said = refused(dir, name);
        assert!(said.contains("shellcal convert CAL run.csv"), "{said}");
    }
    fs::write(dir.join("there.csv"), "rows of another day\n").unwrap();
    for (arguments, word) in [
        ("stream log.csv -o udp:nowhere", "udp:HOST:PORT"),
        ("stream log.csv -o log.csv", "would replace the input `log.csv`"),
        ("stream log.csv -o log.csv --overwrite", "would replace the input `log.csv`"),
        ("stream log.csv -o there.csv", "--overwrite"),
        ("stream log.csv --rate 0", "a rate in Hz"),
        ("stream nothing.csv", "nothing.csv"),
        ("stream log.csv --latency", "is for a port"),
        ("record board --calibration cal.json --raw raw", "--stream"),
    ] {
        let said = refused(dir, arguments);
        assert!(said.contains(word), "{arguments}: {said}");
    }
    let other = "t_s,s1,s2,fx_n,fy_n,fz_n,mx_nm,my_nm,mz_nm\n";
    let row = |i: i32| {
        let (a, b) = (i * 37 % 101, i * 53 % 97);
        format!("{i},{a},{b},{a},{b},{},{},1,{}\n", a + b, a - b, 2 * a)
    };
    let table: String = other.to_owned() + &(0..200).map(row).collect::<String>();
    fs::write(dir.join("other.csv"), table).unwrap();
    ended(dir, "fit other.csv --model linear -o two.json -q", 0);
    let said = refused(dir, "stream log.csv --calibration two.json");
    assert!(said.contains("2 channels"), "{said}");
    let (_, said) =
        ended(dir, "stream log.csv --calibration cal.json --lowpass 400 --speed 1000", 2);
    assert!(said.contains("error: "), "{said}");
}

#[test]
fn a_board_that_goes_away_ends_the_stream_or_is_waited_for() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let board = Board::start(dir, "--radio corruption=0.002");
    let ending = start(dir, "stream board --start -o ending.jsonl");
    wait_for_rows(&dir.join("ending.jsonl"), 50);
    board.end();
    let said = finish(ending, "stream", 2);
    assert!(said.contains("is gone"), "{said}");
    assert!(said.contains("bad CRC") || rows(&dir.join("ending.jsonl")).len() >= 50);

    let board = Board::start(dir, "");
    let waiting = start(dir, "stream board --start --reconnect -o waiting.jsonl");
    wait_for_rows(&dir.join("waiting.jsonl"), 50);
    board.end();
    let before = rows(&dir.join("waiting.jsonl")).len();
    let board = Board::start(dir, "");
    wait_for_rows(&dir.join("waiting.jsonl"), before + 50);
    interrupt(&waiting);
    finish(waiting, "stream", 0);
    board.end();
    let rows = rows(&dir.join("waiting.jsonl"));
    let restart = rows.iter().position(|row| row["flags"].as_str().unwrap().contains("restart"));
    assert!(restart.is_some_and(|at| at >= before), "{restart:?} of {before}");
    assert!(rows.windows(2).all(|pair| pair[1]["t_s"].as_f64() > pair[0]["t_s"].as_f64()));
}
