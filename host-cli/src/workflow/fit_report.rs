//! A fit as one HTML file, and its figure.

use super::fit::add_to_plot;
use super::report::calibration_facts;
use calibration::FitError;
use calibration::fit::{Fit, FitMethod, FoundKind, GroupBy, group_errors, label_poses_or_files};
use calibration_file::CalibrationFile;
use figures::{FitPlot, Size, coverage_figure, fit_figure};
use report::{CalibrationReport, Heading, OutlierTable};
use shell_data::dataset::Dataset;

/// So many loads are drawn of the training rows, and as many of the test rows.
const LOADS: u64 = 600;

/// What is said of a fit beside what is in it.
#[derive(Clone, Debug)]
pub struct ReportFacts<'a> {
    /// The name of the calibration file.
    pub name: &'a str,
    /// How to make it again.
    pub command: &'a str,
    /// Suspicious rows, if they were looked for.
    pub outliers: Option<OutlierTable>,
}

/// Predictions and measurements of the rows that were used, for a figure; of the test rows if there are any.
pub fn plots(fit: &Fit) -> (FitPlot, Option<FitPlot>) {
    let plot = |data| {
        let mut plot = FitPlot::default();
        add_to_plot(&mut plot, &fit.calibration, data);
        plot
    };
    (plot(&fit.used), (!fit.tested.logs.is_empty()).then(|| plot(&fit.tested)))
}

/// The report of a fit, whose calibration file is `file`.
///
/// # Errors
/// [`FitError`] if the errors of groups cannot be found.
pub fn html(fit: &Fit, file: &CalibrationFile, facts: ReportFacts<'_>) -> Result<String, FitError> {
    let (calibration, axes) = (&file.calibration, file.calibration.axes);
    let diagnostics = file.origin.diagnostics.as_ref();
    let errors = |data: &Dataset| group_errors(calibration, data, LOADS, Default::default());
    let train = errors(&labelled(fit))?;
    let test = errors(&label_poses_or_files(&fit.tested))?;
    let title = format!("Calibration {}", calibration.name());
    let (of_train, of_test) = plots(fit);
    let advice = fit.advice.as_ref();
    let mut reasons: Vec<String> = advice.map(|advice| advice.words(axes)).into_iter().collect();
    let comparison = fit.comparison.as_ref().and_then(|found| found.as_ref().ok());
    reasons.extend(comparison.map(ToString::to_string));
    let better = fit.solution().zip(advice);
    let better = better.and_then(|(of, advice)| advice.better_words(of.model.basis, axes));
    let tested = fit.test();
    let report = CalibrationReport {
        heading: Heading {
            title: &title,
            made_by: &file.origin.made_by,
            date: &file.origin.date,
            command: facts.command,
        },
        calibration: calibration_facts(facts.name, file),
        features: fit.parameter_count(),
        rank: fit.rank(),
        has_standard_errors: calibration.has_standard_errors(),
        verdict: &fit.verdict().lines(),
        few_groups: fit.few_groups,
        selection: fit.selection.as_ref(),
        reasons: &reasons,
        warnings: &better.into_iter().collect::<Vec<_>>(),
        excitation: diagnostics.and_then(|diagnostics| diagnostics.excitation.as_ref()),
        test_rows: [tested.rows, tested.out_of_range_rows],
        train_groups: &train.groups,
        test_groups: &test.groups,
        outliers: facts.outliers,
        figure: &fit_figure(Size::Screen, &title, axes, &of_train, of_test.as_ref()),
        coverage: &coverage_figure(&train.loads, &test.loads),
    };
    Ok(report.html())
}

/// The rows that were fitted, by poses where those are known.
fn labelled(fitted: &Fit) -> Dataset {
    let has_poses = match (fitted.group_by, &fitted.method) {
        (None, _) => false,
        (Some(GroupBy::Found(found)), FitMethod::Physics(_)) => found.kind != FoundKind::Recordings,
        (Some(_), _) => true,
    };
    if has_poses { fitted.used.clone() } else { label_poses_or_files(&fitted.used) }
}
