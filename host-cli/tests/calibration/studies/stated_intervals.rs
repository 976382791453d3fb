//! Stated 95 % intervals hold on new groups of other sensors, shipped data and the sensor model.

use std::fmt::Write;
use std::fs;
use std::path::Path;

use calibration::fit::{CovarianceRule, FitOptions, ModelRule};
use calibration::model::Basis;
use log_file::{ColumnRef, Log, Mapping, ReadOptions};
use shellcal::workflow::fit::FitData;
use system_tests::program::{json, succeed};
use system_tests::real_recording;

const AXES: [&str; 6] = ["fx_n", "fy_n", "fz_n", "mx_nm", "my_nm", "mz_nm"];

struct Parted {
    header: String,
    rows: Vec<(usize, String)>,
}

impl Parted {
    /// Divides groups, named in the last column, into consecutive parts: memory terms need the rows before a row.
    fn by_group(text: &str, parts: usize) -> Self {
        let mut lines = text.lines();
        let header = lines.next().unwrap().to_owned();
        let mut groups = Vec::new();
        let rows = lines.map(|line| {
            let group = line.rsplit(',').next().unwrap();
            let position = groups.iter().position(|known| *known == group).unwrap_or_else(|| {
                groups.push(group);
                groups.len() - 1
            });
            (position, line.to_owned())
        });
        let rows: Vec<(usize, String)> = rows.collect();
        let part = |(position, line)| (position * parts / groups.len(), line);
        Self { header, rows: rows.into_iter().map(part).collect() }
    }

    /// Assigns rows, which are already shuffled, to parts in turn.
    fn by_row(channels: usize, lines: impl Iterator<Item = String>, parts: usize) -> Self {
        let names = (1..=channels).map(|channel| format!("s{channel}"));
        let names: Vec<String> = names.chain(AXES.map(str::to_owned)).collect();
        let rows = lines.enumerate().map(|(row, line)| (row % parts, line));
        Self { header: names.join(","), rows: rows.collect() }
    }

    fn write(&self, path: &Path, is_wanted: impl Fn(usize) -> bool) {
        let mut text = self.header.clone() + "\n";
        let wanted = self.rows.iter().filter(|(part, _)| is_wanted(*part));
        wanted.for_each(|(_, line)| writeln!(text, "{line}").unwrap());
        fs::write(path, text).unwrap();
    }

    /// Returns the mean shares of rows within the interval of a plain fit to all other parts, and
    /// within that of each frame by `convert`.
    fn shares(&self, parts: usize) -> [[f64; 6]; 2] {
        let dir = tempfile::tempdir().unwrap();
        let mut found = [[0.0; 6]; 2];
        for part in 0..parts {
            self.write(&dir.path().join("train.csv"), |of| of != part);
            self.write(&dir.path().join("test.csv"), |of| of == part);
            let stated = json(&dir, "fit train.csv -o cal.json --json");
            let half = |axis: usize| stated["verdict"]["interval_95"][axis].as_f64().unwrap();
            succeed(
                &dir,
                "convert cal.json test.csv --no-tare --no-lowpass --all-rows --interval=95 -o out.csv",
            );
            let (measured, of_header) = columns(&dir.path().join("test.csv"));
            let (frames, of_frames) = columns(&dir.path().join("out.csv"));
            assert_eq!(measured.len(), frames.len());
            for (axis, name) in AXES.into_iter().enumerate() {
                let (base, unit) = name.split_once('_').unwrap();
                let at = |end: &str| of_frames(&format!("{base}{end}_{unit}"));
                let (load, value) = (of_header(name), at(""));
                let (lower, upper) = (at("_lower"), at("_upper"));
                let is_within = |row: usize| {
                    let (load, of) = (&measured[row][load], &frames[row]);
                    let stated = (of[value] - load).abs() <= half(axis);
                    [stated, (of[lower]..=of[upper]).contains(load)]
                };
                for row in 0..frames.len() {
                    let weight = ((frames.len() * parts) as f64).recip();
                    for (found, is_within) in found.iter_mut().zip(is_within(row)) {
                        found[axis] += if is_within { weight } else { 0.0 };
                    }
                }
            }
        }
        found
    }
}

/// Returns numeric rows, and the positions of columns.
fn columns(path: &Path) -> (Vec<Vec<f64>>, impl Fn(&str) -> usize + use<>) {
    let text = fs::read_to_string(path).unwrap();
    let mut lines = text.lines();
    let header: Vec<String> = lines.next().unwrap().split(',').map(str::to_owned).collect();
    let number = |field: &str| field.parse().unwrap_or(f64::NAN);
    let rows = lines.map(|line| line.split(',').map(number).collect()).collect();
    (rows, move |name: &str| header.iter().position(|known| known == name).unwrap())
}

/// Prints and checks a line of the table in docs/validation.md.
fn tell(name: &str, what: &str, shares: [f64; 6]) {
    let percent = shares.map(|share| format!("{:.1}", 100.0 * share));
    println!("| {name} | {what} | {} |", percent.join(", "));
    // 92 to 99 %, and half a percent: a share of 418 rows has a standard deviation of 1.1 %.
    assert!(
        shares.iter().all(|share| (0.915..=0.996).contains(share)),
        "{name}, {what}: {percent:?}"
    );
}

fn tell_both(name: &str, [stated, of_frames]: [[f64; 6]; 2]) {
    tell(name, "verdict", stated);
    tell(name, "`convert --interval`", of_frames);
}

#[test]
fn intervals_of_the_shipped_data_and_of_the_sensor_model_hold_on_other_poses() {
    let shipped = concat!(env!("CARGO_MANIFEST_DIR"), "/../calibration-data/synthetic-train.csv");
    tell_both("shipped", Parted::by_group(&fs::read_to_string(shipped).unwrap(), 5).shares(5));
    let dir = tempfile::tempdir().unwrap();
    succeed(&dir, "synth train --rows 60000 -o train.csv");
    let text = fs::read_to_string(dir.path().join("train.csv")).unwrap();
    tell_both("sensor model", Parted::by_group(&text, 5).shares(2));
}

#[test]
#[cfg_attr(not(real_data), ignore = "SHELLCAL_REAL_DATA does not name the recordings")]
fn intervals_of_other_peoples_sensors_hold_on_rows_that_were_held_out() {
    for (name, channels) in [("baseline", 15), ("internal", 6)] {
        let text = |what: &str| {
            fs::read_to_string(real_recording(&format!("others/tongs/{name}_{what}_train.csv")))
                .unwrap()
        };
        let (readings, loads) = (text("pose"), text("FT"));
        let lines = readings.lines().zip(loads.lines()).map(|(s, w)| format!("{s},{w}"));
        tell_both(&format!("tongs, {name}"), Parted::by_row(channels, lines, 4).shares(1));
    }
    let mapping = Mapping {
        sensors: Some((1..=8).map(ColumnRef::Position).collect()),
        wrench: Some(std::array::from_fn(|axis| Some(ColumnRef::Position(9 + axis)))),
        ..Mapping::default()
    };
    let logs = [Log::open(&real_recording("others/fingertip/data.mat"), &mapping).unwrap()];
    let options = FitOptions {
        model: ModelRule::Given(Basis::Cubic),
        covariance: CovarianceRule::Nothing,
        ..FitOptions::default()
    };
    let data = FitData::read(&logs, &[], (&options, false), &ReadOptions::default()).unwrap().train;
    let mut lines = Vec::new();
    for (_, block) in data.blocks() {
        let of_row = |row: usize| {
            let values = block.rows.readings.iter().chain(&block.rows.wrench);
            values.map(|column| column[row].to_string()).collect::<Vec<_>>().join(",")
        };
        lines.extend((0..block.rows.rows).map(of_row));
    }
    tell_both("fingertip", Parted::by_row(8, lines.into_iter(), 4).shares(4));
    let (dir, poses) = (tempfile::tempdir().unwrap(), "others/photointerrupters/poses.csv");
    let poses = real_recording(poses);
    // Each pose held out once, with all that is chosen.
    let found = json(&dir, &format!("fit {} --json", poses.display()));
    let held = |axis: usize| found["verdict"]["interval_95_held"][axis].as_f64().unwrap();
    tell("poses", "verdict and `convert --interval`", std::array::from_fn(held));
}
