//! `shellcal fit --report`: a calibration as one HTML file.

use calibration::uncertainty::{CoefficientCovariance, Covariance};
use calibration_file::CalibrationFile;
use figures::{FitPlot, Size, coverage_figure, fit_figure};
use log_file::Log;
use report::{CalibrationReport, FewGroups, Heading, Intervals, Outliers};
use shellcal::workflow;
use shellcal::workflow::eval::Evaluation;
use shellcal::workflow::group_errors::{GroupedErrors, group_errors};
use shellcal::workflow::groups::GroupBy;
use shellcal::workflow::model_choice;
use shellcal::workflow::report::{calibration_facts, group_rows};
use shellcal::workflow::selection::UsedRows;

use super::super::origin;
use super::super::outliers::rows;
use super::FitArgs;
use super::outliers::OutliersArg;

/// So many loads are drawn of the training rows, and as many of the test rows.
const LOADS: u64 = 600;

/// Intervals of this level are named.
const LEVEL: f64 = 0.95;

/// What a fit has found, beside what is in the calibration's file.
pub(super) struct Found<'a> {
    /// Features or parameters of the model.
    pub(super) features: usize,
    pub(super) intervals: Option<Intervals>,
    pub(super) few_groups: Option<model_choice::FewGroups>,
    /// Why this model.
    pub(super) reasons: Vec<String>,
    pub(super) warnings: Vec<String>,
    pub(super) outliers: Option<Outliers>,
    pub(super) plots: Option<&'a (FitPlot, FitPlot)>,
    pub(super) test: Evaluation,
    /// What the groups of the training logs are, where that is known.
    pub(super) group_by: Option<&'a GroupBy>,
}

impl FitArgs {
    /// The report of a calibration.
    pub(super) fn html(
        &self,
        file: &CalibrationFile,
        found: Found<'_>,
        (train, test): (&[Log], &[Log]),
        used: UsedRows<'_>,
    ) -> anyhow::Result<String> {
        let calibration = &file.calibration;
        let diagnostics = file.origin.diagnostics.as_ref();
        let read = self.mapping.read_options();
        let train_rows = diagnostics.map_or(0, |diagnostics| diagnostics.rows);
        let sample = (train_rows, LOADS);
        let train = group_errors(calibration, train, found.group_by, used, sample, &read)?;
        let test = match test {
            [] => GroupedErrors::default(),
            test => {
                let used = UsedRows { fresh: self.fresh, excluded: None };
                group_errors(calibration, test, None, used, (found.test.rows, LOADS), &read)?
            }
        };
        let name = self.output.as_ref().map_or("not written", |path| path.to_str().unwrap_or("?"));
        let title = format!("Calibration {}", calibration.name());
        let (of_train, of_test) = found.plots.map_or_else(Default::default, Clone::clone);
        let of_test = (!self.test.is_empty()).then_some(&of_test);
        let report = CalibrationReport {
            heading: Heading {
                title: &title,
                made_by: &file.origin.made_by,
                date: &file.origin.date,
                command: &origin::command_line(),
            },
            calibration: calibration_facts(name, file),
            features: found.features,
            rank: diagnostics.map_or(0, |diagnostics| diagnostics.rank),
            has_standard_errors: calibration.has_standard_errors(),
            intervals: found.intervals,
            few_groups: found
                .few_groups
                .map(|few| FewGroups { features: few.features, groups: few.groups }),
            selection: diagnostics.and_then(|diagnostics| diagnostics.selection.as_ref()),
            reasons: &found.reasons,
            warnings: &found.warnings,
            excitation: diagnostics.and_then(|diagnostics| diagnostics.excitation.as_ref()),
            test_rows: [found.test.rows, found.test.out_of_range_rows],
            train_groups: &group_rows(&train.groups),
            test_groups: &group_rows(&test.groups),
            outliers: found.outliers,
            figure: &fit_figure(Size::Screen, &title, file.calibration.axes, &of_train, of_test),
            coverage: &coverage_figure(&train.loads, &test.loads),
        };
        Ok(report.html())
    }

    /// What a report says of rows that do not belong: those that were left out, or were named.
    pub(super) fn outlier_rows(
        &self,
        named: Option<&workflow::outliers::Outliers>,
        dropped: &workflow::outliers::Outliers,
        logs: &[Log],
    ) -> Option<Outliers> {
        let nothing = workflow::outliers::Outliers::default();
        match self.outliers.unwrap_or(OutliersArg::Report) {
            OutliersArg::Keep => None,
            OutliersArg::Drop => Some(rows(dropped, logs, true)),
            OutliersArg::Report if !dropped.rows.is_empty() => Some(rows(dropped, logs, true)),
            OutliersArg::Report => Some(rows(named.unwrap_or(&nothing), logs, false)),
        }
    }
}

/// The intervals that a covariance gives, where it can.
pub(super) fn intervals_of(covariance: &Covariance) -> Option<Intervals> {
    let factors = covariance.interval_factors(LEVEL).ok()?;
    let sd = covariance.residual_sd();
    let (of, of_rows) = match &covariance.coefficients {
        CoefficientCovariance::Groups { groups, .. } => (format!("{groups} groups of rows"), false),
        CoefficientCovariance::Rows { .. } => ("rows taken as independent".to_owned(), true),
    };
    let half_widths = std::array::from_fn(|axis| factors[axis] * sd[axis]);
    Some(Intervals { half_widths, of, of_rows })
}
