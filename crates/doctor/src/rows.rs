//! Checks of rows in memory, before a calibration is fitted to them or tested on them.

use std::collections::HashMap;
use std::ops::Range;

use log_file::summary::LogSummary;
use shell_data::dataset::{Dataset, LabelledBlock, LogRows};
use shell_data::statistics::extremes;

use crate::channels::{channel_name, check_channels, identical_in};
use crate::{Finding, FindingSeverity};

/// A channel that is constant for this share of a log has stopped, if two others move over this
/// share of their ranges.
const STOPPED: f64 = 0.1;
const MOVED: f64 = 0.5;
const FEWEST_STOPPED: usize = 50;

/// A channel has a lower limit if its minimum occurs in this share of rows, in at least this number
/// of rows, and is reached from above this number of times.
const PINNED: f64 = 0.01;
const FEWEST_PINNED: usize = 20;
const ENTRIES: usize = 3;

/// Consecutive rows of a copy, and how many of them must differ from the previous row.
const WINDOW: usize = 16;
const DISTINCT: usize = 8;

/// Odd, with bits in no order: 2⁶⁴ divided by the golden ratio.
const MULTIPLIER: u64 = 0x9E37_79B9_7F4A_7C15;

/// Maximum rows checked; of a longer log only every second, third, … block.
const MOST_ROWS: u64 = 200_000;

type Looked<'a> = Vec<(usize, &'a LabelledBlock)>;

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
    let (mut summary, mut identical) = (LogSummary::default(), None);
    let looked = looked_at(log);
    for (_, block) in &looked {
        summary.add(&block.rows);
        identical = Some(identical_in(block.rows.channels(), identical));
    }
    let mut findings = Vec::new();
    check_channels(&summary, names, &identical.unwrap_or_default(), None, &mut findings);
    for channel in 0..log.channels {
        let column: Vec<f64> =
            looked.iter().flat_map(|(_, block)| &block.rows.readings[channel]).copied().collect();
        let name = channel_name(names, channel);
        let of_channel = &summary.readings[channel];
        // This is already reported as a limit.
        let is_limit = |value: f64| of_channel.is_pinned_at_max() && value == of_channel.max;
        if let Some(floor) = pinned_at_min(&column) {
            let seen = format!("{name} is cut off at {floor}");
            let advice = "something limits it: the supply of the phototransistor, or a filter";
            findings.push(Finding::fault("channel-saturated", seen, advice));
        } else if let Some((first, rows)) = longest_stop(&column)
            && !is_limit(column[first])
            && others_move(&looked, channel, first..first + rows)
        {
            let [from, to] = [first, first + rows - 1].map(|row| number(&looked, row));
            let value = column[first];
            let seen = format!("{name} stands at {value} in rows {from} to {to}");
            let advice = "check its wire; leave these rows out";
            findings.push(Finding::fault("channel-stopped", seen, advice));
        }
    }
    findings.extend(rows_twice(&looked));
    findings
}

fn looked_at(log: &LogRows) -> Looked<'_> {
    let every = log.rows().div_ceil(MOST_ROWS).max(1) as usize;
    let mut start = 0;
    let numbered = log.blocks.iter().map(|block| {
        start += block.rows.rows;
        (start - block.rows.rows, block)
    });
    numbered.step_by(every).collect()
}

fn number(looked: &Looked<'_>, mut row: usize) -> usize {
    for (start, block) in looked {
        if row < block.rows.rows {
            return start + row + 1;
        }
        row -= block.rows.rows;
    }
    row
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

/// Returns first row and length of the longest run of one value, if long.
fn longest_stop(column: &[f64]) -> Option<(usize, usize)> {
    let mut start = 0;
    let runs = column.chunk_by(|a, b| a == b).map(|same| {
        start += same.len();
        (start - same.len(), same.len())
    });
    let longest = runs.max_by_key(|(_, rows)| *rows)?;
    let fewest = FEWEST_STOPPED.max((STOPPED * column.len() as f64) as usize);
    (longest.1 >= fewest && longest.1 < column.len()).then_some(longest)
}

/// Returns true if two channels move over most of their usual range in these rows.
fn others_move(looked: &Looked<'_>, stopped: usize, rows: Range<usize>) -> bool {
    let channels = looked.first().map_or(0, |(_, block)| block.rows.channels().len());
    let moves = |channel: &usize| {
        let column =
            || looked.iter().flat_map(|(_, block)| &block.rows.readings[*channel]).copied();
        let range = |(low, high): (f64, f64)| high - low;
        let all = range(extremes(column()));
        all > 0.0 && range(extremes(column().skip(rows.start).take(rows.len()))) > MOVED * all
    };
    (0..channels).filter(|channel| *channel != stopped).filter(moves).count() >= 2
}

fn rows_twice(looked: &Looked<'_>) -> Option<Finding> {
    let hashes = row_hashes(looked);
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
        copies.extend(before.filter(|before| **before + WINDOW <= start).map(|at| (*at, start)));
    }
    let &(before, first) = copies.first()?;
    let rows = copies.len() * WINDOW;
    let seen = format!(
        "some {rows} rows are there twice: those from row {} on repeat those from row {} on",
        number(looked, first),
        number(looked, before)
    );
    let advice = "leave the copies out: they make errors seem smaller than they are";
    Some(Finding::fault("rows-twice", seen, advice))
}

/// Hashes each row, column by column. Equal hashes of different rows are improbable, though easily made on purpose.
fn row_hashes(looked: &Looked<'_>) -> Vec<u64> {
    let mut all = Vec::new();
    for (_, block) in looked {
        let start = all.len();
        all.resize(start + block.rows.rows, 0_u64);
        for column in block.rows.channels().iter().chain(&block.rows.wrench) {
            for (hash, value) in all[start..].iter_mut().zip(column) {
                *hash = (hash.rotate_left(26) ^ value.to_bits()).wrapping_mul(MULTIPLIER);
            }
        }
    }
    all
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
}
