//! `shellcal fit --model physics`, and `auto` where it takes that model.

use std::time::Instant;

use anyhow::Context;
use calibration::physics::{COVERAGE_LEVEL, PhysicsCalibration, PhysicsValidation};
use calibration::solver::SolverKind;
use calibration::validation::selection::Selection;
use calibration_file::stored::{
    OfAxes, Stored, StoredCrossValidation, StoredExcitation, StoredGroupIntervals, StoredQuality,
    StoredSelection,
};
use calibration_file::{CalibrationFile, Diagnostics, Origin};
use log_file::{Log, ReadOptions};
use report::Intervals;
use serde::Serialize;
use shell_data::wrench::{Axes, Axis, PerAxis};
use shellcal::workflow::groups::FoundSummary;
use shellcal::workflow::model_choice::ModelChoice;
use shellcal::workflow::outliers::Outliers;
use shellcal::workflow::physics::{self, GroupsAre, PhysicsFit, PhysicsOptions};
use shellcal::workflow::selection::UsedRows;
use shellcal::workflow::weighing::Weighing;

use super::super::choices::ModelArg;
use super::super::origin;
use super::super::quality::significant;
use super::super::validation::{print_cross_validation, print_excitation, print_selection};
use super::choice::note_found;
use super::html::Found;
use super::report::{note_range, print_errors};
use super::weighing::{WeighingReport, in_words};
use super::{FitArgs, Logs, Opened, total};
use crate::printer::Printer;

/// What `--json` prints.
#[derive(Serialize)]
struct Report {
    model: String,
    rows: u64,
    skipped_rows: u64,
    repeated_rows: u64,
    test_rows: u64,
    test_rows_out_of_range: u64,
    observations: usize,
    groups: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    groups_found: Option<FoundSummary>,
    parameters: usize,
    lambda: f64,
    prior_width: f64,
    axes: Vec<&'static str>,
    train: OfAxes<StoredQuality>,
    test: Option<OfAxes<StoredQuality>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    cross_validation: Option<StoredCrossValidation>,
    #[serde(skip_serializing_if = "Option::is_none")]
    selection: Option<StoredSelection>,
    #[serde(skip_serializing_if = "Option::is_none")]
    weighing: Option<WeighingReport>,
    /// Median over the groups of the size of their mean error, N and N·m.
    #[serde(skip_serializing_if = "Option::is_none")]
    median_of_groups: Option<PerAxis<f64>>,
    /// Share of held-out rows within their 95 % intervals, each group with the same weight.
    #[serde(skip_serializing_if = "Option::is_none")]
    coverage_95: Option<PerAxis<f64>>,
    intervals: Option<StoredGroupIntervals>,
    excitation: Option<StoredExcitation>,
    time_s: f64,
}

/// What led `auto` to the physics model.
#[derive(Debug, Default)]
pub(super) struct Weighed {
    pub(super) selection: Option<Selection>,
    pub(super) weighing: Option<Weighing>,
}

impl FitArgs {
    /// For `auto`, the physics model weighed against the polynomial that was chosen, and what follows
    /// said in words.
    pub(super) fn weigh_physics(
        &self,
        train: &[Log],
        choice: &ModelChoice,
        used: UsedRows<'_>,
        printer: &mut Printer,
    ) -> Option<Weighing> {
        if !matches!(self.model, ModelArg::Auto) {
            return None;
        }
        if let Err(reason) = self.check_physics(train) {
            printer.note(format!("physics was not weighed: {reason}"));
            return None;
        }
        match self.weigh(train, choice, used, printer)? {
            Err(reason) => {
                printer.note(format!("physics was not weighed: {reason}"));
                None
            }
            Ok(weighing) => {
                printer.note(in_words(&weighing));
                Some(weighing)
            }
        }
    }

    /// Whether options and logs are of use with a physics model.
    fn check_physics(&self, train: &[Log]) -> anyhow::Result<()> {
        let only_polynomials = [
            (self.export_matrix.is_some(), "--export-matrix"),
            (self.ridge > 0.0, "--ridge"),
            (self.solver.0 != SolverKind::Exact, "--solver"),
            (self.no_intercept, "--no-intercept"),
        ];
        for (given, option) in only_polynomials {
            anyhow::ensure!(!given, "`{option}` is for polynomials in the readings");
        }
        physics::check_axes(train)?;
        Ok(())
    }

    pub(super) fn run_physics(
        &self,
        logs: &Logs,
        opened: Opened,
        weighed: Weighed,
        used: UsedRows<'_>,
        start: Instant,
        printer: &mut Printer,
    ) -> anyhow::Result<()> {
        let Logs { train, test } = logs;
        self.check_physics(train)?;
        let bytes = |logs: &[Log]| logs.iter().map(Log::bytes).sum::<u64>();
        let bar = printer.progress("fit", bytes(train) + bytes(test));
        let progress = |bytes| bar.set_position(bytes);
        let read = ReadOptions {
            checksum: self.keeps(),
            progress: Some(&progress),
            ..self.mapping.read_options()
        };
        let options = PhysicsOptions { cross_validation: self.cv, used, plot: self.draws(), read };
        let fitted = physics::fit(train, test, &options).map_err(|error| self.name_logs(error))?;
        bar.finish_and_clear();
        let looks = self.looks_for_outliers() && fitted.stands_out();
        let named = looks.then(|| self.name_outliers(train, printer)).flatten();
        if let Some(groups) = fitted.found {
            note_found(printer, groups);
        }
        let mut file = self.physics_file(logs, &fitted, weighed.selection)?;
        file.origin.columns = self.mapping.specified(train)?;
        let html = self.report.as_ref().map(|_| {
            let found = Found {
                features: fitted.fitted.physics().model().parameter_count(),
                intervals: fitted.fitted.validation.as_ref().and_then(intervals_of),
                few_groups: None,
                reasons: weighed.weighing.as_ref().map(in_words).into_iter().collect(),
                warnings: Vec::new(),
                outliers: self.outlier_rows(named.as_ref(), &Outliers::default(), train),
                plots: fitted.plots.as_ref(),
                test: total(&fitted.test),
                group_by: None,
            };
            self.html(&file, found, (train, test), used)
        });
        self.write(opened, &file, fitted.plots.as_ref(), html.transpose()?.as_deref())?;
        report(printer, &fitted, &file, weighed.weighing.as_ref(), start.elapsed().as_secs_f64())
    }

    fn physics_file(
        &self,
        logs: &Logs,
        fitted: &PhysicsFit,
        selection: Option<Selection>,
    ) -> anyhow::Result<CalibrationFile> {
        let (train, test) = (total(&fitted.train), total(&fitted.test));
        Ok(CalibrationFile {
            calibration: fitted.fitted.calibration.clone(),
            origin: Origin {
                made_by: origin::program(),
                date: origin::date()?,
                sensor_serial: self.serial.clone(),
                solver: None,
                diagnostics: Some(Diagnostics {
                    rows: fitted.rows,
                    skipped_rows: train.skipped_rows,
                    repeated_rows: train.repeated_rows,
                    rank: fitted.fitted.physics().model().parameter_count(),
                    condition: None,
                    train: train.quality().context("no training rows are left")?,
                    test: test.quality(),
                    cross_validation: fitted.fitted.cross_validation(),
                    selection,
                    excitation: fitted.loads.excitation(),
                }),
                sources: self.sources((&logs.train, &logs.test), (&fitted.train, &fitted.test))?,
                columns: None,
            },
        })
    }
}

/// The intervals of groups that were held out, and what they held.
fn intervals_of(validation: &PhysicsValidation) -> Option<Intervals> {
    let coverage = validation.coverage()?;
    let least = coverage.iter().map(|(share, _)| *share).fold(f64::INFINITY, f64::min);
    Some(Intervals {
        half_widths: coverage.map(|(_, half)| half),
        of: format!(
            "groups that were held out, of which they held {:.0} % or more on every axis",
            100.0 * least
        ),
        of_rows: false,
    })
}

fn report(
    printer: &mut Printer,
    fitted: &PhysicsFit,
    file: &CalibrationFile,
    weighing: Option<&Weighing>,
    seconds: f64,
) -> anyhow::Result<()> {
    let test = total(&fitted.test);
    let Some(diagnostics) = &file.origin.diagnostics else { return Ok(()) };
    let (of_rows, physics) = (&fitted.fitted, fitted.fitted.physics());
    let model = physics.model();
    let coverage = of_rows.validation.as_ref().and_then(PhysicsValidation::coverage);
    if printer.json() {
        return printer.document(&Report {
            model: file.calibration.name(),
            rows: diagnostics.rows,
            skipped_rows: diagnostics.skipped_rows,
            repeated_rows: diagnostics.repeated_rows,
            test_rows: test.rows,
            test_rows_out_of_range: test.out_of_range_rows,
            observations: of_rows.observations,
            groups: of_rows.groups,
            groups_found: fitted.found,
            parameters: model.parameter_count(),
            lambda: model.lambda,
            prior_width: model.prior_width,
            axes: Axes::ALL.columns(),
            train: Stored::of(&diagnostics.train, Axes::ALL),
            test: Stored::of(&diagnostics.test, Axes::ALL),
            cross_validation: Stored::of(&diagnostics.cross_validation, Axes::ALL),
            selection: Stored::of(&diagnostics.selection, Axes::ALL),
            weighing: weighing.map(WeighingReport::of),
            median_of_groups: of_rows.validation.as_ref().map(PhysicsValidation::median),
            coverage_95: coverage.map(|of| of.map(|(share, _)| share)),
            intervals: Stored::of(&physics.intervals, Axes::ALL),
            excitation: Stored::of(&diagnostics.excitation, Axes::ALL),
            time_s: seconds,
        });
    }
    if let Some(selection) = &diagnostics.selection {
        print_selection(printer, selection, Axes::ALL)?;
    }
    print_errors(printer, diagnostics, Axes::ALL)?;
    printer.line(format!(
        "physics: {} parameters of {} sensors, fitted to {} means of {} groups; λ {}, prior width {}, \
         both chosen by held-out groups",
        model.parameter_count(),
        model.sensors.len(),
        of_rows.observations,
        of_rows.groups,
        model.lambda,
        model.prior_width,
    ))?;
    printer.line(format!(
        "{} rows used, {} skipped, {} repeated; {:.0} ms",
        diagnostics.rows,
        diagnostics.skipped_rows,
        diagnostics.repeated_rows,
        seconds * 1e3,
    ))?;
    if let Some(excitation) = &diagnostics.excitation {
        print_excitation(printer, excitation, Axes::ALL)?;
    }
    if let (Some(found), Some(validation)) =
        (&diagnostics.cross_validation, of_rows.validation.as_ref())
    {
        print_cross_validation(printer, found, Axes::ALL)?;
        let medians = validation.median();
        let median = |axis: Axis| {
            format!("{} {} {}", axis.name(), significant(medians[axis.index()], 3), axis.unit())
        };
        printer.line(format!("median error of a group: {}", Axis::ALL.map(median).join(", ")))?;
    }
    print_intervals(printer, physics, coverage)?;
    if fitted.groups_are == GroupsAre::Stretches {
        printer.note(format!(
            "the logs have no groups: the rows were held out in {} stretches of time; give groups \
             (`--group`) if poses last longer",
            of_rows.groups
        ));
    }
    let dead: Vec<String> =
        model.dead_channels().into_iter().map(|channel| format!("s{}", channel + 1)).collect();
    if !dead.is_empty() {
        printer.warning(format!("left out, because they never change: {}", dead.join(", ")));
    }
    note_range(printer, &test);
    Ok(())
}

/// Says what intervals `convert` will give, or why it will not.
fn print_intervals(
    printer: &mut Printer,
    physics: &PhysicsCalibration,
    coverage: Option<PerAxis<(f64, f64)>>,
) -> anyhow::Result<()> {
    let Some(intervals) = &physics.intervals else { return Ok(()) };
    match intervals.factors(COVERAGE_LEVEL) {
        Err(reason) => printer.warning(format!("{reason}: none will be given")),
        Ok(factors) => {
            let factor =
                |axis: Axis| format!("{} {}", axis.name(), significant(factors[axis.index()], 3));
            printer.line(format!(
                "95 % intervals, from {} groups held out, in standard errors of each frame: {}",
                intervals.groups,
                Axis::ALL.map(factor).join(", ")
            ))?;
        }
    }
    if let Some(coverage) = coverage {
        let of = |axis: Axis| {
            let (share, half) = coverage[axis.index()];
            let (half, unit) = (significant(half, 3), axis.unit());
            format!("{} {:.1} % within ±{half} {unit}", axis.name(), 100.0 * share)
        };
        printer.line(format!(
            "what 95 % intervals held of groups that were held out: {}",
            Axis::ALL.map(of).join(", ")
        ))?;
    }
    Ok(())
}
