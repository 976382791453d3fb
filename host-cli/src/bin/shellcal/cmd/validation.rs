//! How held-out errors, the choice of a model and the coverage of the training loads are printed.

use calibration::Basis;
use calibration::validation::advice::Advice;
use calibration::validation::comparison::Comparison;
use calibration::validation::cross_validation::CrossValidation;
use calibration::validation::excitation::Excitation;
use calibration::validation::selection::{Candidate, Selection};
use shell_data::wrench::{Axes, Axis};
use shellcal::workflow::model_choice::HeldOut;

use super::quality::significant;
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

fn name(of: &Candidate) -> String {
    match of.ridge > 0.0 {
        true => format!("{} with ridge {:e}", of.basis.name(), of.ridge),
        false => of.basis.name().to_owned(),
    }
}

/// Which model is best on new groups, and which is the cautious choice.
pub(super) fn advice_in_words(advice: &Advice, axes: Axes) -> String {
    let score = |of: &Candidate| {
        let errors = of.errors.map(|of| [of.score, of.standard_error].map(|x| significant(x, 2)));
        errors.map_or_else(String::new, |[score, error]| format!("{score} ± {error}"))
    };
    let (best, cautious) = (&advice.best, &advice.cautious);
    let mut said = format!(
        "best on new groups: {}, squared error {} of the variance of the loads (standard error over \
         {} folds)",
        name(best),
        score(best),
        advice.folds
    );
    match &advice.caution {
        None => said += "; nothing smaller is within a standard error of it",
        Some(comparison) => {
            let all = comparison.all;
            said += &format!(
                "; cautious choice: {}, {} rather than {} features and within a standard error of the \
                 best. The larger is worth {} ± {} of the variance{}: {}",
                name(cautious),
                cautious.features,
                best.features,
                significant(all.value, 2),
                significant(all.standard_error, 2),
                if all.value > all.standard_error { "" } else { ", no more than chance" },
                worth(comparison, axes),
            );
        }
    }
    if advice.ridge_is_at_limit {
        said += "; its ridge is the largest that was tried, a larger one may be better";
    }
    said
}

/// The model that predicts new groups better than the one that was asked for, if there is one.
pub(super) fn better_in_words(advice: &Advice, model: Basis, axes: Axes) -> Option<String> {
    let given = advice.given.as_ref().filter(|_| advice.another_is_better())?;
    let best = &advice.best;
    Some(format!(
        "{} predicts new groups better than {}, by {} ± {} of the variance: {}; take `--model {}` or \
         record more poses",
        name(best),
        model.name(),
        significant(-given.all.value, 2),
        significant(given.all.standard_error, 2),
        worth(given, axes),
        best.basis.name(),
    ))
}

/// The closing word on which model to take.
pub(super) fn print_advice(
    printer: &mut Printer,
    advice: &Advice,
    model: Basis,
    cv: Option<&CrossValidation>,
    axes: Axes,
) -> anyhow::Result<()> {
    printer.line(advice_in_words(advice, axes))?;
    if let Some(better) = better_in_words(advice, model, axes) {
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

/// The errors of the second of two models and of the first.
fn worth(comparison: &Comparison, axes: Axes) -> String {
    let of = |axis: Axis| {
        let [first, second] = comparison.rms.map(|rms| significant(rms[axis.index()], 3));
        format!("{} {second} → {first} {}", axis.name(), axis.unit())
    };
    axes.iter().map(of).collect::<Vec<_>>().join(", ")
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
