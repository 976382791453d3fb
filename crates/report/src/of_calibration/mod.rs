//! The report of a calibration: its reliability, and its limits.

mod certificate;
mod limits;
mod residuals;

use std::fmt::Write;

pub use certificate::{Certificate, CheckedLoad, Contribution};
use limits::limits;
use residuals::residuals;

use super::markup::{
    Column, drawing, escape, facts_table, figure, folded, page, reproduction, table,
};
use super::sections::calibration::{errors_table, facts, sources_table};
use super::units::{AxisUnits, axis_names};
use super::{Heading, OutlierTable};
use calibration::fit::{
    Fit, FitMethod, FoundKind, GroupBy, GroupErrors, HeldOutModels, Workers, group_errors,
    label_poses_or_files,
};
use calibration::validation::excitation::{AxisExcitation, Excitation};
use calibration::validation::selection::Selection;
use calibration::{Calibration, FitError};
use calibration_file::CalibrationFile;
use figures::{FitPlot, Size, coverage_figure, fit_figure};
use shell_data::dataset::Dataset;
use shell_data::wrench::{Axes, Axis, PerAxis};

/// Number of groups shown at once, those with the largest errors.
const WORST: usize = 10;

/// Maximum number of groups listed, to stay readable.
const MOST_GROUPS: usize = 1000;

/// Number of loads plotted from the training rows, and as many from the test rows.
const LOADS: u64 = 600;

#[derive(Clone, Debug)]
pub struct CalibrationReport<'a> {
    pub fit: &'a Fit,
    pub file: &'a CalibrationFile,
    pub name: &'a str,
    pub command: &'a str,
    pub outliers: Option<OutlierTable>,
}

pub fn add_to_plot(plot: &mut FitPlot, calibration: &Calibration, data: &Dataset) {
    let mut predicted = PerAxis::default();
    for (_, block) in data.blocks() {
        calibration.wrench(&block.rows.readings, &mut predicted);
        plot.add(&predicted, &block.rows.wrench);
    }
}

pub fn plots(fit: &Fit) -> (FitPlot, Option<FitPlot>) {
    let plot = |data| {
        let mut plot = FitPlot::default();
        add_to_plot(&mut plot, &fit.calibration, data);
        plot
    };
    (plot(&fit.used), (!fit.tested.logs.is_empty()).then(|| plot(&fit.tested)))
}

impl CalibrationReport<'_> {
    /// # Errors
    /// [`FitError`] if the errors of groups cannot be computed.
    pub fn html(&self) -> Result<String, FitError> {
        let Self { fit, file, command, .. } = *self;
        let calibration = &file.calibration;
        let errors = |data: &Dataset| group_errors(calibration, data, LOADS, Default::default());
        let held_out = HeldOutModels::new(fit, Workers::default())?;
        let (set, train) = match &held_out {
            Some(models) => ("held out", models.errors(fit, LOADS, Workers::default())?),
            None => ("training", errors(&labelled(fit))?),
        };
        let test = errors(&label_poses_or_files(&fit.tested))?;
        let mut groups: Vec<(&str, &GroupErrors)> = Vec::new();
        groups.extend(train.groups.iter().map(|group| (set, group)));
        groups.extend(test.groups.iter().map(|group| ("test", group)));
        let title = format!("Calibration {}", calibration.name());
        let coverage_svg = coverage_figure(&train.loads, &test.loads).svg();
        let sections = [
            ("answer", "How far it can be trusted", answer(self)),
            ("limits", "What it must not be used for", list(&limits(self))),
            ("figure", "Predicted against measured", predicted(self, &title)),
            ("coverage", "Which loads were calibrated", coverage(self, &coverage_svg)),
            ("held-out", "Errors on held-out groups", residuals(self, held_out.as_ref(), &title)),
            ("groups", "By pose", by_group(&groups, calibration.axes)),
            ("model", "Which model, and why", model(self)),
            ("outliers", "Suspicious rows", outliers(self)),
            ("origin", "To make it again", reproduction(command) + &sources_table(file)),
        ];
        let (made_by, date) = (&file.origin.made_by, &file.origin.date);
        let heading = Heading { title: &title, made_by, date, command };
        Ok(page(heading, &heading.made(), &sections, None))
    }
}

/// The fitted rows, grouped by pose if poses are known.
fn labelled(fit: &Fit) -> Dataset {
    let has_poses = match (fit.group_by, &fit.method) {
        (None, _) => false,
        (Some(GroupBy::Found(found)), FitMethod::Physics(_)) => found.kind != FoundKind::Recordings,
        (Some(_), _) => true,
    };
    if has_poses { fit.used.clone() } else { label_poses_or_files(&fit.used) }
}

fn list(sentences: &[String]) -> String {
    let items: String =
        sentences.iter().map(|sentence| format!("<li>{}</li>\n", escape(sentence))).collect();
    if items.is_empty() { items } else { format!("<ul>\n{items}</ul>\n") }
}

fn answer(report: &CalibrationReport<'_>) -> String {
    let CalibrationReport { fit, file, .. } = report;
    let screen = fit.verdict().screen(report.name);
    let mut html = format!("<p><strong>{}</strong></p>\n", escape(&screen.headline));
    let columns = screen.header.iter().enumerate().map(|(at, name)| {
        let cells = screen.rows.iter().map(|row| &row[at]);
        if at == 0 { Column::text(name, cells) } else { Column::numbers(name, cells) }
    });
    html += &table("On each axis", &columns.collect::<Vec<_>>());
    let notes = screen.notes.iter().map(|(label, text)| format!("{label}: {text}"));
    html += &list(&notes.collect::<Vec<_>>());
    let better = fit.solution().zip(fit.advice.as_ref());
    let axes = file.calibration.axes;
    if let Some(warning) = better.and_then(|(of, advice)| advice.better_words(of.model.basis, axes))
    {
        let _ = writeln!(
            html,
            "<p class=\"warning\"><strong>Warning:</strong> {}</p>",
            escape(&warning)
        );
    }
    html + &errors_table(file)
}

fn predicted(report: &CalibrationReport<'_>, title: &str) -> String {
    let CalibrationReport { fit, file, .. } = report;
    let axes = file.calibration.axes;
    let test = fit.test().quality();
    let of = if test.is_some() { "test" } else { "training" };
    let caption = format!(
        "For each axis: predicted against measured load of the {of} rows, the residual (predicted less \
         measured) against the prediction, and how residuals are distributed"
    );
    let rms = |axis: Axis| {
        let rms = test.unwrap_or(fit.train)[axis.index()].rms;
        format!("{} {} {}", axis.name(), figure(rms), axis.unit())
    };
    let alt = format!("{caption}. RMS: {}", axes.iter().map(rms).collect::<Vec<_>>().join(", "));
    let (of_train, of_test) = plots(fit);
    let svg = fit_figure(Size::Screen, title, axes, &of_train, of_test.as_ref()).svg();
    drawing("predicted", &svg, &alt, &caption)
}

fn coverage(report: &CalibrationReport<'_>, svg: &str) -> String {
    let Some(excitation) = &report.fit.excitation else { return String::new() };
    let axes = report.file.calibration.axes;
    let caption = "Loads of the training rows and of the test rows, a sample of each: where it is empty, \
                   the calibration guesses";
    let range = |axis: Axis| {
        let of = &excitation.axes[axis.index()];
        format!("{} {} to {} {}", axis.name(), figure(of.min), figure(of.max), axis.unit())
    };
    let alt = format!("{caption}. {}", axes.iter().map(range).collect::<Vec<_>>().join(", "));
    let html = drawing("loads", svg, &alt, caption);
    let share = |name: &str, of: fn(&AxisExcitation) -> f64| {
        let shares = axes.iter().map(|axis| of(&excitation.axes[axis.index()]));
        Column::numbers(name, shares.map(|share| format!("{:.0}", 100.0 * share)))
    };
    let mut columns = loads(excitation, axes);
    columns.push(share("rows above zero (%)", |of| of.rows_positive));
    columns.push(share("rows below zero (%)", |of| of.rows_negative));
    let training = table("Training loads", &columns);
    let correlations = axes.iter().map(|with| {
        let values = axes.iter().map(|axis| excitation.correlation[axis.index()][with.index()]);
        let texts = values.map(|value| format!("{value:.2}").replace('-', "\u{2212}"));
        Column::numbers(with.name(), texts)
    });
    let columns: Vec<_> = [axis_names(axes)].into_iter().chain(correlations).collect();
    let correlation = table("Correlation of training loads", &columns);
    html + &training + &folded("Which loads came together", &correlation)
}

fn loads(excitation: &Excitation, axes: Axes) -> Vec<Column> {
    let range = |axis: Axis| &excitation.axes[axis.index()];
    let units = AxisUnits::new(|axis| vec![range(axis).min, range(axis).max]);
    vec![
        axis_names(axes),
        units.column("least", axes, |axis| Some(range(axis).min)),
        units.column("most", axes, |axis| Some(range(axis).max)),
        units.column("RMS", axes, |axis| Some(range(axis).rms)),
        units.units(axes),
    ]
}

fn by_group(rows: &[(&str, &GroupErrors)], axes: Axes) -> String {
    if rows.len() < 2 {
        return String::new();
    }
    let typical: Vec<f64> = axes
        .iter()
        .map(|axis| {
            let squares = rows.iter().map(|(_, row)| rms(row, axis).powi(2));
            (squares.sum::<f64>() / rows.len() as f64).sqrt().max(f64::MIN_POSITIVE)
        })
        .collect();
    let size = |row: &GroupErrors| {
        let relative = axes.iter().zip(&typical).map(|(axis, typical)| rms(row, axis) / typical);
        relative.fold(0.0, f64::max)
    };
    let mut worst = rows.to_vec();
    worst.sort_by(|a, b| size(b.1).total_cmp(&size(a.1)));
    let is_all = worst.len() <= WORST;
    worst.truncate(WORST);
    let caption = match is_all {
        true => "Errors (RMS) by group of rows, the largest first".to_owned(),
        false => format!("Errors (RMS) of the {WORST} groups of rows with the largest"),
    };
    let mut html = group_table(&caption, &worst, axes);
    if !is_all {
        let shown = &rows[..rows.len().min(MOST_GROUPS)];
        let caption = match shown.len() == rows.len() {
            true => format!("All {} groups", rows.len()),
            false => format!("The first {MOST_GROUPS} of {} groups", rows.len()),
        };
        html += &folded(&caption, &group_table(&caption, shown, axes));
    }
    html
}

fn rms(group: &GroupErrors, axis: Axis) -> f64 {
    group.errors[axis.index()].quality().map_or(f64::NAN, |quality| quality.rms)
}

fn group_table(caption: &str, groups: &[(&str, &GroupErrors)], axes: Axes) -> String {
    let rows = || groups.iter().map(|(_, row)| *row);
    let units = |of: fn(&GroupErrors, Axis) -> f64| {
        AxisUnits::new(|axis| rows().map(|row| of(row, axis)).collect())
    };
    let (errors, loads) = (units(rms), units(|row, axis| row.load[axis.index()]));
    let load = |row: &GroupErrors| {
        let values = axes.iter().map(|axis| loads.of(axis).value(Some(row.load[axis.index()])));
        values.collect::<Vec<_>>().join(" ")
    };
    let mut columns = vec![
        Column::text("data", groups.iter().map(|(set, _)| set)),
        Column::text("group", rows().map(|row| &row.label)),
        Column::numbers("rows", rows().map(|row| row.rows)),
    ];
    columns.extend(axes.iter().map(|axis| {
        let unit = errors.of(axis);
        let values = rows().map(|row| unit.value(Some(rms(row, axis))));
        Column::numbers(&unit.name(axis.name()), values)
    }));
    let [force, moment] = [Axis::Fx, Axis::Mx].map(|axis| &loads.of(axis).unit);
    columns.push(Column::text(&format!("mean load ({force}; {moment})"), rows().map(load)));
    table(caption, &columns)
}

fn model(report: &CalibrationReport<'_>) -> String {
    let CalibrationReport { fit, file, name, .. } = report;
    let mut html = facts_table("The calibration", &facts(name, file));
    let advice = fit.advice.as_ref().map(|advice| advice.words(file.calibration.axes));
    let comparison = fit.comparison.found().map(ToString::to_string);
    let reasons = advice.into_iter().chain(comparison);
    html += &list(&reasons.collect::<Vec<_>>());
    if let Some(selection) = &fit.selection {
        html += &folded("Models that were compared", &compared(selection));
    }
    html
}

fn compared(selection: &Selection) -> String {
    let candidates = || selection.candidates.iter();
    let score = candidates().map(|candidate| candidate.errors.map(|errors| errors.score));
    let error = candidates().map(|candidate| candidate.errors.map(|errors| errors.standard_error));
    let note = |at| match at {
        at if at == selection.chosen => "chosen",
        at if at == selection.best => "best",
        _ => "",
    };
    let columns = [
        Column::text("model", candidates().map(|candidate| candidate.basis.name())),
        Column::numbers("features", candidates().map(|candidate| candidate.features)),
        Column::figures("ridge", candidates().map(|candidate| candidate.ridge)),
        Column::figures("squared error of the variance", score),
        Column::figures("± standard error", error),
        Column::text("note", (0..candidates().len()).map(note)),
    ];
    table("Errors on groups that were held out", &columns)
}

fn outliers(report: &CalibrationReport<'_>) -> String {
    let Some(outliers) = &report.outliers else { return String::new() };
    let done = if outliers.left_out { "were left out" } else { "were used all the same" };
    outliers
        .html(&format!("{} rows are suspicious, and {done}.", outliers.count), "Suspicious rows")
}
