//! Reading logs into the rows of a fit, and writing a fit to its calibration file.

use super::outliers::NamedOutliers;
use super::remark::{Remark, about_fit};
use super::{WorkflowError, agree_on_axes, check_channels, check_logs};
use calibration::FitError;
use calibration::fit::{
    Fault, Fit, FitMethod, FitOptions, GroupsAsked, HeldOut, OutlierRule, Outliers, may_have_poses,
};
use calibration::quality::AxisQuality;
use calibration::validation::cross_validation::CrossValidation;
use calibration_file::{CalibrationFile, Diagnostics, Origin, Role, SolverRecord, SourceFile};
use log_file::{Log, ReadOptions, Wanted, read_dataset, sample_logs};
use report::{CalibrationReport, OutlierTable};
use shell_data::dataset::{Dataset, LogRows};

#[derive(Debug, Default)]
pub struct FitData {
    pub train: Dataset,
    pub test: Dataset,
    pub channel_names: Vec<String>,
}

impl FitData {
    /// Reads the rows of logs, and the labels needed for their groups; for a report also the times. Fails if a log
    /// cannot be read, or the logs differ in their channels or axes.
    pub fn read(
        train: &[Log],
        test: &[Log],
        (options, is_reported): (&FitOptions<'_>, bool),
        read: &ReadOptions<'_>,
    ) -> Result<Self, WorkflowError> {
        check_logs(train, test, &rows_wanted())?;
        let axes = agree_on_axes(train, &mut [])?;
        test.iter().try_for_each(|log| log.require_axes(axes))?;
        let in_time = !options.dynamics.is_nothing();
        let of_train = wanted_for(train, options.groups_asked(), in_time || is_reported)?;
        let of_test = wanted_for(test, GroupsAsked::IfAny, in_time)?;
        let logs: Vec<(&Log, Wanted)> = (train.iter().map(|log| (log, of_train.clone())))
            .chain(test.iter().map(|log| (log, of_test.clone())))
            .collect();
        let mut data = read_dataset(&logs, read)?;
        let tested = Dataset { logs: data.logs.split_off(train.len()) };
        let names = train.first().map(|log| log.value_names().into_iter().take(log.channels()));
        let channel_names = names.into_iter().flatten().map(str::to_owned).collect();
        let mut read = Self { train: data, test: tested, channel_names };
        sample_logs(&mut read.train, train, &of_train)?;
        sample_logs(&mut read.test, test, &of_test)?;
        Ok(read)
    }

    /// Reads logs to test on; the training rows have already been read. Fails like [`FitData::read`].
    pub fn read_tests(
        &mut self,
        test: &[Log],
        options: &FitOptions<'_>,
        read: &ReadOptions<'_>,
    ) -> Result<(), WorkflowError> {
        let wanted = wanted_for(test, GroupsAsked::IfAny, !options.dynamics.is_nothing())?;
        for log in test {
            log.require(&wanted)?;
            check_channels(log, self.train.channels())?;
        }
        let logs: Vec<(&Log, Wanted)> = test.iter().map(|log| (log, wanted.clone())).collect();
        // A group to exclude may be in the training logs only.
        let read = &ReadOptions { may_exclude_nothing: true, ..*read };
        self.test = read_dataset(&logs, read)?;
        sample_logs(&mut self.test, test, &wanted)?;
        Ok(())
    }

    /// Fits a calibration to the rows, which move into the fit, and examines both. Fails like [`calibration::fit()`].
    pub fn fit(&mut self, options: &FitOptions<'_>) -> Result<Fit, FitError> {
        let faults = |data: &Dataset, of: fn(String) -> Fault| {
            let found = doctor::check_rows(data, &self.channel_names);
            found.into_iter().map(|finding| of(finding.seen)).collect::<Vec<Fault>>()
        };
        let faults = [faults(&self.test, Fault::of_test), faults(&self.train, Fault::of_data)];
        let mut fitted = calibration::fit(self.train.take_rows(), self.test.take_rows(), options)?;
        fitted.examine(options.workers)?;
        if let Some(examination) = &mut fitted.examination {
            let found = std::mem::take(&mut examination.faults);
            examination.faults.extend(faults.into_iter().flatten());
            examination.faults.extend(found);
        }
        Ok(fitted)
    }
}

#[derive(Debug)]
pub struct FittedLogs {
    pub fit: Fit,
    pub file: CalibrationFile,
    /// Outliers that were used, if the fit looked for some.
    pub used: Option<NamedOutliers>,
    pub dropped: NamedOutliers,
    outliers: OutlierRule,
}

impl FittedLogs {
    /// Describes a fit to the rows of training logs, tested on those of others. Fails with [`WorkflowError`] if a
    /// companion file of a log cannot be read.
    pub fn new(
        fit: Fit,
        (train, test): (&[Log], &[Log]),
        data: &FitData,
        (origin, outliers): (Origin, OutlierRule),
    ) -> Result<Self, WorkflowError> {
        let sources = sources((train, test), data, &fit)?;
        let file = calibration_file(&fit, Origin { sources, ..origin });
        let name = |found: &Outliers| NamedOutliers::new(found.clone(), train, &data.train);
        let used = fit.outliers.found().map(name);
        let dropped = name(&fit.dropped);
        Ok(Self { fit, file, used, dropped, outliers })
    }

    /// HTML report. Fails with [`FitError`] if the errors of groups cannot be computed.
    pub fn report(&self, name: &str, command: &str) -> Result<String, FitError> {
        let (fit, file, outliers) = (&self.fit, &self.file, self.outlier_table());
        CalibrationReport { fit, file, name, command, outliers }.html()
    }

    /// Outliers for a report: those that were left out or listed.
    fn outlier_table(&self) -> Option<OutlierTable> {
        let dropped = self.dropped.rows(true);
        match self.outliers {
            OutlierRule::Keep => None,
            OutlierRule::Report if dropped.count == 0 => {
                Some(self.used.as_ref().map(|used| used.rows(false)).unwrap_or_default())
            }
            OutlierRule::Drop | OutlierRule::Report => Some(dropped),
        }
    }

    pub fn remarks(&self) -> Vec<Remark> {
        let mut remarks = about_fit(&self.fit);
        remarks.extend(self.used.iter().flat_map(NamedOutliers::remarks));
        remarks
    }
}

fn rows_wanted() -> Wanted {
    Wanted { readings: true, wrench: true, ..Wanted::default() }
}

/// The columns to read of `logs` for their groups, and for their clocks if rows are processed `in_time`.
fn wanted_for(logs: &[Log], asked: GroupsAsked, in_time: bool) -> Result<Wanted, WorkflowError> {
    let are_given = !logs.is_empty() && logs.iter().all(Log::has_groups);
    let is_given = are_given || logs.len() > 1;
    let may_be_found = |log: &Log| -> Result<bool, WorkflowError> {
        Ok(may_have_poses(&log.sample(&rows_wanted())?, log.compression().is_some()))
    };
    let (groups, finds) = match asked {
        GroupsAsked::Nothing => (false, false),
        GroupsAsked::IfAny if is_given => (are_given, false),
        GroupsAsked::IfAny => {
            let found = logs.iter().map(may_be_found).collect::<Result<Vec<_>, _>>()?;
            (false, found.into_iter().all(|may_be| may_be))
        }
        GroupsAsked::HeldOut(HeldOut::Column) => (true, false),
        GroupsAsked::HeldOut(HeldOut::Poses) => (are_given, true),
        GroupsAsked::HeldOut(_) => (are_given, !is_given),
    };
    let time = (finds || in_time) && logs.iter().all(Log::has_time);
    Ok(Wanted { groups, time, ..rows_wanted() })
}

/// Reads logs and fits a calibration to them. Fails like [`FitData::read`] and [`calibration::fit()`].
pub fn fit(train: &[Log], test: &[Log], options: &FitOptions<'_>) -> Result<Fit, WorkflowError> {
    let read = ReadOptions { threads: options.workers.threads, ..ReadOptions::default() };
    let mut data = FitData::read(train, test, (options, false), &read)?;
    Ok(data.fit(options)?)
}

/// Creates the calibration file of a fit, and adds the solver and the quality of the fit to `origin`.
pub fn calibration_file(fit: &Fit, origin: Origin) -> CalibrationFile {
    // R² is not a result if the fit has in effect seen the rows, or if no row is within its range.
    let is_no_result = fit.leaks.in_test().is_some() || fit.test().is_out_of_range();
    let as_a_result = |of: AxisQuality| match is_no_result {
        true => AxisQuality { r_squared: None, ..of },
        false => of,
    };
    let solver = match &fit.method {
        FitMethod::Polynomial { solution, solver, truncate } => {
            Some(SolverRecord { name: *solver, ridge: solution.ridge, truncate: *truncate })
        }
        FitMethod::Physics(_) => None,
    };
    let diagnostics = Diagnostics {
        rows: fit.rows,
        skipped_rows: fit.skipped_rows,
        repeated_rows: fit.repeated_rows,
        rank: fit.rank(),
        condition: fit.condition(),
        train: fit.train,
        test: fit.test().quality().map(|axes| axes.map(as_a_result)),
        cross_validation: fit.cross_validation.clone().map(CrossValidation::without_folds),
        spread: fit.spread(),
        selection: fit.selection.clone(),
        excitation: fit.excitation.clone(),
        test_leak: fit.leaks.in_test(),
        group_leak: fit.leaks.in_groups(),
        not_ok: fit.verdict().refusal(),
    };
    CalibrationFile {
        calibration: fit.calibration.clone(),
        origin: Origin { solver, diagnostics: Some(diagnostics), ..origin },
    }
}

/// The files that a fit to `data` was made from. Fails if a companion file of a log cannot be read.
fn sources(
    (train, test): (&[Log], &[Log]),
    data: &FitData,
    fit: &Fit,
) -> Result<Vec<SourceFile>, WorkflowError> {
    let tests: Vec<u64> = fit.tests.iter().map(|test| test.rows).collect();
    let mut files = log_sources(Role::Train, train, &data.train.logs, &fit.rows_of_logs)?;
    files.extend(log_sources(Role::Test, test, &data.test.logs, &tests)?);
    Ok(files)
}

/// Logs of one role, with companion files, and the number of rows used. Fails if a companion cannot be read.
pub fn log_sources(
    role: Role,
    logs: &[Log],
    read: &[LogRows],
    rows: &[u64],
) -> Result<Vec<SourceFile>, WorkflowError> {
    let mut files = Vec::new();
    for ((log, read), &rows) in logs.iter().zip(read).zip(rows) {
        let checksum = read.summary.checksum.clone();
        let has_checksum = checksum.is_some();
        files.push(SourceFile { role, path: log.path().into(), checksum, digest: None, rows });
        if let Some(path) = log.companion() {
            let checksum = if has_checksum { log.companion_checksum()? } else { None };
            let (role, path) = (Role::Wrench, path.into());
            files.push(SourceFile { role, path, checksum, digest: None, rows });
        }
    }
    Ok(files)
}
