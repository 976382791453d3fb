//! Models, solvers and other named values of options.

use std::ops::RangeBounds;

use calibration::Basis;
use calibration::fit::{CovarianceRule, ModelRule};
use calibration::solver::SolverKind;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};

/// A name, or several separated by `|` (help shows the first); its help text, if any; and its value.
type NamedChoice<T> = (&'static str, &'static str, T);

pub(crate) fn one_of<T: Copy + Send + Sync + 'static>(
    choices: &[NamedChoice<T>],
) -> impl TypedValueParser<Value = T> + use<T> {
    let choices = choices.to_vec();
    let names = choices.iter().map(|&(names, help, _)| {
        let mut names = names.split('|');
        let name = PossibleValue::new(names.next().unwrap_or_default()).aliases(names);
        if help.is_empty() { name } else { name.help(help) }
    });
    PossibleValuesParser::new(names).try_map(move |text| {
        let known = choices.iter().find(|(names, ..)| names.split('|').any(|name| name == text));
        known.map(|(.., value)| *value).ok_or("no such name")
    })
}

/// Parser for a number in a range; `expected` is the message for any other.
pub(super) fn number_in(
    range: impl RangeBounds<f64> + Clone + Send + Sync + 'static,
    expected: &'static str,
) -> impl TypedValueParser<Value = f64> {
    number_within(range, [expected; 2])
}

/// As [`number_in`], with one message for text that is no number and another for numbers outside the range.
pub(super) fn number_within(
    range: impl RangeBounds<f64> + Clone + Send + Sync + 'static,
    [no_number, outside]: [&'static str; 2],
) -> impl TypedValueParser<Value = f64> {
    move |text: &str| {
        let number = text.parse().map_err(|_| no_number)?;
        if range.contains(&number) { Ok(number) } else { Err(outside) }
    }
}

pub(super) fn numbers<const N: usize>(text: &str) -> Option<[f64; N]> {
    let number = |part: &str| part.trim().parse().ok().filter(|number: &f64| number.is_finite());
    text.split(',').map(number).collect::<Option<Vec<f64>>>()?.try_into().ok()
}

/// Parser for a solver that is offered; the message for another names a replacement.
pub(super) fn solver() -> impl TypedValueParser<Value = SolverKind> {
    let names = SolverKind::ALL.map(|solver| {
        let name = PossibleValue::new(solver.name()).help(solver.description());
        name.hide(solver.instead().is_some())
    });
    PossibleValuesParser::new(names).try_map(|name| {
        let known = SolverKind::ALL.into_iter().find(|solver| solver.name() == name);
        let solver = known.ok_or_else(|| "no such solver".to_owned())?;
        match solver.instead() {
            None => Ok(solver),
            Some(instead) => {
                Err(format!("it only judges others in tests: use `{}`", instead.name()))
            }
        }
    })
}

/// Parser for a family of features, the physics model, or `auto`.
pub(super) fn model() -> impl TypedValueParser<Value = ModelRule> {
    let bases = Basis::ALL.map(|of| (of.name(), of.description(), ModelRule::Given(of)));
    let physics = "A monotone response of each sensor to a displacement, inverted: for few poses";
    let auto = "The smallest that predicts new groups as well as the best, with its ridge, or physics \
                where that predicts them better";
    let others = [("physics", physics, ModelRule::Physics), ("auto", auto, ModelRule::Auto)];
    one_of(&[&bases[..], &others].concat())
}

pub(super) const COVARIANCES: [NamedChoice<CovarianceRule>; 4] = [
    ("auto", BY_GROUPS_OR_ROWS, CovarianceRule::Auto),
    ("groups", BY_GROUPS, CovarianceRule::Groups),
    ("rows", "Errors are independent from row to row", CovarianceRule::Rows),
    ("none", "None: a smaller calibration file, without standard errors", CovarianceRule::Nothing),
];
const BY_GROUPS_OR_ROWS: &str =
    "By the log's group column or its poses where there are ten at least, by rows otherwise";
const BY_GROUPS: &str =
    "Errors are alike within groups: those of the group column, files, or those that are found";
