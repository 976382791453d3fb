//! Wrenches in every file format. Our readers and popular programs read the same numbers as from CSV.

use std::path::{Path, PathBuf};

use log_file::{Log, LogError, Mapping, ReadOptions, Wanted};
use system_tests::program;

const EXTENSIONS: [&str; 4] = ["parquet", "mat", "npy", "mcap"];

/// Converts 2,100 rows to every file format. Without a low-pass, all worker threads encode rows.
fn converted(dir: &Path, flags: &str) -> Vec<PathBuf> {
    program::run(dir, "synth train --rows 2100 --seed 5 -o log.csv", 0);
    // Forty poses suffice for confidence intervals.
    program::run(dir, "synth train --rows 8000 --seed 6 -o train.csv", 0);
    program::run(dir, "fit train.csv --model linear -o cal.json", 0);
    let convert = |extension: &str| {
        program::run(dir, &format!("convert cal.json log.csv -o out.{extension} {flags}"), 0);
        dir.join(format!("out.{extension}"))
    };
    ["csv"].iter().chain(&EXTENSIONS).map(|extension| convert(extension)).collect()
}

/// Returns the numeric columns except the time, which recordings round to ns.
fn columns(path: &Path) -> Vec<(String, Vec<f64>)> {
    let log = Log::open(path, &Mapping::default()).unwrap();
    let is_number = |name: &str| !name.starts_with("flags") && !name.starts_with('s');
    let names = log.columns().iter().map(|column| column.name.to_lowercase());
    let wanted = names
        .enumerate()
        .filter(|(_, name)| is_number(name) && !["t_s", "log"].contains(&name.as_str()));
    let wanted: Vec<(usize, String)> = wanted.collect();
    let others = wanted.iter().map(|(position, _)| *position).collect();
    let mut columns: Vec<(String, Vec<f64>)> =
        wanted.into_iter().map(|(_, name)| (name, Vec::new())).collect();
    log.read(
        &Wanted { others, ..Wanted::default() },
        &ReadOptions::default(),
        |block| std::mem::take(&mut block.others),
        |block| {
            columns.iter_mut().zip(block).for_each(|((_, column), more)| column.extend(more));
            Ok::<_, LogError>(())
        },
    )
    .unwrap();
    for (name, _) in &mut columns {
        // The axes of a ROS wrench have no units in their names.
        if name.len() == 2 {
            name.push_str(if name.starts_with('f') { "_n" } else { "_nm" });
        }
    }
    columns.sort_by(|a, b| a.0.cmp(&b.0));
    columns
}

#[test]
fn every_kind_of_file_holds_the_numbers_of_the_csv() {
    let dir = tempfile::tempdir().unwrap();
    for flags in ["--no-lowpass", "--lowpass 10 --interval=95"] {
        let files = converted(dir.path(), flags);
        let expected = columns(&files[0]);
        assert!(expected.len() >= 12 && expected[0].1.len() == 2100, "{flags}");
        for file in &files[1..] {
            assert_eq!(columns(file), expected, "{} {flags}", file.display());
            std::fs::remove_file(file).unwrap();
        }
    }
}

#[test]
fn results_do_not_depend_on_threads() {
    let dir = tempfile::tempdir().unwrap();
    converted(dir.path(), "--no-lowpass --threads 1");
    let bytes =
        |extension: &str| std::fs::read(dir.path().join(format!("out.{extension}"))).unwrap();
    let expected: Vec<Vec<u8>> = EXTENSIONS.iter().map(|extension| bytes(extension)).collect();
    converted(dir.path(), "--no-lowpass --threads 5");
    for (extension, expected) in EXTENSIONS.iter().zip(&expected) {
        assert!(bytes(extension) == *expected, "{extension}");
    }
}

#[test]
fn unwritable_outputs_are_refused_before_any_work() {
    let dir = tempfile::tempdir().unwrap();
    converted(dir.path(), "--no-lowpass");
    for (flags, expected) in [
        ("-o out.xlsx", "`out.xlsx` ends in none of `.csv`"),
        ("-o out", "`out` ends in none of"),
        ("-o new.mcap --columns fx", "needs time and all six axes"),
    ] {
        let command = format!("convert cal.json log.csv {flags}");
        let said = program::run(dir.path(), &command, 2);
        assert!(said.contains(expected), "{said}");
    }
    assert!(!dir.path().join("new.mcap").exists() && !dir.path().join("out").exists());
    let piped = program::output(dir.path(), "convert cal.json log.csv --no-lowpass -o -");
    assert_eq!(piped.stdout, std::fs::read(dir.path().join("out.csv")).unwrap());
}

#[test]
fn other_columns_are_carried_along() {
    let dir = tempfile::tempdir().unwrap();
    let rows = (0..400).map(|row| {
        let reading = |channel: i32| 2000 + (row * (7 + channel)) % 501;
        let readings: Vec<String> = (0..8).map(|channel| reading(channel).to_string()).collect();
        format!(
            "{},{},{},{},pose {}\n",
            f64::from(row) / 100.0,
            readings.join(","),
            row % 7,
            0.25 * f64::from(row),
            row / 50
        )
    });
    let header = "t_s,s1,s2,s3,s4,s5,s6,s7,s8,temperature,fx_n,group\n";
    let text: String = std::iter::once(header.to_owned()).chain(rows).collect();
    std::fs::write(dir.path().join("log.csv"), &text).unwrap();
    program::run(dir.path(), "synth train --rows 600 --seed 5 -o train.csv", 0);
    program::run(dir.path(), "fit train.csv --model linear -o cal.json", 0);
    for (flags, filter, names) in [
        ("--keep all", "--no-lowpass", "t_s,fz_n,temperature,fx_n,group"),
        ("--keep temperature,11", "--lowpass 5", "t_s,fz_n,temperature,fx_n"),
    ] {
        let command =
            format!("convert cal.json log.csv --columns t,fz {filter} {flags} -o out.csv");
        program::run(dir.path(), &command, 0);
        let out = std::fs::read_to_string(dir.path().join("out.csv")).unwrap();
        let mut lines = out.lines();
        // The force column of the log keeps its name, because no other output column has it.
        assert_eq!(lines.next(), Some(names), "{flags}");
        let kept = |line: &str, positions: [usize; 2]| -> [f64; 2] {
            positions.map(|at| line.split(',').nth(at).unwrap().parse().unwrap())
        };
        let found: Vec<_> = lines.map(|line| kept(line, [2, 3])).collect();
        let expected: Vec<_> = text.lines().skip(1).map(|line| kept(line, [9, 10])).collect();
        assert_eq!(found, expected, "{flags}");
    }
    program::run(dir.path(), "convert cal.json log.csv --no-lowpass --keep fx_n -o out.csv", 0);
    let out = std::fs::read_to_string(dir.path().join("out.csv")).unwrap();
    assert!(out.lines().next().unwrap().contains("log_fx_n"), "two columns of one name");
    let said = program::run(dir.path(), "convert cal.json log.csv --keep nothing -o x.csv", 2);
    assert!(said.contains("no column `nothing`"), "{said}");
}

const CHECK: &str = r#"
import csv, json, math, sys
import numpy, polars, scipy.io
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from mcap_ros2.reader import read_ros2_messages
from rosbags.highlevel import AnyReader
from pathlib import Path

rows = list(csv.DictReader(open("out.csv")))
names = [name for name in rows[0] if name != "flags"]
expected = {name: [float(row[name]) for row in rows] for name in names}
flags = [row["flags"] for row in rows]

table = polars.read_parquet("out.parquet")
assert table.columns == names + ["flags"], table.columns
assert all(table[name].to_list() == expected[name] for name in names)
assert table["flags"].to_list() == flags

mat = scipy.io.loadmat("out.mat")
assert all(mat[name].shape == (len(rows), 1) for name in names)
assert all(mat[name].ravel().tolist() == expected[name] for name in names)
npy = numpy.load("out.npy")
assert all(npy[name].tolist() == expected[name] for name in names)
assert npy["flags"].tolist() == flags

stamp = lambda header: header.stamp.sec * 10**9 + header.stamp.nanosec
axes = lambda w: [w.force.x, w.force.y, w.force.z, w.torque.x, w.torque.y, w.torque.z]
wanted = [[row[name] for name in names[1:7]] for row in ({n: expected[n][i] for n in names} for i in range(len(rows)))]
with open("out.mcap", "rb") as file:
    reader = make_reader(file, decoder_factories=[DecoderFactory()])
    summary = reader.get_summary()
    assert reader.get_header().profile == "ros2"
    assert summary.statistics.message_count == 2 * len(rows), summary.statistics
    assert len(summary.chunk_indexes) == summary.statistics.chunk_count > 1
    messages = list(reader.iter_decoded_messages(topics=["/wrench"]))
    assert [axes(message.decoded_message.wrench) for message in messages] == wanted
    for i, message in enumerate(messages):
        assert abs(stamp(message.decoded_message.header) - expected["t_s"][i] * 1e9) <= 1
        assert stamp(message.decoded_message.header) == message.message.log_time
        assert message.decoded_message.header.frame_id == "shell"
    details = [it.decoded_message for it in reader.iter_decoded_messages(topics=["/wrench/details"])]
    assert [row.flags for row in details] == flags
    assert [row.fx_se_n for row in details] == expected["fx_se_n"]
    assert [stamp(row.header) for row in details] == [stamp(m.decoded_message.header) for m in messages]
    assert min(stamp(row.header) for row in details) > 0
    log = list(csv.DictReader(open("log.csv")))
    assert [row.s1 for row in details] == [float(row["s1"]) for row in log]
# No topic is named: every message of a bag is of a type of ROS.
assert sum(1 for _ in read_ros2_messages("out.mcap")) == 2 * len(rows)
with AnyReader([Path("out.mcap")]) as reader:
    assert sum(reader.deserialize(raw, c.msgtype) is not None for c, _, raw in reader.messages()) == 2 * len(rows)
    wrenches = [c for c in reader.connections if c.topic == "/wrench"]
    found = [axes(reader.deserialize(raw, c.msgtype).wrench) for c, _, raw in reader.messages(wrenches)]
    assert found == wanted
print("checked", len(rows))
"#;

#[test]
#[ignore = "needs a Python with packages that read tables and bags"]
fn python_packages_read_the_written_files() {
    let dir = tempfile::tempdir().unwrap();
    converted(dir.path(), "--no-lowpass");
    let checked = program::python().args(["-c", CHECK]).current_dir(dir.path()).output().unwrap();
    let said = String::from_utf8_lossy(&checked.stderr);
    assert!(checked.status.success(), "{said}");
    assert_eq!(String::from_utf8_lossy(&checked.stdout).trim(), "checked 2100");
}
