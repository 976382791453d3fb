//! From training logs to a calibration by the physics model.

use std::collections::HashMap;

use super::eval::{EvalOptions, Evaluation, eval};
use super::groups::{self, FoundGroups, FoundSummary, GroupBy};
use super::model_choice::HeldOut;
use super::selection::UsedRows;
use super::{WorkflowError, check_logs};
use calibration::physics::{Choice, PhysicsCalibration, PhysicsValidation, TrainingRows};
use calibration::reading_ranges::ReadingRange;
use calibration::validation::cross_validation::{CrossValidation, HeldOutQuality};
use calibration::validation::excitation::WrenchSums;
use calibration::{Calibration, Kind};
use figures::FitPlot;
use log_file::{Log, ReadOptions, Wanted};
use shell_data::block::Block;
use shell_data::wrench::Axes;

/// Up to this many groups `--cv` holds each out alone, more in [`FOLDS`] folds: a fit for each.
const MOST_ALONE: usize = 40;
const FOLDS: usize = 10;

/// What is asked for.
#[derive(Clone, Copy, Default)]
pub struct PhysicsOptions<'a> {
    /// Find the errors on groups that were held out, by fits without them.
    pub cross_validation: Option<HeldOut>,
    /// Which rows of the training logs are used.
    pub used: UsedRows<'a>,
    /// Reduce predictions and measurements to what a figure needs.
    pub plot: bool,
    /// How logs are read. Progress counts the bytes of the training logs twice.
    pub read: ReadOptions<'a>,
}

/// What rows were held out together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GroupsAre {
    /// The rows with one label in the logs' group column.
    Labels,
    /// The rows of a file.
    Files,
    /// Stretches that were found in the rows.
    Found,
    /// The rows of a stretch of time, in logs that have neither.
    Stretches,
}

/// The training rows, and what their groups are called.
#[derive(Clone, Debug)]
pub struct GroupedRows {
    /// The rows; groups are places in `labels`.
    pub rows: TrainingRows,
    /// Label of each group.
    pub labels: Vec<String>,
    /// What a group is.
    pub groups_are: GroupsAre,
}

/// A calibration by the physics model, and how well it does.
#[derive(Debug)]
pub struct PhysicsFit {
    /// What the training rows determine.
    pub fitted: FittedRows,
    /// Rows fitted.
    pub rows: u64,
    /// What a group is.
    pub groups_are: GroupsAre,
    /// The groups that were found, where that is what they are.
    pub found: Option<FoundSummary>,
    /// Errors on each training log.
    pub train: Vec<Evaluation>,
    /// The wrench that the training logs have measured.
    pub loads: WrenchSums,
    /// Errors on each test log.
    pub test: Vec<Evaluation>,
    /// What a figure needs of training and test logs.
    pub plots: Option<(FitPlot, FitPlot)>,
}

impl PhysicsFit {
    /// Whether a training row has an error far from the others'.
    pub fn stands_out(&self) -> bool {
        let mut train = Evaluation::default();
        self.train.iter().for_each(|evaluation| train.merge(evaluation));
        train.has_large_errors()
    }
}

/// What training rows determine: a calibration, and its errors on groups of them.
#[derive(Debug)]
pub struct FittedRows {
    /// The calibration.
    pub calibration: Calibration,
    /// What the priors were chosen from.
    pub choice: Choice,
    /// Means that the rows were reduced to.
    pub observations: usize,
    /// Groups.
    pub groups: usize,
    /// Errors on groups that were held out, where that was asked for.
    pub validation: Option<PhysicsValidation>,
}

impl FittedRows {
    /// The calibration's model.
    pub fn physics(&self) -> &PhysicsCalibration {
        match self.calibration.kind() {
            Kind::Physics(physics) => physics,
            Kind::Polynomial(_) => unreachable!("a physics fit makes a physics calibration"),
        }
    }

    /// What a calibration file says of the held-out errors.
    pub fn cross_validation(&self) -> Option<CrossValidation> {
        let validation = self.validation.as_ref()?;
        let total = validation.total();
        Some(CrossValidation {
            groups: self.groups,
            folds: validation.folds.len(),
            rows: total[0].rows,
            undetermined: Vec::new(),
            grouped: total.map(|of| HeldOutQuality { rms: of.rms(), bias: of.bias() }),
            random_folds: 0,
            random: None,
        })
    }
}

impl GroupedRows {
    /// Rows without groups, in stretches of time.
    pub(super) fn in_stretches(mut rows: TrainingRows) -> Self {
        rows.group_by_time();
        let labels = (0..rows.group_count()).map(|i| (i + 1).to_string()).collect();
        Self { rows, labels, groups_are: GroupsAre::Stretches }
    }
}

/// Reads all rows of `train` with their groups; stretches of time where there are none.
///
/// # Errors
/// [`WorkflowError`] if a log cannot be read or the logs differ in their number of channels.
pub fn read_rows(
    train: &[Log],
    group_by: Option<&GroupBy>,
    used: UsedRows<'_>,
    read: &ReadOptions<'_>,
) -> Result<GroupedRows, WorkflowError> {
    let labelled = group_by.unwrap_or(&GroupBy::File);
    let wanted = labelled.wanted(train);
    let first = check_logs(train, &[], &wanted)?;
    let (mut rows, mut labels) = (TrainingRows::default(), Labels::default());
    rows.readings.resize_with(first.channels(), Vec::new);
    let logs: Vec<&Log> = train.iter().collect();
    let map = |(): &mut (), log: usize, block: &mut Block| -> Result<Block, WorkflowError> {
        labelled.label(train, log, block)?;
        used.select(log, block);
        Ok(std::mem::take(block))
    };
    let fold = |_: usize, block: Result<Block, WorkflowError>| -> Result<(), WorkflowError> {
        labels.add(&mut rows, &block?);
        Ok(())
    };
    log_file::read_all(&logs, &wanted, read, || (), map, fold)?;
    let groups_are = match group_by {
        Some(GroupBy::Column) => GroupsAre::Labels,
        Some(GroupBy::File) => GroupsAre::Files,
        Some(GroupBy::Found(_)) => GroupsAre::Found,
        None => return Ok(GroupedRows::in_stretches(rows)),
    };
    Ok(GroupedRows { rows, labels: labels.names, groups_are })
}

/// Names of groups, in the order of their first rows.
#[derive(Default)]
pub(super) struct Labels {
    pub(super) names: Vec<String>,
    places: HashMap<String, u64>,
}

impl Labels {
    /// Adds the rows of a block to `rows`.
    pub(super) fn add(&mut self, rows: &mut TrainingRows, block: &Block) {
        let columns = rows.wrench.iter_mut().chain(&mut rows.readings);
        for (column, more) in columns.zip(block.wrench.iter().chain(&block.readings)) {
            column.extend_from_slice(more);
        }
        for (label, count) in &block.groups {
            rows.groups.extend(std::iter::repeat_n(self.place(label), *count));
        }
    }

    fn place(&mut self, label: &str) -> u64 {
        if let Some(&place) = self.places.get(label) {
            return place;
        }
        let place = self.names.len() as u64;
        self.names.push(label.to_owned());
        self.places.insert(label.to_owned(), place);
        place
    }
}

/// Whether training logs have all axes of the wrench, to which every sensor answers.
///
/// # Errors
/// [`WorkflowError::PhysicsAxes`].
pub fn check_axes(train: &[Log]) -> Result<(), WorkflowError> {
    let found = train.first().map_or(Axes::ALL, Log::axes);
    if found.are_all() { Ok(()) } else { Err(WorkflowError::PhysicsAxes { found }) }
}

/// Fits the physics model to `train` and finds its errors there and on `test`.
///
/// All training rows are held in memory.
///
/// # Errors
/// [`WorkflowError`] if a log cannot be read, the logs differ in their number of channels, or the
/// rows do not determine the model.
pub fn fit(
    train: &[Log],
    test: &[Log],
    options: &PhysicsOptions<'_>,
) -> Result<PhysicsFit, WorkflowError> {
    check_logs(train, test, &Wanted { readings: true, wrench: true, ..Wanted::default() })?;
    check_axes(train)?;
    let read = ReadOptions { checksum: false, ..options.read };
    let held_out = options.cross_validation.unwrap_or(HeldOut::Auto);
    let group_by = groups::held_out(train, held_out, &read)?;
    let grouped = read_rows(train, group_by.as_ref(), options.used, &read)?;
    let rows = &grouped.rows;
    let fitted = fit_rows(rows, options.cross_validation, &|| false)?;
    let mut plots = options.plot.then(|| (FitPlot::new(), FitPlot::new()));
    let mut evaluations = Vec::with_capacity(train.len() + test.len());
    for (place, log) in train.iter().chain(test).enumerate() {
        let plot = plots.as_mut().map(|(of_train, of_test)| match place < train.len() {
            true => of_train,
            false => of_test,
        });
        let used = match place < train.len() {
            true => options.used,
            false => UsedRows { excluded: None, ..options.used },
        };
        let eval_options = EvalOptions { used, place, read: options.read };
        evaluations.push(eval(&fitted.calibration, log, &eval_options, plot)?);
    }
    let test_errors = evaluations.split_off(train.len());
    Ok(PhysicsFit {
        fitted,
        rows: rows.groups.len() as u64,
        groups_are: grouped.groups_are,
        found: group_by.as_ref().and_then(GroupBy::found).map(FoundGroups::summary),
        train: evaluations,
        loads: WrenchSums::of(&rows.wrench),
        test: test_errors,
        plots,
    })
}

/// Fits the physics model to rows, and to what is left of them where groups are held out, unless it is stopped
/// before a fit.
pub(super) fn fit_rows(
    rows: &TrainingRows,
    cross_validation: Option<HeldOut>,
    is_stopped: &dyn Fn() -> bool,
) -> Result<FittedRows, WorkflowError> {
    let (physics, choice) = PhysicsCalibration::fit(rows)?;
    let validation =
        cross_validation.map(|held_out| validate(rows, held_out, is_stopped)).transpose()?;
    let mut calibration = Calibration::of(Kind::Physics(Box::new(physics)));
    calibration.valid_range = Some(rows.readings.iter().map(|column| range(column)).collect());
    Ok(FittedRows {
        calibration,
        choice,
        observations: rows.observations()?.len(),
        groups: rows.group_count(),
        validation,
    })
}

fn validate(
    rows: &TrainingRows,
    held_out: HeldOut,
    is_stopped: &dyn Fn() -> bool,
) -> Result<PhysicsValidation, WorkflowError> {
    let groups = rows.group_count();
    let folds = match held_out {
        HeldOut::Folds(folds) => folds,
        _ if groups <= MOST_ALONE => groups,
        _ => FOLDS,
    };
    let mut validation = PhysicsValidation { folds: Vec::new() };
    for fold in rows.folds(folds) {
        if is_stopped() {
            return Err(WorkflowError::Interrupted);
        }
        validation.folds.append(&mut PhysicsValidation::of(rows, &[fold])?.folds);
    }
    Ok(validation)
}

fn range(column: &[f64]) -> ReadingRange {
    let range = ReadingRange { min: f64::INFINITY, max: f64::NEG_INFINITY };
    column.iter().fold(range, |range, &reading| ReadingRange {
        min: range.min.min(reading),
        max: range.max.max(reading),
    })
}
