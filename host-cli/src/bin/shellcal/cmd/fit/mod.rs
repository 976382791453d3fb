//! `shellcal fit`: from training logs to a calibration.

mod dynamics;
mod html;
mod partial;
mod physics;
mod plan;
mod report;

use std::time::Instant;

use calibration::fit::{FitMethod, HeldOut, Warning};
use clap::ValueEnum;
use output_file::Outputs;

use self::plan::FitPlan;
use super::choices::{ModelArg, SolverArg};
use super::covariance::CovarianceArg;
use super::figure_size::FigureSize;
use super::mapping::MappingArgs;
use super::validation::parse_cv;
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

    /// How many ms later than the readings the reference shows a load (rows, where logs have no time); `auto`
    /// finds it [default: `auto` with `--model auto`, otherwise 0]
    #[arg(long, value_name = "auto|MS", value_parser = parse_lag, allow_hyphen_values = true)]
    lag: Option<LagArg>,

    /// Let each channel remember: terms `s - EMA(s)` with these time constants (rows, where logs have no time);
    /// `auto` takes those that lower held-out errors [default: `auto` with `--model auto`, otherwise none]
    #[arg(long, value_name = "auto|none|SECONDS,...", value_parser = parse_memory)]
    memory_terms: Option<MemoryArg>,

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
    #[arg(long, conflicts_with = "partial")]
    means: bool,

    /// Which way rows are dealt into the random folds that `--cv` compares with
    #[arg(long, value_name = "N", default_value_t = 1, requires = "held_out")]
    cv_seed: u64,

    /// Sum the rows, write the sums for `shellcal merge`, and fit nothing (JSON; `-` for the standard
    /// output)
    #[arg(
        long,
        value_name = "FILE.json",
        conflicts_with_all = ["test", "output", "export_matrix", "plot", "report", "ridge", "truncate", "cv", "dropped", "valid_range", "lag", "memory_terms"]
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

    /// Rows that do not belong [default: report]
    #[arg(long, value_name = "WHAT")]
    outliers: Option<OutliersArg>,

    /// Readings outside are wrong: leave out rows with any
    #[arg(long, value_name = "LO:HI", value_parser = parse_range, allow_hyphen_values = true)]
    valid_range: Option<[f64; 2]>,

    /// List the rows that `--outliers drop` and `--valid-range` leave out, and why (CSV)
    #[arg(long, value_name = "FILE.csv")]
    dropped: Option<OutputPath>,

    #[command(flatten)]
    mapping: MappingArgs,
}

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

/// The lag of the reference.
#[derive(Clone, Copy, Debug)]
enum LagArg {
    Auto,
    /// In ms, or rows.
    Given(f64),
}

/// Memory terms.
#[derive(Clone, Debug)]
enum MemoryArg {
    Auto,
    /// Time constants in s, or rows.
    Given(Vec<f64>),
}

/// What is done about rows that do not belong.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum OutliersArg {
    /// Name them, with what they do to the fit, and use them
    Report,
    /// Leave them out, and list them in the file of `--dropped`
    Drop,
    /// Use them, and do not look
    Keep,
}

impl FitArgs {
    pub(crate) fn run(&self, printer: &mut Printer, outputs: &Outputs) -> anyhow::Result<Outcome> {
        let start = Instant::now();
        if let Some(path) = &self.partial {
            self.write_partial(path, printer, outputs)?;
            return Ok(Outcome::Done);
        }
        let plan = FitPlan::from_args(self, outputs)?;
        let (data, fitted) = plan.fit(printer)?;
        let told = plan.tell(&data, &fitted, printer)?;
        let file = plan.file(&data, &fitted)?;
        let html = self.report.as_ref().map(|_| plan.html(&file, &fitted, &told)).transpose()?;
        plan.write(&file, &fitted, html.as_deref())?;
        let seconds = start.elapsed().as_secs_f64();
        match &fitted.method {
            FitMethod::Polynomial { .. } => {
                report::report(printer, &fitted, &file, &told, seconds)?;
            }
            FitMethod::Physics(physics) => {
                physics::report(printer, &fitted, physics, &file, seconds)?;
            }
        }
        // It is about the table.
        let is_late = |warning: &&Warning| matches!(warning, Warning::OutOfRange { .. });
        fitted.warnings.iter().filter(is_late).for_each(|late| printer.note(late.to_string()));
        Ok(Outcome::Done)
    }
}

fn parse_share(text: &str) -> Result<f64, String> {
    let share = text.parse().ok().filter(|share| (0.0..1.0).contains(share));
    share.ok_or_else(|| "a share from 0 to 1, such as 1e-8".to_owned())
}

fn parse_lag(text: &str) -> Result<LagArg, String> {
    match text {
        "auto" => Ok(LagArg::Auto),
        _ => match text.parse() {
            Ok(lag) if f64::is_finite(lag) => Ok(LagArg::Given(lag)),
            _ => Err("expected `auto`, or a time in ms such as 3.1".to_owned()),
        },
    }
}

fn parse_memory(text: &str) -> Result<MemoryArg, String> {
    let positive = |text: &str| text.trim().parse().ok().filter(|tau| *tau > 0.0 && *tau < 1e9);
    match text {
        "auto" => Ok(MemoryArg::Auto),
        "none" => Ok(MemoryArg::Given(Vec::new())),
        _ => text
            .split(',')
            .map(positive)
            .collect::<Option<Vec<f64>>>()
            .map(MemoryArg::Given)
            .ok_or_else(|| "expected `auto`, `none`, or times in s such as 0.03,1.2".to_owned()),
    }
}

/// `LO:HI`.
fn parse_range(text: &str) -> Result<[f64; 2], String> {
    let ends =
        text.split_once(':').map(|(least, most)| (least.trim().parse(), most.trim().parse()));
    match ends {
        Some((Ok(least), Ok(most))) if least < most => Ok([least, most]),
        _ => Err("expected the least and the largest valid reading, such as 0:4095".to_owned()),
    }
}
