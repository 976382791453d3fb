//! What `shellcal fit` prints.

use calibration::fit::{Fit, ModelComparison};
use calibration::quality::{AxisQuality, significant};
use calibration::uncertainty::{CoefficientCovariance, Covariance};
use calibration::validation::advice::Advice;
use calibration_file::stored::{
    OfAxes, Stored, StoredCandidate, StoredCrossValidation, StoredExcitation, StoredQuality,
    StoredSelection, StoredSolverRecord,
};
use calibration_file::{CalibrationFile, Diagnostics};
use serde::Serialize;
use shell_data::wrench::{Axes, PerAxis};
use shellcal::workflow::outliers::{NamedOutliers, OutlierReport};

use super::super::quality::table_row;
use super::super::validation::{
    ComparisonReport, FoundReport, log_ratio, print_advice, print_cross_validation,
    print_excitation, print_selection,
};
use super::dynamics::DynamicsReport;
use super::plan::NamedRows;
use super::verdict::VerdictReport;
use crate::printer::Printer;

/// What `--json` prints.
#[derive(Serialize)]
struct FitReport {
    model: String,
    verdict: VerdictReport,
    solver: StoredSolverRecord,
    #[serde(flatten)]
    counts: RowCounts,
    /// The share of test rows that were recorded at plateaus of the training data.
    #[serde(skip_serializing_if = "Option::is_none")]
    test_share_on_training_plateaus: Option<f64>,
    features: usize,
    rank: usize,
    condition: Option<f64>,
    #[serde(flatten)]
    errors: ErrorReport,
    #[serde(skip_serializing_if = "Option::is_none")]
    advice: Option<AdviceReport>,
    #[serde(skip_serializing_if = "Option::is_none")]
    groups_found: Option<FoundReport>,
    #[serde(skip_serializing_if = "Option::is_none")]
    outliers: Option<Vec<OutlierReport>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    dropped: Option<Vec<OutlierReport>>,
    excitation: Option<StoredExcitation>,
    #[serde(skip_serializing_if = "Option::is_none")]
    covariance: Option<CovarianceReport>,
    time_s: f64,
}

/// The rows of a fit.
#[derive(Serialize)]
pub(super) struct RowCounts {
    rows: u64,
    skipped_rows: u64,
    repeated_rows: u64,
    test_rows: u64,
    test_rows_out_of_range: u64,
}

/// What a fit says of its errors, whatever was fitted.
#[derive(Serialize)]
pub(super) struct ErrorReport {
    axes: Vec<&'static str>,
    train: OfAxes<StoredQuality>,
    test: Option<OfAxes<StoredQuality>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    cross_validation: Option<StoredCrossValidation>,
    #[serde(skip_serializing_if = "Option::is_none")]
    selection: Option<StoredSelection>,
    #[serde(skip_serializing_if = "Option::is_none")]
    dynamics: Option<DynamicsReport>,
    #[serde(skip_serializing_if = "Option::is_none")]
    weighing: Option<ComparisonReport>,
}

impl RowCounts {
    pub(super) fn new(fitted: &Fit, diagnostics: &Diagnostics) -> Self {
        let test = fitted.test();
        Self {
            rows: diagnostics.rows,
            skipped_rows: diagnostics.skipped_rows,
            repeated_rows: diagnostics.repeated_rows,
            test_rows: test.rows,
            test_rows_out_of_range: test.out_of_range_rows,
        }
    }
}

impl ErrorReport {
    pub(super) fn new(fitted: &Fit, diagnostics: &Diagnostics, axes: Axes) -> Self {
        Self {
            axes: axes.columns(),
            train: Stored::of(&diagnostics.train, axes),
            test: Stored::of(&diagnostics.test, axes),
            cross_validation: Stored::of(&diagnostics.cross_validation, axes),
            selection: Stored::of(&diagnostics.selection, axes),
            dynamics: DynamicsReport::from_fit(fitted, axes),
            weighing: ComparisonReport::new(fitted),
        }
    }
}

/// What held-out errors say to do.
#[derive(Serialize)]
struct AdviceReport {
    folds: usize,
    best: StoredCandidate,
    cautious: StoredCandidate,
    /// Natural logarithm of the error of the cautious choice relative to that of the best, and its standard error; zeros
    /// where they are one.
    log_ratio: [f64; 2],
    /// Whether another model predicts new groups better than the one that was fitted.
    another_is_better: bool,
    ridge_is_at_limit: bool,
}

impl AdviceReport {
    fn new(advice: &Advice, axes: Axes) -> Self {
        let caution = advice.caution.map(|of| log_ratio(of.all));
        Self {
            folds: advice.folds,
            best: Stored::of(&advice.best, axes),
            cautious: Stored::of(&advice.cautious, axes),
            log_ratio: caution.unwrap_or_default(),
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
    fn new(covariance: &Covariance, axes: Axes) -> Self {
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

/// The table of errors on training and test rows.
pub(super) fn print_errors(
    printer: &Printer,
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
    let rows = axes.iter().map(|axis| table_row(axis, &sets));
    printer.table(&header, rows)
}

/// How many rows there were, and which loads they measured.
pub(super) fn print_rows(
    printer: &Printer,
    diagnostics: &Diagnostics,
    seconds: f64,
    axes: Axes,
) -> anyhow::Result<()> {
    printer.line(format!(
        "{} rows used, {} skipped, {} repeated; {:.0} ms",
        diagnostics.rows,
        diagnostics.skipped_rows,
        diagnostics.repeated_rows,
        seconds * 1e3,
    ))?;
    match &diagnostics.excitation {
        Some(excitation) => print_excitation(printer, excitation, axes),
        None => Ok(()),
    }
}

/// The physics model beside the polynomial, where they were compared.
pub(super) fn compared(fitted: &Fit) -> Option<&ModelComparison> {
    fitted.comparison.as_ref().and_then(|found| found.as_ref().ok())
}

/// The ridge, and what it penalises: with an intercept readings are centred before powers are taken.
fn ridge(ridge: f64, intercept: bool) -> String {
    let powers = if intercept { "centred" } else { "raw" };
    match ridge > 0.0 {
        true => format!(", ridge {ridge:e} on powers of {powers} readings"),
        false => String::new(),
    }
}

pub(super) fn report(
    printer: &Printer,
    fitted: &Fit,
    file: &CalibrationFile,
    named: &NamedRows,
    seconds: f64,
) -> anyhow::Result<()> {
    let (Some(diagnostics), Some(solver), Some(solution)) =
        (&file.origin.diagnostics, file.origin.solver, fitted.solution())
    else {
        return Ok(());
    };
    let model = solution.model;
    let covariance = fitted.calibration.covariance.as_ref();
    let axes = fitted.calibration.axes;
    if printer.json() {
        return printer.document(&FitReport {
            model: model.name(),
            verdict: VerdictReport::from(&fitted.verdict()),
            solver: Stored::of(&solver, axes),
            counts: RowCounts::new(fitted, diagnostics),
            test_share_on_training_plateaus: fitted.leaks.test,
            features: model.term_count(),
            rank: diagnostics.rank,
            condition: diagnostics.condition,
            errors: ErrorReport::new(fitted, diagnostics, axes),
            advice: fitted.advice.as_ref().map(|advice| AdviceReport::new(advice, axes)),
            groups_found: fitted.found_groups.map(FoundReport::from),
            outliers: named.used.as_ref().map(NamedOutliers::report),
            dropped: named.dropped.as_ref().map(NamedOutliers::report),
            excitation: Stored::of(&diagnostics.excitation, axes),
            covariance: covariance.map(|covariance| CovarianceReport::new(covariance, axes)),
            time_s: seconds,
        });
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
    print_rows(printer, diagnostics, seconds, axes)?;
    if let Some(cross_validation) = &diagnostics.cross_validation {
        print_cross_validation(printer, cross_validation, axes)?;
    }
    if let Some(selection) = &diagnostics.selection {
        print_selection(printer, selection, compared(fitted), axes)?;
    } else if let Some(advice) = &fitted.advice {
        print_advice(printer, advice, model.basis, diagnostics.cross_validation.as_ref(), axes)?;
    }
    Ok(())
}
