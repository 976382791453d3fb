//! What `shellcal fit` prints of a physics model.

use calibration::Kind;
use calibration::fit::{Fit, PhysicsFit};
use calibration::physics::{COVERAGE_LEVEL, FactorTrial, PhysicsCalibration, PhysicsValidation};
use calibration_file::CalibrationFile;
use calibration_file::stored::{Stored, StoredExcitation, StoredGroupIntervals};
use serde::Serialize;
use shell_data::wrench::{Axes, PerAxis};
use shellcal::workflow::hung_loads::HungReference;

use super::super::quality::in_line;
use super::super::validation::{FoundReport, print_cross_validation, print_selection};
use super::hung_loads::{self, HungReport};
use super::report::{ErrorReport, RowCounts, compared, print_errors, print_rows};
use super::verdict::VerdictReport;
use crate::printer::Printer;

/// What `--json` prints.
#[derive(Serialize)]
struct PhysicsReport {
    model: String,
    verdict: VerdictReport,
    #[serde(flatten)]
    counts: RowCounts,
    observations: usize,
    groups: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    groups_found: Option<FoundReport>,
    parameters: usize,
    lambda: f64,
    prior_width: f64,
    /// Factors that the sensors share.
    factors: usize,
    factors_tried: Vec<FactorsTried>,
    /// What the model's standard errors are multiplied by, from held-out groups.
    standard_error_scale: PerAxis<f64>,
    #[serde(flatten)]
    errors: ErrorReport,
    /// Median over the groups of the size of their mean error, N and N·m.
    #[serde(skip_serializing_if = "Option::is_none")]
    median_of_groups: Option<PerAxis<f64>>,
    /// Share of held-out rows within their 95 % intervals, each group with the same weight.
    #[serde(skip_serializing_if = "Option::is_none")]
    coverage_95: Option<PerAxis<f64>>,
    /// Root mean square of held-out errors in their standard errors.
    #[serde(skip_serializing_if = "Option::is_none")]
    held_out_in_standard_errors: Option<PerAxis<f64>>,
    intervals: Option<StoredGroupIntervals>,
    excitation: Option<StoredExcitation>,
    /// What was hung, and what the readings say it was.
    #[serde(skip_serializing_if = "Option::is_none")]
    hung: Option<HungReport>,
    time_s: f64,
}

#[derive(Serialize)]
struct FactorsTried {
    factors: usize,
    /// Mean gain of the log density of a held-out fold over the best of fewer.
    gain: f64,
    standard_error: f64,
}

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
    let tried = |of: &FactorTrial| {
        let FactorTrial { factors, gain, standard_error } = *of;
        FactorsTried { factors, gain, standard_error }
    };
    let coverage = of_rows.validation.as_ref().and_then(PhysicsValidation::coverage);
    if printer.json() {
        return printer.document(&PhysicsReport {
            model: file.calibration.name(),
            verdict: VerdictReport::from(&fitted.verdict()),
            counts: RowCounts::new(fitted, diagnostics),
            observations: of_rows.observations,
            groups: of_rows.groups,
            groups_found: fitted.found_groups.map(FoundReport::from),
            parameters: model.parameter_count(),
            lambda: model.lambda,
            prior_width: model.prior_width,
            factors: model.factor_count(),
            factors_tried: of_rows.choice.factor_trials.iter().map(tried).collect(),
            standard_error_scale: *physics.error_scale(),
            errors: ErrorReport::new(fitted, diagnostics, Axes::ALL),
            median_of_groups: of_rows.validation.as_ref().map(PhysicsValidation::median),
            coverage_95: coverage.map(|of| of.map(|(share, _)| share)),
            held_out_in_standard_errors: of_rows.validation.as_ref().map(PhysicsValidation::scores),
            intervals: Stored::of(&physics.intervals, Axes::ALL),
            excitation: Stored::of(&diagnostics.excitation, Axes::ALL),
            hung: hung.map(HungReport::from),
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
    if let (Some(found), Some(validation)) =
        (&diagnostics.cross_validation, of_rows.validation.as_ref())
    {
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
    tell_factors(printer, physics);
    Ok(())
}

/// Says how wide the intervals of `convert` are, with `--verbose`.
fn tell_factors(printer: &Printer, physics: &PhysicsCalibration) {
    let Some(Ok(factors)) = physics.intervals.as_ref().map(|of| of.factors(COVERAGE_LEVEL)) else {
        return;
    };
    let factors = in_line(Axes::ALL, &factors, false);
    printer.detail(format!("95 % interval in standard errors of each frame: {factors}"));
}
