//! What `shellcal fit` prints.

use calibration::dynamics::{Dynamics, NotSearched};
use calibration::fit::{Fit, ModelComparison, UnseenRows, Verdict};
use calibration::quality::significant;
use calibration::uncertainty::{CoefficientCovariance, Covariance};
use calibration::validation::advice::Advice;
use calibration_file::stored::{
    OfAxes, Stored, StoredCandidate, StoredCrossValidation, StoredExcitation, StoredQuality,
    StoredSelection, StoredSolverRecord,
};
use calibration_file::{CalibrationFile, Diagnostics};
use serde::Serialize;
use shell_data::wrench::{Axes, PerAxis};
use shellcal::workflow::outliers::NamedOutliers;

use super::super::quality::print_errors;
use super::super::validation::{
    comparison, groups_found, log_ratio, print_advice, print_cross_validation, print_excitation,
    print_selection,
};
use super::plan::NamedRows;
use crate::printer::Printer;

/// Prints the verdict, before all else.
pub(super) fn print_verdict(printer: &Printer, verdict: &Verdict<'_>) -> anyhow::Result<()> {
    verdict.lines().into_iter().try_for_each(|line| printer.line(line))?;
    printer.line("")
}

/// What `--json` prints of it.
pub(super) fn verdict(verdict: &Verdict<'_>) -> impl Serialize + use<> {
    let (axes, unseen) = (verdict.axes, verdict.unseen.as_ref());
    let interval = verdict.interval.as_ref().ok();
    document! {
        // The same in words.
        text: verdict.lines(),
        // Errors on rows that were not used, N and N·m.
        unseen_rms?: unseen.map(|of| axes.of(&of.rms)),
        // The same over the range of the training loads.
        unseen_share_of_range?: unseen.map(|of| axes.of(&of.share_of_range)),
        unseen_rows?: unseen.map(|of| match of.on {
            UnseenRows::HeldOut { are_shuffled: false, .. } => "held_out",
            UnseenRows::HeldOut { are_shuffled: true, .. } => "held_out_of_shuffled_rows",
            UnseenRows::Test(_) => "test",
        }),
        // Half the width of what holds 95 % of single frames, N and N·m.
        interval_95?: interval.map(|of| axes.of(&of.half_width)),
        // The share of held-out rows within it, where they were counted.
        interval_95_held?: interval.and_then(|of| of.held).map(|held| axes.of(&held)),
        usable: verdict.is_usable(),
        // Axes whose error is about as large as the loads.
        useless_axes: verdict.useless.columns(),
    }
}

/// What `--json` prints of the rows of a fit.
pub(super) fn row_counts(fitted: &Fit, diagnostics: &Diagnostics) -> impl Serialize {
    let test = fitted.test();
    document! {
        rows: diagnostics.rows,
        skipped_rows: diagnostics.skipped_rows,
        repeated_rows: diagnostics.repeated_rows,
        test_rows: test.rows,
        test_rows_out_of_range: test.out_of_range_rows,
    }
}

/// What `--json` prints of errors, whatever was fitted.
pub(super) fn errors(fitted: &Fit, of: &Diagnostics, axes: Axes) -> impl Serialize {
    document! {
        axes: axes.columns(),
        train: OfAxes::<StoredQuality>::of(&of.train, axes),
        test: Option::<OfAxes<StoredQuality>>::of(&of.test, axes),
        cross_validation?: Option::<StoredCrossValidation>::of(&of.cross_validation, axes),
        selection?: Option::<StoredSelection>::of(&of.selection, axes),
        dynamics?: fitted.dynamics.as_ref().map(|found| dynamics(found, axes)),
        weighing?: compared(fitted).map(comparison),
    }
}

/// What `--json` says of lag and memory: what was found, or why nothing was searched for.
fn dynamics(of: &Result<Dynamics, NotSearched>, axes: Axes) -> impl Serialize {
    let found = of.as_ref().ok();
    let memory = found.and_then(|found| found.memory.as_ref());
    document! {
        not_searched?: of.as_ref().err().map(ToString::to_string),
        // `s` or `rows`.
        time_base?: found.map(|found| found.time_base.unit()),
        // Of the reference, in units of the time base; 0 for none.
        lag: found.and_then(|found| found.lag).map_or(0.0, |lag| lag.by),
        lag_standard_error?: found.and_then(|found| found.lag_standard_error),
        time_constants: memory.map_or(&[][..], |memory| &memory.time_constants),
        // Errors of the family that was searched on, N and N·m.
        held_out_rms?: found.and_then(|found| found.gain).map(|gain| document! {
            folds: gain.folds,
            plain: axes.of(&gain.plain),
            with_lag: axes.of(&gain.with_lag),
            with_lag_and_memory: axes.of(&gain.with_all),
        }),
    }
}

/// What held-out errors say to do, for `--json`.
fn advice(advice: &Advice, axes: Axes) -> impl Serialize {
    document! {
        folds: advice.folds,
        best: StoredCandidate::of(&advice.best, axes),
        cautious: StoredCandidate::of(&advice.cautious, axes),
        // Natural logarithm of the error of the cautious choice relative to that of the best, and its standard error;
        // zeros where they are one.
        log_ratio: advice.caution.map(|of| log_ratio(of.all)).unwrap_or_default(),
        // Whether another model predicts new groups better than the one that was fitted.
        another_is_better: advice.another_is_better(),
        ridge_is_at_limit: advice.ridge_is_at_limit,
    }
}

/// What standard errors come from, and the covariance of the errors of a row, for `--json`.
fn covariance(covariance: &Covariance, axes: Axes) -> impl Serialize {
    let groups = match &covariance.coefficients {
        CoefficientCovariance::Groups { groups, .. } => Some(*groups),
        CoefficientCovariance::Rows { .. } => None,
    };
    let (sd, factors) = (covariance.residual_sd(), covariance.interval_factors(0.95).ok());
    let half_width =
        |factors: PerAxis<f64>| axes.of(&std::array::from_fn(|axis| factors[axis] * sd[axis]));
    document! {
        // Groups of rows; absent where rows are taken as independent.
        groups?: groups,
        degrees_of_freedom: covariance.degrees_of_freedom,
        // In products of N and N·m.
        residual: OfAxes::<OfAxes<f64>>::of(&covariance.residual, axes),
        // Half the width of a 95 % prediction interval, coefficients taken as certain, N and N·m; `null` where
        // groups are too few to tell.
        interval_95: factors.map(half_width),
    }
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
    let axes = fitted.calibration.axes;
    if printer.json() {
        return printer.document(&document! {
            model: model.name(),
            verdict: verdict(&fitted.verdict()),
            solver: StoredSolverRecord::of(&solver, axes),
            ..counts: row_counts(fitted, diagnostics),
            // The share of test rows that were recorded at plateaus of the training data.
            test_share_on_training_plateaus?: fitted.leaks.test,
            features: model.term_count(),
            rank: diagnostics.rank,
            condition: diagnostics.condition,
            ..errors: errors(fitted, diagnostics, axes),
            advice?: fitted.advice.as_ref().map(|found| advice(found, axes)),
            groups_found?: fitted.found_groups.map(groups_found),
            outliers?: named.used.as_ref().map(NamedOutliers::report),
            dropped?: named.dropped.as_ref().map(NamedOutliers::report),
            excitation: Option::<StoredExcitation>::of(&diagnostics.excitation, axes),
            covariance?: fitted.calibration.covariance.as_ref().map(|of| covariance(of, axes)),
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
