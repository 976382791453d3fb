//! `shellcal fit`: from training logs to a calibration.

use std::io::Write;
use std::path::PathBuf;
use std::time::Instant;

use anyhow::Context;
use clap::ValueEnum;
use serde::Serialize;
use shellcal::calibration::quality::AxisQuality;
use shellcal::calibration::solver::SolverKind;
use shellcal::calibration::validation::cross_validation::{CrossValidation, cross_validate};
use shellcal::calibration::validation::excitation::Excitation;
use shellcal::calibration::validation::selection::{self, Selection};
use shellcal::calibration::{Basis, Model};
use shellcal::calibration_file::{
    CalibrationFile, Diagnostics, Origin, PartialFit, Role, SolverRecord, Source, matrix,
};
use shellcal::log_file::{Log, ReadOptions};
use shellcal::output::AtomicFile;
use shellcal::plot::{Format, fit_figure};
use shellcal::workflow::WorkflowError;
use shellcal::workflow::eval::Evaluation;
use shellcal::workflow::fit::{self, Fit, FitOptions};
use shellcal::workflow::moments::{self, GroupBy, SumOptions};
use shellcal::wrench::{Axis, PerAxis};

use super::mapping::MappingArgs;
use super::quality::{significant, table_row};
use super::validation::{
    CvArg, ModelChoice, parse_cv, print_cross_validation, print_excitation, print_selection,
};
use super::{Outcome, origin};
use crate::printer::Printer;

const EXAMPLES: &str = "\
Examples:
  shellcal fit train.csv --test test.csv -o calibration.json --plot fit.svg
  shellcal fit monday.csv tuesday.csv --model quadratic --json
  shellcal fit log.txt --sensors S1,S2,S3,S4 --wrench 10-15 --moment-unit mNm";

/// Fit a calibration to logs with readings and a measured wrench
///
/// Prints the error of every axis, on the training logs and on test logs that the fit has not
/// seen. Rows are read twice, never held: memory does not grow with the logs.
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct FitArgs {
    /// Logs to fit to
    #[arg(required = true, value_name = "TRAIN")]
    train: Vec<PathBuf>,

    /// Logs to test on
    #[arg(long, value_name = "TEST", num_args = 1..)]
    test: Vec<PathBuf>,

    /// Features of the readings
    #[arg(long, value_name = "MODEL", default_value = "cubic")]
    model: ModelChoice,

    /// Fit no constant: offsets are then left to the tare
    #[arg(long)]
    no_intercept: bool,

    /// Penalise large coefficients: λ, relative to features of norm one, such as 1e-6
    #[arg(long, value_name = "LAMBDA", default_value_t = 0.0, hide_default_value = true)]
    ridge: f64,

    /// How to solve the least-squares problem
    #[arg(long, value_name = "SOLVER", default_value = "exact")]
    solver: SolverArg,

    /// Leave out rows that repeat the readings of the row before
    #[arg(long)]
    fresh: bool,

    /// Write the calibration (JSON)
    #[arg(long, short, value_name = "CAL.json")]
    output: Option<PathBuf>,

    /// Find the errors on groups of rows that were held out: each group of the group column, or
    /// each file; a number K deals the groups into K folds
    #[arg(
        long,
        value_name = "file|column|K",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "auto",
        value_parser = parse_cv
    )]
    cv: Option<CvArg>,

    /// Which way rows are dealt into the random folds that `--cv` compares with
    #[arg(long, value_name = "N", default_value_t = 1, requires = "cv")]
    cv_seed: u64,

    /// Sum the rows, write the sums for `shellcal merge`, and fit nothing (JSON)
    #[arg(
        long,
        value_name = "FILE.json",
        conflicts_with_all = ["test", "output", "export_matrix", "plot", "ridge", "solver", "cv"]
    )]
    partial: Option<PathBuf>,

    /// Write the coefficients for raw readings, one row per feature, moments in mN·m (CSV)
    #[arg(long, value_name = "FILE.csv")]
    export_matrix: Option<PathBuf>,

    /// Draw predicted against measured, and the residuals
    #[arg(long, value_name = "FILE.svg|png")]
    plot: Option<PathBuf>,

    /// Leave the covariance out of the calibration: smaller, but without standard errors
    #[arg(long)]
    no_covariance: bool,

    /// The label of the sensor, for the calibration file
    #[arg(long, value_name = "SERIAL")]
    serial: Option<String>,

    #[command(flatten)]
    mapping: MappingArgs,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub(super) enum ModelArg {
    /// Each reading
    Linear,
    /// Each reading, its square and its cube
    Cubic,
    /// Products of up to two readings
    Quadratic,
    /// Products of up to three readings
    Poly3,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub(super) enum SolverArg {
    /// Exact sums of integer readings; `refined-tsqr` where readings are not integers
    Exact,
    /// Householder QR over row blocks
    Tsqr,
    /// The same, corrected by residuals in double-double
    RefinedTsqr,
    /// QR with column pivoting
    PivotedQr,
    /// Singular values
    Svd,
    /// Normal equations in double precision: fast and coarse
    Gram,
    /// Normal equations in double-double
    WideGram,
    /// Householder QR in double-double: slow and sure
    WideTsqr,
    /// Ridge, its parameter chosen by generalised cross-validation
    RidgeGcv,
    /// Huber's M-estimator: rows far off count less
    Huber,
}

/// The model that is fitted, and what is known of it before.
struct Choice {
    basis: Basis,
    ridge: f64,
    selection: Option<Selection>,
    cross_validation: Option<CrossValidation>,
}

/// Folds of the random split that `--cv` compares with, where it does not say how many.
const RANDOM_FOLDS: usize = 10;

/// The files that are written, opened before the work.
struct Outputs {
    calibration: Option<AtomicFile>,
    matrix: Option<AtomicFile>,
    plot: Option<(AtomicFile, Format)>,
}

impl FitArgs {
    pub(crate) fn run(&self, printer: &mut Printer) -> anyhow::Result<Outcome> {
        let start = Instant::now();
        let mapping = self.mapping.mapping()?;
        let open = |path: &PathBuf| Log::open(path, &mapping);
        let train = self.train.iter().map(open).collect::<Result<Vec<_>, _>>()?;
        if let Some(path) = &self.partial {
            self.write_partial(path, &train, printer)?;
            return Ok(Outcome::Done);
        }
        let test = self.test.iter().map(open).collect::<Result<Vec<_>, _>>()?;
        let outputs = self.open_outputs()?;

        let choice = self.choose(&train, printer)?;
        let bar = printer.progress("fit", fit::bytes_to_read(&train, &test));
        let progress = |bytes| bar.set_position(bytes);
        let read = ReadOptions {
            checksum: self.output.is_some(),
            progress: Some(&progress),
            ..self.mapping.read_options()
        };
        let fitted = fit::fit(&train, &test, &self.options(read, &choice))
            .map_err(|error| self.name_logs(error))?;
        bar.finish_and_clear();

        if let Some(reason) = &fitted.not_exact {
            printer.warning(format!("not solved exactly but by refined QR: {reason}"));
        }
        let file = self.calibration_file(&fitted, choice)?;
        self.write(outputs, &file, &fitted)?;
        let seconds = start.elapsed().as_secs_f64();
        report(printer, &fitted, &file, seconds)?;
        Ok(Outcome::Done)
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

    fn write_partial(
        &self,
        path: &PathBuf,
        train: &[Log],
        printer: &mut Printer,
    ) -> anyhow::Result<()> {
        let ModelChoice::Given(model) = self.model else {
            anyhow::bail!("`--partial` needs one model, not `--model auto`");
        };
        let basis = model.into();
        let mut output = AtomicFile::create(path)?;
        let options = SumOptions {
            basis,
            group_by: GroupBy::File,
            random_folds: 0,
            seed: 0,
            fresh: self.fresh,
            read: ReadOptions { checksum: true, ..self.mapping.read_options() },
        };
        let (sums, summaries) = moments::sum(train, &options)?;
        let total = sums.total()?.context("no training rows are left")?;
        let model = Model { basis, intercept: !self.no_intercept, channels: total.channels() };
        let mut partial = PartialFit::new(model, total);
        partial.made_by = origin::program();
        partial.date = origin::date()?;
        for (log, summary) in train.iter().zip(&summaries) {
            partial.skipped_rows += summary.skipped_rows;
            partial.repeated_rows += summary.repeated_rows;
            let rows = if self.fresh { summary.rows - summary.repeated_rows } else { summary.rows };
            let checksum = summary.checksum.clone();
            partial.sources.push(Source {
                role: Role::Train,
                path: log.path().into(),
                checksum,
                rows,
            });
        }
        output.write_all(partial.to_json().as_bytes())?;
        output.commit()?;
        let rows = partial.moments.rows();
        if printer.json() {
            return printer.document(&serde_json::json!({ "model": model.name(), "rows": rows }));
        }
        printer.line(format!("{}: sums over {rows} rows of {} files", model.name(), train.len()))
    }

    /// Chooses the model and validates it, where that is asked for: one more pass over the logs.
    fn choose(&self, train: &[Log], printer: &mut Printer) -> anyhow::Result<Choice> {
        let given = match self.model {
            ModelChoice::Given(model) => Some(Basis::from(model)),
            ModelChoice::Auto => None,
        };
        let mut choice = Choice {
            basis: given.unwrap_or(Basis::Poly3),
            ridge: self.ridge,
            selection: None,
            cross_validation: None,
        };
        if given.is_some() && self.cv.is_none() {
            return Ok(choice);
        }
        let (group_by, folds) = match self.cv {
            Some(CvArg::File) => (Some(GroupBy::File), None),
            Some(CvArg::Column) => (Some(GroupBy::Column), None),
            Some(CvArg::Folds(folds)) => (moments::group_by(train), Some(folds)),
            Some(CvArg::Auto) | None => (moments::group_by(train), None),
        };
        let group_by = group_by.context(
            "there is nothing to hold out: give several logs, or logs with a group column \
             (`--group`)",
        )?;
        let bytes = train.iter().map(Log::bytes).sum();
        let bar = printer.progress("groups", bytes);
        let progress = |bytes| bar.set_position(bytes);
        let options = SumOptions {
            basis: choice.basis,
            group_by,
            random_folds: self.cv.map_or(0, |_| folds.unwrap_or(RANDOM_FOLDS)),
            seed: self.cv_seed,
            fresh: self.fresh,
            read: ReadOptions { progress: Some(&progress), ..self.mapping.read_options() },
        };
        let (sums, _) = moments::sum(train, &options)?;
        bar.finish_and_clear();
        let intercept = !self.no_intercept;
        if given.is_none() {
            let ridges = if self.ridge > 0.0 { &[self.ridge][..] } else { &selection::RIDGES };
            let selection = selection::select(&sums, intercept, ridges)?;
            let chosen = &selection.candidates[selection.chosen];
            (choice.basis, choice.ridge) = (chosen.basis, chosen.ridge);
            choice.selection = Some(selection);
        }
        if self.cv.is_some() {
            let channels = train.first().map_or(0, Log::channels);
            let model = Model { basis: choice.basis, intercept, channels };
            choice.cross_validation = Some(cross_validate(&sums, &model, choice.ridge, folds)?);
        }
        Ok(choice)
    }

    fn options<'a>(&self, read: ReadOptions<'a>, choice: &Choice) -> FitOptions<'a> {
        FitOptions {
            basis: choice.basis,
            intercept: !self.no_intercept,
            solver: self.solver.into(),
            ridge: choice.ridge,
            fresh: self.fresh,
            plot: self.plot.is_some(),
            read,
        }
    }

    fn open_outputs(&self) -> anyhow::Result<Outputs> {
        let open = |path: &Option<PathBuf>| path.as_ref().map(AtomicFile::create).transpose();
        let format = self.plot.as_ref().map(Format::of).transpose()?;
        Ok(Outputs {
            calibration: open(&self.output)?,
            matrix: open(&self.export_matrix)?,
            plot: open(&self.plot)?.zip(format),
        })
    }

    fn calibration_file(&self, fitted: &Fit, choice: Choice) -> anyhow::Result<CalibrationFile> {
        let (train, test) = (total(&fitted.train), total(&fitted.test));
        let mut calibration = fitted.calibration.clone();
        if self.no_covariance {
            calibration.covariance = None;
        }
        let sources = |role, paths: &[PathBuf], evaluations: &[Evaluation]| -> Vec<Source> {
            let source = |(path, evaluation): (&PathBuf, &Evaluation)| Source {
                role,
                path: path.clone(),
                checksum: evaluation.checksum.clone(),
                rows: evaluation.rows,
            };
            std::iter::zip(paths, evaluations).map(source).collect()
        };
        let mut files = sources(Role::Train, &self.train, &fitted.train);
        files.extend(sources(Role::Test, &self.test, &fitted.test));
        let condition = fitted.solution.condition;
        Ok(CalibrationFile {
            calibration,
            origin: Origin {
                made_by: origin::program(),
                date: origin::date()?,
                sensor_serial: self.serial.clone(),
                solver: Some(SolverRecord { name: fitted.solver, ridge: choice.ridge }),
                diagnostics: Some(Diagnostics {
                    rows: fitted.solution.rows,
                    skipped_rows: train.skipped_rows,
                    repeated_rows: train.repeated_rows,
                    rank: fitted.solution.rank,
                    condition: condition.is_finite().then_some(condition),
                    train: train.quality().context("no training rows are left")?,
                    test: test.quality(),
                    cross_validation: choice.cross_validation,
                    selection: choice.selection,
                    excitation: fitted.loads.excitation(),
                }),
                sources: files,
            },
        })
    }

    fn write(&self, outputs: Outputs, file: &CalibrationFile, fitted: &Fit) -> anyhow::Result<()> {
        if let Some(mut output) = outputs.calibration {
            output.write_all(file.to_json().as_bytes())?;
            output.commit()?;
        }
        if let Some(mut output) = outputs.matrix {
            output.write_all(matrix::to_csv(&file.calibration).as_bytes())?;
            output.commit()?;
        }
        if let (Some((mut output, format)), Some((train, test))) = (outputs.plot, &fitted.plots) {
            let title = format!("Calibration {}", fitted.calibration.model().name());
            let test = (!fitted.test.is_empty()).then_some(test);
            output.write_all(&fit_figure(&title, train, test).render(format)?)?;
            output.commit()?;
        }
        Ok(())
    }
}

fn total(evaluations: &[Evaluation]) -> Evaluation {
    let mut total = Evaluation::default();
    evaluations.iter().for_each(|evaluation| total.merge(evaluation));
    total
}

/// What `--json` prints.
#[derive(Serialize)]
struct Report<'a> {
    model: String,
    solver: SolverRecord,
    rows: u64,
    skipped_rows: u64,
    repeated_rows: u64,
    test_rows: u64,
    test_rows_out_of_range: u64,
    features: usize,
    rank: usize,
    condition: Option<f64>,
    axes: PerAxis<&'static str>,
    train: &'a PerAxis<AxisQuality>,
    test: &'a Option<PerAxis<AxisQuality>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    cross_validation: &'a Option<CrossValidation>,
    #[serde(skip_serializing_if = "Option::is_none")]
    selection: &'a Option<Selection>,
    excitation: &'a Option<Excitation>,
    time_s: f64,
}

fn report(
    printer: &mut Printer,
    fitted: &Fit,
    file: &CalibrationFile,
    seconds: f64,
) -> anyhow::Result<()> {
    let test = total(&fitted.test);
    let (Some(diagnostics), Some(solver)) = (&file.origin.diagnostics, file.origin.solver) else {
        return Ok(());
    };
    let model = fitted.calibration.model();
    if printer.json() {
        return printer.document(&Report {
            model: model.name(),
            solver,
            rows: diagnostics.rows,
            skipped_rows: diagnostics.skipped_rows,
            repeated_rows: diagnostics.repeated_rows,
            test_rows: test.rows,
            test_rows_out_of_range: test.out_of_range_rows,
            features: model.term_count(),
            rank: diagnostics.rank,
            condition: diagnostics.condition,
            axes: Axis::ALL.map(Axis::column),
            train: &diagnostics.train,
            test: &diagnostics.test,
            cross_validation: &diagnostics.cross_validation,
            selection: &diagnostics.selection,
            excitation: &diagnostics.excitation,
            time_s: seconds,
        });
    }
    if let Some(selection) = &diagnostics.selection {
        print_selection(printer, selection)?;
    }
    let sets: Vec<&PerAxis<AxisQuality>> =
        [Some(&diagnostics.train), diagnostics.test.as_ref()].into_iter().flatten().collect();
    let mut header = vec!["axis"];
    for (train, test) in
        [("RMS train", "RMS test"), ("max train", "max test"), ("R² train", "R² test")]
    {
        header.extend([train, test].iter().take(sets.len()));
    }
    header.push("unit");
    let rows: Vec<Vec<String>> = Axis::ALL.map(|axis| table_row(axis, &sets)).to_vec();
    printer.table(&header, &rows)?;
    let condition = diagnostics.condition.map_or("infinite".into(), |c| significant(c, 3));
    printer.line(format!(
        "{}, solver {}: rank {} of {}, condition {condition}",
        model.name(),
        solver.name.name(),
        diagnostics.rank,
        model.term_count(),
    ))?;
    printer.line(format!(
        "{} rows used, {} skipped, {} repeated; {:.0} ms",
        diagnostics.rows,
        diagnostics.skipped_rows,
        diagnostics.repeated_rows,
        seconds * 1e3,
    ))?;
    if let Some(excitation) = &diagnostics.excitation {
        print_excitation(printer, excitation)?;
    }
    if let Some(cross_validation) = &diagnostics.cross_validation {
        print_cross_validation(printer, cross_validation)?;
    }
    if test.out_of_range_rows > 0 {
        printer.note(format!(
            "{} of {} test rows have a reading outside the range of the training data",
            test.out_of_range_rows, test.rows
        ));
    }
    Ok(())
}

impl From<ModelArg> for Basis {
    fn from(model: ModelArg) -> Self {
        match model {
            ModelArg::Linear => Basis::Linear,
            ModelArg::Cubic => Basis::Cubic,
            ModelArg::Quadratic => Basis::Quadratic,
            ModelArg::Poly3 => Basis::Poly3,
        }
    }
}

impl From<SolverArg> for SolverKind {
    fn from(solver: SolverArg) -> Self {
        match solver {
            SolverArg::Exact => SolverKind::Exact,
            SolverArg::Tsqr => SolverKind::Tsqr,
            SolverArg::RefinedTsqr => SolverKind::RefinedTsqr,
            SolverArg::PivotedQr => SolverKind::PivotedQr,
            SolverArg::Svd => SolverKind::Svd,
            SolverArg::Gram => SolverKind::Gram,
            SolverArg::WideGram => SolverKind::WideGram,
            SolverArg::WideTsqr => SolverKind::WideTsqr,
            SolverArg::RidgeGcv => SolverKind::RidgeGcv,
            SolverArg::Huber => SolverKind::Huber,
        }
    }
}
