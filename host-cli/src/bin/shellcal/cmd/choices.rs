//! Models, solvers and the like as values of options, by the names that the library gives them.

use calibration::Basis;
use calibration::fit::ModelRule;
use calibration::solver::SolverKind;
use clap::ValueEnum;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};

/// Reads one of some names, each with what help says of it, if anything, and the value that it stands for.
pub(crate) fn one_of<T: Copy + Send + Sync + 'static>(
    choices: &'static [(&'static str, &'static str, T)],
) -> impl TypedValueParser<Value = T> {
    let names = choices.iter().map(|&(name, help, _)| match help {
        "" => PossibleValue::new(name),
        help => PossibleValue::new(name).help(help),
    });
    PossibleValuesParser::new(names).try_map(move |text| {
        let known = choices.iter().find(|(name, ..)| *name == text);
        known.map(|(.., value)| *value).ok_or("no such name")
    })
}

/// A family of features.
#[derive(Clone, Copy, Debug)]
pub(super) struct BasisArg(pub(super) Basis);

/// A solver.
#[derive(Clone, Copy, Debug)]
pub(super) struct SolverArg(pub(super) SolverKind);

/// A family of features, the physics model, or the best of them.
#[derive(Clone, Copy, Debug)]
pub(super) struct ModelArg(pub(super) ModelRule);

impl ValueEnum for BasisArg {
    fn value_variants<'a>() -> &'a [Self] {
        const { &wrap_bases() }
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        Some(PossibleValue::new(self.0.name()).help(self.0.description()))
    }
}

impl ValueEnum for SolverArg {
    fn value_variants<'a>() -> &'a [Self] {
        const { &wrap_solvers() }
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        Some(PossibleValue::new(self.0.name()).help(self.0.description()))
    }
}

impl ValueEnum for ModelArg {
    fn value_variants<'a>() -> &'a [Self] {
        const { &wrap_choices() }
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        match self.0 {
            ModelRule::Given(basis) => BasisArg(basis).to_possible_value(),
            ModelRule::Physics => Some(PossibleValue::new("physics").help(
                "A monotone response of each sensor to a displacement, inverted: for few poses",
            )),
            ModelRule::Auto => Some(PossibleValue::new("auto").help(
                "The smallest that predicts new groups as well as the best, with its ridge, or \
                 physics where that predicts them better",
            )),
        }
    }
}

// Iterators do not run at compile time.

const fn wrap_bases() -> [BasisArg; Basis::ALL.len()] {
    let mut wrapped = [BasisArg(Basis::ALL[0]); Basis::ALL.len()];
    let mut i = 0;
    while i < wrapped.len() {
        wrapped[i] = BasisArg(Basis::ALL[i]);
        i += 1;
    }
    wrapped
}

const fn wrap_solvers() -> [SolverArg; SolverKind::ALL.len()] {
    let mut wrapped = [SolverArg(SolverKind::ALL[0]); SolverKind::ALL.len()];
    let mut i = 0;
    while i < wrapped.len() {
        wrapped[i] = SolverArg(SolverKind::ALL[i]);
        i += 1;
    }
    wrapped
}

const fn wrap_choices() -> [ModelArg; Basis::ALL.len() + 2] {
    let mut wrapped = [ModelArg(ModelRule::Auto); Basis::ALL.len() + 2];
    wrapped[Basis::ALL.len()] = ModelArg(ModelRule::Physics);
    let mut i = 0;
    while i < Basis::ALL.len() {
        wrapped[i] = ModelArg(ModelRule::Given(Basis::ALL[i]));
        i += 1;
    }
    wrapped
}
