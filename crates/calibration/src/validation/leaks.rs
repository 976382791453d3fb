//! Check that test rows were not recorded at the poses of the training rows.
//!
//! A random split of one recording, or random group labels, leaves rows of every pose on both
//! sides: the test error is a training error. A row belongs to a training pose if its load equals the
//! load of the pose within the last digit of the coarser file, and every reading is near those of the
//! pose: a pose that is set up again reads differently. Rows may be in any order. A reference that
//! flickers by more than its last digit hides leaks.

use std::collections::HashMap;
use std::iter::repeat_n;

use shell_data::block::Block;
use shell_data::dataset::Dataset;
use shell_data::statistics::extremes;
use shell_data::wrench::PerAxis;

const KEPT: usize = 4096;

/// Number of rows that determine the number of digits of loads.
const DIGIT_ROWS: usize = 256;

/// Maximum number of significant digits that are looked at.
const MOST_DIGITS: i32 = 12;

/// Loads of one file within this share of the range count as equal: they may be sums in another order.
const SAME: f64 = 1e-9;

/// Fewest rows of a load that determine its readings.
const FEWEST_ROWS: usize = 4;

const FEWEST_LOADS: usize = 3;

/// Share of rows at training poses from which on a test says nothing about new poses.
pub const LEAKY: f64 = 0.1;

#[derive(Clone, Debug, Default)]
pub struct RowSample {
    rows: Vec<SampledRow>,
}

#[derive(Clone, Debug)]
struct SampledRow {
    load: PerAxis<f64>,
    readings: Vec<f64>,
    group: usize,
}

/// Last digit of numbers rounded to some decimals or significant digits.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct LastDigit {
    /// Value of the last decimal place, as a power of ten.
    decimal: f64,
    digits: i32,
}

#[derive(Clone, Debug)]
pub struct RecordedPoses {
    /// Ascending by the load on the first axis.
    poses: Vec<RecordedPose>,
    sample: RowSample,
    range: PerAxis<f64>,
}

#[derive(Clone, Debug)]
struct RecordedPose {
    load: PerAxis<f64>,
    readings: Vec<ReadingSpan>,
    rows: Vec<usize>,
}

impl RowSample {
    /// Takes every `stride`-th row; see [`stride`](Self::stride).
    pub fn new(block: &Block, stride: usize) -> Self {
        let row = |row: usize| SampledRow {
            load: std::array::from_fn(|axis| block.wrench[axis][row]),
            readings: block.readings.iter().map(|column| column[row]).collect(),
            group: 0,
        };
        Self { rows: (0..block.rows).step_by(stride).map(row).collect() }
    }

    fn from_groups(data: &Dataset) -> Self {
        let (stride, mut sample) = (Self::stride(data.rows()), Self::default());
        let mut groups = HashMap::new();
        for (_, block) in data.blocks() {
            let mut of_block = Self::new(&block.rows, stride);
            let labels = block.labels.iter().flat_map(|(label, rows)| repeat_n(label, *rows));
            for (row, label) in of_block.rows.iter_mut().zip(labels.step_by(stride)) {
                let next = groups.len();
                row.group = *groups.entry(label).or_insert(next);
            }
            sample.add(of_block);
        }
        sample
    }

    /// Stride that takes about as many of `rows` rows as a sample keeps.
    pub fn stride(rows: u64) -> usize {
        // Odd, because rows often alternate in pairs.
        usize::try_from(rows / KEPT as u64).unwrap_or(usize::MAX) | 1
    }

    pub fn add(&mut self, mut block: Self) {
        self.rows.append(&mut block.rows);
        while self.rows.len() > KEPT {
            let mut row = 0_usize;
            self.rows.retain(|_| {
                row += 1;
                row % 2 == 1
            });
        }
    }

    fn some(&self) -> impl Iterator<Item = &SampledRow> {
        self.rows.iter().step_by(self.rows.len().div_ceil(DIGIT_ROWS).max(1))
    }

    fn digits(&self) -> PerAxis<LastDigit> {
        std::array::from_fn(|axis| LastDigit::new(self.some().map(|row| row.load[axis])))
    }

    fn reading_step(&self) -> f64 {
        LastDigit::new(self.some().flat_map(|row| row.readings.iter().copied())).decimal
    }

    /// Poses of the rows; `None` if the rows do not consist of poses.
    pub fn poses(self) -> Option<RecordedPoses> {
        let range: PerAxis<f64> = std::array::from_fn(|axis| {
            let (least, most) = extremes(self.rows.iter().map(|row| row.load[axis]));
            most - least
        });
        let mut of_one_load = vec![(0..self.rows.len()).collect::<Vec<usize>>()];
        for (axis, range) in range.iter().enumerate() {
            let divide = |rows: Vec<usize>| self.divide(rows, axis, SAME * range);
            of_one_load = of_one_load.into_iter().flat_map(divide).collect();
            let held: usize = of_one_load.iter().map(Vec::len).sum();
            if 2 * held < self.rows.len() {
                return None;
            }
        }
        if of_one_load.len() < FEWEST_LOADS {
            return None;
        }
        let pose = |rows: Vec<usize>| RecordedPose {
            load: self.rows[rows[0]].load,
            readings: spans(rows.iter().map(|&row| &self.rows[row])),
            rows,
        };
        // The order is ascending because the rows were divided along the first axis first.
        let poses = of_one_load.into_iter().map(pose).collect();
        Some(RecordedPoses { poses, sample: self, range })
    }

    /// Divides rows where the sorted axis steps by more than `step`; drops parts of a few rows.
    fn divide(&self, mut rows: Vec<usize>, axis: usize, step: f64) -> Vec<Vec<usize>> {
        let load = |row: &usize| self.rows[*row].load[axis];
        rows.sort_unstable_by(|a, b| load(a).total_cmp(&load(b)));
        let parts = rows.chunk_by(|a, b| load(b) - load(a) <= step);
        parts.filter(|part| part.len() >= FEWEST_ROWS).map(<[usize]>::to_vec).collect()
    }
}

impl LastDigit {
    fn new(values: impl Iterator<Item = f64>) -> Self {
        let mut finest = Self { decimal: 1.0, digits: 1 };
        for value in values {
            // Conversion of units leaves rounding errors in further digits.
            let text = format!("{value:.*e}", (MOST_DIGITS - 1) as usize);
            let (mantissa, exponent) = text.split_once('e').unwrap_or((&text, "0"));
            let mantissa = mantissa.trim_end_matches('0').trim_end_matches('.');
            let digits = mantissa.chars().filter(char::is_ascii_digit).count() as i32;
            let exponent: i32 = exponent.parse().unwrap_or(0);
            if value != 0.0 {
                let decimal = 10_f64.powi((exponent - digits + 1).min(0));
                finest.decimal = finest.decimal.min(decimal);
            }
            finest.digits = finest.digits.max(digits);
        }
        finest
    }

    fn rounding(&self, value: f64) -> f64 {
        let leading = if value == 0.0 { f64::MIN } else { value.abs().log10().floor() };
        let significant = 10_f64.powf(leading + 1.0 - f64::from(self.digits));
        0.5 * self.decimal.max(significant)
    }
}

impl RecordedPoses {
    /// Share of the rows of `test` that were recorded at these poses; `None` for zero rows.
    pub fn share_of(&self, test: &RowSample) -> Option<f64> {
        let (own_digits, digits) = (self.sample.digits(), test.digits());
        let slack = 0.5 * (self.sample.reading_step() + test.reading_step());
        let is_at = |row: &&SampledRow| {
            let near = |axis: usize| {
                let load = row.load[axis];
                let rounding = own_digits[axis].rounding(load) + digits[axis].rounding(load);
                rounding + SAME * self.range[axis]
            };
            let tolerance: PerAxis<f64> = std::array::from_fn(near);
            let first =
                self.poses.partition_point(|pose| pose.load[0] < row.load[0] - tolerance[0]);
            let near = self.poses[first..].iter();
            near.take_while(|pose| pose.load[0] <= row.load[0] + tolerance[0]).any(|pose| {
                let is_near =
                    |axis: usize| (pose.load[axis] - row.load[axis]).abs() <= tolerance[axis];
                (0..6).all(is_near) && have(&pose.readings, row, slack)
            })
        };
        let rows = test.rows.len();
        (rows > 0).then(|| test.rows.iter().filter(is_at).count() as f64 / rows as f64)
    }

    fn share_in_several_groups(&self) -> f64 {
        let (mut shared, step) = (0, self.sample.reading_step());
        for pose in &self.poses {
            let mut rows: Vec<&SampledRow> =
                pose.rows.iter().map(|&row| &self.sample.rows[row]).collect();
            rows.sort_by_key(|row| row.group);
            let groups: Vec<_> = rows.chunk_by(|a, b| a.group == b.group).collect();
            let readings: Vec<_> = groups.iter().map(|rows| spans(rows.iter().copied())).collect();
            for (at, rows) in groups.iter().enumerate() {
                let others = readings.iter().enumerate().filter(|(other, _)| *other != at);
                let is_shared =
                    |row: &&&SampledRow| others.clone().any(|(_, spans)| have(spans, row, step));
                shared += rows.iter().filter(is_shared).count();
            }
        }
        shared as f64 / self.sample.rows.len() as f64
    }
}

type ReadingSpan = [f64; 2];

fn spans<'a>(rows: impl Iterator<Item = &'a SampledRow>) -> Vec<ReadingSpan> {
    let mut spans = Vec::new();
    for row in rows {
        spans.resize(row.readings.len(), [f64::INFINITY, f64::NEG_INFINITY]);
        for (span, &reading) in spans.iter_mut().zip(&row.readings) {
            *span = [span[0].min(reading), span[1].max(reading)];
        }
    }
    spans
}

/// Returns true if every reading is within its span, widened on each side by the width of the span and `slack`.
fn have(spans: &[ReadingSpan], row: &SampledRow, slack: f64) -> bool {
    spans.iter().zip(&row.readings).all(|(&[least, most], reading)| {
        let width = most - least + slack;
        (least - width..=most + width).contains(reading)
    })
}

/// Share of rows whose pose is in several groups, nearly 1 for random labels; `None` without poses.
pub fn share_in_several_groups(data: &Dataset) -> Option<f64> {
    Some(RowSample::from_groups(data).poses()?.share_in_several_groups())
}

#[cfg(test)]
mod tests {
    use super::*;
    use system_tests::random::Random;

    /// Rows of poses in a random order, each with its own load and readings; noise of one count.
    fn poses(seed: u64, poses: usize, rows: usize) -> Vec<(PerAxis<f64>, Vec<f64>, usize)> {
        let mut random = Random(seed);
        let mut all = Vec::new();
        for pose in 0..poses {
            let load: PerAxis<f64> = std::array::from_fn(|_| 20.0 * random.unit() - 10.0);
            let at: Vec<f64> = (0..8).map(|_| (500.0 * random.unit()).round()).collect();
            for _ in 0..rows {
                let readings = at.iter().map(|at| (at + random.normal()).round()).collect();
                all.push((load, readings, pose));
            }
        }
        for last in (1..all.len()).rev() {
            all.swap(last, random.below(last as u64 + 1) as usize);
        }
        all
    }

    fn sample<'a>(
        rows: impl IntoIterator<Item = &'a (PerAxis<f64>, Vec<f64>, usize)>,
        rounded: impl Fn(f64) -> f64,
    ) -> RowSample {
        let mut sample = RowSample::default();
        for (load, readings, group) in rows {
            let row =
                SampledRow { load: load.map(&rounded), readings: readings.clone(), group: *group };
            sample.add(RowSample { rows: vec![row] });
        }
        sample
    }

    fn significant(value: f64, digits: usize) -> f64 {
        format!("{value:.*e}", digits - 1).parse().unwrap()
    }

    #[test]
    fn rows_of_the_same_poses_are_found_whichever_file_was_rounded_and_those_of_others_are_not() {
        let all = poses(1, 40, 100);
        let part = |keep: &dyn Fn(usize, usize) -> bool| {
            let kept = all.iter().enumerate().filter(|(row, (.., pose))| keep(*row, *pose));
            kept.map(|(_, row)| row.clone()).collect::<Vec<_>>()
        };
        let (train, test) = (part(&|row, _| row % 5 > 0), part(&|row, _| row % 5 == 0));
        let roundings: [fn(f64) -> f64; 5] = [
            |x| x,
            |x| (x * 1e9).round() / 1e9,
            |x| (x * 1e2).round() / 1e2,
            |x| significant(x, 4),
            |x| significant(x, 15),
        ];
        for rounded in roundings {
            for (of_train, of_test) in [(rounded, roundings[0]), (roundings[0], rounded)] {
                let found = sample(&train, of_train).poses().unwrap();
                let share = found.share_of(&sample(&test, of_test)).unwrap();
                assert!(share > 0.99, "{share}");
                let others = found.share_of(&sample(&poses(2, 20, 50), of_test));
                assert_eq!(others, Some(0.0));
            }
        }
        let grouped = sample(&part(&|_, pose| pose % 5 > 0), |x| x).poses().unwrap();
        assert_eq!(grouped.share_of(&sample(&part(&|_, pose| pose % 5 == 0), |x| x)), Some(0.0));
        // A second setup with the same weights.
        let again: Vec<_> = test
            .iter()
            .map(|(load, readings, pose)| {
                (*load, readings.iter().map(|reading| reading + 30.0).collect(), *pose)
            })
            .collect();
        assert_eq!(
            sample(&train, |x| x).poses().unwrap().share_of(&sample(&again, |x| x)),
            Some(0.0)
        );
    }

    #[test]
    fn labels_that_were_dealt_at_random_share_every_pose_and_those_of_poses_none() {
        let mut all = poses(3, 40, 100);
        assert_eq!(sample(&all, |x| x).poses().unwrap().share_in_several_groups(), 0.0);
        let mut random = Random(4);
        all.iter_mut().for_each(|row| row.2 = random.below(40) as usize);
        assert!(sample(&all, |x| x).poses().unwrap().share_in_several_groups() > 0.95);
    }

    #[test]
    fn loads_that_hardly_repeat_and_rest_are_no_poses() {
        let mut moving = poses(5, 1000, 1);
        assert!(sample(&moving, |x| x).poses().is_none());
        moving.iter_mut().take(600).for_each(|row| row.0 = [0.0; 6]);
        assert!(sample(&moving, |x| x).poses().is_none());
        assert!(RowSample::default().poses().is_none());
        let found = sample(&poses(6, 10, 10), |x| x).poses().unwrap();
        assert_eq!(found.share_of(&RowSample::default()), None);
    }
}
