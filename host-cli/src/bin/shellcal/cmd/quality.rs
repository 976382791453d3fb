//! Printing of the errors of a calibration, also on held-out groups, of the choice of a model, and of the
//! coverage of the training loads.

use calibration::Basis;
use calibration::fit::{ModelComparison, Screen, TestRatio};
use calibration::quality::{AxisQuality, significant};
use calibration::validation::cross_validation::CrossValidation;
use calibration::validation::excitation::Excitation;
use calibration::validation::selection::Advice;
use calibration::validation::selection::{Candidate, Selection};
use calibration_file::Diagnostics;
use serde::Serialize;
use shell_data::hint::quoted;
use shell_data::wrench::{Axes, Axis, PerAxis};
use shellcal::workflow::gates::Gate;

use crate::printer::{Printer, TableColumn};
use crate::tables::{NOTHING, or_dash, shown};

pub(super) fn table_row(axis: Axis, sets: &[&PerAxis<AxisQuality>]) -> Vec<String> {
    let figures: [fn(&AxisQuality) -> String; 3] = [
        |quality| significant(quality.rms, 4),
        |quality| shown(quality.max, |max| significant(max, 4)),
        |quality| shown(quality.r_squared, r_squared),
    ];
    let mut row = vec![axis.name().to_owned()];
    for figure in figures {
        row.extend(sets.iter().map(|set| figure(&set[axis.index()])));
    }
    row.push(axis.unit().to_owned());
    row
}

/// Prints a screen. If the gate does not pass, its summary replaces a headline that begins with OK.
pub(super) fn print_screen(printer: &Printer, screen: &Screen, gate: &Gate) {
    let not_kept = gate.summary().filter(|_| screen.headline.starts_with("OK"));
    let headline = not_kept.map(|what| format!("NOT OK: {what}"));
    let screen =
        Screen { headline: headline.unwrap_or_else(|| screen.headline.clone()), ..screen.clone() };
    screen.headlines().into_iter().for_each(|line| printer.line(line));
    let header: Vec<&str> = screen.header.iter().map(String::as_str).collect();
    printer.table(&header, screen.rows.iter().cloned());
    screen.note_lines().into_iter().for_each(|line| printer.line(line));
}

/// The output of `--json` for the error on a test relative to the promised error, on the axis with the largest ratio.
pub(super) fn test_ratio(of: TestRatio) -> impl Serialize {
    document! {
        axis: of.axis.column(),
        of.{ratio},
        interval_95: of.interval,
    }
}

pub(super) fn print_errors(printer: &Printer, of: &Diagnostics, axes: Axes) {
    let sets: Vec<&PerAxis<AxisQuality>> =
        [Some(&of.train), of.test.as_ref()].into_iter().flatten().collect();
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

/// R² down to the digit that distinguishes it from 1.
fn r_squared(value: f64) -> String {
    if value < 0.9999 { format!("{value:.4}") } else { format!("{value:.7}") }
}

/// The forces, then the moments, of some axes in their order, each formatted by `text`, followed by the unit.
pub(super) fn by_unit(
    values: &[(Axis, f64)],
    text: impl Fn(Axis, f64) -> String,
) -> impl Iterator<Item = String> {
    values.chunk_by(|(a, _), (b, _)| a.unit() == b.unit()).map(move |group| {
        let texts: Vec<String> = group.iter().map(|&(axis, value)| text(axis, value)).collect();
        format!("{} {}", texts.join(" "), group[0].0.unit())
    })
}

/// Values of axes in one line, as `Fx 0.12 N, Fy 0.3 N`, or without their units.
pub(super) fn in_line(axes: Axes, values: &PerAxis<f64>, with_units: bool) -> String {
    let value = |axis: Axis| {
        let unit = if with_units { format!(" {}", axis.unit()) } else { String::new() };
        format!("{} {}{unit}", axis.name(), significant(values[axis.index()], 3))
    };
    axes.iter().map(value).collect::<Vec<_>>().join(", ")
}

pub(super) fn print_cross_validation(printer: &Printer, cv: &CrossValidation, axes: Axes) {
    let ratios = cv.ratios();
    let random_rms = |axis: &Axis| cv.random.map(|random| random[axis.index()].rms);
    let columns: [TableColumn<'_, Axis>; 6] = [
        ("held out", &|axis| axis.name().to_owned()),
        ("RMS new groups", &|axis| significant(cv.grouped[axis.index()].rms, 4)),
        ("RMS random", &|axis| shown(random_rms(axis), |rms| significant(rms, 4))),
        ("ratio", &|axis| or_dash(ratios[axis.index()], 2)),
        ("bias new groups", &|axis| significant(cv.grouped[axis.index()].bias, 2)),
        ("unit", &|axis| axis.unit().to_owned()),
    ];
    printer.line("");
    printer.records(&columns, axes.iter());
    let how = match cv.folds == cv.groups {
        true => "leave-one-group-out".to_owned(),
        false => format!("{}-fold", cv.folds),
    };
    let random = match cv.random_folds {
        0 => String::new(),
        parts => format!("; for comparison, {parts} random parts of the same rows"),
    };
    let (groups, rows) = (cv.groups, cv.rows);
    printer.line(format!("{how} cross-validation ({groups} groups, {rows} rows){random}"));
    if !cv.undetermined.is_empty() {
        /// More names do not help to find the cause.
        const SHOWN: usize = 5;
        printer.warning(format!(
            "without {} of the groups the model cannot be fitted ({}{}): they are not counted",
            cv.undetermined.len(),
            quoted(cv.undetermined.iter().take(SHOWN), ", "),
            if cv.undetermined.len() > SHOWN { ", …" } else { "" },
        ));
    }
}

pub(super) fn print_advice(
    printer: &Printer,
    advice: &Advice,
    model: Basis,
    cv: Option<&CrossValidation>,
    axes: Axes,
) {
    printer.line(advice.words(axes));
    if let Some(better) = advice.better_words(model, axes) {
        printer.warning(better);
    } else if let Some((axis, ratio)) = cv.and_then(CrossValidation::suspicious) {
        printer.note(format!(
            "errors on new groups are up to {ratio:.1} times those on random rows ({}): rows of a group are correlated",
            axis.name()
        ));
    }
}

/// Prints the models that were compared, each with its best ridge, and which was chosen.
pub(super) fn print_selection(
    printer: &Printer,
    selection: &Selection,
    physics: Option<&ModelComparison>,
    axes: Axes,
) {
    let mark = |is_chosen: bool| if is_chosen { " ←" } else { "" };
    let takes_physics = physics.is_some_and(ModelComparison::physics_is_better);
    let row = |candidate: &Candidate| {
        let is_chosen = !takes_physics && *candidate == selection.candidates[selection.chosen];
        let mut row = vec![
            format!("{}{}", candidate.basis.name(), mark(is_chosen)),
            candidate.features.to_string(),
            format!("{:e}", candidate.ridge),
        ];
        match candidate.errors {
            None => row.extend(std::iter::repeat_n(NOTHING.to_owned(), axes.count())),
            Some(errors) => {
                row.extend(axes.of(&errors.rms).into_iter().map(|rms| significant(rms, 3)));
            }
        }
        row
    };
    let mut rows: Vec<Vec<String>> = best_of_each(selection).into_iter().map(row).collect();
    if let Some(found) = physics {
        let mut row =
            vec![format!("physics{}", mark(takes_physics)), NOTHING.into(), NOTHING.into()];
        row.extend(axes.of(&found.comparison.rms[0]).into_iter().map(|rms| significant(rms, 3)));
        rows.push(row);
    }
    let mut header = vec!["model", "features", "ridge"];
    header.extend(axes.iter().map(Axis::name));
    printer.line("");
    printer.table(&header, rows);
    printer.line(format!(
        "RMS on groups that were held out in {} folds, each polynomial with its best ridge; ← chosen: the fewest \
         features within one standard error of the best polynomial{}",
        selection.folds,
        match physics {
            Some(found) => format!(", or physics if it errs less in {} folds", found.folds),
            None => String::new(),
        }
    ))
}

/// The candidate of each family with the smallest error, or the chosen one for its family.
fn best_of_each(selection: &Selection) -> Vec<&Candidate> {
    let chosen = &selection.candidates[selection.chosen];
    let score = |candidate: &Candidate| candidate.errors.map_or(f64::INFINITY, |of| of.score);
    let families = selection.candidates.chunk_by(|a, b| a.basis == b.basis);
    let best = families.filter_map(|family| match family[0].basis == chosen.basis {
        true => Some(chosen),
        false => family.iter().min_by(|a, b| score(a).total_cmp(&score(b))),
    });
    best.collect()
}

pub(super) fn print_excitation(printer: &Printer, excitation: &Excitation, axes: Axes) {
    let range = |axis: Axis| {
        let of = &excitation.axes[axis.index()];
        let (min, max) = (significant(of.min, 2), significant(of.max, 2));
        format!("{} {min} … {max} {}", axis.name(), axis.unit())
    };
    printer.line(format!(
        "loads: {}; load coupling: {} (aim for less than 10)",
        axes.iter().map(range).collect::<Vec<_>>().join(", "),
        excitation.condition.map_or("infinite".to_owned(), |c| significant(c, 2)),
    ));
    for gap in excitation.gaps(axes) {
        printer.note(gap.to_string());
    }
}
