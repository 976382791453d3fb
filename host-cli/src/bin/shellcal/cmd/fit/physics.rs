//! What `shellcal fit` prints of a physics model.

use calibration::Kind;
use calibration::fit::{Fit, PhysicsFit};
use calibration::physics::{COVERAGE_LEVEL, FactorTrial, PhysicsValidation};
use calibration_file::CalibrationFile;
use shell_data::wrench::Axes;
use shellcal::workflow::hung_loads::HungReference;

use super::super::quality::{in_line, print_errors};
use super::super::validation::{groups_found, print_cross_validation, print_selection};
use super::hung_loads;
use super::report::{compared, errors, print_rows, row_counts, verdict};
use crate::printer::Printer;

pub(super) fn report(
    printer: &Printer,
    fitted: &Fit,
    (of_rows, hung): (&PhysicsFit, Option<&HungReference>),
    file: &CalibrationFile,
    seconds: f64,
) -> anyhow::Result<()> {
    let (Some(diagnostics), Kind::Physics(physics)) =
        (&file.origin.diagnostics, fitted.calibration.kind())
    else {
        return Ok(());
    };
    let model = physics.model();
    let validation = of_rows.validation.as_ref();
    if printer.json() {
        let tried = |of: &FactorTrial| {
            document! {
                factors: of.factors,
                // Mean gain of the log density of a held-out fold over the best of fewer.
                gain: of.gain,
                standard_error: of.standard_error,
            }
        };
        let coverage = validation.and_then(PhysicsValidation::coverage);
        return printer.document(&document! {
            model: file.calibration.name(),
            verdict: verdict(&fitted.verdict()),
            ..counts: row_counts(fitted, diagnostics),
            observations: of_rows.observations,
            groups: of_rows.groups,
            groups_found?: fitted.found_groups.map(groups_found),
            parameters: model.parameter_count(),
            lambda: model.lambda,
            prior_width: model.prior_width,
            // Factors that the sensors share.
            factors: model.factor_count(),
            factors_tried: of_rows.choice.factor_trials.iter().map(tried).collect::<Vec<_>>(),
            // What the model's standard errors are multiplied by, from held-out groups.
            standard_error_scale: physics.error_scale(),
            ..errors: errors(fitted, diagnostics, Axes::ALL),
            // Median over the groups of the size of their mean error, N and N·m.
            median_of_groups?: validation.map(PhysicsValidation::median),
            // Share of held-out rows within their 95 % intervals, each group with the same weight.
            coverage_95?: coverage.map(|of| of.map(|(share, _)| share)),
            // Root mean square of held-out errors in their standard errors.
            held_out_in_standard_errors?: validation.map(PhysicsValidation::scores),
            intervals: &physics.intervals,
            excitation: &diagnostics.excitation,
            // What was hung, and what the readings say it was.
            hung?: hung.map(hung_loads::document),
            time_s: seconds,
        });
    }
    print_errors(printer, diagnostics, Axes::ALL)?;
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
    ))?;
    print_rows(printer, diagnostics, seconds, Axes::ALL)?;
    if let (Some(found), Some(validation)) = (&diagnostics.cross_validation, validation) {
        print_cross_validation(printer, found, Axes::ALL)?;
        let medians = in_line(Axes::ALL, &validation.median(), true);
        printer.line(format!("median error of a group: {medians}"))?;
        let scores = in_line(Axes::ALL, &validation.scores(), false);
        printer.line(format!(
            "RMS of held-out errors in standard errors (1 where those are right): {scores}"
        ))?;
    }
    if let Some(selection) = &diagnostics.selection {
        print_selection(printer, selection, compared(fitted), Axes::ALL)?;
    }
    if let Some(hung) = hung {
        hung_loads::print(printer, hung)?;
    }
    // How wide the intervals of `convert` are.
    if let Some(Ok(factors)) = physics.intervals.as_ref().map(|of| of.factors(COVERAGE_LEVEL)) {
        let factors = in_line(Axes::ALL, &factors, false);
        printer.detail(format!("95 % interval in standard errors of each frame: {factors}"));
    }
    Ok(())
}
