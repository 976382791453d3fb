//! How held-out errors, the choice of a model and the coverage of the training loads are printed.

use calibration::Basis;
use calibration::fit::{Fit, FoundGroups, HeldOut};
use calibration::quality::significant;
use calibration::validation::advice::Advice;
use calibration::validation::cross_validation::CrossValidation;
use calibration::validation::excitation::Excitation;
use calibration::validation::selection::Selection;
use serde::Serialize;
use shell_data::wrench::{Axes, Axis, PerAxis};

use crate::printer::Printer;

pub(super) fn parse_cv(text: &str) -> Result<HeldOut, String> {
    match (text, text.parse()) {
        ("auto", _) => Ok(HeldOut::Auto),
        ("file", _) => Ok(HeldOut::File),
        ("column", _) => Ok(HeldOut::Column),
        ("plateau", _) => Ok(HeldOut::Plateaus),
        (_, Ok(folds @ 2..)) => Ok(HeldOut::Folds(folds)),
        _ => Err("expected `file`, `column`, `plateau` or a number of folds from 2 up".to_owned()),
    }
}

pub(super) fn print_cross_validation(
    printer: &mut Printer,
    cv: &CrossValidation,
    axes: Axes,
) -> anyhow::Result<()> {
    let ratios = cv.ratios();
    let rows: Vec<Vec<String>> = (axes.iter())
        .map(|axis| {
            let i = axis.index();
            let none = || "–".to_owned();
            vec![
                axis.name().to_owned(),
                significant(cv.grouped[i].rms, 4),
                cv.random.map_or_else(none, |random| significant(random[i].rms, 4)),
                ratios[i].map_or_else(none, |ratio| format!("{ratio:.2}")),
                significant(cv.grouped[i].bias, 2),
                axis.unit().to_owned(),
            ]
        })
        .collect();
    printer.line("")?;
    let header = ["held out", "RMS new groups", "RMS random", "ratio", "bias new groups", "unit"];
    printer.table(&header, &rows)?;
    let each = if cv.folds == cv.groups {
        "each alone".to_owned()
    } else {
        format!("in {} folds", cv.folds)
    };
    let beside = match cv.random_folds {
        0 => String::new(),
        folds => format!("; beside it {folds} random parts of the same rows"),
    };
    printer.line(format!("{} groups held out {each}, {} rows{beside}", cv.groups, cv.rows))?;
    if !cv.undetermined.is_empty() {
        /// More names do not help to find the cause.
        const SHOWN: usize = 5;
        let shown = cv.undetermined.iter().take(SHOWN);
        let names: Vec<String> = shown.map(|label| format!("`{label}`")).collect();
        printer.warning(format!(
            "without {} of the groups the model cannot be fitted ({}{}): they are not counted",
            cv.undetermined.len(),
            names.join(", "),
            if cv.undetermined.len() > SHOWN { ", …" } else { "" },
        ));
    }
    Ok(())
}

/// What `--json` prints of groups that were found.
#[derive(Serialize)]
pub(super) struct FoundReport {
    found: &'static str,
    groups: usize,
    rows_min: u64,
    rows_median: u64,
    rows_max: u64,
}

impl From<FoundGroups> for FoundReport {
    fn from(groups: FoundGroups) -> Self {
        let FoundGroups { kind, groups, rows_min, rows_median, rows_max } = groups;
        Self { found: kind.name(), groups, rows_min, rows_median, rows_max }
    }
}

/// Says what the groups are where nobody has named them.
pub(super) fn note_found(printer: &mut Printer, groups: FoundGroups) {
    printer.note(format!(
        "the logs name no groups: found {groups}, and took those (`--group` names a column)",
    ));
}

/// What `--json` prints of a comparison of physics and a polynomial.
#[derive(Serialize)]
pub(super) struct ComparisonReport {
    folds: usize,
    polynomial: String,
    /// On the same held-out rows, N and N·m.
    physics_rms: PerAxis<f64>,
    polynomial_rms: PerAxis<f64>,
    /// Squared errors of physics less those of the polynomial, relative to the variance, over all axes.
    difference: f64,
    standard_error: f64,
    /// The same for each axis.
    axes: PerAxis<[f64; 2]>,
    physics_is_better: bool,
}

impl ComparisonReport {
    pub(super) fn of(fit: &Fit) -> Option<Self> {
        let found = fit.comparison.as_ref()?.as_ref().ok()?;
        let comparison = &found.comparison;
        let [physics_rms, polynomial_rms] = comparison.rms;
        Some(Self {
            folds: found.folds,
            polynomial: found.model.name(),
            physics_rms,
            polynomial_rms,
            difference: comparison.all.value,
            standard_error: comparison.all.standard_error,
            axes: comparison.axes.map(|axis| [axis.value, axis.standard_error]),
            physics_is_better: found.physics_is_better(),
        })
    }
}

/// The closing word on which model to take.
pub(super) fn print_advice(
    printer: &mut Printer,
    advice: &Advice,
    model: Basis,
    cv: Option<&CrossValidation>,
    axes: Axes,
) -> anyhow::Result<()> {
    printer.line(advice.words(axes))?;
    if let Some(better) = advice.better_words(model, axes) {
        printer.warning(better);
    } else if let Some((axis, ratio)) = cv.and_then(CrossValidation::suspicious) {
        printer.note(format!(
            "the error on new groups is up to {ratio:.1} times that on random rows ({}): rows of a group \
             resemble each other, and only the figures for new groups count. More poses would help, a \
             smaller model would not",
            axis.name()
        ));
    }
    Ok(())
}

pub(super) fn print_selection(
    printer: &mut Printer,
    selection: &Selection,
    axes: Axes,
) -> anyhow::Result<()> {
    let rows: Vec<Vec<String>> = (selection.candidates.iter().enumerate())
        .map(|(i, candidate)| {
            let mark = match i {
                i if i == selection.chosen => " ←",
                i if i == selection.best => " *",
                _ => "",
            };
            let mut row = vec![
                format!("{}{mark}", candidate.basis.name()),
                candidate.features.to_string(),
                format!("{:e}", candidate.ridge),
            ];
            match candidate.errors {
                None => row.extend(std::iter::repeat_n("–".to_owned(), 2 + axes.count())),
                Some(errors) => {
                    row.push(significant(errors.score, 3));
                    row.push(significant(errors.standard_error, 2));
                    row.extend(axes.of(&errors.rms).into_iter().map(|rms| significant(rms, 3)));
                }
            }
            row
        })
        .collect();
    let mut header = vec!["model", "features", "ridge", "score", "±"];
    header.extend(axes.iter().map(Axis::name));
    printer.table(&header, &rows)?;
    printer.line(format!(
        "errors on groups held out in {} folds, score relative to the variance; ← chosen: fewest \
         features within one standard error of the best (*)",
        selection.folds
    ))?;
    printer.line("")
}

pub(super) fn print_excitation(
    printer: &mut Printer,
    excitation: &Excitation,
    axes: Axes,
) -> anyhow::Result<()> {
    let range = |axis: Axis| {
        let of = &excitation.axes[axis.index()];
        let (min, max) = (significant(of.min, 2), significant(of.max, 2));
        format!("{} {min} … {max} {}", axis.name(), axis.unit())
    };
    printer.line(format!(
        "loads: {}; condition of their correlation {}",
        axes.iter().map(range).collect::<Vec<_>>().join(", "),
        excitation.condition.map_or("infinite".to_owned(), |c| significant(c, 2)),
    ))?;
    for gap in excitation.gaps(axes) {
        printer.note(gap.to_string());
    }
    Ok(())
}
