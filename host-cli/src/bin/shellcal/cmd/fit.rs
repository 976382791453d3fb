//! `shellcal fit`: from training logs to a calibration.

use std::io::Write;
use std::path::PathBuf;
use std::time::Instant;

use anyhow::Context;
use clap::ValueEnum;
use serde::Serialize;
use shellcal::calibration::Basis;
use shellcal::calibration::quality::AxisQuality;
use shellcal::calibration::solver::SolverKind;
use shellcal::calibration_file::{
    CalibrationFile, Diagnostics, Origin, Role, SolverRecord, Source, matrix,
};
use shellcal::log_file::{Log, ReadOptions};
use shellcal::output::AtomicFile;
use shellcal::plot::{Format, fit_figure};
use shellcal::workflow::eval::Evaluation;
use shellcal::workflow::fit::{self, Fit, FitOptions};
use shellcal::wrench::{Axis, PerAxis};

use super::mapping::MappingArgs;
use super::quality::{significant, table_row};
use super::{Outcome, origin};
use crate::printer::Printer;

/// Fit a calibration to logs with readings and a measured wrench
///
/// Prints the error of every axis, on the training logs and on test logs that the fit has not
/// seen. Rows are read twice, never held: memory does not grow with the logs.
#[derive(Debug, clap::Args)]
pub(crate) struct FitArgs {
    /// Logs to fit to
    #[arg(required = true, value_name = "TRAIN")]
    train: Vec<PathBuf>,

    /// Logs to test on
    #[arg(long, value_name = "TEST", num_args = 1..)]
    test: Vec<PathBuf>,

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
    #[arg(long, value_name = "SOLVER", default_value = "tsqr")]
    solver: SolverArg,

    /// Leave out rows that repeat the readings of the row before
    #[arg(long)]
    fresh: bool,

    /// Write the calibration (JSON)
    #[arg(long, short, value_name = "CAL.json")]
    output: Option<PathBuf>,

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
enum ModelArg {
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
enum SolverArg {
    /// Householder QR over row blocks
    Tsqr,
}

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
        let test = self.test.iter().map(open).collect::<Result<Vec<_>, _>>()?;
        let outputs = self.open_outputs()?;

        let bar = printer.progress("fit", fit::bytes_to_read(&train, &test));
        let progress = |bytes| bar.set_position(bytes);
        let read = ReadOptions {
            checksum: self.output.is_some(),
            progress: Some(&progress),
            ..self.mapping.read_options()
        };
        let fitted = fit::fit(&train, &test, &self.options(read))?;
        bar.finish_and_clear();

        let file = self.calibration_file(&fitted)?;
        self.write(outputs, &file, &fitted)?;
        let seconds = start.elapsed().as_secs_f64();
        report(printer, &fitted, &file, seconds)?;
        Ok(Outcome::Done)
    }

    fn options<'a>(&self, read: ReadOptions<'a>) -> FitOptions<'a> {
        FitOptions {
            basis: self.model.into(),
            intercept: !self.no_intercept,
            solver: self.solver.into(),
            ridge: self.ridge,
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

    fn calibration_file(&self, fitted: &Fit) -> anyhow::Result<CalibrationFile> {
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
                solver: Some(SolverRecord { name: self.solver.into(), ridge: self.ridge }),
                diagnostics: Some(Diagnostics {
                    rows: fitted.solution.rows,
                    skipped_rows: train.skipped_rows,
                    repeated_rows: train.repeated_rows,
                    rank: fitted.solution.rank,
                    condition: condition.is_finite().then_some(condition),
                    train: train.quality().context("no training rows are left")?,
                    test: test.quality(),
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
            time_s: seconds,
        });
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
        "{}: rank {} of {}, condition {condition}; {} rows used, {} skipped, {} repeated; {} s",
        model.name(),
        diagnostics.rank,
        model.term_count(),
        diagnostics.rows,
        diagnostics.skipped_rows,
        diagnostics.repeated_rows,
        significant(seconds, 3),
    ))?;
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
            SolverArg::Tsqr => SolverKind::Tsqr,
        }
    }
}
