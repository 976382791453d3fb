//! Conversion of Python's option names.

use calibration::Basis;
use calibration::fit::{CovarianceRule, ModelRule};
use calibration::solver::SolverKind;

use crate::error::{PythonFailure, PythonMessage};

pub(crate) fn model(name: &str) -> Result<ModelRule, PythonFailure> {
    let names = Basis::ALL.map(Basis::name).join("`, `");
    ModelRule::from_name(name).ok_or_else(|| unknown("model", name, &format!("{names}`, `auto")))
}

pub(crate) fn solver(name: &str) -> Result<SolverKind, PythonFailure> {
    let found = SolverKind::offered().find(|solver| solver.name() == name);
    let names = SolverKind::offered().map(SolverKind::name).collect::<Vec<_>>().join("`, `");
    found.ok_or_else(|| unknown("solver", name, &names))
}

pub(crate) fn covariance(name: &str) -> Result<CovarianceRule, PythonFailure> {
    match name {
        "auto" => Ok(CovarianceRule::Auto),
        "groups" => Ok(CovarianceRule::Groups),
        "rows" => Ok(CovarianceRule::Rows),
        "none" => Ok(CovarianceRule::Nothing),
        _ => Err(unknown("covariance", name, "auto`, `groups`, `rows`, `none")),
    }
}

fn unknown(option: &str, found: &str, expected: &str) -> PythonFailure {
    let message = format!("{option} is `{found}`, expected one of `{expected}`");
    PythonMessage::new("OptionError", message).into()
}
