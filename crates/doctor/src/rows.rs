//! Checks of the rows of a log: columns that stand still or are cut off, and rows that are there twice. Readings and
//! loads follow one set of rules.

use std::borrow::Cow;
use std::collections::{HashMap, HashSet};
use std::ops::Range;

use log_file::summary::{ColumnSummary, LogSummary};
use shell_data::block::Block;
use shell_data::dataset::{Dataset, LogRows};
use shell_data::statistics::extremes;
use shell_data::wrench::{Axes, Axis};

use crate::channels::{channel_name, check_channels, identical_in};
use crate::{Finding, FindingSeverity};

/// A column has stopped if it is constant for the share `STOPPED` of a log while two channels move over `MOVED` of
/// their ranges, and over `MOVED_IN_PART` in each of `PARTS` parts: neighbouring poses may have the same reading.
const STOPPED: f64 = 0.1;
const MOVED: f64 = 0.5;
const PARTS: usize = 4;
const MOVED_IN_PART: f64 = 0.1;
const FEWEST_STOPPED: usize = 50;

/// Least range of a channel that moves at all, in mean steps from row to row. The range of noise is smaller.
const MOVED_IN_STEPS: f64 = 10.0;

/// Least share of rows for a stopped load. A measured load changes from row to row: in over `CHANGES` of all rows, with
/// over `VALUES` values or `VALUES_PER_ROW` for each row. A load that was typed in is constant in each pose.
const STOPPED_LOAD: f64 = 0.05;
const CHANGES: f64 = 0.2;
const VALUES: usize = 100;
const VALUES_PER_ROW: f64 = 0.2;

/// A column has a lower limit if its minimum occurs in this share of rows, in at least this number
/// of rows, and is reached from above this number of times.
const PINNED: f64 = 0.01;
const FEWEST_PINNED: usize = 20;
const ENTRIES: usize = 3;

/// Consecutive rows of a copy, and how many of them must differ from the previous row.
const WINDOW: usize = 16;
const DISTINCT: usize = 8;

/// Odd, with bits in no order: 2⁶⁴ divided by the golden ratio.
const MULTIPLIER: u64 = 0x9E37_79B9_7F4A_7C15;

/// Maximum rows checked; of a longer log only every second, fourth, … block.
const MOST_ROWS: usize = 200_000;

const LOADS_ADVICE: &str = "the reference has stopped or is overloaded: leave these rows out";

pub fn check_rows(data: &Dataset, names: &[String]) -> Vec<Finding> {
    let mut all = Vec::new();
    for log in &data.logs {
        let mut findings = check_log(log, names);
        findings.retain(|finding| finding.severity == FindingSeverity::Fault);
        if data.logs.len() > 1 {
            let name = log.name.display();
            let named =
                |finding: &mut Finding| finding.seen = format!("in `{name}` {}", finding.seen);
            findings.iter_mut().for_each(named);
        }
        all.extend(findings);
    }
    all
}

fn check_log(log: &LogRows, names: &[String]) -> Vec<Finding> {
    if log.rows() == 0 {
        return Vec::new();
    }
    let mut rows = KeptRows::default();
    log.blocks.iter().for_each(|block| rows.add(Cow::Borrowed(&block.rows)));
    let (mut summary, mut identical) = (LogSummary::default(), None);
    for (_, block) in &rows.blocks {
        summary.add(block);
        identical = Some(identical_in(block.channels(), identical));
    }
    let mut findings = Vec::new();
    let (readings, identical) = (rows.readings(), identical.unwrap_or_default());
    let of_log = (&summary, are_still(&readings));
    check_channels(of_log, names, &identical, None, &mut findings);
    rows.check((&summary, names), (&readings, log.axes), &mut findings);
    findings
}

/// Rows of a log, or of every second, fourth, … block of a long one.
#[derive(Debug)]
pub(crate) struct KeptRows<'a> {
    /// Blocks, each with the number of rows before it.
    blocks: Vec<(usize, Cow<'a, Block>)>,
    every: usize,
    blocks_seen: usize,
    rows_seen: usize,
}

impl Default for KeptRows<'_> {
    fn default() -> Self {
        Self { blocks: Vec::new(), every: 1, blocks_seen: 0, rows_seen: 0 }
    }
}

/// A column: name in messages, values of all kept rows, and the axis if it is a load.
struct Column<'a> {
    name: String,
    values: Cow<'a, [f64]>,
    summary: &'a ColumnSummary,
    load: Option<Axis>,
}

impl<'a> KeptRows<'a> {
    pub(crate) fn add(&mut self, block: Cow<'a, Block>) {
        let rows = block.rows;
        if self.blocks_seen.is_multiple_of(self.every) {
            self.blocks.push((self.rows_seen, block));
        }
        (self.blocks_seen, self.rows_seen) = (self.blocks_seen + 1, self.rows_seen + rows);
        if self.count() > MOST_ROWS && self.blocks.len() > 1 {
            let mut at = 0;
            self.blocks.retain(|_| {
                at += 1;
                at % 2 == 1
            });
            self.every *= 2;
        }
    }

    fn count(&self) -> usize {
        self.blocks.iter().map(|(_, block)| block.rows).sum()
    }

    fn column(&self, of: impl Fn(&Block) -> Option<&Vec<f64>>) -> Vec<f64> {
        let parts: Vec<&[f64]> =
            self.blocks.iter().filter_map(|(_, block)| of(block)).map(Vec::as_slice).collect();
        parts.concat()
    }

    pub(crate) fn readings(&self) -> Vec<Vec<f64>> {
        let channels = self.blocks.first().map_or(0, |(_, block)| block.channels().len());
        (0..channels).map(|channel| self.column(|block| block.channels().get(channel))).collect()
    }

    /// Number of a kept row in the log, from 1.
    fn number(&self, mut row: usize) -> usize {
        for (start, block) in &self.blocks {
            if row < block.rows {
                return start + row + 1;
            }
            row -= block.rows;
        }
        row
    }

    /// Checks the columns for faults that the summary of the log does not show, and looks for copied rows.
    pub(crate) fn check(
        &self,
        (summary, names): (&LogSummary, &[String]),
        (readings, axes): (&[Vec<f64>], Axes),
        findings: &mut Vec<Finding>,
    ) {
        for (channel, values) in readings.iter().enumerate() {
            let (name, summary) = (channel_name(names, channel), &summary.readings[channel]);
            let column = Column { name, values: Cow::Borrowed(values), summary, load: None };
            findings.extend(self.check_column(&column, readings, &[]));
        }
        if summary.wrench.is_empty() {
            return;
        }
        let loads: Vec<Column<'_>> = axes
            .iter()
            .map(|axis| Column {
                name: axis.name().to_owned(),
                values: Cow::Owned(self.column(|block| block.wrench.get(axis.index()))),
                summary: &summary.wrench[axis.index()],
                load: Some(axis),
            })
            .collect();
        let of_loads = loads.iter().filter_map(|load| self.check_column(load, readings, &loads));
        let mut of_loads: Vec<Finding> = of_loads.collect();
        // A reference that stands still on all axes is reported once.
        of_loads.dedup();
        findings.extend(of_loads);
        findings.extend(self.rows_twice());
    }

    fn check_column(
        &self,
        column: &Column<'_>,
        readings: &[Vec<f64>],
        loads: &[Column<'_>],
    ) -> Option<Finding> {
        let Column { name, values, summary, load } = column;
        let is_cut_above = summary.is_pinned_at_max();
        let limits = load.map_or("channel-saturated", |_| "load-saturated");
        let floor = pinned_at_min(values);
        let may_be_cut = |limit: f64| load.is_none() || is_measured(values, |of| of == limit);
        // `check_channels` reports upper limits of channels.
        let limit = (is_cut_above && load.is_some()).then_some(summary.max).or(floor);
        // Without contact, a load rests at zero.
        let limit = limit.filter(|limit| load.is_none() || *limit != 0.0);
        if let Some(limit) = limit.filter(|limit| may_be_cut(*limit)) {
            let seen = format!("{name} is cut off at {limit}");
            let advice = match load {
                Some(_) => LOADS_ADVICE,
                None => "something limits it: the supply of the phototransistor, or a filter",
            };
            return Some(Finding::fault(limits, seen, advice));
        }
        let share = if load.is_some() { STOPPED_LOAD } else { STOPPED };
        let (first, rows) = longest_stop(values, share)?;
        let (value, run) = (values[first], first..first + rows);
        // These rows are already reported as cut off.
        if is_cut_above && value == summary.max || !others_move(readings, values, run.clone()) {
            return None;
        }
        let [from, to] = [first, first + rows - 1].map(|row| self.number(row));
        let Some(axis) = load else {
            let seen = format!("{name} stands at {value} in rows {from} to {to}");
            let advice = "check its wire; leave these rows out";
            return Some(Finding::fault("channel-stopped", seen, advice));
        };
        let others = loads.iter().filter(|other| other.load != *load);
        let others = others.filter(|other| !other.summary.is_constant());
        let mut changes = others.map(|other| share_of_changes(&other.values[run.clone()]));
        let seen = if changes.clone().all(|share| share == 0.0) {
            format!("the reference stands still in rows {from} to {to} while the readings move")
        } else if changes.all(|share| share > CHANGES) && is_measured(values, |of| of == value) {
            format!("{name} stands at {value} {} in rows {from} to {to}", axis.unit())
        } else {
            return None;
        };
        Some(Finding::fault("load-stopped", seen, LOADS_ADVICE))
    }

    fn rows_twice(&self) -> Option<Finding> {
        let hashes = self.row_hashes();
        // Running totals over the rows: the number that differ from their previous row, and a hash of all. A window
        // has the difference of two totals.
        let (mut distinct, mut hashed) = (vec![0], vec![0_u64]);
        let power = MULTIPLIER.wrapping_pow(WINDOW as u32);
        for (row, hash) in hashes.iter().enumerate() {
            let is_new = row > 0 && *hash != hashes[row - 1];
            distinct.push(distinct[row] + usize::from(is_new));
            hashed.push(hashed[row].wrapping_mul(MULTIPLIER).wrapping_add(*hash));
        }
        let window = |start: usize| {
            let end = start + WINDOW;
            (distinct[end] - distinct[start] >= DISTINCT)
                .then(|| hashed[end].wrapping_sub(hashed[start].wrapping_mul(power)))
        };
        let starts = || 0..(hashes.len() + 1).saturating_sub(WINDOW);
        let mut known: HashMap<u64, usize> = HashMap::new();
        for start in starts().step_by(WINDOW) {
            if let Some(key) = window(start) {
                known.entry(key).or_insert(start);
            }
        }
        let mut copies: Vec<(usize, usize)> = Vec::new();
        for start in starts() {
            let before = window(start).and_then(|key| known.get(&key));
            copies
                .extend(before.filter(|before| **before + WINDOW <= start).map(|at| (*at, start)));
        }
        let &(before, first) = copies.first()?;
        let rows = copies.len() * WINDOW;
        let seen = format!(
            "some {rows} rows are there twice: those from row {} on repeat those from row {} on",
            self.number(first),
            self.number(before)
        );
        let advice = "leave the copies out: they make errors seem smaller than they are";
        Some(Finding::fault("rows-twice", seen, advice))
    }

    /// Hashes each row, column by column. Equal hashes of different rows are improbable, though easily made on purpose.
    fn row_hashes(&self) -> Vec<u64> {
        let mut all = Vec::new();
        for (_, block) in &self.blocks {
            let start = all.len();
            all.resize(start + block.rows, 0_u64);
            for column in block.channels().iter().chain(&block.wrench) {
                for (hash, value) in all[start..].iter_mut().zip(column) {
                    *hash = (hash.rotate_left(26) ^ value.to_bits()).wrapping_mul(MULTIPLIER);
                }
            }
        }
        all
    }
}

/// Returns true for loads that change from row to row, unlike typed ones; `is_left_out` names the value of rows that
/// do not count.
fn is_measured(values: &[f64], is_left_out: impl Fn(f64) -> bool) -> bool {
    let pairs = values.windows(2).filter(|pair| !pair.iter().all(|of| is_left_out(*of)));
    let (count, changed) = pairs.fold((0, 0), |(count, changed), pair| {
        (count + 1, changed + usize::from(pair[0] != pair[1]))
    });
    let enough = VALUES.min((VALUES_PER_ROW * count as f64) as usize);
    let mut distinct = HashSet::new();
    changed as f64 > CHANGES * count as f64
        && values.iter().any(|value| {
            distinct.insert(value.to_bits());
            distinct.len() > enough
        })
}

/// Returns true if channels only flicker: the sensor is held still.
pub(crate) fn are_still(readings: &[Vec<f64>]) -> bool {
    let varying: Vec<&Vec<f64>> = readings.iter().filter(|column| range(column) > 0.0).collect();
    let is_alive = |column: &&&Vec<f64>| moves_at_all(column) || share_of_changes(column) > 0.5;
    varying.len() >= 2 && varying.iter().filter(is_alive).count() < 2
}

fn range(values: &[f64]) -> f64 {
    let (low, high) = extremes(values.iter().copied());
    high - low
}

fn moves_at_all(values: &[f64]) -> bool {
    range(values) > MOVED_IN_STEPS * mean_step(values)
}

/// Mean size of the changes from row to row.
fn mean_step(values: &[f64]) -> f64 {
    let steps = values.windows(2).map(|pair| (pair[1] - pair[0]).abs());
    let (count, sum) = steps
        .filter(|step| *step > 0.0)
        .fold((0, 0.0), |(count, sum), step| (count + 1, sum + step));
    sum / f64::from(count.max(1))
}

fn share_of_changes(values: &[f64]) -> f64 {
    let changed = values.windows(2).filter(|pair| pair[0] != pair[1]).count();
    changed as f64 / values.len().max(1) as f64
}

fn pinned_at_min(column: &[f64]) -> Option<f64> {
    let (least, most) = extremes(column.iter().copied());
    let above = column.iter().copied().filter(|value| *value > least).fold(most, f64::min);
    let at = column.iter().filter(|value| **value == least).count();
    let next = column.iter().filter(|value| **value == above).count();
    let is_entry = |pair: &&[f64]| pair[0] > above && pair[1] == least;
    let entries = column.windows(2).filter(is_entry).count();
    let often = at >= FEWEST_PINNED && at as f64 >= PINNED * column.len() as f64;
    (least < most && often && at >= 3 * next && entries >= ENTRIES).then_some(least)
}

/// Returns first row and length of the longest run of one value, if it has this share of the rows.
fn longest_stop(column: &[f64], share: f64) -> Option<(usize, usize)> {
    let mut start = 0;
    let runs = column.chunk_by(|a, b| a == b).map(|same| {
        start += same.len();
        (start - same.len(), same.len())
    });
    let longest = runs.max_by_key(|(_, rows)| *rows)?;
    let fewest = FEWEST_STOPPED.max((share * column.len() as f64) as usize);
    (longest.1 >= fewest && longest.1 < column.len()).then_some(longest)
}

/// Returns true if two channels other than `stopped` move over most of their usual range in these rows, and in each
/// part of them: between two poses they would move once.
fn others_move(readings: &[Vec<f64>], stopped: &[f64], rows: Range<usize>) -> bool {
    let others: Vec<(&[f64], f64)> = readings
        .iter()
        .filter(|column| column[..] != *stopped && moves_at_all(column))
        .map(|column| (&column[rows.clone()], range(column)))
        .collect();
    let two_move = |part: Range<usize>, least: f64| {
        let moves = |(run, all): &&(&[f64], f64)| range(&run[part.clone()]) > least * all;
        others.iter().filter(moves).count() >= 2
    };
    let border = |part: usize| rows.len() * part / PARTS;
    two_move(0..rows.len(), MOVED)
        && (0..PARTS).all(|part| two_move(border(part)..border(part + 1), MOVED_IN_PART))
}

#[cfg(test)]
mod tests {
    use super::*;
    use shell_data::block::Block;
    use shell_data::wrench::Axes;
    use system_tests::random::Random;

    /// Changes a log of 600 rows with three wandering channels.
    fn seen(change: impl Fn(&mut Block)) -> Vec<&'static str> {
        let mut random = Random(5);
        let wander = |_| {
            let mut at = 500.0;
            let step = |_| {
                at = (at + 20.0 * random.normal()).clamp(100.0, 900.0);
                f64::round(at)
            };
            (0..600).map(step).collect::<Vec<f64>>()
        };
        let readings: Vec<Vec<f64>> = (0..3).map(wander).collect();
        let wrench = vec![readings[0].clone(); 6];
        let mut block = Block { rows: 600, readings, wrench, ..Block::default() };
        change(&mut block);
        let data = Dataset::from_blocks("rows", Axes::ALL, vec![block]);
        check_rows(&data, &[]).iter().map(|finding| finding.check).collect()
    }

    #[test]
    fn a_log_without_rows_has_no_findings() {
        let readings = vec![vec![500.0, 501.0]; 3];
        let block =
            Block { rows: 2, readings, wrench: vec![vec![1.0, 2.0]; 6], ..Block::default() };
        let mut data = Dataset::from_blocks("rows", Axes::ALL, vec![block]);
        data.logs[0].blocks.clear();
        assert!(check_rows(&data, &[]).is_empty());
    }

    #[test]
    fn each_fault_of_readings_is_found_and_a_sound_log_has_none() {
        assert_eq!(seen(|_| ()), Vec::<&str>::new());
        assert_eq!(seen(|block| block.readings[1].fill(0.0)), ["channel-dead"]);
        assert_eq!(seen(|block| block.readings[1][300..].fill(7.0)), ["channel-stopped"]);
        let cut = |low: f64, high: f64| {
            move |block: &mut Block| {
                block.readings[2].iter_mut().for_each(|value| *value = value.clamp(low, high));
            }
        };
        assert_eq!(seen(cut(480.0, 1e9)), ["channel-saturated"]);
        assert_eq!(seen(cut(0.0, 520.0)), ["channel-saturated"]);
        let copied = |block: &mut Block| {
            let columns = block.readings.iter_mut().chain(&mut block.wrench);
            columns.for_each(|column| column.copy_within(100..200, 400));
        };
        assert_eq!(seen(copied), ["rows-twice"]);
    }

    #[test]
    fn each_fault_of_loads_is_found_by_the_same_rules_and_typed_loads_have_none() {
        let measured = |block: &mut Block| {
            let mut random = Random(6);
            for (axis, column) in block.wrench.iter_mut().enumerate() {
                let reading = &block.readings[axis % 3];
                *column = reading.iter().map(|of| 0.01 * (of - 500.0) + random.normal()).collect();
            }
        };
        let changed = |change: &dyn Fn(&mut Block)| {
            seen(|block| {
                measured(block);
                change(block);
            })
        };
        assert_eq!(changed(&|_| ()), Vec::<&str>::new());
        assert_eq!(changed(&|of| of.wrench[2][200..320].fill(1.5)), ["load-stopped"]);
        let stopped = |of: &mut Block| {
            of.wrench.iter_mut().for_each(|column| {
                let value = column[200];
                column[200..320].fill(value);
            });
        };
        assert_eq!(changed(&stopped), ["load-stopped"]);
        let cut = |low: f64, high: f64| {
            move |of: &mut Block| of.wrench[3].iter_mut().for_each(|x| *x = x.clamp(low, high))
        };
        assert_eq!(changed(&cut(-9.0, 0.5)), ["load-saturated"]);
        assert_eq!(changed(&cut(-0.5, 9.0)), ["load-saturated"]);
        // A reference that only pushes rests at zero without contact.
        assert_eq!(changed(&cut(0.0, 9.0)), Vec::<&str>::new());
        // Weights in thirty poses, and one axis that is loaded in the last third only.
        let typed = |of: &mut Block| {
            let mut random = Random(7);
            for (axis, column) in of.wrench.iter_mut().enumerate() {
                column.chunks_mut(20).enumerate().for_each(|(pose, rows)| {
                    rows.fill(if axis == 0 && pose < 20 { 0.0 } else { random.normal() });
                });
            }
        };
        assert_eq!(changed(&typed), Vec::<&str>::new());
    }

    #[test]
    fn neighbouring_poses_with_one_reading_and_a_single_pose_are_no_faults() {
        let in_poses = |poses: usize, same: Range<usize>| {
            seen(move |block| {
                let mut random = Random(8);
                for (channel, column) in block.readings.iter_mut().enumerate() {
                    column.chunks_mut(600 / poses).enumerate().for_each(|(pose, rows)| {
                        let at = (500.0 + 100.0 * random.normal()).round();
                        let at = if channel == 1 && same.contains(&pose) { 512.0 } else { at };
                        let mut flicker =
                            |_| f64::from(u8::from(channel != 1 && random.unit() > 0.7));
                        rows.iter_mut().for_each(|value| *value = at + flicker(()));
                    });
                }
                block.wrench = block.readings.iter().chain(&block.readings).cloned().collect();
                // Without noise on the loads, rows would be there twice.
                block.wrench.iter_mut().flatten().for_each(|load| *load += random.normal());
            })
        };
        assert_eq!(in_poses(6, 2..4), Vec::<&str>::new());
        assert_eq!(in_poses(30, 5..15), ["channel-stopped"]);
        assert_eq!(in_poses(1, 0..1), Vec::<&str>::new());
    }
}
