//! `shellcal fit`: from training logs to a calibration.

mod choice;
mod html;
mod means;
mod outliers;
mod partial;
mod physics;
mod report;
mod weighing;

use std::io::Write;
use std::time::Instant;

use calibration::solver::SolverKind;
use calibration::validation::grouped::{GroupKind, GroupedMoments};
use calibration_file::{CalibrationFile, Diagnostics, Origin, Role, SolverRecord, Source, matrix};
use clap::ValueEnum;
use figures::{FitPlot, Format, fit_figure};
use log_file::{Log, ReadOptions};
use output_file::{AtomicFile, Outputs};
use shell_data::wrench::Axes;
use shellcal::workflow::eval::Evaluation;
use shellcal::workflow::fit::{self, BeyondMemory, Fit, FitOptions};
use shellcal::workflow::model_choice::{CovarianceRule, HeldOut, ModelChoice};
use shellcal::workflow::partial::KeptGroups;
use shellcal::workflow::selection::UsedRows;
use shellcal::workflow::weighing::Weighing;
use shellcal::workflow::{WorkflowError, agree_on_axes};

use self::html::{Found, intervals_of};
use self::outliers::{OutliersArg, parse_range};
use self::physics::Weighed;
use self::report::{Known, report};
use self::weighing::in_words;
use super::choices::{ModelArg, SolverArg};
use super::covariance::{CovarianceArg, warn_of_few_groups};
use super::figure_size::FigureSize;
use super::mapping::{MappingArgs, open_logs};
use super::origin;
use super::outliers::report as outlier_reports;
use super::validation::{advice_in_words, better_in_words, parse_cv};
use crate::files::{InputPath, OutputOrStdout, OutputPath};
use crate::outcome::Outcome;
use crate::printer::Printer;

const EXAMPLES: &str = "\
Examples:
  shellcal fit train.csv --test test.csv -o calibration.json --plot fit.svg
  shellcal fit monday.csv tuesday.csv --model quadratic --json
  shellcal fit log.txt --sensors S1,S2,S3,S4 --wrench 10-15 --moment-unit mNm";

#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
#[group(skip)]
#[command(group = clap::ArgGroup::new("held_out").args(["cv", "groups"]).multiple(true))]
pub(crate) struct FitArgs {
    /// Logs to fit to
    #[arg(required = true, value_name = "TRAIN")]
    train: Vec<InputPath>,

    /// Logs to test on
    #[arg(long, value_name = "TEST", num_args = 1..)]
    test: Vec<InputPath>,

    /// Take the wrench from these files, one for each training log, row by row
    #[arg(long, value_name = "FILE", num_args = 1.., help_heading = "Reading logs")]
    wrench_from: Vec<InputPath>,

    /// The same for each log to test on
    #[arg(long, value_name = "FILE", num_args = 1.., requires = "test", help_heading = "Reading logs")]
    test_wrench_from: Vec<InputPath>,

    /// Features of the readings
    #[arg(long, value_name = "MODEL", default_value = "cubic")]
    model: ModelArg,

    /// Fit no constant: offsets are then left to the tare
    #[arg(long)]
    no_intercept: bool,

    /// Penalise large coefficients: λ, relative to features of norm one, such as 1e-6
    #[arg(long, value_name = "LAMBDA", default_value_t = 0.0, hide_default_value = true)]
    ridge: f64,

    /// How to solve the least-squares problem
    #[arg(long, value_name = "SOLVER", default_value = "exact")]
    solver: SolverArg,

    /// With `--solver svd`: leave out directions that the data hardly excite, those whose singular
    /// value is below this share of the largest, such as 1e-8
    #[arg(long, value_name = "SHARE", value_parser = parse_share)]
    truncate: Option<f64>,

    /// Leave out rows that repeat the readings of the row before
    #[arg(long)]
    fresh: bool,

    /// Write the calibration (JSON)
    #[arg(long, short, value_name = "CAL.json")]
    output: Option<OutputPath>,

    /// Find the errors on groups of rows that were held out: each group of the group column, or
    /// each file, or each plateau of constant load; a number K deals the groups into K folds
    #[arg(
        long,
        value_name = "file|column|plateau|K",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "auto",
        value_parser = parse_cv
    )]
    cv: Option<HeldOut>,

    /// Fit to the mean of each group of rows, each counted once: the group column, files, or plateaus that are
    /// found. Test logs are compared row by row
    #[arg(long, conflicts_with_all = ["partial", "residuals"])]
    means: bool,

    /// Which way rows are dealt into the random folds that `--cv` compares with
    #[arg(long, value_name = "N", default_value_t = 1, requires = "held_out")]
    cv_seed: u64,

    /// Sum the rows, write the sums for `shellcal merge`, and fit nothing (JSON; `-` for the standard
    /// output)
    #[arg(
        long,
        value_name = "FILE.json",
        conflicts_with_all = ["test", "output", "export_matrix", "plot", "report", "ridge", "truncate", "cv", "dropped", "valid_range", "residuals"]
    )]
    partial: Option<OutputOrStdout>,

    /// With `--partial`: keep the sums of each group, so that `merge` can validate, choose a model and
    /// find standard errors by group
    #[arg(
        long,
        value_enum,
        value_name = "file|column",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "auto",
        hide_possible_values = true,
        requires = "partial"
    )]
    groups: Option<GroupsArg>,

    /// Write the coefficients for raw readings, one row per feature, moments in mN·m (CSV)
    #[arg(long, value_name = "FILE.csv")]
    export_matrix: Option<OutputPath>,

    /// Draw predicted against measured, and the residuals
    #[arg(long, value_name = "FILE.svg|pdf|png")]
    plot: Option<OutputPath>,

    #[command(flatten)]
    figure_size: FigureSize,

    /// Write a report: errors by axis and by pose, which loads were calibrated, which model and why, and what
    /// the calibration must not be used for
    #[arg(long, value_name = "FILE.html")]
    report: Option<OutputPath>,

    /// Which rows have errors of their own, for the standard errors and intervals of `convert`
    #[arg(long, value_name = "OF", default_value = "auto")]
    covariance: CovarianceArg,

    /// The label of the sensor, for the calibration file
    #[arg(long, value_name = "SERIAL")]
    serial: Option<String>,

    /// Rows that do not belong [default: report, in logs that fit into `--memory`]
    #[arg(long, value_name = "WHAT")]
    outliers: Option<OutliersArg>,

    /// Readings outside are wrong: leave out rows with any
    #[arg(long, value_name = "LO:HI", value_parser = parse_range, allow_hyphen_values = true)]
    valid_range: Option<[f64; 2]>,

    /// List the rows that `--outliers drop` and `--valid-range` leave out, and why (CSV)
    #[arg(long, value_name = "FILE.csv")]
    dropped: Option<OutputPath>,

    /// Memory that training rows may take. Logs whose rows take more are read once and forgotten: their errors
    /// come from sums, without the largest
    #[arg(long, value_name = "MB", default_value_t = fit::MEMORY / MEGABYTE)]
    memory: u64,

    /// Look at the error of every training row, also where that means reading logs beyond `--memory` twice:
    /// the largest errors, and rows that do not belong
    #[arg(long)]
    residuals: bool,

    #[command(flatten)]
    mapping: MappingArgs,
}

/// A megabyte, as `--memory` has it.
const MEGABYTE: u64 = 1_000_000;

/// The share of test rows on plateaus of the training data that is worth a word.
const MUCH_SHARED: f64 = 0.1;

/// What the groups are that a partial fit keeps.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum GroupsArg {
    /// Those of the group column where there is one, files otherwise
    Auto,
    /// Files
    File,
    /// Those of the group column
    Column,
}

impl GroupsArg {
    fn kept(self) -> KeptGroups {
        match self {
            Self::Auto => KeptGroups::Auto,
            Self::File => KeptGroups::By(GroupKind::File),
            Self::Column => KeptGroups::By(GroupKind::Column),
        }
    }
}

/// What is fitted to, and tested on.
struct Logs {
    train: Vec<Log>,
    test: Vec<Log>,
}

/// The files that are written, opened before the work.
struct Opened {
    calibration: Option<AtomicFile>,
    matrix: Option<AtomicFile>,
    plot: Option<(AtomicFile, Format)>,
    report: Option<AtomicFile>,
}

impl FitArgs {
    pub(crate) fn run(&self, printer: &mut Printer, outputs: &Outputs) -> anyhow::Result<Outcome> {
        let start = Instant::now();
        anyhow::ensure!(
            self.truncate.is_none() || self.solver.0 == SolverKind::Svd,
            "`--truncate` is for `--solver svd`"
        );
        anyhow::ensure!(
            self.ridge == 0.0 || self.solver.0 != SolverKind::RidgeGcv,
            "`--solver ridge-gcv` finds the parameter itself: leave out `--ridge`"
        );
        anyhow::ensure!(
            !self.means || !matches!(self.model, ModelArg::Physics),
            "`--model physics` is fitted to means of stretches of rows of its own: leave out `--means`"
        );
        let mapping = self.mapping.mapping()?;
        let train = open_logs(&self.train, ("--wrench-from", &self.wrench_from), &mapping)?;
        let dropped = self.drop_rows(&train, printer, outputs)?;
        let excluded = dropped.excluded();
        let used = UsedRows { fresh: self.fresh, excluded: Some(&excluded) };
        if let Some(path) = &self.partial {
            self.write_partial(path, train, printer, outputs)?;
            return Ok(Outcome::Done);
        }
        let wrenches = ("--test-wrench-from", self.test_wrench_from.as_slice());
        let mut test = open_logs(&self.test, wrenches, &mapping)?;
        let axes = agree_on_axes(&train, &mut test)?;
        note_axes(axes, printer);
        let opened = self.open_outputs(outputs)?;
        let specified = self.mapping.specified(&train)?;
        let means = self.means.then(|| self.reduce_to_means(&train, used, printer)).transpose()?;
        let (train, used, sources) = match means {
            Some((log, sources)) => (vec![log], UsedRows::default(), Some(sources)),
            None => (train, used, None),
        };
        if matches!(self.model, ModelArg::Physics) {
            let weighed = Weighed::default();
            self.run_physics(&Logs { train, test }, opened, weighed, used, start, printer)?;
            return Ok(Outcome::Done);
        }

        let choice = self.choose(&train, used, printer)?;
        let weighing = self.weigh_physics(&train, &choice, used, printer);
        if weighing.as_ref().is_some_and(Weighing::physics_is_better) {
            let weighed = Weighed { selection: choice.selection, weighing };
            self.run_physics(&Logs { train, test }, opened, weighed, used, start, printer)?;
            return Ok(Outcome::Done);
        }
        let options = self.options(ReadOptions::default(), used, &choice);
        let bar = printer.progress("fit", options.bytes_to_read(&train, &test));
        let progress = |bytes| bar.set_position(bytes);
        let read = ReadOptions {
            checksum: self.keeps(),
            progress: Some(&progress),
            ..self.mapping.read_options()
        };
        let fitted = fit::fit(&train, &test, &FitOptions { read, ..options })
            .map_err(|error| self.name_logs(error))?;
        bar.finish_and_clear();

        let left_out_residuals = self.tell_passes(&fitted, printer);
        if let Some(reason) = &fitted.not_exact {
            printer.warning(format!("not solved exactly but by refined QR: {reason}"));
        }
        if let Some(reason) = choice.not_grouped.as_ref().or(fitted.not_grouped.as_ref()) {
            self.covariance.tell_not_grouped(reason, printer)?;
        }
        if let Some(few) = &choice.few_groups {
            warn_of_few_groups(few, printer);
        }
        let left_out = fitted.solution.model.term_count() - fitted.solution.rank;
        if left_out > 0 {
            let s = if left_out > 1 { "s" } else { "" };
            printer.warning(format!(
                "left out {left_out} direction{s} in which the data hardly move the readings"
            ));
        }
        // A fit of as many coefficients as rows goes through every point, whatever they are.
        let (rows, rank) = (fitted.solution.rows, fitted.solution.rank as u64);
        if rows < 2 * rank {
            printer.warning(format!(
                "{rows} rows for {rank} coefficients: the errors on the training logs say little; \
                 record more poses or choose a smaller `--model`"
            ));
        }
        let named = fitted.stands_out.then(|| self.name_outliers(&train, printer)).flatten();
        if let Some(share) = fitted.on_plateaus.filter(|&share| share >= MUCH_SHARED) {
            printer.warning(format!(
                "{:.0} % of the test rows lie on plateaus of the training data, at the same loads with \
                 the same readings: the error on them is that of training, and flatters. `--cv` holds \
                 out whole plateaus",
                100.0 * share
            ));
        }
        let tested = total(&fitted.test);
        if tested.rows > 0 && tested.out_of_range_rows == tested.rows {
            printer.warning(format!(
                "none of the {} test rows lies within the range of the training data: their errors are of a \
                 guess beyond it. Was the sensor zeroed anew, or the columns taken in another order?",
                tested.rows
            ));
        }
        let known = Known {
            weighing: weighing.as_ref(),
            groups: choice.found_groups(),
            advice: choice.advice.clone(),
            outliers: named.as_ref().map(|named| outlier_reports(named, &train)),
            dropped: self.dropped.as_ref().map(|_| outlier_reports(&dropped, &train)),
            left_out_residuals,
        };
        let group_by = choice.group_by.clone();
        let few_groups = choice.few_groups;
        let mut file = self.calibration_file((&train, &test), &fitted, choice)?;
        file.origin.columns = specified;
        if let Some(sources) = sources {
            file.origin.sources.retain(|source| source.role != Role::Train);
            file.origin.sources.splice(..0, sources);
        }
        let html = self.report.as_ref().map(|_| {
            let model = fitted.solution.model;
            let axes = file.calibration.axes;
            let advice = known.advice.as_ref();
            let mut reasons: Vec<String> =
                advice.map(|of| advice_in_words(of, axes)).into_iter().collect();
            reasons.extend(weighing.as_ref().map(in_words));
            let found = Found {
                features: model.term_count(),
                intervals: fitted.calibration.covariance.as_ref().and_then(intervals_of),
                few_groups,
                reasons,
                warnings: advice
                    .and_then(|of| better_in_words(of, model.basis, axes))
                    .into_iter()
                    .collect(),
                outliers: self.outlier_rows(named.as_ref(), &dropped, &train),
                plots: fitted.plots.as_ref(),
                test: tested,
                group_by: group_by.as_ref(),
            };
            self.html(&file, found, (&train, &test), used)
        });
        self.write(opened, &file, fitted.plots.as_ref(), html.transpose()?.as_deref())?;
        report(printer, &fitted, &file, &known, start.elapsed().as_secs_f64())?;
        Ok(Outcome::Done)
    }

    /// Says how often logs beyond the memory were read; returns why there are no residuals, where there are none.
    fn tell_passes(&self, fitted: &Fit, printer: &mut Printer) -> Option<String> {
        let BeyondMemory { wanted, read_again } = fitted.beyond_memory?;
        let reason = format!(
            "the rows of the training logs would take about {} MB, and `--memory` allows {} MB",
            wanted.div_ceil(MEGABYTE),
            self.memory
        );
        if read_again {
            printer.detail(format!("the training logs were read twice: {reason}"));
            return None;
        }
        printer.note(format!(
            "the training logs were read once, without a look at the largest errors and for rows that do not \
             belong: {reason}. `--residuals` reads them twice"
        ));
        Some(reason)
    }

    fn memory_bytes(&self) -> u64 {
        self.memory.saturating_mul(MEGABYTE)
    }

    /// Says which rows do not determine a calibration.
    fn name_logs(&self, error: WorkflowError) -> anyhow::Error {
        let rows_fail = matches!(error, WorkflowError::Fit(_));
        let error = anyhow::Error::new(error);
        if !rows_fail {
            return error;
        }
        let logs: Vec<_> = self.train.iter().map(|path| format!("`{}`", path.display())).collect();
        error.context(logs.join(", "))
    }

    fn options<'a>(
        &self,
        read: ReadOptions<'a>,
        used: UsedRows<'a>,
        choice: &'a ModelChoice,
    ) -> FitOptions<'a> {
        FitOptions {
            basis: choice.basis,
            intercept: !self.no_intercept,
            solver: self.solver.0,
            ridge: choice.ridge,
            truncate: self.truncate,
            used,
            total: choice.sums.as_ref().and_then(GroupedMoments::total),
            covariance: choice.covariance_from(self.covariance_rule()),
            plot: self.draws(),
            facts: choice.facts.as_ref(),
            looks: self.looks_for_outliers(),
            residuals: self.residuals || self.outliers == Some(OutliersArg::Report),
            memory: self.memory_bytes(),
            read,
        }
    }

    /// A covariance is of use in a calibration file; one by groups is found for whoever asks for it.
    fn covariance_rule(&self) -> CovarianceRule {
        match self.covariance {
            CovarianceArg::Auto | CovarianceArg::Rows if !self.keeps() => CovarianceRule::Nothing,
            asked => asked.rule(),
        }
    }

    /// Whether what is found is kept, and not only printed.
    fn keeps(&self) -> bool {
        self.output.is_some() || self.report.is_some()
    }

    /// Whether a figure is drawn, by itself or in a report.
    fn draws(&self) -> bool {
        self.plot.is_some() || self.report.is_some()
    }

    fn open_outputs(&self, outputs: &Outputs) -> anyhow::Result<Opened> {
        let open =
            |path: &Option<OutputPath>| path.as_ref().map(|path| outputs.create(path)).transpose();
        let format = self.plot.as_ref().map(Format::of).transpose()?;
        Ok(Opened {
            calibration: open(&self.output)?,
            matrix: open(&self.export_matrix)?,
            plot: open(&self.plot)?.zip(format),
            report: open(&self.report)?,
        })
    }

    fn calibration_file(
        &self,
        logs: (&[Log], &[Log]),
        fitted: &Fit,
        choice: ModelChoice,
    ) -> anyhow::Result<CalibrationFile> {
        let (train, test) = (total(&fitted.train), total(&fitted.test));
        let condition = fitted.solution.condition;
        Ok(CalibrationFile {
            calibration: fitted.calibration.clone(),
            origin: Origin {
                made_by: origin::program(),
                date: origin::date()?,
                sensor_serial: self.serial.clone(),
                solver: Some(SolverRecord {
                    name: fitted.solver,
                    ridge: fitted.solution.ridge,
                    truncate: self.truncate,
                }),
                diagnostics: Some(Diagnostics {
                    rows: fitted.solution.rows,
                    skipped_rows: train.skipped_rows,
                    repeated_rows: train.repeated_rows,
                    rank: fitted.solution.rank,
                    condition: condition.is_finite().then_some(condition),
                    train: fitted.train_quality,
                    test: test.quality(),
                    cross_validation: choice.cross_validation,
                    selection: choice.selection,
                    excitation: fitted.loads.excitation(),
                }),
                sources: self.sources((logs.0, logs.1), (&fitted.train, &fitted.test))?,
                columns: None,
            },
        })
    }

    /// The files, with what their evaluations know of them.
    fn sources(
        &self,
        (train, test): (&[Log], &[Log]),
        evaluations: (&[Evaluation], &[Evaluation]),
    ) -> anyhow::Result<Vec<Source>> {
        let mut files = Vec::new();
        for (role, logs, evaluations) in
            [(Role::Train, train, evaluations.0), (Role::Test, test, evaluations.1)]
        {
            for (log, evaluation) in logs.iter().zip(evaluations) {
                let (checksum, rows) = (evaluation.checksum.clone(), evaluation.rows);
                let has_checksum = checksum.is_some();
                files.push(Source { role, path: log.path().into(), checksum, rows });
                if let Some(path) = log.beside() {
                    let checksum = if has_checksum { log.checksum_beside()? } else { None };
                    files.push(Source { role: Role::Wrench, path: path.into(), checksum, rows });
                }
            }
        }
        Ok(files)
    }

    fn write(
        &self,
        opened: Opened,
        file: &CalibrationFile,
        plots: Option<&(FitPlot, FitPlot)>,
        html: Option<&str>,
    ) -> anyhow::Result<()> {
        if let (Some(mut output), Some(html)) = (opened.report, html) {
            output.write_all(html.as_bytes())?;
            output.commit()?;
        }
        if let Some(mut output) = opened.calibration {
            output.write_all(file.to_json().as_bytes())?;
            output.commit()?;
        }
        if let (Some(mut output), Some(polynomial)) = (opened.matrix, file.calibration.polynomial())
        {
            output.write_all(matrix::to_csv(polynomial, file.calibration.axes).as_bytes())?;
            output.commit()?;
        }
        if let (Some((mut output, format)), Some((train, test))) = (opened.plot, plots) {
            let title = format!("Calibration {}", file.calibration.name());
            let test = (!self.test.is_empty()).then_some(test);
            let axes = file.calibration.axes;
            output.write_all(
                &fit_figure(self.figure_size.size(), &title, axes, train, test).render(format)?,
            )?;
            output.commit()?;
        }
        Ok(())
    }
}

fn parse_share(text: &str) -> Result<f64, String> {
    let share = text.parse().ok().filter(|share| (0.0..1.0).contains(share));
    share.ok_or_else(|| "a share from 0 to 1, such as 1e-8".to_owned())
}

/// Says which axes a calibration will not have.
fn note_axes(axes: Axes, printer: &mut Printer) {
    if !axes.are_all() {
        let absent = Axes::ALL.without(axes);
        printer.note(format!("the logs have no {absent}: the calibration is of {axes}"));
    }
}

fn total(evaluations: &[Evaluation]) -> Evaluation {
    let mut total = Evaluation::default();
    evaluations.iter().for_each(|evaluation| total.merge(evaluation));
    total
}
