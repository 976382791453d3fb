//! From logs to exact sums, group by group, in one pass and without fitting anything.

use super::groups::GroupBy;
use super::log_facts::{BlockFacts, Gathering, LogFacts};
use super::selection::UsedRows;
use super::{WorkflowError, check_logs};
use calibration::FitError;
use calibration::model::{Basis, Model};
use calibration::reading_ranges::ReadingRanges;
use calibration::validation::ValidationError;
use calibration::validation::grouped::{
    Apart, BlockGroups, GroupSums, GroupWorker, GroupedMoments, RandomSplit,
};
use log_file::{self, Log, ReadOptions, ReadSummary};
use shell_data::block::Block;

/// What is summed, and how.
#[derive(Clone)]
pub struct SumOptions<'a> {
    /// The largest family of features that is to be fitted.
    pub basis: Basis,
    /// What a group is.
    pub group_by: GroupBy,
    /// What is summed apart.
    pub apart: Apart,
    /// Rows that are summed again, drawn at random.
    pub random: RandomSplit,
    /// Which rows of the training logs are used.
    pub used: UsedRows<'a>,
    /// What is gathered of the rows beside their sums.
    pub gathering: Option<Gathering>,
    /// How logs are read.
    pub read: ReadOptions<'a>,
}

/// What was summed.
#[derive(Debug)]
pub struct Sums {
    /// The sums by group.
    pub grouped: GroupedMoments,
    /// For each group or set of groups, the log that has its first row.
    pub first_in: Vec<usize>,
    /// What each log was.
    pub summaries: Vec<ReadSummary>,
    /// What was gathered, if anything.
    pub facts: Option<LogFacts>,
}

/// Sums the rows of `logs`.
///
/// # Errors
/// [`WorkflowError`] if a log cannot be read, the logs differ in their number of channels, lack a
/// group column that is asked for, or their rows cannot be summed exactly.
pub fn sum(logs: &[Log], options: &SumOptions<'_>) -> Result<Sums, WorkflowError> {
    let wanted = options.group_by.wanted(logs);
    let channels = check_logs(logs, &[], &wanted)?.channels();
    let model = Model { basis: options.basis, intercept: true, channels };
    model.check_size().map_err(FitError::from)?;
    let mut sums = GroupSums::new(options.basis, channels, options.apart, options.random);
    let empty = sums.worker();
    let init = || empty.clone();
    type Mapped = Result<(BlockGroups, Option<BlockFacts>), WorkflowError>;
    let map = |worker: &mut GroupWorker, log: usize, block: &mut Block| -> Mapped {
        options.group_by.label(logs, log, block)?;
        options.used.select(log, block);
        // Names what is not finite, as every fit does.
        ReadingRanges::of_block(block, channels)?;
        let facts = options.gathering.map(|gathering| gathering.of(log, block));
        Ok((worker.add(block)?, facts))
    };
    let all: Vec<&Log> = logs.iter().collect();
    let (mut first_in, mut facts) = (Vec::new(), LogFacts::default());
    facts.expect(logs);
    let fold = |log, mapped: Mapped| -> Result<(), WorkflowError> {
        let (groups, of_block) = mapped?;
        sums.add(groups)?;
        if let (Some(gathering), Some(of_block)) = (&options.gathering, of_block) {
            facts.add(gathering, log, of_block);
        }
        first_in.resize(sums.group_count(), log);
        Ok(())
    };
    let (summaries, workers) = log_file::read_all(&all, &wanted, &options.read, init, map, fold)?;
    facts.finish(summaries.iter().cloned());
    let facts = options.gathering.map(|_| facts);
    Ok(Sums { grouped: sums.finish(workers)?, first_in, summaries, facts })
}

impl From<ValidationError> for WorkflowError {
    fn from(error: ValidationError) -> Self {
        match error {
            ValidationError::NotExact(error) => FitError::NotExact(error).into(),
            error => WorkflowError::Validation(error),
        }
    }
}
