//! `shellcal fit`: a calibration from training logs; with `--partial`, sums for `shellcal merge` and no fit.

pub(super) mod hung_loads;
mod recalibration;
mod report;
mod run;
mod stages;

use calibration::Basis;
use calibration::fit::{
    CovarianceRule, Fit, FitOptions, HeldOut, ModelRule, OutlierRule, UnseenErrors, UnseenRows,
};
use calibration::solver::SolverKind;
use calibration::validation::grouped::GroupKind;
use calibration_file::Sums;
use shell_data::wrench::Axes;
use shellcal::workflow::gates::{ErrorLimits, Gate};
use shellcal::workflow::partial::{self, KeptGroups, PartialOptions};
use shellcal::workflow::remark::absent_axes;

use super::choices::{self, COVARIANCES, number_in, one_of};
use super::eval::RmsLimits;
use super::mapping::{CompanionArgs, EditedArg, MappingArgs, open_logs};
use super::outputs::{self, FigureArgs};
use crate::files::{InputPath, OutputPath, is_standard};
use crate::printer::{Outcome, Printer};
use crate::tables::counted;

#[derive(Debug, clap::Args)]
#[command(before_help = "Examples:
  shellcal fit poses.csv -o calibration.json
  shellcal fit monday.csv tuesday.csv --test wednesday.csv --report fit.html
  shellcal fit session.csv --loads loads.csv -o calibration.json
  shellcal fit four-poses.csv --from calibration.json -o remounted.json
  shellcal fit train.csv --model cubic -o calibration.json
  shellcal fit log.txt --sensors S1,S2,S3,S4 --wrench 10-15 --moment-unit mNm")]
#[group(skip)]
pub(crate) struct FitArgs {
    /// Logs to fit to
    #[arg(required = true, value_name = "TRAIN")]
    train: Vec<InputPath>,

    /// Logs to test on
    #[arg(long, value_name = "TEST", num_args = 1..)]
    test: Vec<InputPath>,

    /// Write the calibration (JSON)
    #[arg(long, short, value_name = "CAL.json")]
    output: Option<OutputPath>,

    /// Write a report: errors by axis and by pose, the calibrated loads, the choice of the model, and the
    /// limits of use of the calibration
    #[arg(long, value_name = "FILE.html")]
    report: Option<OutputPath>,

    /// Model [default: auto; with `--partial`: cubic]
    #[arg(long, value_name = "MODEL", value_parser = choices::model(), help_heading = "Model")]
    model: Option<ModelRule>,

    /// Fit no constant; offsets are left to the tare
    #[arg(long, help_heading = "Model")]
    no_intercept: bool,

    /// Penalise large coefficients: λ, relative to features of norm one, such as 1e-6
    #[arg(long, value_name = "LAMBDA", help_heading = "Model")]
    #[arg(default_value_t = 0.0, hide_default_value = true)]
    ridge: f64,

    /// Solver of the least-squares problem
    #[arg(long, value_name = "SOLVER", value_parser = choices::solver(), default_value = "exact",
        help_heading = "Model", hide_short_help = true)]
    solver: SolverKind,

    /// With `--solver svd`: leave out poorly excited directions, those whose singular value is below this
    /// share of the largest, such as 1e-8
    #[arg(long, value_name = "SHARE", value_parser = number_in(0.0..1.0, "a share from 0 to 1, such as 1e-8"),
        help_heading = "Model", hide_short_help = true)]
    truncate: Option<f64>,

    /// Delay of the reference relative to the readings in ms (in rows, if logs have no time); `auto` finds it
    /// [default: `auto` if the model is chosen, otherwise 0]
    #[arg(long, value_name = "auto|MS", value_parser = parse_lag, allow_hyphen_values = true, help_heading = "Model")]
    lag: Option<SearchArg<f64>>,

    /// Add memory to each channel: terms `s - EMA(s)` with these time constants (in rows, if logs have no
    /// time); `auto` takes those that lower held-out errors [default: `auto` if the model is chosen,
    /// otherwise none]
    #[arg(long, value_name = "auto|none|SECONDS,...", value_parser = parse_memory, help_heading = "Model")]
    memory_terms: Option<SearchArg<Vec<f64>>>,

    /// Cross-validate over these groups of rows, with any model: the groups of the group column, files, or
    /// automatically found poses of constant load; a number K assigns the groups to K folds
    #[arg(long, value_name = "file|column|plateau|K", num_args = 0..=1, require_equals = true,
        default_missing_value = "auto", value_parser = clap::value_parser!(HeldOut), help_heading = "Validation")]
    cv: Option<HeldOut>,

    #[command(flatten, next_help_heading = "Validation")]
    limits: RmsLimits,

    /// Fail unless the first line is OK: errors on new poses are known, and test and data have passed
    #[arg(long, help_heading = "Validation")]
    strict: bool,

    /// Basis of the standard errors and intervals of `convert`
    #[arg(long, value_name = "OF", value_parser = one_of(&COVARIANCES), default_value = "auto",
        help_heading = "Validation", hide_short_help = true)]
    covariance: CovarianceRule,

    /// Leave out duplicates: rows whose readings equal the previous row's
    #[arg(long = "skip-repeats", alias = "fresh", help_heading = "Rows")]
    fresh: bool,

    /// Treatment of suspicious rows [default: report]
    #[arg(long, value_name = "WHAT", value_parser = one_of(&OUTLIERS), help_heading = "Rows")]
    outliers: Option<OutlierRule>,

    /// Leave out rows with any reading outside this range
    #[arg(long, value_name = "LO:HI", value_parser = parse_range, allow_hyphen_values = true, help_heading = "Rows")]
    valid_range: Option<[f64; 2]>,

    /// List the rows left out by `--outliers drop` and `--valid-range`, with the reason (CSV)
    #[arg(long, value_name = "FILE.csv", help_heading = "Rows")]
    dropped: Option<OutputPath>,

    /// Fit to the mean of each group of rows, with equal weights: the group column, files, or poses that are
    /// found. Test logs are compared row by row
    #[arg(long, conflicts_with = "partial", help_heading = "Rows", hide_short_help = true)]
    means: bool,

    /// Take the wrench from a table of the hung loads, one line for each pose: mass or force, point and
    /// direction, with their errors. Loads are matched by the group column, otherwise pose
    /// by pose, in order
    #[arg(long, value_name = "LOADS.csv",
        conflicts_with_all = ["wrench_from", "partial", "means", "outliers", "valid_range", "cv", "lag", "memory_terms"],
        help_heading = "Reading logs")]
    loads: Option<InputPath>,

    /// Update this calibration with a few loads, after the sensor was remounted or has aged: finds the
    /// changes of zeros, gains, lever and rotation, and keeps everything else. Hold each load still
    #[arg(long, value_name = "CAL.json", help_heading = "Model",
        conflicts_with_all = ["test", "report", "plot", "model", "no_intercept", "ridge", "solver", "truncate", "lag",
            "memory_terms", "cv", "covariance", "strict", "max_rms", "max_rms_moment", "fresh", "outliers", "valid_range",
            "dropped", "means", "partial", "export_matrix"])]
    from: Option<InputPath>,

    #[command(flatten)]
    edited: EditedArg,

    #[command(flatten)]
    companions: CompanionArgs,

    /// Take the wrench from these files, one for each log to test on
    #[arg(long, value_name = "FILE", num_args = 1.., requires = "test", help_heading = "Reading logs")]
    test_wrench_from: Vec<InputPath>,

    /// Sum the rows, write the sums for `shellcal merge`, and fit nothing (JSON; `-` for the standard output)
    #[arg(long, value_name = "FILE.json",
        conflicts_with_all = ["test", "output", "export_matrix", "plot", "report", "ridge", "truncate", "cv", "dropped", "valid_range", "strict", "max_rms", "max_rms_moment", "lag", "memory_terms"],
        help_heading = "Partial fits", hide_short_help = true)]
    partial: Option<OutputPath>,

    /// With `--partial`: keep the sums of each group, so that `merge` can validate, choose a model and find
    /// standard errors by group
    #[arg(long, value_parser = one_of(&GROUPS), value_name = "file|column", num_args = 0..=1, require_equals = true,
        default_missing_value = "auto", hide_possible_values = true, requires = "partial",
        help_heading = "Partial fits", hide_short_help = true)]
    groups: Option<KeptGroups>,

    /// Write the coefficients for raw readings, one row per feature, moments in mN·m (CSV)
    #[arg(long, value_name = "FILE.csv", help_heading = "Other output", hide_short_help = true)]
    export_matrix: Option<OutputPath>,

    #[command(flatten, next_help_heading = "Other output")]
    figure: FigureArgs,

    /// Serial number or label of the sensor, for the calibration file
    #[arg(long, value_name = "SERIAL", help_heading = "Other output")]
    serial: Option<String>,

    #[command(flatten)]
    mapping: MappingArgs,
}

const GROUPS: [(&str, &str, KeptGroups); 3] = [
    ("auto", "Those of the group column where there is one, files otherwise", KeptGroups::Auto),
    ("file", "Files", KeptGroups::By(GroupKind::File)),
    ("column", "Those of the group column", KeptGroups::By(GroupKind::Column)),
];

/// A lag in ms or time constants in s, or both in rows: to be found, or given.
#[derive(Clone, Debug)]
enum SearchArg<T> {
    Auto,
    Given(T),
}

const OUTLIERS: [(&str, &str, OutlierRule); 3] = [
    ("report", "Name them, with what they do to the fit, and use them", OutlierRule::Report),
    ("drop", "Leave them out, and list them in the file of `--dropped`", OutlierRule::Drop),
    ("keep", "Use them, and do not look", OutlierRule::Keep),
];

impl FitArgs {
    pub(crate) fn run(&self, printer: &Printer) -> anyhow::Result<Outcome> {
        if let Some(path) = &self.partial {
            return self.write_partial(path, printer).map(Outcome::from);
        }
        if let Some(before) = &self.from {
            return self.recalibrate(before, printer);
        }
        self.fit(printer)
    }

    /// Requires errors within the limits on all rows that were not used for the fit: held-out rows and test logs.
    fn ask_errors(&self, fitted: &Fit, gate: &mut Gate) {
        let (limits, axes) = (self.limits.of(None), fitted.calibration.axes);
        let train = format!("`{}`", self.train[0].display());
        gate.ask("the calibration", limits.asked().without(axes))
            .lacks(Axes::ALL, |axes| format!("{axes}, which {train} does not have"));
        match fitted.unseen_errors() {
            None => gate.ask("", limits.asked()).lacks(Axes::ALL, |axes| {
                format!("{axes}, since the error on new loads is not known")
            }),
            Some(UnseenErrors { on: UnseenRows::Test(_), .. }) => {}
            Some(of) => limits.ask_errors(gate, axes, " on rows that were held out", &of.rms),
        }
        let limits = ErrorLimits { axes: Some(limits.asked().and(axes)), ..limits };
        for (path, of) in self.test.iter().zip(&fitted.tests) {
            limits.ask_log(gate, path, axes, [of.rows, of.rows + of.skipped_rows]);
        }
        if let Some(quality) = fitted.test().quality() {
            let rms = quality.map(|axis| axis.rms);
            limits.ask_errors(gate, axes, " on the test logs", &rms);
        }
    }
}

/// Parses a lag in ms, or rows.
fn parse_lag(text: &str) -> Result<SearchArg<f64>, &'static str> {
    match text.parse() {
        _ if text == "auto" => Ok(SearchArg::Auto),
        Ok(lag) if f64::is_finite(lag) => Ok(SearchArg::Given(lag)),
        _ => Err("expected `auto`, or a time in ms such as 3.1"),
    }
}

fn parse_memory(text: &str) -> Result<SearchArg<Vec<f64>>, &'static str> {
    let positive = |text: &str| text.trim().parse().ok().filter(|tau| *tau > 0.0 && *tau < 1e9);
    match text {
        "auto" => Ok(SearchArg::Auto),
        "none" => Ok(SearchArg::Given(Vec::new())),
        _ => {
            let times: Option<Vec<f64>> = text.split(',').map(positive).collect();
            let times = times.ok_or("expected `auto`, `none`, or times in s such as 0.03,1.2")?;
            Ok(SearchArg::Given(times))
        }
    }
}

/// Parses `LO:HI`.
fn parse_range(text: &str) -> Result<[f64; 2], &'static str> {
    let ends =
        text.split_once(':').map(|(least, most)| (least.trim().parse(), most.trim().parse()));
    match ends {
        Some((Ok(least), Ok(most))) if least < most => Ok([least, most]),
        _ => Err("expected the least and the largest valid reading, such as 0:4095"),
    }
}

impl FitArgs {
    fn write_partial(&self, path: &OutputPath, printer: &Printer) -> anyhow::Result<()> {
        let wrenches = ("--wrench-from", self.companions.wrench_from.as_slice());
        let mapping = self.mapping.mapping();
        let mut train = open_logs(&self.train, wrenches, &mapping)?;
        self.check_dropped()?;
        let model = self.model.unwrap_or(Basis::Cubic.into());
        let basis = match (model, self.groups) {
            (ModelRule::Given(basis), _) => basis,
            // The sums for this model serve every model that is compared.
            (ModelRule::Auto, Some(_)) => Basis::Poly3,
            (ModelRule::Auto, None) => {
                anyhow::bail!("`--partial` needs one model, or `--groups` for `merge --model auto`")
            }
            (ModelRule::Physics, _) => {
                anyhow::bail!("`--partial` is for polynomials in the readings: physics has no sums")
            }
        };
        let destination = printer.create_or_stdout(Some(path))?;
        // True if R factors are wanted even if the rows can be summed exactly.
        let r_factors = match self.solver {
            SolverKind::Exact => false,
            SolverKind::Tsqr => true,
            _ => anyhow::bail!(
                "`--partial` keeps exact sums, or with `--solver tsqr` R factors: leave out `--solver`"
            ),
        };
        let options = PartialOptions {
            basis,
            intercept: !self.no_intercept,
            groups: self.groups,
            seed: FitOptions::default().seed,
            r_factors,
            fresh: self.fresh,
            mapping: &mapping,
            read: self.mapping.read_options(),
        };
        let mut partial = partial::sum(&mut train, &options)?;
        partial.made_by = shellcal::PROGRAM.to_owned();
        partial.date = outputs::date()?;
        partial.columns = self.mapping.specified(&train);
        partial.sensor_serial = self.serial.clone();
        printer.remarks(absent_axes(partial.axes));
        destination.commit_with(partial.to_json().as_bytes())?;
        let (rows, model) = (partial.sums.rows(), partial.model);
        if printer.json() {
            return printer.document(&serde_json::json!({ "model": model.name(), "rows": rows }));
        }
        let kept = match &partial.sums {
            Sums::Exact(_) => "sums over",
            Sums::Factored(_) => "the R factor of",
        };
        let files = counted(train.len(), "file");
        let mut done = format!("{}: {kept} {rows} rows of {files}", model.name());
        if let Some(groups) = &partial.groups {
            done += &format!(", in {} groups by {}", groups.groups.len(), groups.by.name());
        }
        if is_standard(path) {
            printer.note(done)
        } else {
            printer.line(done)
        }
        Ok(())
    }
}
