//! Partial fits: the sums of some logs, for [`merge`](super::merge).

use super::WorkflowError;
use super::factored::{Factored, factor};
use super::groups::{self, GroupBy};
use super::model_choice::{RANDOM_FOLDS, random_split};
use super::moments::{self, SumOptions};
use super::selection::UsedRows;
use calibration::exact::Moments;
use calibration::factored::FactoredGroups;
use calibration::validation::grouped::{Apart, GroupKind, GroupedMoments, RandomSplit};
use calibration::{Basis, FitError, Model};
use calibration_file::{PartialFit, PartialGroups, Role, Source, Sums};
use log_file::{Log, ReadOptions, ReadSummary};

/// What is summed, and how.
#[derive(Clone, Copy)]
pub struct PartialOptions<'a> {
    /// The largest family of features that is to be fitted.
    pub basis: Basis,
    /// Whether there is to be a constant beside them.
    pub intercept: bool,
    /// Whether the sums of each group are kept.
    pub groups: Option<KeptGroups>,
    /// Which way rows are dealt into the random folds that held-out errors are compared with.
    pub seed: u64,
    /// Keep triangles also where rows can be summed exactly, for parts of which others cannot.
    pub triangles: bool,
    /// Use only rows whose readings differ from those of the row before.
    pub fresh: bool,
    /// How logs are read.
    pub read: ReadOptions<'a>,
}

/// The groups that are kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum KeptGroups {
    /// Those of the group column where there is one, files otherwise.
    Auto,
    /// These.
    By(GroupKind),
}

/// What was kept of some logs.
struct Kept {
    total: Sums,
    groups: Vec<(String, Sums)>,
    random: (RandomSplit, Vec<Moments>),
    /// For each group, the log that has its first row.
    first_in: Vec<usize>,
    summaries: Vec<ReadSummary>,
}

/// Sums the rows of `logs`, exactly where that can be, which are put into the order of their names where
/// groups are kept. Program and date are left to the caller.
///
/// # Errors
/// [`WorkflowError`] if a log cannot be read, or there are too many groups.
pub fn sum(logs: &mut [Log], options: &PartialOptions<'_>) -> Result<PartialFit, WorkflowError> {
    let axes = super::agree_on_axes(logs, &mut [])?;
    if options.groups.is_some() {
        logs.sort_unstable_by(|a, b| a.path().cmp(b.path()));
    }
    let group_by = options.groups.map(|groups| match groups {
        KeptGroups::By(by) => by,
        KeptGroups::Auto => groups::given(logs).unwrap_or(GroupKind::File),
    });
    let random = match group_by {
        Some(_) => random_split(RANDOM_FOLDS, options.seed),
        None => RandomSplit::default(),
    };
    let sum_options = SumOptions {
        basis: options.basis,
        group_by: group_by.map_or(GroupBy::File, GroupBy::from),
        apart: Apart::Groups,
        random,
        used: UsedRows { fresh: options.fresh, excluded: None },
        gathering: None,
        read: ReadOptions { checksum: true, ..options.read },
    };
    let kept = match options.triangles {
        true => keep_triangles(logs, &sum_options),
        false => match moments::sum(logs, &sum_options) {
            Err(WorkflowError::Fit(FitError::NotExact(_))) => keep_triangles(logs, &sum_options),
            sums => keep_sums(sums?, random),
        },
    };
    let Kept { total, groups, random, first_in, summaries } = kept?;
    let model =
        Model { basis: options.basis, intercept: options.intercept, channels: total.channels() };
    let mut partial = PartialFit::new(model, total);
    partial.axes = axes;
    partial.groups = group_by.map(|by| PartialGroups::new(by, random, groups, &first_in));
    for (log, summary) in logs.iter().zip(&summaries) {
        partial.skipped_rows += summary.skipped_rows;
        partial.repeated_rows += summary.repeated_rows;
        let rows = if options.fresh { summary.rows - summary.repeated_rows } else { summary.rows };
        let checksum = summary.checksum.clone();
        let path = log.path().into();
        partial.sources.push(Source { role: Role::Train, path, checksum, rows });
    }
    // After the logs, which groups name by their places.
    for (log, summary) in logs.iter().zip(&summaries) {
        if let Some(path) = log.beside() {
            let (path, checksum) = (path.into(), log.checksum_beside()?);
            partial.sources.push(Source { role: Role::Wrench, path, checksum, rows: summary.rows });
        }
    }
    Ok(partial)
}

fn keep_sums(sums: moments::Sums, split: RandomSplit) -> Result<Kept, WorkflowError> {
    let moments::Sums { grouped, first_in, summaries, .. } = sums;
    let total = grouped.total().ok_or(WorkflowError::NoRows)?.clone();
    let GroupedMoments { groups, random, .. } = grouped;
    let exact = |(label, moments): (String, Moments)| (label, Sums::Exact(moments));
    Ok(Kept {
        total: Sums::Exact(total),
        groups: groups.into_iter().map(exact).collect(),
        random: (split, random),
        first_in,
        summaries,
    })
}

fn keep_triangles(logs: &[Log], options: &SumOptions<'_>) -> Result<Kept, WorkflowError> {
    let SumOptions { basis, group_by, used, read, .. } = options;
    let Factored { groups, first_in, summaries } = factor(logs, *basis, group_by, *used, read)?;
    let total = groups.total().ok_or(WorkflowError::NoRows)?;
    let FactoredGroups { groups } = groups;
    let groups = groups.into_iter().map(|(label, rows)| (label, Sums::Factored(rows)));
    Ok(Kept {
        total: Sums::Factored(total),
        groups: groups.collect(),
        // Rows are not dealt at random: their triangle would have to be made without each fold.
        random: (RandomSplit::default(), Vec::new()),
        first_in,
        summaries,
    })
}
