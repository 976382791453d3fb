//! Which rows belong together: by a column, by file, or as found in the rows themselves.

use std::collections::HashMap;
use std::fmt;
use std::sync::Arc;

use super::{WorkflowError, check_logs};
use calibration::validation::grouped::GroupKind;
use calibration::validation::plateaus::{PlateauFinder, Steps, Stretches};
use log_file::{self, Log, ReadOptions, Wanted};
use shell_data::block::Block;

/// What is held out together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HeldOut {
    /// Each group of the logs' group column, or each file, or what is found in a log alone.
    Auto,
    /// Each file.
    File,
    /// Each group of the column.
    Column,
    /// Each plateau of constant load.
    Plateaus,
    /// So many folds of groups.
    Folds(usize),
}

impl From<Option<usize>> for HeldOut {
    /// So many folds of groups, or each group.
    fn from(folds: Option<usize>) -> Self {
        folds.map_or(Self::Auto, Self::Folds)
    }
}

/// What a group is.
#[derive(Clone, Debug, PartialEq)]
pub enum GroupBy {
    /// The rows of a file.
    File,
    /// The rows with one label in the logs' group column.
    Column,
    /// Stretches of rows that were found.
    Found(Arc<FoundGroups>),
}

/// What tells groups apart that were found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Found {
    /// The load is constant within each.
    Plateaus,
    /// The clock jumps between them.
    Recordings,
}

/// Groups that were found in logs without a group column.
#[derive(Clone, Debug, PartialEq)]
pub struct FoundGroups {
    /// What they are.
    pub found: Found,
    /// The rows of each, in the order of the logs.
    pub rows: Vec<u64>,
    /// The labels in each block of each log, by where the block is.
    labels: Vec<HashMap<u64, Vec<(String, usize)>>>,
}

/// How many groups were found, and how long they are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub struct FoundSummary {
    /// What they are.
    pub found: Found,
    /// How many.
    pub groups: usize,
    /// The rows of the shortest.
    pub rows_min: u64,
    /// Of the median.
    pub rows_median: u64,
    /// Of the longest.
    pub rows_max: u64,
}

impl GroupBy {
    /// Whether groups are poses, as far as one can tell, so that the scatter of their errors says how
    /// sure a calibration is.
    pub fn is_of_poses(&self) -> bool {
        match self {
            Self::File => false,
            Self::Column => true,
            Self::Found(groups) => groups.found == Found::Plateaus,
        }
    }

    /// The groups that were found, if they were.
    pub fn found(&self) -> Option<&FoundGroups> {
        match self {
            Self::Found(groups) => Some(groups),
            _ => None,
        }
    }

    /// What has to be read of `logs` for readings, wrench and group of every row.
    pub(super) fn wanted(&self, logs: &[Log]) -> Wanted {
        match self {
            // What is wrong in a row depends on what is read of it: the same as when they were found.
            Self::Found(_) => wanted_to_find(logs),
            _ => {
                let groups = *self == Self::Column;
                Wanted { readings: true, wrench: true, groups, ..Wanted::default() }
            }
        }
    }

    /// Labels the rows of a block of one of `logs`, as it was read.
    pub(super) fn label(
        &self,
        logs: &[Log],
        log: usize,
        block: &mut Block,
    ) -> Result<(), WorkflowError> {
        let path = logs[log].path();
        match self {
            Self::Column => {}
            Self::File => block.groups = vec![(path.display().to_string(), block.rows)],
            Self::Found(groups) => {
                let labels = groups.labels.get(log).and_then(|labels| labels.get(&block.place));
                let is_whole = |runs: &&Vec<(String, usize)>| {
                    runs.iter().map(|(_, rows)| rows).sum::<usize>() == block.rows
                };
                let labels = labels.filter(is_whole);
                let changed = || WorkflowError::Changed { path: path.to_path_buf() };
                block.groups = labels.ok_or_else(changed)?.clone();
            }
        }
        Ok(())
    }
}

/// What groups of `logs` can be held out, as asked for or, for [`HeldOut::Auto`] and folds, the first
/// there is: labels of a column that all have, files where there are several, plateaus of constant
/// load, stretches between jumps of the clock. `None` where there are none.
///
/// # Errors
/// [`WorkflowError`] if the logs have to be read to find groups, and cannot be.
pub fn held_out(
    logs: &[Log],
    held_out: HeldOut,
    read: &ReadOptions<'_>,
) -> Result<Option<GroupBy>, WorkflowError> {
    let found = || Ok(find(logs, read)?.map(|groups| GroupBy::Found(Arc::new(groups))));
    match held_out {
        HeldOut::File => Ok(Some(GroupBy::File)),
        HeldOut::Column => Ok(Some(GroupBy::Column)),
        HeldOut::Plateaus => Ok(found()?.filter(GroupBy::is_of_poses)),
        HeldOut::Auto | HeldOut::Folds(_) => match given(logs) {
            None => found(),
            given => Ok(given.map(GroupBy::from)),
        },
    }
}

/// The groups that errors may be alike in, as far as a look at some rows says that it is worth reading
/// all to find them.
///
/// # Errors
/// As [`held_out`].
pub fn of_errors(logs: &[Log], read: &ReadOptions<'_>) -> Result<Option<GroupBy>, WorkflowError> {
    match given(logs) {
        None if logs.iter().all(may_have_plateaus) => held_out(logs, HeldOut::Plateaus, read),
        given => Ok(given.map(GroupBy::from)),
    }
}

/// What groups `logs` are given in: those of a column where all have one, otherwise files where there
/// are several.
pub(super) fn given(logs: &[Log]) -> Option<GroupKind> {
    match logs.len() {
        1.. if logs.iter().all(Log::has_groups) => Some(GroupKind::Column),
        2.. => Some(GroupKind::File),
        _ => None,
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

fn wanted_to_find(logs: &[Log]) -> Wanted {
    let time = logs.iter().all(Log::has_time);
    Wanted { time, readings: true, wrench: true, ..Wanted::default() }
}

/// Whether a sample of the rows falls into plateaus; a compressed log has no sample of all its parts.
fn may_have_plateaus(log: &Log) -> bool {
    let wanted = Wanted { wrench: true, ..Wanted::default() };
    let Ok(sample) = log.sample(&wanted) else { return false };
    let mut finder = PlateauFinder::new(Steps::of_sample(&[], &sample.wrench));
    finder.add(&[], &sample.wrench);
    log.is_compressed() || matches!(finder.finish(), Stretches::Plateaus(_))
}

/// A block of a log.
struct Part {
    log: usize,
    place: u64,
    rows: usize,
}

/// Reads the logs once to find groups. Logs are groups of their own where only others have any.
fn find(logs: &[Log], read: &ReadOptions<'_>) -> Result<Option<FoundGroups>, WorkflowError> {
    let wanted = wanted_to_find(logs);
    check_logs(logs, &[], &wanted)?;
    let finder = |log: &Log| -> Result<PlateauFinder, WorkflowError> {
        let sample = log.sample(&wanted)?;
        Ok(PlateauFinder::new(Steps::of_sample(&sample.time_s, &sample.wrench)))
    };
    let mut finders = logs.iter().map(finder).collect::<Result<Vec<_>, _>>()?;
    let mut parts = Vec::new();
    let map = |(): &mut (), log: usize, block: &mut Block| {
        let part = Part { log, place: block.place, rows: block.rows };
        (part, std::mem::take(&mut block.time_s), std::mem::take(&mut block.wrench))
    };
    let fold = |log: usize, (part, time_s, wrench): (Part, Vec<f64>, Vec<Vec<f64>>)| {
        finders[log].add(&time_s, &wrench);
        parts.push(part);
        Ok::<_, WorkflowError>(())
    };
    let read = ReadOptions { checksum: false, ..*read };
    let all: Vec<&Log> = logs.iter().collect();
    log_file::read_all(&all, &wanted, &read, || (), map, fold)?;
    let stretches: Vec<Stretches> = finders.into_iter().map(PlateauFinder::finish).collect();
    let is_plateaus = |stretches: &Stretches| matches!(stretches, Stretches::Plateaus(_));
    let found = match &stretches[..] {
        all if all.iter().any(is_plateaus) => Found::Plateaus,
        all if all.iter().all(|of| *of == Stretches::Nothing) => return Ok(None),
        _ => Found::Recordings,
    };
    let mut groups = FoundGroups { found, rows: Vec::new(), labels: Vec::new() };
    for (log, stretches) in stretches.into_iter().enumerate() {
        let parts: Vec<&Part> = parts.iter().filter(|part| part.log == log).collect();
        let rows = match (stretches, found) {
            (Stretches::Plateaus(rows), _) | (Stretches::Recordings(rows), Found::Recordings) => {
                rows
            }
            _ => vec![parts.iter().map(|part| part.rows as u64).sum()],
        };
        groups.add(&rows, &parts);
    }
    Ok(Some(groups))
}

impl FoundGroups {
    /// Adds a log whose groups have so many rows, in these blocks.
    fn add(&mut self, rows: &[u64], parts: &[&Part]) {
        let name = match self.found {
            Found::Plateaus => "plateau",
            Found::Recordings => "recording",
        };
        let mut groups = rows.iter().copied().zip(self.rows.len() + 1..);
        let (mut left, mut number) = (0, 0);
        let mut labels = HashMap::new();
        for part in parts {
            let (mut unlabelled, mut runs) = (part.rows, Vec::new());
            while unlabelled > 0 {
                while left == 0 {
                    (left, number) = groups.next().unwrap_or((u64::MAX, number));
                }
                let run = usize::try_from(left).map_or(unlabelled, |left| left.min(unlabelled));
                runs.push((format!("{name} {number}"), run));
                unlabelled -= run;
                left -= run as u64;
            }
            labels.insert(part.place, runs);
        }
        self.rows.extend(rows);
        self.labels.push(labels);
    }

    /// What they are, how many and how long.
    pub fn summary(&self) -> FoundSummary {
        let mut rows = self.rows.clone();
        rows.sort_unstable();
        FoundSummary {
            found: self.found,
            groups: rows.len(),
            rows_min: rows.first().copied().unwrap_or(0),
            rows_median: rows.get(rows.len() / 2).copied().unwrap_or(0),
            rows_max: rows.last().copied().unwrap_or(0),
        }
    }
}

impl fmt::Display for FoundSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { found, groups, rows_min, rows_median, rows_max } = self;
        let what = match found {
            Found::Plateaus => "plateaus of constant load",
            Found::Recordings => "recordings between jumps of the clock",
        };
        match rows_min == rows_max {
            true => write!(f, "{groups} {what}, {rows_min} rows each"),
            false => {
                write!(f, "{groups} {what}, {rows_min} to {rows_max} rows (median {rows_median})")
            }
        }
    }
}
