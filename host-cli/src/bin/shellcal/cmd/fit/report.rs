//! Output of `shellcal fit`.

use calibration::Kind;
use calibration::dynamics::{Dynamics, NotSearched};
use calibration::fit::{Fit, FitMethod, ModelComparison, Outcome, UnseenRows, Verdict};
use calibration::physics::{COVERAGE_LEVEL, FactorTrial, PhysicsValidation};
use calibration::quality::significant;
use calibration::uncertainty::{CoefficientCovariance, Covariance};
use calibration::validation::comparison::FoldMean;
use calibration::validation::selection::Advice;
use calibration_file::Diagnostics;
use serde::Serialize;
use shell_data::by_axis::Among;
use shell_data::wrench::{Axes, PerAxis};
use shellcal::workflow::fit::FittedLogs;
use shellcal::workflow::hung_loads::HungReference;
use shellcal::workflow::outliers::NamedOutliers;

use super::super::quality::{
    in_line, print_advice, print_cross_validation, print_errors, print_excitation, print_selection,
    test_ratio,
};
use super::hung_loads;
use crate::printer::Printer;

fn verdict(verdict: &Verdict<'_>) -> impl Serialize + use<> {
    let (axes, unseen) = (verdict.axes, verdict.unseen.as_ref());
    let interval = verdict.interval.as_ref().ok();
    let test = verdict.examination().and_then(|of| of.test).map(test_ratio);
    document! {
        text: verdict.screen("").lines(),
        // True if errors are known and all checks have passed.
        ok: verdict.is_ok(),
        // Reasons why not, most important first.
        reasons: verdict.reasons(),
        // Faults of test or training rows.
        faults: verdict.examination().map(|of| of.faults.clone()).unwrap_or_default(),
        // Ratio of the error on the test to the promised error, on the axis with the largest ratio.
        test_ratio?: test,
        // Errors on rows that were not used, N and N·m.
        unseen_rms?: unseen.map(|of| axes.of(&of.rms)),
        // Factor of a possible increase in a new file, from the scatter between files.
        unseen_spread?: unseen.and_then(|of| of.spread).map(|spread| axes.of(&spread)),
        // Errors on rows that were not used, relative to the range of the training loads.
        unseen_share_of_range?: unseen.map(|of| axes.of(&of.share_of_range)),
        unseen_rows?: unseen.map(|of| match of.on {
            UnseenRows::HeldOut { are_shuffled: false, .. } => "held_out",
            UnseenRows::HeldOut { are_shuffled: true, .. } => "held_out_of_shuffled_rows",
            UnseenRows::Test(_) => "test",
        }),
        // Half-width of the interval that contains 95 % of single frames, N and N·m.
        interval_95?: interval.map(|of| axes.of(&of.half_width)),
        // Share of held-out rows within this interval, if they were counted.
        interval_95_held?: interval.and_then(|of| of.held).map(|held| axes.of(&held)),
        // Axes whose error is about as large as the loads.
        useless_axes: verdict.useless.columns(),
    }
}

/// The output of `--json` on lag and memory: the findings, or the reason for not searching.
fn dynamics(asked: &Outcome<Dynamics, NotSearched>, axes: Axes) -> Option<impl Serialize> {
    let found = asked.found();
    let memory = found.and_then(|found| found.memory.as_ref());
    let answer = document! {
        not_searched?: asked.reason().map(ToString::to_string),
        // `s` or `rows`.
        time_base?: found.map(|found| found.time_base.unit()),
        // Lag of the reference, in units of the time base; 0 for none.
        lag: found.and_then(|found| found.lag).map_or(0.0, |lag| lag.by),
        lag_standard_error?: found.and_then(|found| found.lag_standard_error),
        time_constants: memory.map_or(&[][..], |memory| &memory.time_constants),
        // Errors of the family used for the search, N and N·m.
        held_out_rms?: found.and_then(|found| found.gain).map(|gain| document! {
            folds: gain.folds,
            plain: axes.of(&gain.plain),
            with_lag: axes.of(&gain.with_lag),
            with_lag_and_memory: axes.of(&gain.with_all),
        }),
    };
    (!matches!(asked, Outcome::NotAsked)).then_some(answer)
}

fn advice(advice: &Advice, axes: Axes) -> impl Serialize {
    document! {
        advice.{folds, ridge_is_at_limit},
        best: Among(axes, &advice.best),
        cautious: Among(axes, &advice.cautious),
        // Natural logarithm of the error of the cautious choice relative to the error of the best, and its
        // standard error; zeros if they are the same.
        log_ratio: advice.caution.map(|of| log_ratio(of.all)).unwrap_or_default(),
        // True if another model predicts new groups better than the fitted one.
        another_is_better: advice.another_is_better(),
    }
}

fn covariance(covariance: &Covariance, axes: Axes) -> impl Serialize {
    let (groups, of_coefficients) = match &covariance.coefficients {
        CoefficientCovariance::Groups { groups, degrees_of_freedom, .. } => {
            (Some(*groups), degrees_of_freedom.as_ref())
        }
        CoefficientCovariance::Rows { .. } => (None, None),
    };
    let (sd, factors) = (covariance.residual_sd(), covariance.interval_factors(0.95).ok());
    let half_width =
        |factors: PerAxis<f64>| axes.of(&std::array::from_fn(|axis| factors[axis] * sd[axis]));
    document! {
        // Number of groups of rows; absent if rows are taken as independent.
        groups?: groups,
        degrees_of_freedom: covariance.degrees_of_freedom,
        // Satterthwaite's, of the variance of each coefficient; absent for independent rows or a ridge.
        coefficient_degrees_of_freedom?: of_coefficients,
        // In products of N and N·m.
        residual: axes.of(&covariance.residual.map(|row| axes.of(&row))),
        // Half-width of a 95 % prediction interval, for exactly known coefficients, N and N·m; `null` if
        // there are too few groups.
        interval_95: factors.map(half_width),
    }
}

fn compared(fitted: &Fit) -> Option<&ModelComparison> {
    fitted.comparison.found()
}

fn comparison(found: &ModelComparison) -> impl Serialize + use<> {
    let of = &found.comparison;
    document! {
        folds: found.folds,
        polynomial: found.model.name(),
        // On the same held-out rows, N and N·m.
        physics_rms: of.rms[0],
        polynomial_rms: of.rms[1],
        // Natural logarithm of the error of physics relative to the error of the polynomial, averaged over
        // all axes, and its standard error.
        log_ratio: log_ratio(of.all),
        // The logarithm for each axis.
        axes: of.axes.map(log_ratio),
        physics_is_better: found.physics_is_better(),
    }
}

/// The logarithm of a ratio, and its standard error.
fn log_ratio(ratio: FoldMean) -> [f64; 2] {
    [ratio.value, ratio.standard_error]
}

/// The ridge, and the features that it penalises: with an intercept, readings are centred before powers are taken.
fn ridge(ridge: f64, intercept: bool) -> String {
    let powers = if intercept { "centred" } else { "raw" };
    match ridge > 0.0 {
        true => format!(", ridge {ridge:e} on powers of {powers} readings"),
        false => String::new(),
    }
}

pub(super) fn report(
    printer: &Printer,
    logs: &FittedLogs,
    hung: Option<&HungReference>,
    lists_dropped: bool,
    seconds: f64,
) -> anyhow::Result<()> {
    let FittedLogs { fit: fitted, file, used, dropped, .. } = logs;
    let Some(diagnostics) = &file.origin.diagnostics else { return Ok(()) };
    let axes = fitted.calibration.axes;
    let polynomial = file.origin.solver.zip(fitted.solution());
    let polynomial = polynomial.map(|(solver, solution)| (solver, solution.model));
    let physics = match (&fitted.method, &fitted.calibration.kind) {
        (FitMethod::Physics(of_rows), Kind::Physics(physics)) => Some((of_rows, physics)),
        _ => None,
    };
    let validation = physics.and_then(|(of_rows, _)| of_rows.validation.as_ref());
    if printer.json() {
        let of_polynomial = polynomial.map(|(solver, model)| {
            document! {
                solver,
                // Share of test rows that were recorded at poses of the training data.
                test_share_on_training_plateaus?: fitted.leaks.test,
                features: model.term_count(),
                diagnostics.{rank, condition},
                advice?: fitted.advice.as_ref().map(|found| advice(found, axes)),
                outliers?: used.as_ref().map(NamedOutliers::report),
                dropped?: lists_dropped.then(|| dropped.report()),
                covariance?: fitted.calibration.covariance.as_ref().map(|of| covariance(of, axes)),
            }
        });
        let tried = |of: &FactorTrial| {
            document! {
                // Mean gain in the log density of a held-out fold over the best with fewer factors.
                of.{factors, gain, standard_error},
            }
        };
        let of_physics = physics.map(|(of_rows, physics)| {
            let (model, choice) = (physics.model(), &of_rows.choice);
            let coverage = validation.and_then(PhysicsValidation::coverage);
            document! {
                of_rows.{observations, groups},
                parameters: model.parameter_count(),
                model.{lambda, prior_width},
                // Factors that the sensors share.
                factors: model.factor_count(),
                factors_tried: choice.factor_trials.iter().map(tried).collect::<Vec<_>>(),
                // Factors on the model's standard errors, from held-out groups.
                standard_error_scale: &physics.error_scale,
                // Median over the groups of the magnitude of their mean error, N and N·m.
                median_of_groups?: validation.map(PhysicsValidation::median),
                // Share of held-out rows within their 95 % intervals, with equal weight for each group.
                coverage_95?: coverage.map(|of| of.map(|(share, _)| share)),
                // RMS of held-out errors, in their standard errors.
                held_out_in_standard_errors?: validation.map(PhysicsValidation::scores),
                intervals: Among(axes, &physics.intervals),
                // The hung loads, as stated and as corrected.
                hung?: hung.map(hung_loads::document),
            }
        });
        let (of, test) = (diagnostics, fitted.test());
        return printer.document(&document! {
            model: polynomial.map_or_else(|| file.calibration.name(), |(_, model)| model.name()),
            verdict: verdict(&fitted.verdict()),
            of.{rows, skipped_rows, repeated_rows},
            test_rows: test.rows,
            test_rows_out_of_range: test.out_of_range_rows,
            axes: axes.columns(),
            train: axes.of(&of.train),
            test: of.test.as_ref().map(|test| axes.of(test)),
            cross_validation?: of.cross_validation.as_ref().map(|of| Among(axes, of)),
            selection?: of.selection.as_ref().map(|of| Among(axes, of)),
            dynamics?: dynamics(&fitted.dynamics, axes),
            weighing?: compared(fitted).map(comparison),
            groups_found?: fitted.found_groups.map(|of| document! {
                found: of.kind.name(),
                of.{groups, rows_min, rows_median, rows_max},
            }),
            excitation: Among(axes, &of.excitation),
            ..polynomial: of_polynomial,
            ..physics: of_physics,
            time_s: seconds,
        });
    }
    print_errors(printer, diagnostics, axes);
    if let Some((solver, model)) = polynomial {
        let condition = diagnostics.condition.map_or("infinite".into(), |c| significant(c, 3));
        printer.line(format!(
            "{}{}, solver {}: rank {} of {}, condition {condition}",
            model.name(),
            ridge(solver.ridge, model.intercept),
            solver.name.name(),
            diagnostics.rank,
            model.term_count(),
        ));
    }
    if let Some((of_rows, physics)) = physics {
        let model = physics.model();
        printer.line(format!(
            "physics: {} parameters of {} sensors, fitted to {} means of {} groups; λ {}, prior width {}, \
             shared factors {}, chosen by held-out groups",
            model.parameter_count(),
            model.sensors.len(),
            of_rows.observations,
            of_rows.groups,
            model.lambda,
            model.prior_width,
            model.factor_count(),
        ));
    }
    let Diagnostics { rows, skipped_rows, repeated_rows, .. } = diagnostics;
    printer.line(format!(
        "{rows} rows used, {skipped_rows} skipped, {repeated_rows} repeated; {:.0} ms",
        seconds * 1e3,
    ));
    if let Some(excitation) = &diagnostics.excitation {
        print_excitation(printer, excitation, axes);
    }
    if let Some(cross_validation) = &diagnostics.cross_validation {
        print_cross_validation(printer, cross_validation, axes);
    }
    if let Some(validation) = validation {
        let medians = in_line(axes, &validation.median(), true);
        printer.line(format!("median error of a group: {medians}"));
        let scores = in_line(axes, &validation.scores(), false);
        printer.line(format!(
            "RMS of held-out errors in standard errors (1 where those are right): {scores}"
        ));
    }
    if let Some(selection) = &diagnostics.selection {
        print_selection(printer, selection, compared(fitted), axes);
    } else if let (Some(advice), Some((_, model))) = (&fitted.advice, polynomial) {
        print_advice(printer, advice, model.basis, diagnostics.cross_validation.as_ref(), axes);
    }
    if let Some(hung) = hung {
        hung_loads::print(printer, hung);
    }
    let intervals = physics.and_then(|(_, physics)| physics.intervals.as_ref());
    if let Some(Ok(factors)) = intervals.map(|of| of.factors(COVERAGE_LEVEL)) {
        let factors = in_line(axes, &factors, false);
        printer.detail(format!("95 % interval in standard errors of each frame: {factors}"));
    }
    Ok(())
}
