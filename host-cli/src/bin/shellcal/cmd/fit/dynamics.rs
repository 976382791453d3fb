//! What `--json` says of lag and memory.

use calibration::dynamics::{Dynamics, NotSearched};
use serde::Serialize;
use shell_data::wrench::Axes;

use crate::document::document;

/// What was found, or why nothing was searched for.
pub(super) fn dynamics(of: &Result<Dynamics, NotSearched>, axes: Axes) -> impl Serialize {
    let found = of.as_ref().ok();
    let memory = found.and_then(|found| found.memory.as_ref());
    document! {
        not_searched?: of.as_ref().err().map(ToString::to_string),
        // `s` or `rows`.
        time_base?: found.map(|found| found.time_base.unit()),
        // Of the reference, in units of the time base; 0 for none.
        lag: found.and_then(|found| found.lag).map_or(0.0, |lag| lag.by),
        lag_standard_error?: found.and_then(|found| found.lag_standard_error),
        time_constants: memory.map_or(&[][..], |memory| &memory.time_constants),
        // Errors of the family that was searched on, N and N·m.
        held_out_rms?: found.and_then(|found| found.gain).map(|gain| document! {
            folds: gain.folds,
            plain: axes.of(&gain.plain),
            with_lag: axes.of(&gain.with_lag),
            with_lag_and_memory: axes.of(&gain.with_all),
        }),
    }
}
