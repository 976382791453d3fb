//! Residuals of rows that were held out of the fit, against load and time.

use super::super::markup::drawing;
use super::CalibrationReport;
use calibration::fit::{Fit, HeldOutModels};
use figures::{FitPlot, RowsName, Size, WrenchTrace, fit_figure, trace_figure};
use shell_data::dataset::LabelledBlock;
use shell_data::wrench::PerAxis;

/// The figures of a fit's held-out rows; empty without such rows.
pub(super) fn residuals(
    report: &CalibrationReport<'_>,
    models: Option<&HeldOutModels>,
    title: &str,
) -> String {
    let Some(models) = models else { return String::new() };
    let axes = report.file.calibration.axes;
    let fit = report.fit;
    // Logs have separate clocks.
    let has_time = |(_, block): (usize, &LabelledBlock)| !block.rows.time_s.is_empty();
    let is_by_row = fit.used.logs.len() > 1 || !fit.used.blocks().all(has_time);
    let (plot, trace) = plots(fit, models, is_by_row);
    let caption = "Each group of rows was converted by the model fitted without it. For each axis: predicted \
                   against measured load, the residual (predicted less measured) against the prediction, and \
                   how residuals are distributed";
    let svg = fit_figure(Size::Screen, title, axes, &plot, None).svg();
    let loads = drawing("held-out-loads", &svg, caption, caption);
    let what = if is_by_row { "rows in the order of the logs" } else { "time" };
    let caption = format!(
        "Residuals of held-out rows over {what}: steps and slopes are a zero that moved, or a reference that did"
    );
    let svg = trace_figure(Size::Screen, "Residuals of held-out rows", &trace).svg();
    loads + &drawing("held-out-time", &svg, &caption, &caption)
}

fn plots(fit: &Fit, models: &HeldOutModels, is_by_row: bool) -> (FitPlot, WrenchTrace) {
    let mut trace = if is_by_row { WrenchTrace::by_row() } else { WrenchTrace::default() };
    let mut plot = FitPlot::new(RowsName::HeldOut);
    let (mut predicted, mut rows) = (PerAxis::default(), 0);
    for (_, block) in fit.used.blocks() {
        models.wrench(block, &mut predicted);
        plot.add(&predicted, &block.rows.wrench);
        let of_axis = |axis: usize| -> Vec<f64> {
            let pairs = predicted[axis].iter().zip(&block.rows.wrench[axis]);
            let is_known = fit.calibration.axes.iter().any(|of| of.index() == axis);
            pairs.filter(|_| is_known).map(|(predicted, measured)| predicted - measured).collect()
        };
        let residuals: PerAxis<Vec<f64>> = std::array::from_fn(of_axis);
        let times = match is_by_row {
            true => (rows..rows + block.rows.rows).map(|row| row as f64).collect(),
            false => block.rows.time_s.clone(),
        };
        rows += block.rows.rows;
        trace.add(&times, &residuals);
    }
    (plot, trace)
}
