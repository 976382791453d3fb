//! The fit: all arguments are checked and all files are opened before the work begins.

use std::sync::OnceLock;
use std::time::Instant;

use calibration::dynamics::DynamicsRule;
use calibration::fit::{CovarianceRule, Fit, FitOptions, HeldOut, ModelRule, OutlierRule, Workers};
use calibration::solver::SolverKind;
use calibration_file::{Origin, matrix};
use figures::fit_figure;
use indicatif::ProgressBar;
use load_table::HungLoads;
use log_file::{Log, ReadOptions};
use report::plots;
use shell_data::hint::quoted;
use shell_data::wrench::Axes;
use shellcal::workflow::agree_on_axes;
use shellcal::workflow::fit::{FitData, FittedLogs};
use shellcal::workflow::gates::Gate;
use shellcal::workflow::hung_loads::HungReference;
use shellcal::workflow::remark::Remark;

use super::super::mapping::{cut_off, open_logs, replaced_wrench};
use super::super::outputs;
use super::super::plan::read_table;
use super::super::quality::print_screen;
use super::report::report;
use super::stages::StageTimes;
use super::{FitArgs, SearchArg, hung_loads};
use crate::printer::{Outcome, Printer};

impl FitArgs {
    pub(super) fn fit(&self, printer: &Printer) -> anyhow::Result<Outcome> {
        let (start, stages) = (Instant::now(), StageTimes::new("opening the files"));
        self.check()?;
        let mapping = self.mapping.mapping();
        let train =
            open_logs(&self.train, ("--wrench-from", &self.companions.wrench_from), &mapping)?;
        let wrenches = ("--test-wrench-from", self.test_wrench_from.as_slice());
        let mut test = open_logs(&self.test, wrenches, &mapping)?;
        let logs = || train.iter().chain(&test);
        logs().filter_map(cut_off).for_each(|said| printer.warning(said));
        logs().filter_map(replaced_wrench).for_each(|said| printer.warning(said));
        let loads = self.loads.as_ref().map(read_table).transpose()?;
        let excluded = &self.mapping.exclude_group;
        let loads = loads.map(|table| table.without(excluded));
        match loads {
            None => {
                agree_on_axes(&train, &mut test)?;
            }
            Some(_) => test.iter_mut().try_for_each(|log| log.keep_axes(Axes::ALL))?,
        }
        let dropped_file = printer.create(self.dropped.as_ref())?;
        let calibration_file = printer.create(self.output.as_ref())?;
        let matrix_file = printer.create(self.export_matrix.as_ref())?;
        let plot = self.figure.create(printer)?;
        let report_file = printer.create(self.report.as_ref())?;

        let (data, hung, fitted) =
            self.fit_logs((&train, &test), loads.as_ref(), &stages, printer)?;
        stages.start("verdict and files");
        let mut gate = hung.as_ref().map_or_else(Gate::default, |hung| hung.gate.clone());
        self.ask_errors(&fitted, &mut gate);
        let mut outcome = printer.judge(&gate);
        if self.strict && !fitted.verdict().is_ok() {
            printer.warning("`--strict`: the verdict is not OK");
            outcome = printer.decide(false);
        }
        let origin = (self.origin(&train)?, self.outlier_rule());
        let fitted = FittedLogs::new(fitted, (&train, &test), &data, origin)?;
        let file = &fitted.file;

        if let Some(mut output) = dropped_file {
            fitted.dropped.write(&mut output)?;
            output.commit()?;
        }
        if let Some(output) = report_file {
            let path = self.output.as_ref();
            let name = path.map_or("not written", |path| path.to_str().unwrap_or("?"));
            let report = fitted.report(name, &outputs::command_line())?;
            output.commit_with(report.as_bytes())?;
        }
        calibration_file.map(|it| it.commit_with(file.to_json().as_bytes())).transpose()?;
        let axes = file.calibration.axes;
        if let Some((output, polynomial)) = matrix_file.zip(file.calibration.polynomial()) {
            output.commit_with(matrix::to_csv(polynomial, axes).as_bytes())?;
        }
        if let Some(plot) = plot {
            let (train, test) = plots(&fitted.fit);
            let title = format!("Calibration {}", file.calibration.name());
            plot.draw(|size| fit_figure(size, &title, axes, &train, test.as_ref()))?;
        }

        if !printer.json() {
            self.print_screen(&fitted.fit, &gate, printer);
        }
        self.tell(&fitted, printer);
        let seconds = start.elapsed().as_secs_f64();
        if printer.json() || printer.is_verbose() {
            report(printer, &fitted, hung.as_ref(), self.dropped.is_some(), seconds)?;
        }
        stages.lines().into_iter().for_each(|line| printer.detail(line));
        if let Some(hung) = &hung {
            hung_loads::tell(hung, printer);
            if !fitted.fit.verdict().is_ok() {
                let wrong = hung.wrong_load(self.options(false).workers);
                wrong.into_iter().for_each(|wrong| printer.warning(wrong.to_string()));
            }
        }
        Ok(outcome)
    }

    fn print_screen(&self, fitted: &Fit, gate: &Gate, printer: &Printer) {
        let written = [&self.output, &self.report, &self.export_matrix, &self.dropped];
        let figure = self.figure.plot.as_ref();
        let written = written.into_iter().flatten().chain(figure);
        let files: Vec<String> = written.map(|path| path.display().to_string()).collect();
        let files = match &files[..] {
            [] => "nothing saved: give -o FILE".to_owned(),
            files => files.join(", "),
        };
        print_screen(printer, &fitted.verdict().screen(&files), gate);
    }

    fn fit_logs(
        &self,
        (train, test): (&[Log], &[Log]),
        loads: Option<&HungLoads>,
        stages: &StageTimes,
        printer: &Printer,
    ) -> anyhow::Result<(FitData, Option<HungReference>, Fit)> {
        stages.start("reading the rows");
        let bytes = train.iter().chain(test).map(Log::bytes).sum();
        let bar = printer.progress("fit", bytes);
        let progress = |bytes| bar.set_position(bytes);
        let read = ReadOptions {
            checksum: self.keeps(),
            progress: Some(&progress),
            ..self.mapping.read_options()
        };
        let options = self.options(train.iter().all(Log::has_time));
        let asked = (&options, self.report.is_some());
        let (mut data, hung) = match loads {
            None => (FitData::read(train, test, asked, &read)?, None),
            Some(table) => {
                let (mut data, hung) = HungReference::read(train, table, &read)?;
                hung_loads::tell_repeated(&hung, printer);
                data.read_tests(test, &options, &read)?;
                (data, Some(hung))
            }
        };
        bar.finish_and_clear();
        let status = printer.status();
        let folds = OnceLock::<ProgressBar>::new();
        let told = |done: usize, of: usize| {
            let bar = folds.get_or_init(|| {
                status.finish_and_clear();
                printer.count("folds of the physics model", of as u64)
            });
            bar.set_position(done as u64);
        };
        let started = |stage: &'static str| {
            status.set_message(stage);
            stages.start(stage);
        };
        started("checks of the rows");
        let workers = Workers { folds: Some(&told), stages: Some(&started), ..options.workers };
        let stated_loads = hung.as_ref().map(|hung| &hung.judged_by);
        let options = FitOptions { workers, stated_loads, ..options };
        let fitted = data.fit(&options).map_err(|error| {
            let (is_about_rows, error) = (error.is_about_rows(), anyhow::Error::new(error));
            match is_about_rows {
                true => error.context(quoted(self.train.iter().map(|it| it.display()), ", ")),
                false => error,
            }
        })?;
        status.finish_and_clear();
        Ok((data, hung, fitted))
    }

    fn tell(&self, fitted: &FittedLogs, printer: &Printer) {
        if let Some(path) = &self.dropped {
            printer.remarks(fitted.dropped.remarks());
            let (rows, path) = (fitted.dropped.count(), path.display());
            printer.note(format!("left out {rows} rows, listed in `{path}`"));
        }
        for remark in fitted.remarks() {
            match remark {
                Remark::Note(text) => printer.detail(text),
                Remark::Warning(text) => printer.warning(text),
            }
        }
        if fitted.used.as_ref().is_some_and(|used| used.count() > 0) {
            printer.note(
                "`--outliers drop --dropped FILE.csv` fits without them, `--outliers keep` does \
                 not look",
            );
        }
    }

    fn outlier_rule(&self) -> OutlierRule {
        self.outliers.unwrap_or(OutlierRule::Report)
    }

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
            "`--model physics` computes its own means: leave out `--means`"
        );
        self.check_dropped()?;
        if let Some(option) = self.polynomials_only().filter(|_| is_physics) {
            anyhow::bail!("`{option}` is for polynomials in the readings");
        }
        Ok(())
    }

    pub(super) fn origin(&self, train: &[Log]) -> anyhow::Result<Origin> {
        Ok(Origin {
            made_by: shellcal::PROGRAM.to_owned(),
            date: outputs::date()?,
            sensor_serial: self.serial.clone(),
            columns: self.mapping.specified(train),
            ..Origin::default()
        })
    }

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

    fn polynomials_only(&self) -> Option<&'static str> {
        let asked = [
            (self.export_matrix.is_some(), "--export-matrix"),
            (self.ridge > 0.0, "--ridge"),
            (self.solver != SolverKind::Exact, "--solver"),
            (self.no_intercept, "--no-intercept"),
        ];
        asked.into_iter().find_map(|(given, option)| given.then_some(option))
    }

    fn dynamics(&self, has_time: bool) -> DynamicsRule<'_> {
        let default = match self.means {
            true => DynamicsRule::NOTHING,
            false => self.model().usual_dynamics(),
        };
        DynamicsRule {
            lag: match self.lag {
                None => default.lag,
                Some(SearchArg::Auto) => None,
                Some(SearchArg::Given(by)) => Some(if has_time { by / 1e3 } else { by }),
            },
            memory: match &self.memory_terms {
                // A matrix has no memory terms.
                None if self.export_matrix.is_some() => Some(&[]),
                None => default.memory,
                Some(SearchArg::Auto) => None,
                Some(SearchArg::Given(times)) => Some(times),
            },
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
            // A covariance is needed only for a calibration file, and for the verdict on a cross-validated model.
            covariance: match self.covariance {
                CovarianceRule::Auto | CovarianceRule::Rows if !self.keeps() && !self.judges() => {
                    CovarianceRule::Nothing
                }
                asked => asked,
            },
            means: self.means,
            fresh: self.fresh,
            valid_range: self.valid_range,
            outliers: self.outlier_rule(),
            polynomials_only: self.polynomials_only(),
            stated_loads: None,
            workers: Workers::new(self.mapping.threads.map_or(0, usize::from)),
            ..FitOptions::default()
        }
    }

    fn judges(&self) -> bool {
        self.cv.is_some() || self.model() == ModelRule::Auto
    }

    pub(super) fn keeps(&self) -> bool {
        self.output.is_some() || self.report.is_some()
    }
}
