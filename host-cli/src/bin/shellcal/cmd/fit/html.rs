//! `shellcal fit --report`: a calibration as one HTML file.

use calibration::fit::{Fit, FitMethod, FoundKind, GroupBy, group_errors, label_poses_or_files};
use calibration_file::CalibrationFile;
use figures::{Size, coverage_figure, fit_figure};
use report::{CalibrationReport, FewGroups, Heading, OutlierTable};
use shell_data::dataset::Dataset;
use shellcal::workflow::report::{calibration_facts, group_rows};

use super::super::origin;
use super::OutliersArg;
use super::plan::{FitPlan, Told};

/// So many loads are drawn of the training rows, and as many of the test rows.
const LOADS: u64 = 600;

impl FitPlan<'_> {
    /// The report of a calibration.
    pub(super) fn html(
        &self,
        file: &CalibrationFile,
        fitted: &Fit,
        told: &Told,
    ) -> anyhow::Result<String> {
        let (calibration, axes) = (&file.calibration, file.calibration.axes);
        let diagnostics = file.origin.diagnostics.as_ref();
        let errors = |data: &Dataset| group_errors(calibration, data, LOADS, Default::default());
        let train = errors(&labelled(fitted))?;
        let test = errors(&label_poses_or_files(&fitted.tested))?;
        let output = self.args.output.as_ref();
        let name = output.map_or("not written", |path| path.to_str().unwrap_or("?"));
        let title = format!("Calibration {}", calibration.name());
        let (of_train, of_test) = self.plots(fitted);
        let advice = fitted.advice.as_ref();
        let mut reasons: Vec<String> =
            advice.map(|advice| advice.words(axes)).into_iter().collect();
        let comparison = fitted.comparison.as_ref().and_then(|found| found.as_ref().ok());
        reasons.extend(comparison.map(ToString::to_string));
        let better = fitted.solution().zip(advice);
        let better = better.and_then(|(of, advice)| advice.better_words(of.model.basis, axes));
        let tested = fitted.test();
        let report = CalibrationReport {
            heading: Heading {
                title: &title,
                made_by: &file.origin.made_by,
                date: &file.origin.date,
                command: &origin::command_line(),
            },
            calibration: calibration_facts(name, file),
            features: fitted.parameter_count(),
            rank: fitted.rank(),
            has_standard_errors: calibration.has_standard_errors(),
            verdict: &fitted.verdict().lines(),
            few_groups: fitted
                .few_groups
                .map(|few| FewGroups { features: few.features, groups: few.groups }),
            selection: fitted.selection.as_ref(),
            reasons: &reasons,
            warnings: &better.into_iter().collect::<Vec<_>>(),
            excitation: diagnostics.and_then(|diagnostics| diagnostics.excitation.as_ref()),
            test_rows: [tested.rows, tested.out_of_range_rows],
            train_groups: &group_rows(&train.groups),
            test_groups: &group_rows(&test.groups),
            outliers: self.outlier_rows(told),
            figure: &fit_figure(Size::Screen, &title, axes, &of_train, of_test.as_ref()),
            coverage: &coverage_figure(&train.loads, &test.loads),
        };
        Ok(report.html())
    }

    /// What a report says of outliers: those that were left out, or were named.
    fn outlier_rows(&self, told: &Told) -> Option<OutlierTable> {
        let Told { named, dropped } = told;
        let dropped = dropped.as_ref().map(|dropped| dropped.rows(true));
        match self.args.outliers.unwrap_or(OutliersArg::Report) {
            OutliersArg::Keep => None,
            OutliersArg::Drop => dropped,
            OutliersArg::Report => dropped
                .filter(|dropped| dropped.count > 0)
                .or_else(|| named.as_ref().map(|named| named.rows(false)))
                .or_else(|| Some(OutlierTable::default())),
        }
    }
}

/// The rows that were fitted, by poses where those are known.
fn labelled(fitted: &Fit) -> Dataset {
    match fitted.group_by {
        Some(GroupBy::Found(found)) if found.kind == FoundKind::Recordings => {
            match &fitted.method {
                FitMethod::Polynomial { .. } => fitted.used.clone(),
                FitMethod::Physics(_) => label_poses_or_files(&fitted.used),
            }
        }
        Some(_) => fitted.used.clone(),
        None => label_poses_or_files(&fitted.used),
    }
}
