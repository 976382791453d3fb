//! What `shellcal fit` has to do, with all arguments checked and all files open before the work begins.

use std::sync::OnceLock;

use calibration::dynamics::{DynamicsRule, LagRule, MemoryRule};
use calibration::fit::{
    CovarianceRule, Fit, FitOptions, HeldOut, ModelRule, OutlierRule, Outliers, Workers,
};
use calibration::solver::SolverKind;
use calibration_file::{CalibrationFile, Origin, SourceFile, matrix};
use figures::fit_figure;
use indicatif::ProgressBar;
use load_table::HungLoads;
use log_file::{Log, ReadOptions};
use output_file::AtomicFile;
use report::{CalibrationReport, OutlierTable, plots};
use shell_data::hint::quoted;
use shell_data::wrench::Axes;
use shellcal::workflow::agree_on_axes;
use shellcal::workflow::fit::{FitData, calibration_file, sources};
use shellcal::workflow::hung_loads::HungReference;
use shellcal::workflow::outliers::NamedOutliers;
use shellcal::workflow::remark::about_fit;

use super::super::mapping::open_logs;
use super::super::outputs::{self, FigureFile};
use super::super::plan::read_table;
use super::{FitArgs, MemoryArg};
use crate::printer::Printer;

/// A fit to be made.
pub(super) struct FitPlan<'a> {
    pub(super) args: &'a FitArgs,
    train: Vec<Log>,
    test: Vec<Log>,
    loads: Option<HungLoads>,
    options: FitOptions<'a>,
    calibration: Option<AtomicFile>,
    matrix: Option<AtomicFile>,
    plot: Option<FigureFile>,
    report: Option<AtomicFile>,
    dropped: Option<AtomicFile>,
}

/// Rows of a fit with their files and lines.
pub(super) struct NamedRows {
    /// Outliers that were used, where some were looked for.
    pub(super) used: Option<NamedOutliers>,
    /// Rows that were left out.
    pub(super) dropped: Option<NamedOutliers>,
}

impl<'a> FitPlan<'a> {
    /// Checks the arguments, opens the logs, and all files that are written.
    pub(super) fn from_args(args: &'a FitArgs, printer: &Printer) -> anyhow::Result<Self> {
        args.check()?;
        let mapping = args.mapping.mapping();
        let train = open_logs(&args.train, ("--wrench-from", &args.wrench_from), &mapping)?;
        let wrenches = ("--test-wrench-from", args.test_wrench_from.as_slice());
        let mut test = open_logs(&args.test, wrenches, &mapping)?;
        let loads = args.loads.as_ref().map(read_table).transpose()?;
        match loads {
            None => {
                agree_on_axes(&train, &mut test)?;
            }
            Some(_) => test.iter_mut().try_for_each(|log| log.keep_axes(Axes::ALL))?,
        }
        Ok(Self {
            args,
            options: args.options(train.iter().all(Log::has_time)),
            train,
            test,
            loads,
            dropped: printer.create(args.dropped.as_ref())?,
            calibration: printer.create(args.output.as_ref())?,
            matrix: printer.create(args.export_matrix.as_ref())?,
            plot: args.figure.create(printer)?,
            report: printer.create(args.report.as_ref())?,
        })
    }

    /// Reads the logs and fits.
    pub(super) fn fit(
        &self,
        printer: &Printer,
    ) -> anyhow::Result<(FitData, Option<HungReference>, Fit)> {
        let bytes = self.train.iter().chain(&self.test).map(Log::bytes).sum();
        let bar = printer.progress("fit", bytes);
        let progress = |bytes| bar.set_position(bytes);
        let read = ReadOptions {
            checksum: self.args.keeps(),
            progress: Some(&progress),
            ..self.args.mapping.read_options()
        };
        let asked = (&self.options, self.args.report.is_some());
        let (mut data, hung) = match &self.loads {
            None => (FitData::read(&self.train, &self.test, asked, &read)?, None),
            Some(table) => {
                let (mut data, hung) = HungReference::read(&self.train, table, &read)?;
                data.read_tests(&self.test, asked, &read)?;
                (data, Some(hung))
            }
        };
        bar.finish_and_clear();
        let folds = OnceLock::<ProgressBar>::new();
        let told = |done: usize, of: usize| {
            let bar = folds.get_or_init(|| printer.count("folds of the physics model", of as u64));
            bar.set_position(done as u64);
        };
        let workers = Workers { folds: Some(&told), ..self.options.workers };
        let stated_loads = hung.as_ref().map(|hung| &hung.judged_by);
        let options = FitOptions { workers, stated_loads, ..self.options };
        let fitted = data.fit(&options);
        folds.get().into_iter().for_each(ProgressBar::finish_and_clear);
        let fitted = fitted.map_err(|error| {
            let (is_about_rows, error) = (error.is_about_rows(), anyhow::Error::new(error));
            match is_about_rows {
                // Those of the training logs.
                true => error.context(quoted(self.args.train.iter().map(|it| it.display()), ", ")),
                false => error,
            }
        })?;
        Ok((data, hung, fitted))
    }

    /// Names the outliers, and lists the rows that were left out.
    pub(super) fn name_rows(&mut self, data: &FitData, fitted: &Fit) -> anyhow::Result<NamedRows> {
        let output = self.dropped.take();
        let name = |found: &Outliers| NamedOutliers::new(found.clone(), &self.train, &data.train);
        let dropped = output.is_some().then(|| name(&fitted.dropped));
        if let (Some(rows), Some(mut output)) = (&dropped, output) {
            rows.write(&mut output)?;
            output.commit()?;
        }
        let used = fitted.outliers.as_ref().and_then(|found| found.as_ref().ok());
        Ok(NamedRows { used: used.map(name), dropped })
    }

    /// Says what is to be known of a fit beside its figures.
    pub(super) fn tell(&self, fitted: &Fit, named: &NamedRows, printer: &Printer) {
        if let (Some(dropped), Some(path)) = (&named.dropped, &self.args.dropped) {
            printer.remarks(dropped.remarks());
            let (rows, path) = (dropped.count(), path.display());
            printer.note(format!("left out {rows} rows, listed in `{path}`"));
        }
        printer.remarks(about_fit(fitted));
        if let Some(used) = &named.used {
            printer.remarks(used.remarks());
            if used.count() > 0 {
                printer.note(
                    "`--outliers drop --dropped FILE.csv` fits without them, `--outliers keep` does \
                     not look",
                );
            }
        }
    }

    /// The calibration file.
    pub(super) fn file(&self, data: &FitData, fitted: &Fit) -> anyhow::Result<CalibrationFile> {
        let sources = sources((&self.train, &self.test), data, fitted)?;
        Ok(calibration_file(fitted, self.args.origin(sources, &self.train)?))
    }

    /// What a report says of outliers: those that were left out, or were named.
    fn outlier_rows(&self, named: &NamedRows) -> Option<OutlierTable> {
        let NamedRows { used, dropped } = named;
        let dropped = dropped.as_ref().map(|dropped| dropped.rows(true));
        match self.args.outliers.unwrap_or(OutlierRule::Report) {
            OutlierRule::Keep => None,
            OutlierRule::Drop => dropped,
            OutlierRule::Report => dropped
                .filter(|dropped| dropped.count > 0)
                .or_else(|| used.as_ref().map(|used| used.rows(false)))
                .or_else(|| Some(OutlierTable::default())),
        }
    }

    /// Writes all files.
    pub(super) fn write(
        &mut self,
        file: &CalibrationFile,
        fitted: &Fit,
        named: &NamedRows,
    ) -> anyhow::Result<()> {
        if let Some(report) = self.report.take() {
            let output = self.args.output.as_ref();
            let name = output.map_or("not written", |path| path.to_str().unwrap_or("?"));
            let outliers = self.outlier_rows(named);
            let command = &outputs::command_line();
            let html = CalibrationReport { fit: fitted, file, name, command, outliers }.html()?;
            report.commit_with(html.as_bytes())?;
        }
        let output = self.calibration.take();
        output.map(|output| output.commit_with(file.to_json().as_bytes())).transpose()?;
        let axes = file.calibration.axes;
        if let Some((output, polynomial)) = self.matrix.take().zip(file.calibration.polynomial()) {
            output.commit_with(matrix::to_csv(polynomial, axes).as_bytes())?;
        }
        if let Some(plot) = self.plot.take() {
            let (train, test) = plots(fitted);
            let title = format!("Calibration {}", file.calibration.name());
            plot.draw(|size| fit_figure(size, &title, axes, &train, test.as_ref()))?;
        }
        Ok(())
    }
}

impl FitArgs {
    /// Whether the arguments go together.
    fn check(&self) -> anyhow::Result<()> {
        let is_physics = self.model() == ModelRule::Physics;
        anyhow::ensure!(
            self.truncate.is_none() || self.solver == SolverKind::Svd,
            "`--truncate` is for `--solver svd`"
        );
        anyhow::ensure!(
            self.ridge == 0.0 || self.solver != SolverKind::RidgeGcv,
            "`--solver ridge-gcv` finds the parameter itself: leave out `--ridge`"
        );
        anyhow::ensure!(
            self.loads.is_none() || self.model.is_none_or(|model| model == ModelRule::Physics),
            "loads of `--loads` are found with the physics model: leave out `--model`"
        );
        anyhow::ensure!(
            !self.means || !is_physics,
            "`--model physics` is fitted to means of stretches of rows of its own: leave out `--means`"
        );
        self.check_dropped()?;
        if let Some(option) = self.polynomials_only().filter(|_| is_physics) {
            anyhow::bail!("`{option}` is for polynomials in the readings");
        }
        Ok(())
    }

    /// What a calibration file says of where it comes from.
    pub(super) fn origin(&self, sources: Vec<SourceFile>, train: &[Log]) -> anyhow::Result<Origin> {
        Ok(Origin {
            made_by: shellcal::PROGRAM.to_owned(),
            date: outputs::date()?,
            sensor_serial: self.serial.clone(),
            sources,
            columns: self.mapping.specified(train),
            ..Origin::default()
        })
    }

    /// Whether rows that are left out are listed.
    pub(super) fn check_dropped(&self) -> anyhow::Result<()> {
        let drops = self.outliers == Some(OutlierRule::Drop) || self.valid_range.is_some();
        anyhow::ensure!(
            !drops || self.dropped.is_some(),
            "rows are not left out without a list of them: name a file with `--dropped FILE.csv`"
        );
        anyhow::ensure!(
            drops || self.dropped.is_none(),
            "`--dropped` lists the rows that `--outliers drop` or `--valid-range` leave out: give one"
        );
        Ok(())
    }

    fn model(&self) -> ModelRule {
        if self.loads.is_some() {
            return ModelRule::Physics;
        }
        self.model.unwrap_or(ModelRule::Auto)
    }

    /// What was asked for that polynomials alone have.
    fn polynomials_only(&self) -> Option<&'static str> {
        let asked = [
            (self.export_matrix.is_some(), "--export-matrix"),
            (self.ridge > 0.0, "--ridge"),
            (self.solver != SolverKind::Exact, "--solver"),
            (self.no_intercept, "--no-intercept"),
        ];
        asked.into_iter().find_map(|(given, option)| given.then_some(option))
    }

    /// What is done about lag and memory.
    fn dynamics(&self, has_time: bool) -> DynamicsRule<'_> {
        let default = match self.means {
            true => DynamicsRule::NOTHING,
            false => self.model().usual_dynamics(),
        };
        DynamicsRule {
            lag: match self.lag {
                None => default.lag,
                Some(LagRule::Given(by_ms)) if has_time => LagRule::Given(by_ms / 1e3),
                Some(lag) => lag,
            },
            memory: match &self.memory_terms {
                // A matrix has none.
                None if self.export_matrix.is_some() => MemoryRule::Given(&[]),
                None => default.memory,
                Some(MemoryArg::Auto) => MemoryRule::Auto,
                Some(MemoryArg::Given(times)) => MemoryRule::Given(times),
            },
            in_groups: self.lag == Some(LagRule::Auto)
                || matches!(self.memory_terms, Some(MemoryArg::Auto)),
        }
    }

    fn options(&self, has_time: bool) -> FitOptions<'_> {
        FitOptions {
            dynamics: self.dynamics(has_time),
            model: self.model(),
            intercept: !self.no_intercept,
            ridge: self.ridge,
            solver: self.solver,
            truncate: self.truncate,
            cross_validation: self.cv.or(self.loads.as_ref().map(|_| HeldOut::Column)),
            seed: self.cv_seed,
            // A covariance is of use in a calibration file, and for the verdict on a model that is judged.
            covariance: match self.covariance {
                CovarianceRule::Auto | CovarianceRule::Rows if !self.keeps() && !self.judges() => {
                    CovarianceRule::Nothing
                }
                asked => asked,
            },
            means: self.means,
            fresh: self.fresh,
            valid_range: self.valid_range,
            outliers: self.outliers.unwrap_or(OutlierRule::Report),
            polynomials_only: self.polynomials_only(),
            stated_loads: None,
            workers: Workers::new(self.mapping.threads.map_or(0, usize::from)),
        }
    }

    /// Whether errors on held-out groups are found.
    fn judges(&self) -> bool {
        self.cv.is_some() || self.model() == ModelRule::Auto
    }

    /// Whether what is found is kept, and not only printed.
    pub(super) fn keeps(&self) -> bool {
        self.output.is_some() || self.report.is_some()
    }
}
