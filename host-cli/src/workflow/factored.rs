//! From logs to the triangles of their groups, in one pass: what stands in for sums that cannot be exact.

use super::groups::GroupBy;
use super::selection::UsedRows;
use super::{WorkflowError, check_logs};
use calibration::FitError;
use calibration::factored::{FactoredGroups, GroupFactors};
use calibration::model::{Basis, Model};
use calibration::scaling::Scaling;
use calibration::validation::ValidationError;
use log_file::{Log, ReadOptions, ReadSummary, Wanted};
use shell_data::block::Block;

/// What was factored.
#[derive(Debug)]
pub struct Factored {
    /// The rows by group.
    pub groups: FactoredGroups,
    /// For each group, the log that has its first row.
    pub first_in: Vec<usize>,
    /// What each log was.
    pub summaries: Vec<ReadSummary>,
}

/// Factors the rows of `logs` for `basis` and what is within it.
///
/// # Errors
/// [`WorkflowError`] if a log cannot be read, the logs differ in their number of channels, or there are too many
/// groups.
pub fn factor(
    logs: &[Log],
    basis: Basis,
    group_by: &GroupBy,
    used: UsedRows<'_>,
    read: &ReadOptions<'_>,
) -> Result<Factored, WorkflowError> {
    let wanted = group_by.wanted(logs);
    let first = check_logs(logs, &[], &wanted)?;
    let channels = first.channels();
    Model { basis, intercept: true, channels }.check_size().map_err(FitError::from)?;
    let sample = first.sample(&Wanted { readings: true, ..Wanted::default() })?;
    let mut groups = GroupFactors::new(basis, Scaling::of_sample(&sample.readings, true));
    let mut first_in = Vec::new();
    let map = |(): &mut (), log: usize, block: &mut Block| -> Result<Block, WorkflowError> {
        group_by.label(logs, log, block)?;
        used.select(log, block);
        Ok(std::mem::take(block))
    };
    let fold = |log: usize, block: Result<Block, WorkflowError>| -> Result<(), WorkflowError> {
        groups.add(&block?).map_err(of_rows)?;
        first_in.resize(groups.group_count(), log);
        Ok(())
    };
    let all: Vec<&Log> = logs.iter().collect();
    let (summaries, _) = log_file::read_all(&all, &wanted, read, || (), map, fold)?;
    let groups = groups.finish().map_err(of_rows)?;
    Ok(Factored { groups, first_in, summaries })
}

/// All rows of `logs`, with their groups.
///
/// # Errors
/// [`WorkflowError`] if a log cannot be read, or the logs differ in their number of channels.
pub(super) fn grouped_rows(
    logs: &[Log],
    group_by: &GroupBy,
    used: UsedRows<'_>,
    read: &ReadOptions<'_>,
) -> Result<Block, WorkflowError> {
    let wanted = group_by.wanted(logs);
    check_logs(logs, &[], &wanted)?;
    let map = |(): &mut (), log: usize, block: &mut Block| -> Result<Block, WorkflowError> {
        group_by.label(logs, log, block)?;
        used.select(log, block);
        Ok(std::mem::take(block))
    };
    let mut all = Block::default();
    let fold = |_, block: Result<Block, WorkflowError>| -> Result<(), WorkflowError> {
        append(&mut all, block?);
        Ok(())
    };
    let refs: Vec<&Log> = logs.iter().collect();
    log_file::read_all(&refs, &wanted, read, || (), map, fold)?;
    Ok(all)
}

/// Adds rows to others: readings, wrench and groups.
pub(super) fn append(all: &mut Block, block: Block) {
    let columns = [(&mut all.readings, block.readings), (&mut all.wrench, block.wrench)];
    for (to, from) in columns {
        to.resize_with(from.len(), Vec::new);
        to.iter_mut().zip(from).for_each(|(to, mut from)| to.append(&mut from));
    }
    all.groups.extend(block.groups);
    all.rows += block.rows;
}

/// A row that no fit can take is no fault of the groups.
pub(super) fn of_rows(error: ValidationError) -> WorkflowError {
    match error {
        ValidationError::Rows(error) => WorkflowError::Fit(*error),
        error => WorkflowError::Validation(error),
    }
}
