//! Partial fits: the sums of some logs, and a calibration from merged sums. Logs are streamed, so they may
//! exceed the memory.

use super::fit::calibration_file;
use super::{WorkflowError, check_logs};
use calibration::factored::GroupFactors;
use calibration::fit::{Fit, FitOptions, HeldOut, ModelRule, RANDOM_FOLDS, fit_sums, random_split};
use calibration::reading_ranges::ReadingRanges;
use calibration::scaling::Scaling;
use calibration::validation::grouped::{
    Apart, BlockGroups, GroupKind, GroupSums, GroupWorker, RandomSplit,
};
use calibration::{Basis, FitError, Model};
use calibration_file::{
    CalibrationFile, Origin, PartialFit, PartialGroups, Role, SourceFile, Sums,
};
use log_file::{Log, Mapping, ReadOptions, ReadSummary, Wanted};
use shell_data::block::Block;
use shell_data::fingerprint::Fingerprint;

#[derive(Clone, Copy)]
pub struct PartialOptions<'a> {
    pub basis: Basis,
    pub intercept: bool,
    pub groups: Option<KeptGroups>,
    /// Seed that assigns rows to the random folds, which held-out errors are compared with.
    pub seed: u64,
    /// Keep R factors even if rows can be summed exactly, for merging with parts whose rows cannot.
    pub r_factors: bool,
    /// Use only rows whose readings differ from those of the previous row.
    pub fresh: bool,
    pub mapping: &'a Mapping,
    pub read: ReadOptions<'a>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum KeptGroups {
    /// The groups of the group column if there is one, files otherwise.
    Auto,
    By(GroupKind),
}

type KeptLogs = (Sums, PartialGroups, ReadRows);

struct ReadRows {
    /// For each group, the log that has its first row.
    first_in: Vec<usize>,
    summaries: Vec<ReadSummary>,
    digests: Vec<Fingerprint>,
}

/// Sums the rows of `logs`, exactly if possible. Sorts the logs by name if groups are kept. The caller sets program
/// and date. Fails with [`WorkflowError`] if a log cannot be read, or there are too many groups.
pub fn sum(logs: &mut [Log], options: &PartialOptions<'_>) -> Result<PartialFit, WorkflowError> {
    let axes = super::agree_on_axes(logs, &mut [])?;
    if options.groups.is_some() {
        logs.sort_unstable_by(|a, b| a.path().cmp(b.path()));
    }
    let group_by = options.groups.map(|groups| match groups {
        KeptGroups::By(by) => by,
        KeptGroups::Auto if logs.iter().all(Log::has_groups) => GroupKind::Column,
        KeptGroups::Auto => GroupKind::File,
    });
    let random = match group_by {
        Some(_) => random_split(RANDOM_FOLDS, options.seed),
        None => RandomSplit::default(),
    };
    let read = ReadOptions { checksum: true, ..options.read };
    let options = PartialOptions { read, ..*options };
    let stream = BlockStream { logs, by: group_by.unwrap_or(GroupKind::File), options };
    let kept = match options.r_factors {
        true => stream.factor(),
        false => match stream.sum(random) {
            Err(WorkflowError::Fit(FitError::NotExact(_))) => stream.factor(),
            sums => sums,
        },
    };
    let (total, groups, ReadRows { summaries, digests, .. }) = kept?;
    let (basis, intercept, channels) = (options.basis, options.intercept, total.channels());
    let mut partial = PartialFit::new(Model { basis, intercept, channels, memory: 0 }, total);
    partial.axes = axes;
    partial.summed = logs.first().map(|log| log.specified_values(options.mapping));
    partial.groups = group_by.map(|_| groups);
    for ((log, summary), digest) in logs.iter().zip(&summaries).zip(&digests) {
        partial.skipped_rows += summary.skipped_rows;
        partial.repeated_rows += summary.repeated_rows;
        let rows = if options.fresh { summary.rows - summary.repeated_rows } else { summary.rows };
        let checksum = summary.checksum.clone();
        let path = log.path().into();
        let digest = (digest.rows() > 0).then(|| digest.to_string());
        partial.sources.push(SourceFile { role: Role::Train, path, checksum, digest, rows });
    }
    // After the logs, because groups refer to them by position.
    for (log, summary) in logs.iter().zip(&summaries) {
        if let Some(path) = log.companion() {
            let (path, checksum) = (path.into(), log.companion_checksum()?);
            let (role, digest, rows) = (Role::Wrench, None, summary.rows);
            partial.sources.push(SourceFile { role, path, checksum, digest, rows });
        }
    }
    Ok(partial)
}

struct BlockStream<'a> {
    logs: &'a [Log],
    by: GroupKind,
    options: PartialOptions<'a>,
}

impl BlockStream<'_> {
    /// Returns the model of the sums, after checks of the channels, whose number must be the same in all
    /// logs, and of the number of features.
    fn model(&self) -> Result<Model, WorkflowError> {
        let channels = check_logs(self.logs, &[], &self.wanted())?.channels();
        let model = Model { basis: self.options.basis, intercept: true, channels, memory: 0 };
        model.check_size().map_err(FitError::from)?;
        Ok(model)
    }

    fn wanted(&self) -> Wanted {
        let groups = self.by == GroupKind::Column;
        Wanted { readings: true, wrench: true, groups, ..Wanted::default() }
    }

    /// Labels the rows of a block by their groups, and keeps those that are used.
    fn select(&self, log: usize, block: &mut Block) {
        if self.by == GroupKind::File {
            block.groups = vec![(self.logs[log].path().display().to_string(), block.rows)];
        }
        if self.options.fresh {
            *block = block.kept(&block.fresh_rows());
        }
    }

    /// Reads the logs: `map` processes the selected rows of a block; `add` adds the result to all groups and
    /// returns their number.
    fn read<S: Send, T: Send>(
        &self,
        init: impl Fn() -> S + Sync,
        map: impl Fn(&mut S, &mut Block) -> Result<T, FitError> + Sync,
        mut add: impl FnMut(T) -> Result<usize, FitError>,
    ) -> Result<(ReadRows, Vec<S>), WorkflowError> {
        let mut first_in = Vec::new();
        let mut digests = vec![Fingerprint::default(); self.logs.len()];
        let map = |state: &mut S, log: usize, block: &mut Block| {
            let digest = Fingerprint::new(block);
            self.select(log, block);
            Ok((digest, map(state, block)?))
        };
        let fold = |log: usize, mapped: Result<_, FitError>| -> Result<(), WorkflowError> {
            let (digest, found): (Fingerprint, T) = mapped?;
            digests[log].merge(digest);
            first_in.resize(add(found)?, log);
            Ok(())
        };
        let logs: Vec<_> = self.logs.iter().map(|log| (log, self.wanted())).collect();
        let (summaries, states) = log_file::read_all(&logs, &self.options.read, init, map, fold)?;
        Ok((ReadRows { first_in, summaries, digests }, states))
    }

    fn sum(&self, split: RandomSplit) -> Result<KeptLogs, WorkflowError> {
        let Model { basis, channels, .. } = self.model()?;
        let mut sums = GroupSums::new(basis, channels, Apart::Groups, split);
        let empty = sums.worker();
        let map = |worker: &mut GroupWorker, block: &mut Block| {
            // Reports values that are not finite, as every fit does.
            ReadingRanges::from_block(block, channels)?;
            worker.add(block, &block.groups)
        };
        let add = |groups: BlockGroups| {
            sums.add(groups)?;
            Ok(sums.group_count())
        };
        let (rows, workers) = self.read(|| empty.clone(), map, add)?;
        let grouped = sums.finish(workers)?;
        let total = Sums::Exact(grouped.total().ok_or(FitError::NoRows)?.clone());
        Ok((total, PartialGroups::exact(self.by, split, grouped, &rows.first_in), rows))
    }

    fn factor(&self) -> Result<KeptLogs, WorkflowError> {
        let model = self.model()?;
        let sample = Wanted { readings: true, ..Wanted::default() };
        let sample = self.logs.first().ok_or(WorkflowError::NoLogs)?.sample(&sample)?;
        let mut groups = GroupFactors::new(model, Scaling::from_sample(&sample.readings, true));
        let map = |(): &mut (), block: &mut Block| Ok(std::mem::take(block));
        let add = |block: Block| {
            groups.add(&block, &block.groups)?;
            Ok(groups.group_count())
        };
        let (rows, _) = self.read(|| (), map, add)?;
        let groups = groups.finish()?;
        let total = Sums::Factored(groups.total().ok_or(FitError::NoRows)?);
        Ok((total, PartialGroups::factored(self.by, groups, &rows.first_in), rows))
    }
}

/// Fits a calibration to the sums of `merged`, which is [in order](PartialFit::put_in_order). Without `model`, the
/// model of the sums is used. Fails with [`WorkflowError`] if the rows do not determine the coefficients, or an
/// option needs groups and there are none.
pub fn fit_merged(
    merged: &PartialFit,
    model: Option<ModelRule>,
    options: &FitOptions<'_>,
) -> Result<Fit, WorkflowError> {
    let model = model.unwrap_or(merged.model.basis.into());
    let options = FitOptions { model, intercept: merged.model.intercept, ..*options };
    let folds = options.cross_validation.map(|held_out| match held_out {
        HeldOut::Folds(folds) => folds,
        _ => RANDOM_FOLDS,
    });
    let fit = fit_sums(&merged.sums, merged.grouped_sums(folds)?, merged.axes, &options)?;
    let (skipped_rows, repeated_rows) = (merged.skipped_rows, merged.repeated_rows);
    Ok(Fit { skipped_rows, repeated_rows, ..fit })
}

pub fn merged_file(fit: &Fit, merged: &PartialFit) -> CalibrationFile {
    let origin = Origin {
        made_by: merged.made_by.clone(),
        date: merged.date.clone(),
        sensor_serial: merged.sensor_serial.clone(),
        sources: merged.sources.clone(),
        columns: merged.columns.clone(),
        ..Origin::default()
    };
    calibration_file(fit, origin)
}
