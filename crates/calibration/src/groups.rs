//! Groups of rows: by a column, by file, or found in the rows themselves.

use std::fmt;
use std::ops::Range;
use std::sync::Arc;

use crate::validation::pose_finder::{GroupLengths, PoseFinder, Steps};
use least_squares::grouped_rows::GroupedRows;
use least_squares::validation::grouped::GroupKind;
use shell_data::block::Block;
use shell_data::dataset::{BLOCK_ROWS, Dataset, LabelRuns, LogRows};
use shell_data::statistics::RunningVariance;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HeldOut {
    /// Groups of the logs' column, or files, or groups found in a single log, or blocks of time.
    Auto,
    File,
    Column,
    Poses,
    Folds(usize),
}

impl std::str::FromStr for HeldOut {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match (text, text.parse()) {
            ("auto", _) => Ok(Self::Auto),
            ("file", _) => Ok(Self::File),
            ("column", _) => Ok(Self::Column),
            ("plateau", _) => Ok(Self::Poses),
            (_, Ok(folds @ 2..)) => Ok(Self::Folds(folds)),
            _ => {
                Err("expected `file`, `column`, `plateau` or a number of folds from 2 up"
                    .to_owned())
            }
        }
    }
}

impl From<Option<usize>> for HeldOut {
    /// Converts a number of folds of groups; `None` holds out each group alone.
    fn from(folds: Option<usize>) -> Self {
        folds.map_or(Self::Auto, Self::Folds)
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GroupBy {
    File,
    Column,
    Found(FoundGroups),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FoundKind {
    /// The load is constant within each group.
    Poses,
    /// The clock jumps between groups.
    Recordings,
    /// Only time separates the groups.
    TimeBlocks,
}

const TIME_BLOCKS: u64 = 40;

/// Rows count as shuffled if neighbouring loads correlate less; in order of time, they correlate far more.
pub(crate) const SHUFFLED_BELOW: f64 = 0.3;

/// Maximum number of blocks of time into which the rows of several files are divided.
const MOST_TIME_BLOCKS: u64 = 100;

/// Minimum length of a block of time, in correlation lengths of the loads.
const TIME_BLOCK_LENGTHS: usize = 8;

const MOST_ROWS: usize = 20_000;

impl FoundKind {
    pub fn name(self) -> &'static str {
        self.words()[0]
    }

    /// Name in documents, singular, plural, and full name.
    fn words(self) -> [&'static str; 4] {
        match self {
            Self::Poses => ["plateaus", "plateau", "poses", "plateaus of constant load"],
            Self::Recordings => {
                ["recordings", "recording", "recordings", "recordings between jumps of the clock"]
            }
            Self::TimeBlocks => ["stretches", "block", "blocks of time", "blocks of time"],
        }
    }
}

/// Groups that were found in logs without a group column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FoundGroups {
    pub kind: FoundKind,
    pub groups: usize,
    pub rows_min: u64,
    pub rows_median: u64,
    pub rows_max: u64,
}

impl GroupBy {
    /// Returns true if groups are probably poses.
    pub fn is_poses(&self) -> bool {
        match self {
            Self::File => false,
            Self::Column => true,
            Self::Found(groups) => groups.kind == FoundKind::Poses,
        }
    }

    pub fn is_time_blocks(&self) -> bool {
        self.found().is_some_and(|groups| groups.kind == FoundKind::TimeBlocks)
    }

    pub fn plural(&self) -> &'static str {
        match self {
            Self::File => "files",
            Self::Column => "groups",
            Self::Found(groups) => groups.kind.words()[2],
        }
    }

    pub fn found(&self) -> Option<FoundGroups> {
        match self {
            Self::Found(groups) => Some(*groups),
            _ => None,
        }
    }
}

impl From<GroupKind> for GroupBy {
    fn from(kind: GroupKind) -> Self {
        match kind {
            GroupKind::File => Self::File,
            GroupKind::Column => Self::Column,
        }
    }
}

/// Labels rows by groups that can be held out: the requested ones or, for [`HeldOut::Auto`] and folds,
/// the first available of a column in all logs, several files, poses,
/// recordings between jumps of the clock, forty blocks of time. `None` without groups.
pub fn label_groups(data: &Dataset, held_out: HeldOut) -> Option<(GroupBy, Dataset)> {
    match held_out {
        HeldOut::File => Some((GroupBy::File, label_by_file(data))),
        HeldOut::Column => Some((GroupBy::Column, data.clone())),
        HeldOut::Poses => find(data).filter(|(by, _)| by.is_poses()),
        HeldOut::Auto | HeldOut::Folds(_) => {
            given(data).or_else(|| find(data)).or_else(|| label_time_blocks(data))
        }
    }
}

/// Labels the rows of a data set by their group column, file or pose.
pub fn label_poses_or_files(data: &Dataset) -> Dataset {
    label_poses(data).map_or_else(|| label_by_file(data), |(_, data)| data)
}

/// Labels rows by groups with correlated errors: a column, several files, or poses if samples of the logs show some.
pub(crate) fn label_poses(data: &Dataset) -> Option<(GroupBy, Dataset)> {
    given(data).or_else(|| label_found_poses(data))
}

/// Labels rows by the poses that are found in them, if a sample of each log shows some.
pub(crate) fn label_found_poses(data: &Dataset) -> Option<(GroupBy, Dataset)> {
    let may_have = |log: &LogRows| may_have_poses(&log.sample, log.is_sampled_at_start);
    data.logs.iter().all(may_have).then(|| label_groups(data, HeldOut::Poses))?
}

/// Groups of a column are poses if at most this share of the variance of the loads is within them.
const WITHIN_POSES: f64 = 0.1;

/// Returns true if loads hardly change within the groups of a column or, without a column, if all logs have poses.
pub(crate) fn has_poses(data: &Dataset) -> bool {
    match data.logs.iter().all(|log| log.has_groups) {
        true => loads_are_constant_in_groups(data),
        false => label_found_poses(data).is_some(),
    }
}

fn loads_are_constant_in_groups(data: &Dataset) -> bool {
    let (rows, _) = GroupedRows::from_labels(data);
    (0..6).all(|axis| {
        let within: f64 = rows.groups().map(|runs| rows.spread(runs, axis).squares).sum();
        within <= WITHIN_POSES * rows.spread(&rows.runs, axis).squares
    })
}

/// Returns false if a sample of a log rules out poses. A sample of the first rows only cannot do so.
pub fn may_have_poses(sample: &Block, is_sampled_at_start: bool) -> bool {
    let mut finder = PoseFinder::<6>::new(Steps::from_sample(&[], &sample.wrench));
    finder.add(&[], &sample.wrench);
    is_sampled_at_start || matches!(finder.finish(), GroupLengths::Poses(_))
}

/// Labels rows by the column if all logs have one, otherwise by file if there are several.
fn given(data: &Dataset) -> Option<(GroupBy, Dataset)> {
    match data.logs.len() {
        1.. if data.logs.iter().all(|log| log.has_groups) => Some((GroupBy::Column, data.clone())),
        2.. => Some((GroupBy::File, label_by_file(data))),
        _ => None,
    }
}

fn label_by_file(data: &Dataset) -> Dataset {
    let mut data = data.clone();
    for log in &mut data.logs {
        label_runs(log, [(log.name.display().to_string(), u64::MAX)]);
    }
    data
}

/// Finds groups in the rows. A log without groups becomes one group if another log has some.
fn find(data: &Dataset) -> Option<(GroupBy, Dataset)> {
    let lengths = |log: &LogRows| {
        let steps = Steps::from_sample(&log.sample.time_s, &log.sample.wrench);
        let mut finder = PoseFinder::<6>::new(steps);
        log.blocks.iter().for_each(|block| finder.add(&block.rows.time_s, &block.rows.wrench));
        finder.finish()
    };
    let lengths: Vec<GroupLengths> = data.logs.iter().map(lengths).collect();
    let kind = match &lengths[..] {
        all if all.iter().any(|of| matches!(of, GroupLengths::Poses(_))) => FoundKind::Poses,
        all if all.iter().all(|of| *of == GroupLengths::Nothing) => return None,
        _ => FoundKind::Recordings,
    };
    let rows = data.logs.iter().zip(lengths).map(|(log, lengths)| match (lengths, kind) {
        (GroupLengths::Poses(rows), _)
        | (GroupLengths::Recordings(rows), FoundKind::Recordings) => rows,
        _ => vec![log.rows()],
    });
    Some(label_found(data, kind, rows.collect()))
}

/// Divides the rows of a log into blocks of time, as evenly as possible. `None` for a single row or several logs.
fn label_time_blocks(data: &Dataset) -> Option<(GroupBy, Dataset)> {
    let [log] = &data.logs[..] else { return None };
    let groups = log.rows().min(TIME_BLOCKS);
    let start = |group: u64| (log.rows() * group).div_ceil(groups);
    let rows = (0..groups).map(|group| start(group + 1) - start(group)).collect();
    (groups > 1).then(|| label_found(data, FoundKind::TimeBlocks, vec![rows]))
}

/// Labels the rows of several files by blocks of time, and returns the range of blocks of each file. Blocks
/// are so long that errors of neighbouring blocks are nearly uncorrelated. `None` for rows in poses,
/// shuffled rows, or loads that stay correlated too long.
pub(crate) fn time_blocks_of_files(data: &Dataset) -> Option<(Dataset, Vec<Range<usize>>)> {
    let is_apart = |&lag: &usize| load_correlation(data, lag) < SHUFFLED_BELOW;
    let lags = std::iter::successors(Some(1), |lag| Some(2 * lag));
    let apart = lags.take_while(|&lag| lag < BLOCK_ROWS / 4).find(is_apart)?;
    if apart == 1 || has_poses(data) {
        return None;
    }
    let longest = (data.rows() / MOST_TIME_BLOCKS).max((TIME_BLOCK_LENGTHS * apart) as u64);
    let (mut files, mut lengths, mut first) = (Vec::new(), Vec::new(), 0);
    for log in &data.logs {
        let count = if log.rows() > 0 { (log.rows() / longest).max(1) } else { 0 };
        let start = |part: u64| log.rows() * part / count;
        lengths.push((0..count).map(|part| start(part + 1) - start(part)).collect());
        files.push(first..first + count as usize);
        first += count as usize;
    }
    files.retain(|blocks| !blocks.is_empty());
    Some((label_found(data, FoundKind::TimeBlocks, lengths).1, files))
}

/// Returns true if the rows are not in order of time: neighbouring loads are uncorrelated on every
/// axis, so rows cannot be held out by time.
pub(crate) fn rows_are_shuffled(data: &Dataset) -> bool {
    data.rows() > TIME_BLOCKS && load_correlation(data, 1) < SHUFFLED_BELOW
}

/// The correlation of the loads of rows `lag` apart, on the axis where it is largest.
pub(crate) fn load_correlation(data: &Dataset, lag: usize) -> f64 {
    let correlation = |axis: usize| {
        let mut rest = MOST_ROWS;
        let columns: Vec<&[f64]> = (data.blocks())
            .map(|(_, block)| {
                let column = &block.rows.wrench[axis];
                let some = &column[..column.len().min(rest)];
                rest -= some.len();
                some
            })
            .collect();
        let mut all = RunningVariance::default();
        columns.iter().for_each(|column| all.merge(&RunningVariance::new(column)));
        let of_pair = |pair: &[f64]| (pair[0] - all.mean) * (pair[lag] - all.mean);
        let pairs = || columns.iter().flat_map(|column| column.windows(lag + 1));
        let mean = pairs().map(of_pair).sum::<f64>() / pairs().count().max(1) as f64;
        if all.squares > 0.0 { mean * all.count as f64 / all.squares } else { 0.0 }
    };
    (0..6).map(correlation).fold(0.0, f64::max)
}

/// Labels the rows of a data set by groups with the given numbers of rows in each log.
fn label_found(data: &Dataset, kind: FoundKind, rows: Vec<Vec<u64>>) -> (GroupBy, Dataset) {
    let (mut all, mut data) = (Vec::new(), data.clone());
    for (log, rows) in data.logs.iter_mut().zip(rows) {
        let [_, name, ..] = kind.words();
        let numbered = rows.iter().zip(all.len() + 1..);
        label_runs(log, numbered.map(|(&rows, number)| (format!("{name} {number}"), rows)));
        all.extend(rows);
    }
    all.sort_unstable();
    let found = FoundGroups {
        kind,
        groups: all.len(),
        rows_min: all.first().copied().unwrap_or(0),
        rows_median: all.get(all.len() / 2).copied().unwrap_or(0),
        rows_max: all.last().copied().unwrap_or(0),
    };
    (GroupBy::Found(found), data)
}

/// Labels the rows of a log by consecutive runs; the last continues to the end.
pub(crate) fn label_runs(log: &mut LogRows, runs: impl IntoIterator<Item = (String, u64)>) {
    let (mut runs, mut label, mut left) = (runs.into_iter(), String::new(), 0);
    for block in &mut log.blocks {
        let (mut unlabelled, mut labels) = (block.rows.rows, LabelRuns::new());
        while unlabelled > 0 {
            while left == 0 {
                (label, left) = runs.next().unwrap_or((label, u64::MAX));
            }
            let run = left.min(unlabelled as u64);
            labels.push((label.clone(), run as usize));
            unlabelled -= run as usize;
            left -= run;
        }
        block.labels = Arc::new(labels);
    }
}

impl fmt::Display for FoundGroups {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { kind, groups, rows_min, rows_median, rows_max } = self;
        let [.., what] = kind.words();
        match rows_min == rows_max {
            true => write!(f, "{groups} {what}, {rows_min} rows each"),
            false => {
                write!(f, "{groups} {what}, {rows_min} to {rows_max} rows (median {rows_median})")
            }
        }
    }
}
