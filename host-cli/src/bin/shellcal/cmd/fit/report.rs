//! What `shellcal fit` prints.

use calibration::quality::AxisQuality;
use calibration::uncertainty::{CoefficientCovariance, Covariance};
use calibration::validation::advice::Advice;
use calibration_file::stored::{
    OfAxes, Stored, StoredCandidate, StoredCrossValidation, StoredExcitation, StoredQuality,
    StoredSelection, StoredSolverRecord,
};
use calibration_file::{CalibrationFile, Diagnostics};
use serde::Serialize;
use shell_data::wrench::{Axes, Axis, PerAxis};
use shellcal::workflow::eval::Evaluation;
use shellcal::workflow::fit::Fit;
use shellcal::workflow::groups::FoundSummary;
use shellcal::workflow::weighing::Weighing;

use super::super::outliers::OutlierReport;
use super::super::quality::{significant, table_row};
use super::super::validation::{
    print_advice, print_cross_validation, print_excitation, print_selection,
};
use super::total;
use super::weighing::WeighingReport;
use crate::printer::Printer;

/// What `--json` prints.
#[derive(Serialize)]
struct Report<'a> {
    model: String,
    solver: StoredSolverRecord,
    rows: u64,
    skipped_rows: u64,
    repeated_rows: u64,
    test_rows: u64,
    test_rows_out_of_range: u64,
    /// The share of test rows that were recorded at plateaus of the training data.
    #[serde(skip_serializing_if = "Option::is_none")]
    test_share_on_training_plateaus: Option<f64>,
    features: usize,
    rank: usize,
    condition: Option<f64>,
    axes: Vec<&'static str>,
    train: OfAxes<StoredQuality>,
    /// Why there are no largest errors of training rows, and none was looked at.
    #[serde(skip_serializing_if = "Option::is_none")]
    train_residuals_left_out: Option<&'a str>,
    test: Option<OfAxes<StoredQuality>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    cross_validation: Option<StoredCrossValidation>,
    #[serde(skip_serializing_if = "Option::is_none")]
    selection: Option<StoredSelection>,
    #[serde(skip_serializing_if = "Option::is_none")]
    weighing: Option<WeighingReport>,
    #[serde(skip_serializing_if = "Option::is_none")]
    advice: Option<AdviceReport>,
    #[serde(skip_serializing_if = "Option::is_none")]
    groups_found: Option<FoundSummary>,
    #[serde(skip_serializing_if = "Option::is_none")]
    outliers: Option<&'a [OutlierReport]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    dropped: Option<&'a [OutlierReport]>,
    excitation: Option<StoredExcitation>,
    #[serde(skip_serializing_if = "Option::is_none")]
    covariance: Option<CovarianceReport>,
    time_s: f64,
}

/// What held-out errors say to do.
#[derive(Serialize)]
struct AdviceReport {
    folds: usize,
    best: StoredCandidate,
    cautious: StoredCandidate,
    /// Squared error of the cautious choice less that of the best, relative to the variance, and its
    /// standard error; zeros where they are one.
    difference: [f64; 2],
    /// Whether another model predicts new groups better than the one that was fitted.
    another_is_better: bool,
    ridge_is_at_limit: bool,
}

impl AdviceReport {
    fn of(advice: &Advice, axes: Axes) -> Self {
        let difference = advice.caution.map(|of| [of.all.value, of.all.standard_error]);
        Self {
            folds: advice.folds,
            best: Stored::of(&advice.best, axes),
            cautious: Stored::of(&advice.cautious, axes),
            difference: difference.unwrap_or_default(),
            another_is_better: advice.another_is_better(),
            ridge_is_at_limit: advice.ridge_is_at_limit,
        }
    }
}

/// What standard errors come from, and the covariance of the errors of a row.
#[derive(Serialize)]
struct CovarianceReport {
    /// Groups of rows; absent where rows are taken as independent.
    #[serde(skip_serializing_if = "Option::is_none")]
    groups: Option<u64>,
    degrees_of_freedom: u64,
    /// In products of N and N·m.
    residual: OfAxes<OfAxes<f64>>,
    /// Half the width of a 95 % prediction interval, coefficients taken as certain, N and N·m; `None` where
    /// groups are too few to tell.
    interval_95: Option<OfAxes<f64>>,
}

impl CovarianceReport {
    fn of(covariance: &Covariance, axes: Axes) -> Self {
        let groups = match &covariance.coefficients {
            CoefficientCovariance::Groups { groups, .. } => Some(*groups),
            CoefficientCovariance::Rows { .. } => None,
        };
        let (sd, factors) = (covariance.residual_sd(), covariance.interval_factors(0.95));
        Self {
            groups,
            degrees_of_freedom: covariance.degrees_of_freedom,
            residual: Stored::of(&covariance.residual, axes),
            interval_95: factors.ok().map(|factors| {
                Stored::of(&std::array::from_fn(|axis| factors[axis] * sd[axis]), axes)
            }),
        }
    }
}

fn print_covariance(
    printer: &mut Printer,
    covariance: &Covariance,
    axes: Axes,
) -> anyhow::Result<()> {
    let report = CovarianceReport::of(covariance, axes);
    let of = match report.groups {
        Some(groups) => format!("{groups} groups of rows"),
        None => "rows taken as independent".to_owned(),
    };
    if let Err(too_few) = covariance.interval_factors(0.95) {
        printer.warning(too_few.to_string());
        return Ok(());
    }
    let half = |(axis, half): (Axis, &f64)| {
        format!("{} ±{} {}", axis.name(), significant(*half, 2), axis.unit())
    };
    let widths = report.interval_95.iter().flat_map(OfAxes::iter);
    let halves: Vec<String> = axes.iter().zip(widths).map(half).collect();
    printer.line(format!("95 % intervals, from {of}: {}", halves.join(", ")))
}

/// The table of errors on training and test rows.
pub(super) fn print_errors(
    printer: &mut Printer,
    diagnostics: &Diagnostics,
    axes: Axes,
) -> anyhow::Result<()> {
    let sets: Vec<&PerAxis<AxisQuality>> =
        [Some(&diagnostics.train), diagnostics.test.as_ref()].into_iter().flatten().collect();
    let mut header = vec!["axis"];
    for (train, test) in
        [("RMS train", "RMS test"), ("max train", "max test"), ("R² train", "R² test")]
    {
        header.extend([train, test].iter().take(sets.len()));
    }
    header.push("unit");
    let rows: Vec<Vec<String>> = axes.iter().map(|axis| table_row(axis, &sets)).collect();
    printer.table(&header, &rows)
}

/// Says how many test rows the calibration does not reach.
pub(super) fn note_range(printer: &mut Printer, test: &Evaluation) {
    if test.out_of_range_rows > 0 {
        printer.note(format!(
            "{} of {} test rows have a reading outside the range of the training data",
            test.out_of_range_rows, test.rows
        ));
    }
}

/// The ridge, and what it penalises: with an intercept readings are centred before powers are taken.
fn ridge(ridge: f64, intercept: bool) -> String {
    let powers = if intercept { "centred" } else { "raw" };
    match ridge > 0.0 {
        true => format!(", ridge {ridge:e} on powers of {powers} readings"),
        false => String::new(),
    }
}

/// What was known before the fit.
pub(super) struct Known<'a> {
    /// Physics beside the polynomial, where that was weighed.
    pub(super) weighing: Option<&'a Weighing>,
    /// Groups that were found.
    pub(super) groups: Option<FoundSummary>,
    /// What held-out errors say to do.
    pub(super) advice: Option<Advice>,
    /// Rows that do not belong and were used.
    pub(super) outliers: Option<Vec<OutlierReport>>,
    /// Rows that were left out.
    pub(super) dropped: Option<Vec<OutlierReport>>,
    /// Why the errors of training rows were not looked at one by one, where they were not.
    pub(super) left_out_residuals: Option<String>,
}

pub(super) fn report(
    printer: &mut Printer,
    fitted: &Fit,
    file: &CalibrationFile,
    known: &Known<'_>,
    seconds: f64,
) -> anyhow::Result<()> {
    let (test, weighing) = (total(&fitted.test), known.weighing);
    let (Some(diagnostics), Some(solver)) = (&file.origin.diagnostics, file.origin.solver) else {
        return Ok(());
    };
    let model = fitted.solution.model;
    let covariance = fitted.calibration.covariance.as_ref();
    let axes = fitted.calibration.axes;
    if printer.json() {
        return printer.document(&Report {
            model: model.name(),
            solver: Stored::of(&solver, axes),
            rows: diagnostics.rows,
            skipped_rows: diagnostics.skipped_rows,
            repeated_rows: diagnostics.repeated_rows,
            test_rows: test.rows,
            test_rows_out_of_range: test.out_of_range_rows,
            test_share_on_training_plateaus: fitted.on_plateaus,
            features: model.term_count(),
            rank: diagnostics.rank,
            condition: diagnostics.condition,
            axes: axes.columns(),
            train: Stored::of(&diagnostics.train, axes),
            train_residuals_left_out: known.left_out_residuals.as_deref(),
            test: Stored::of(&diagnostics.test, axes),
            cross_validation: Stored::of(&diagnostics.cross_validation, axes),
            selection: Stored::of(&diagnostics.selection, axes),
            weighing: weighing.map(WeighingReport::of),
            advice: known.advice.as_ref().map(|advice| AdviceReport::of(advice, axes)),
            groups_found: known.groups,
            outliers: known.outliers.as_deref(),
            dropped: known.dropped.as_deref(),
            excitation: Stored::of(&diagnostics.excitation, axes),
            covariance: covariance.map(|covariance| CovarianceReport::of(covariance, axes)),
            time_s: seconds,
        });
    }
    if let Some(selection) = &diagnostics.selection {
        print_selection(printer, selection, axes)?;
    }
    print_errors(printer, diagnostics, axes)?;
    let condition = diagnostics.condition.map_or("infinite".into(), |c| significant(c, 3));
    printer.line(format!(
        "{}{}, solver {}: rank {} of {}, condition {condition}",
        model.name(),
        ridge(solver.ridge, model.intercept),
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
        print_excitation(printer, excitation, axes)?;
    }
    if let Some(cross_validation) = &diagnostics.cross_validation {
        print_cross_validation(printer, cross_validation, axes)?;
    }
    if let Some(covariance) = covariance {
        print_covariance(printer, covariance, axes)?;
    }
    note_range(printer, &test);
    if let Some(advice) = &known.advice {
        print_advice(printer, advice, model.basis, diagnostics.cross_validation.as_ref(), axes)?;
    }
    Ok(())
}
