//! Spoilt training and test rows are named with the right cure, and sound ones are not. A test compares
//! the results with the table of `docs/spoilt-files.md`.

use std::fmt::Write;
use std::fs;
use std::path::Path;

use calibration::fit::{Fit, HeldOut};
use calibration::{Basis, FitOptions};
use shell_data::block::Block;
use shell_data::dataset::Dataset;
use shell_data::wrench::Axes;
use shellcal::workflow::fit::FitData;
use system_tests::random::Random;

const CHANNELS: usize = 8;
const POSES: usize = 60;
const ROWS_OF_POSE: usize = 20;
const TEST_ROWS: usize = 800;

/// Root mean square loads, N or N·m.
const LOADS: [f64; 6] = [1.0, 1.2, 1.5, 0.05, 0.06, 0.04];

/// Eight channels that each respond to all loads, with a slight nonlinearity.
#[derive(Clone)]
struct Sensor {
    mixing: Vec<[f64; 6]>,
    /// Standard deviation, counts.
    noise: f64,
    bend: f64,
}

impl Sensor {
    fn new(random: &mut Random, noise: f64, bend: f64) -> Self {
        let row = |_| std::array::from_fn(|axis| 150.0 * random.normal() / LOADS[axis]);
        Self { mixing: (0..CHANNELS).map(row).collect(), noise, bend }
    }

    fn readings(&self, load: &[f64; 6], random: &mut Random) -> Vec<f64> {
        let of_channel = |mixing: &[f64; 6]| {
            let u: f64 = mixing.iter().zip(load).map(|(a, w)| a * w).sum();
            (2000.0 + u + self.bend * u * u / 1000.0 + self.noise * random.normal()).round()
        };
        self.mixing.iter().map(of_channel).collect()
    }
}

#[derive(Clone)]
struct Recording {
    name: &'static str,
    readings: Vec<Vec<f64>>,
    wrench: Vec<Vec<f64>>,
    groups: Vec<(String, usize)>,
}

impl Recording {
    fn new(name: &'static str, sensor: &Sensor, loads: &[[f64; 6]], random: &mut Random) -> Self {
        let mut readings = vec![Vec::new(); CHANNELS];
        for load in loads {
            let row = sensor.readings(load, random);
            readings.iter_mut().zip(row).for_each(|(column, value)| column.push(value));
        }
        let wrench = (0..6).map(|axis| loads.iter().map(|load| load[axis]).collect()).collect();
        Self { name, readings, wrench, groups: Vec::new() }
    }

    fn rows(&self) -> usize {
        self.readings[0].len()
    }

    fn forces(&mut self, change: impl Fn(&mut f64)) {
        self.wrench[..3].iter_mut().flatten().for_each(change);
    }

    fn moments(&mut self, change: impl Fn(&mut f64)) {
        self.wrench[3..].iter_mut().flatten().for_each(change);
    }

    fn negate(&mut self, axes: &[usize], from: usize) {
        for &axis in axes {
            self.wrench[axis][from..].iter_mut().for_each(|value| *value = -*value);
        }
    }

    fn exchange(&mut self, a: usize, b: usize, from: usize) {
        let (low, high) = self.wrench.split_at_mut(a.max(b));
        low[a.min(b)][from..].swap_with_slice(&mut high[0][from..]);
    }
}

#[derive(Clone)]
struct Session {
    train: Vec<Recording>,
    test: Recording,
}

fn wander(random: &mut Random, rows: usize) -> Vec<[f64; 6]> {
    let mut load = [0.0; 6];
    let step = |_| {
        for (axis, value) in load.iter_mut().enumerate() {
            *value = 0.97 * *value + 0.24 * LOADS[axis] * random.normal();
        }
        load
    };
    (0..rows).map(step).collect()
}

impl Session {
    fn of_poses(seed: u64, poses: usize, noise: f64, bend: f64) -> Self {
        let mut random = Random(seed);
        let sensor = Sensor::new(&mut random, noise, bend);
        let mut loads = Vec::new();
        for _ in 0..poses {
            let load = std::array::from_fn(|axis| LOADS[axis] * random.normal());
            loads.extend([load; ROWS_OF_POSE]);
        }
        let mut train = Recording::new("train.csv", &sensor, &loads, &mut random);
        train.groups = (0..poses).map(|pose| (format!("p{pose}"), ROWS_OF_POSE)).collect();
        let loads = wander(&mut random, TEST_ROWS);
        let test = Recording::new("test.csv", &sensor, &loads, &mut random);
        Self { train: vec![train], test }
    }

    fn of_files(seed: u64, noise: f64, bend: f64) -> Self {
        let mut random = Random(seed);
        let sensor = Sensor::new(&mut random, noise, bend);
        let mut recording = |name| {
            let loads = wander(&mut random, 600);
            Recording::new(name, &sensor, &loads, &mut random)
        };
        let train = ["a.csv", "b.csv", "c.csv", "d.csv", "e.csv"].map(&mut recording).into();
        Self { train, test: recording("test.csv") }
    }

    /// Seven files of five poses each, without labels.
    fn of_files_of_poses(seed: u64, noise: f64, bend: f64) -> Self {
        let mut of_poses = Self::of_poses(seed, 35, noise, bend);
        let whole = of_poses.train.remove(0);
        let names = ["a.csv", "b.csv", "c.csv", "d.csv", "e.csv", "f.csv", "g.csv"];
        let part = |columns: &[Vec<f64>], file: usize| {
            let rows = 5 * ROWS_OF_POSE;
            columns.iter().map(|of| of[file * rows..(file + 1) * rows].to_vec()).collect()
        };
        let file = |(file, name)| Recording {
            name,
            readings: part(&whole.readings, file),
            wrench: part(&whole.wrench, file),
            groups: Vec::new(),
        };
        of_poses.train = names.into_iter().enumerate().map(file).collect();
        of_poses
    }

    fn fit(self) -> Fit {
        let by = if self.train.len() > 1 { HeldOut::File } else { HeldOut::Column };
        let data = |recordings: Vec<Recording>| Dataset {
            logs: recordings
                .into_iter()
                .flat_map(|of| {
                    let rows = of.rows();
                    let Recording { name, readings, wrench, groups } = of;
                    let block = Block { rows, readings, wrench, groups, ..Block::default() };
                    Dataset::from_blocks(name, Axes::ALL, vec![block]).logs
                })
                .collect(),
        };
        let (train, test) = (data(self.train), data(vec![self.test]));
        let options = FitOptions {
            model: Basis::Cubic.into(),
            cross_validation: Some(by),
            ..FitOptions::default()
        };
        FitData { train, test, ..FitData::default() }.fit(&options).unwrap()
    }
}

type Spoil = fn(&mut Session);

/// Name of each case, its change, and a part of the resulting headline.
const OF_POSES: [(&str, Spoil, &str); 37] = [
    (
        "test: Fx and Fy exchanged",
        |s| s.test.exchange(0, 1, 0),
        "on the test: exchanging Fx and Fy",
    ),
    (
        "test: Fx and Fz exchanged",
        |s| s.test.exchange(0, 2, 0),
        "on the test: exchanging Fx and Fz",
    ),
    (
        "test: Mx and My exchanged",
        |s| s.test.exchange(3, 4, 0),
        "on the test: exchanging Mx and My",
    ),
    ("test: Fz with the other sign", |s| s.test.negate(&[2], 0), "turning the sign of Fz"),
    ("test: My with the other sign", |s| s.test.negate(&[4], 0), "turning the sign of My"),
    (
        "test: all forces with the other sign",
        |s| s.test.negate(&[0, 1, 2], 0),
        "turning the signs of Fx, Fy, Fz",
    ),
    (
        "test: all six with the other sign",
        |s| s.test.negate(&[0, 1, 2, 3, 4, 5], 0),
        "turning the signs of x, y, z of forces and of moments alike",
    ),
    (
        "test: left-handed, y mirrored",
        |s| s.test.negate(&[1, 3, 5], 0),
        "mirroring y (another handedness) of forces and moments",
    ),
    (
        "test: left-handed, x mirrored",
        |s| s.test.negate(&[0, 4, 5], 0),
        "mirroring x (another handedness) of forces and moments",
    ),
    (
        "test: turned by 90° about z",
        |s| {
            s.test.exchange(0, 1, 0);
            s.test.exchange(3, 4, 0);
            s.test.negate(&[0, 3], 0);
        },
        "a turn by 90° about z of forces and moments",
    ),
    (
        "test: turned by 180° about x",
        |s| s.test.negate(&[1, 2, 4, 5], 0),
        "a turn by 180° about x of forces and moments",
    ),
    (
        "test: axes in another order (y, z, x)",
        |s| {
            s.test.wrench[..3].rotate_left(1);
            s.test.wrench[3..].rotate_left(1);
        },
        "a turn of the frame",
    ),
    ("test: moments in N·mm", |s| s.test.moments(|m| *m *= 1e3), "dividing moments by 1000 (N·mm)"),
    ("test: forces in mN", |s| s.test.forces(|f| *f *= 1e3), "dividing forces by 1000 (mN)"),
    (
        "test: forces in lbf",
        |s| s.test.forces(|f| *f /= 4.448_221_615),
        "converting forces from lbf",
    ),
    ("test: forces in kgf", |s| s.test.forces(|f| *f /= 9.806_65), "converting forces from kgf"),
    (
        "test: moments in lbf·in",
        |s| s.test.moments(|m| *m /= 0.112_984_829),
        "converting moments from lbf·in",
    ),
    (
        "test: forces with another zero",
        |s| s.test.wrench[1].iter_mut().for_each(|f| *f += 4.0),
        "another zero of forces",
    ),
    (
        "test: moments with another zero",
        |s| s.test.moments(|m| *m += 0.3),
        "another zero of moments",
    ),
    (
        "test: moments before forces",
        |s| s.test.wrench.rotate_left(3),
        "exchanging forces and moments",
    ),
    ("test: Fz and Mz exchanged", |s| s.test.wrench.swap(2, 5), "exchanging Fz and Mz"),
    (
        "test: two channels exchanged",
        |s| s.test.readings.swap(1, 4),
        "exchanging the readings s2 and s5",
    ),
    (
        "test: a channel unplugged",
        |s| s.test.readings[2].fill(0.0),
        "on the test: s3 is 0 in every frame",
    ),
    (
        "test: the reference six rows late",
        |s| s.test.wrench.iter_mut().for_each(|column| column.rotate_right(6)),
        "taking the reference 6 rows earlier",
    ),
    (
        "test: Fx and Fy exchanged in its second half",
        |s| s.test.exchange(0, 1, TEST_ROWS / 2),
        "in the second half of `test.csv` exchanging Fx and Fy",
    ),
    (
        "training: all signs turned in the second half",
        |s| s.train[0].negate(&[0, 1, 2, 3, 4, 5], POSES / 2 * ROWS_OF_POSE),
        "turning the signs of x, y, z",
    ),
    (
        "training: Fx and Fy exchanged in the last quarter",
        |s| s.train[0].exchange(0, 1, POSES / 4 * 3 * ROWS_OF_POSE),
        "rows 901 to 1200 against rows 1 to 300, exchanging Fx and Fy",
    ),
    (
        "training: moments in N·mm in the second half",
        |s| {
            let half = POSES / 2 * ROWS_OF_POSE;
            s.train[0].wrench[3..].iter_mut().for_each(|column| {
                column[half..].iter_mut().for_each(|m| *m *= 1e3);
            });
        },
        "dividing moments by 1000",
    ),
    (
        "training: a channel at 0 for half of the rows",
        |s| s.train[0].readings[3][600..].fill(0.0),
        "the data: s4",
    ),
    (
        "training: a channel that stands still for a third",
        |s| s.train[0].readings[5][200..600].fill(1234.0),
        "the data: s6 stands at 1234 in rows 201 to 600",
    ),
    (
        "training: a channel cut off above",
        |s| s.train[0].readings[6].iter_mut().for_each(|r| *r = r.min(2100.0)),
        "the data: s7 is cut off at 2100",
    ),
    (
        "training: a channel cut off below",
        |s| s.train[0].readings[6].iter_mut().for_each(|r| *r = r.max(1900.0)),
        "the data: s7 is cut off at 1900",
    ),
    (
        "training: 200 rows twice",
        |s| {
            let Recording { readings, wrench, .. } = &mut s.train[0];
            let columns = readings.iter_mut().chain(wrench);
            columns.for_each(|column| column.copy_within(200..400, 800));
        },
        "rows are there twice",
    ),
    (
        "training: the zero of the reference jumps half way",
        |s| s.train[0].wrench[2][600..].iter_mut().for_each(|f| *f += 1.0),
        "the zero of Fz jumps",
    ),
    (
        "training: the zero of the reference drifts",
        |s| {
            let rows = (POSES * ROWS_OF_POSE) as f64;
            s.train[0].wrench[2]
                .iter_mut()
                .enumerate()
                .for_each(|(row, f)| *f += row as f64 / rows);
        },
        "the zero of Fz drifts by 0.",
    ),
    (
        "training: the load of a pose written down wrongly",
        |s| s.train[0].wrench[2][400..420].iter_mut().for_each(|f| *f += 4.0),
        "pose `p20` errs",
    ),
    (
        "training: one pose recorded under the loads of two",
        |s| s.train[0].readings.iter_mut().for_each(|column| column.copy_within(200..220, 600)),
        "poses `p10` and `p30` have the same readings under different loads",
    ),
];

/// Like the cases above, for sessions of five files.
const OF_FILES: [(&str, Spoil, &str); 14] = [
    (
        "training: a file with all forces of the other sign",
        |s| s.train[3].negate(&[0, 1, 2], 0),
        "in `d.csv` against `a.csv`, turning the signs of Fx, Fy, Fz",
    ),
    (
        "training: a file with forces in lbf",
        |s| s.train[1].forces(|f| *f /= 4.448_221_615),
        "in `b.csv` against `a.csv`, converting forces from lbf",
    ),
    (
        "training: a file with moments in N·mm",
        |s| s.train[2].moments(|m| *m *= 1e3),
        "in `c.csv` against `a.csv`, dividing moments by 1000 (N·mm)",
    ),
    (
        "training: a file with Fx and Fy exchanged",
        |s| s.train[4].exchange(0, 1, 0),
        "in `e.csv` against `a.csv`, exchanging Fx and Fy",
    ),
    (
        "training: a left-handed file",
        |s| s.train[2].negate(&[1, 3, 5], 0),
        "in `c.csv` against `a.csv`, mirroring y (another handedness)",
    ),
    (
        "training: a file with another zero of the forces",
        |s| s.train[3].wrench[1].iter_mut().for_each(|f| *f += 1.0),
        "in `d.csv` another zero of forces",
    ),
    (
        "training: a file with the reference six rows late",
        |s| s.train[1].wrench.iter_mut().for_each(|column| column.rotate_right(6)),
        "in `b.csv` taking the reference 6 rows earlier",
    ),
    (
        "training: a file with two channels exchanged",
        |s| s.train[2].readings.swap(1, 4),
        "in `c.csv` exchanging the readings s2 and s5",
    ),
    (
        "training: a file with noise in place of Mz",
        |s| {
            let mut random = Random(13);
            s.train[4].wrench[5].iter_mut().for_each(|m| *m = 0.04 * random.normal());
        },
        "`e.csv` errs",
    ),
    (
        "training: the reference stands still for a quarter of a file",
        |s| {
            s.train[0].wrench.iter_mut().for_each(|column| {
                let value = column[200];
                column[200..350].fill(value);
            });
        },
        "in `a.csv` the reference stands still in rows 201 to 350",
    ),
    (
        "training: Fz of the reference stands still for a quarter of a file",
        |s| s.train[0].wrench[2][200..350].fill(0.75),
        "in `a.csv` Fz stands at 0.75 N in rows 201 to 350",
    ),
    (
        "training: the reference is overloaded along Fx",
        |s| s.train[3].wrench[0].iter_mut().for_each(|f| *f = f.min(0.9)),
        "in `d.csv` Fx is cut off at 0.9",
    ),
    (
        "training: noise in place of Mz in all files",
        |s| {
            let mut random = Random(14);
            for of in &mut s.train {
                of.wrench[5].iter_mut().for_each(|m| *m = 0.04 * random.normal());
            }
        },
        "the error of Mz is about as large as the loads",
    ),
    (
        "training: a reference that is computed from the readings",
        |s| {
            for of in s.train.iter_mut().chain([&mut s.test]) {
                for axis in 0..6 {
                    of.wrench[axis] = of.readings[axis].iter().map(|r| 1e-3 * r - 2.0).collect();
                }
            }
        },
        "the reference is computed from the readings",
    ),
];

#[test]
fn spoilt_files_are_named_with_their_cure_and_the_table_of_the_docs_is_theirs() {
    let mut table = "| spoilt | the first line of `fit` |\n|---|---|\n".to_owned();
    let mut missed = Vec::new();
    let of_poses = OF_POSES.iter().map(|of| (of, Session::of_poses(11, POSES, 2.0, 0.02)));
    let of_files = OF_FILES.iter().map(|of| (of, Session::of_files(12, 2.0, 0.02)));
    for ((what, spoil, expected), mut session) in of_poses.chain(of_files) {
        spoil(&mut session);
        let fitted = session.fit();
        let headline = fitted.verdict().headline();
        if !headline.starts_with("NOT OK") || !headline.contains(expected) {
            missed.push(format!("{what}: {headline}"));
        }
        writeln!(table, "| {what} | {headline} |").unwrap();
    }
    assert_eq!(missed, Vec::<String>::new());
    let docs =
        fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/spoilt-files.md"))
            .unwrap();
    assert!(docs.contains(&table), "`docs/spoilt-files.md` should have:\n{table}");
}

/// A test of three poses has an error of 2.7 or 7 times the promise: the first may be chance.
#[test]
fn a_few_test_poses_are_not_ok_if_far_off_and_not_known_if_they_cannot_tell() {
    for (times, expected) in [(1.0, "OK"), (2.7, "NOT KNOWN"), (7.0, "NOT OK on the test: ")] {
        let mut session = Session::of_poses(15, POSES, 2.0, 0.02);
        let promised = session.clone().fit().unseen_errors().unwrap().rms[2];
        let [train, test] = [&mut session.train[0], &mut session.test];
        // Takes poses out of the training data to test on them: the fit has not seen them.
        let rows = 3 * ROWS_OF_POSE;
        let take = |column: &mut Vec<f64>| column.drain(..rows).collect::<Vec<f64>>();
        test.readings = train.readings.iter_mut().map(take).collect();
        test.wrench = train.wrench.iter_mut().map(take).collect();
        train.groups.drain(..3);
        let error = |row: usize| [1.0, -1.0, 1.0][row / ROWS_OF_POSE] * times * promised;
        for (row, load) in test.wrench[2].iter_mut().enumerate() {
            *load += error(row);
        }
        let fitted = session.fit();
        let headline = fitted.verdict().headline();
        assert!(headline.starts_with(expected), "{times}: {headline}");
        assert_eq!(fitted.verdict().is_ok(), expected == "OK");
    }
}

/// Sessions with different noise, nonlinearity, numbers of poses and numbers of files.
#[test]
fn fifty_sound_sessions_are_ok() {
    let mut blamed = Vec::new();
    for seed in 0..50_u64 {
        let (noise, bend) = (1.0 + (seed % 5) as f64, 0.02 * (seed % 7) as f64);
        let session = match seed % 2 {
            _ if seed >= 40 => Session::of_files_of_poses(100 + seed, noise, 0.1 * bend),
            0 => Session::of_poses(100 + seed, 40 + 5 * (seed as usize % 9), noise, bend),
            _ => Session::of_files(100 + seed, noise, bend),
        };
        let verdict = session.fit();
        let verdict = verdict.verdict();
        if !verdict.is_ok() {
            blamed.push(format!("{seed}: {}", verdict.headline()));
        }
    }
    assert_eq!(blamed, Vec::<String>::new());
}
