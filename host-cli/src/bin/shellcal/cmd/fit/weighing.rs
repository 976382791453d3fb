//! What `auto` says of the physics model beside the polynomial.

use serde::Serialize;
use shell_data::wrench::{Axis, PerAxis};
use shellcal::workflow::weighing::Weighing;

use super::super::quality::significant;

/// What `--json` prints of a weighing.
#[derive(Serialize)]
pub(super) struct WeighingReport {
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

impl WeighingReport {
    pub(super) fn of(weighing: &Weighing) -> Self {
        let comparison = &weighing.comparison;
        let [physics_rms, polynomial_rms] = comparison.rms;
        Self {
            folds: weighing.folds,
            polynomial: weighing.model.name(),
            physics_rms,
            polynomial_rms,
            difference: comparison.all.value,
            standard_error: comparison.all.standard_error,
            axes: comparison.axes.map(|axis| [axis.value, axis.standard_error]),
            physics_is_better: weighing.physics_is_better(),
        }
    }
}

/// Which model `auto` takes, and why.
pub(super) fn in_words(weighing: &Weighing) -> String {
    let Weighing { model, ridge, comparison, folds } = weighing;
    let errors = |of: usize| {
        let error = |axis: Axis| {
            let rms = significant(comparison.rms[of][axis.index()], 3);
            format!("{} {rms} {}", axis.name(), axis.unit())
        };
        Axis::ALL.map(error).join(", ")
    };
    let (name, all) = (model.name(), comparison.all);
    let (difference, error) = (significant(all.value, 2), significant(all.standard_error, 2));
    let verdict = match (weighing.physics_is_better(), all.value < 0.0) {
        (true, _) => "so physics is taken".to_owned(),
        (false, true) => format!("which is no more than chance does, so {name} is kept"),
        (false, false) => format!("so {name} is kept"),
    };
    let better: Vec<&str> = (Axis::ALL.iter())
        .filter(|axis| comparison.axes[axis.index()].first_is_better())
        .map(|axis| axis.name())
        .collect();
    let where_better = match better.len() {
        0 => "on no axis by more than a standard error".to_owned(),
        6 => "on every axis by more than a standard error".to_owned(),
        _ => format!("by more than a standard error on {}", better.join(", ")),
    };
    format!(
        "on the same {folds} folds of held-out groups physics errs by {}; {name} with ridge {ridge:e} by \
         {}. The paired difference of squared errors, relative to the variance, is {difference} ± {error}, \
         {verdict}; physics is better {where_better}",
        errors(0),
        errors(1),
    )
}
