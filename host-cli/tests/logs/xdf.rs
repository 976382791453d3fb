//! Recordings of Lab Streaming Layer as logs: readings with forces from another computer.

use std::fs;
use std::path::Path;

use shell_data::Block;
use system_tests::program::{python, run};

use crate::recording::read_log;

fn chunk(tag: u16, content: &[&[u8]]) -> Vec<u8> {
    let content = content.concat();
    let length = (content.len() + 2) as u32;
    [&[4], &length.to_le_bytes()[..], &tag.to_le_bytes(), &content].concat()
}

fn header(id: u32, name: &str, rate_hz: u32, format: &str, labels: &[(&str, &str)]) -> Vec<u8> {
    let channels: String = labels
        .iter()
        .map(|(label, unit)| {
            format!("<channel><label>{label}</label><unit>{unit}</unit></channel>")
        })
        .collect();
    let text = format!(
        "<?xml version=\"1.0\"?><info><name>{name}</name><type>F</type><channel_count>{}</channel_count>\
         <nominal_srate>{rate_hz}</nominal_srate><channel_format>{format}</channel_format>\
         <created_at>1</created_at><desc><channels>{channels}</channels></desc></info>",
        labels.len()
    );
    chunk(2, &[&id.to_le_bytes(), text.as_bytes()])
}

fn sample(id: u32, time_s: f64, values: &[u8]) -> Vec<u8> {
    chunk(3, &[&id.to_le_bytes(), &[1, 1, 8], &time_s.to_le_bytes(), values])
}

/// Writes readings at 100 Hz with a pause of 4 s, and forces at 250 Hz by a clock 3 s behind and 80 ppm slow.
fn recording(path: &Path) {
    let own = |time_s: f64| (time_s - 3.0) * (1.0 - 80e-6);
    let labels: Vec<(String, &str)> = (1..=8).map(|n| (format!("s{n}"), "counts")).collect();
    let labels: Vec<(&str, &str)> = labels.iter().map(|(l, u)| (l.as_str(), *u)).collect();
    let axes = ["Fx", "Fy", "Fz", "Tx", "Ty", "Tz"];
    let forces: Vec<(&str, &str)> =
        axes.iter().map(|axis| (*axis, if axis.starts_with('F') { "N" } else { "N*mm" })).collect();
    let mut bytes = b"XDF:".to_vec();
    bytes.extend(chunk(1, &[b"<?xml version=\"1.0\"?><info><version>1.0</version></info>"]));
    bytes.extend(header(7, "shell", 100, "int16", &labels));
    bytes.extend(header(9, "reference", 250, "double64", &forces));
    for at in (0..=20).map(|n| 100.0 + 5.0 * f64::from(n)) {
        let (own, offset) = (own(at), at - own(at));
        bytes.extend(chunk(4, &[&9_u32.to_le_bytes(), &own.to_le_bytes(), &offset.to_le_bytes()]));
        bytes.extend(chunk(4, &[&7_u32.to_le_bytes(), &at.to_le_bytes(), &0_f64.to_le_bytes()]));
    }
    for n in 0..2000_i32 {
        let time_s = 110.0 + f64::from(n) / 100.0 + if n >= 900 { 4.0 } else { 0.0 };
        let values: Vec<u8> = (0..8).flat_map(|c| ((n + 100 * c) as i16).to_le_bytes()).collect();
        bytes.extend(sample(7, time_s, &values));
    }
    for n in 0..7000_i32 {
        let time_s = 109.0 + f64::from(n) / 250.0;
        let values: Vec<u8> =
            (0..6).flat_map(|c| (time_s * f64::from(c + 1)).sin().to_le_bytes()).collect();
        bytes.extend(sample(9, own(time_s), &values));
    }
    fs::write(path, bytes).unwrap();
}

#[test]
fn readings_and_forces_of_two_computers_are_one_log() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("session.xdf");
    recording(&path);
    let log = read_log(&path).unwrap();
    assert_eq!((log.rows, log.readings.len(), log.wrench.len()), (2000, 8, 6));
    assert!((log.time_s[900] - log.time_s[899] - 4.01).abs() < 1e-9);
    for row in [0, 899, 900, 1999] {
        let time_s = log.time_s[row];
        assert_eq!(log.readings[3][row], row as f64 + 300.0);
        // Forces in N, moments in N·mm; between two samples the sine bends by 2e-6 n² or less.
        for (axis, column) in log.wrench.iter().enumerate() {
            let scale = if axis < 3 { 1.0 } else { 1e-3 };
            let wanted = scale * (time_s * (axis + 1) as f64).sin();
            assert!((column[row] - wanted).abs() < 1e-4 * scale, "row {row}, axis {axis}");
        }
    }
    let said = run(dir.path(), "info session.xdf", 0);
    assert!(said.contains("stream `reference` is interpolated to the times of `shell`"), "{said}");
}

const CHECK: &str = r#"
import csv, sys
import numpy as np, pyxdf
# Stamps as they were recorded: by default a line is laid through them, which hides the pause.
streams, _ = pyxdf.load_xdf("session.xdf", dejitter_timestamps=False)
streams = {s["info"]["name"][0]: s for s in streams}
shell, reference = streams["shell"], streams["reference"]
found = np.loadtxt("read.csv", delimiter=",")
assert found.shape == (2000, 15)
assert np.abs(found[:, 0] - shell["time_stamps"]).max() < 1e-9
assert (found[:, 1:9] == shell["time_series"]).all()
for axis in range(6):
    wanted = np.interp(found[:, 0], reference["time_stamps"], reference["time_series"][:, axis])
    error = np.abs(found[:, 9 + axis] * (1 if axis < 3 else 1e3) - wanted).max()
    assert error < 1e-6, (axis, error)
print("checked")
"#;

fn write_rows(log: &Block, path: &Path) {
    let columns = || [&log.time_s].into_iter().chain(&log.readings).chain(&log.wrench);
    let line = |row: usize| columns().map(|of| of[row].to_string()).collect::<Vec<_>>().join(",");
    let lines: Vec<String> = (0..log.rows).map(line).collect();
    fs::write(path, lines.join("\n")).unwrap();
}

#[test]
#[ignore = "needs a Python with packages that read tables and bags"]
fn pyxdf_reads_the_same_from_a_recording() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("session.xdf");
    recording(&path);
    write_rows(&read_log(&path).unwrap(), &dir.path().join("read.csv"));
    let checked = python().args(["-c", CHECK]).current_dir(dir.path()).output().unwrap();
    assert!(checked.status.success(), "{}", String::from_utf8_lossy(&checked.stderr));
}
