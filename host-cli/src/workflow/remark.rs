//! Remarks on a result besides its figures, worded once for all displays.

use std::fmt::Display;
use std::path::Path;

use super::selection::RowFilter;
use calibration::fit::{Fit, FoundGroups, Outcome, Warning};
use forces::stationary::ZeroMove;
use shell_data::wrench::Axes;

#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(tag = "kind", content = "text", rename_all = "snake_case")]
pub enum Remark {
    Note(String),
    Warning(String),
}

pub fn absent_axes(axes: Axes) -> Option<Remark> {
    let absent = Axes::ALL.without(axes);
    let text = || format!("the logs have no {absent}: the calibration is of {axes}");
    (!axes.are_all()).then(|| Remark::Note(text()))
}

pub fn found_groups(groups: FoundGroups) -> Remark {
    Remark::Note(format!(
        "the logs name no groups: found {groups}, and took those (`--group` names a column)",
    ))
}

/// A note on the rows of a log that were used. The counts are of all rows, of duplicates of the previous row,
/// and of bad rows.
pub fn used_rows(log: &Path, used: RowFilter, [rows, repeated, skipped]: [u64; 3]) -> Remark {
    let log = log.display();
    let used = match used {
        RowFilter::Fresh => format!("{} of {rows}", rows - repeated),
        RowFilter::All => rows.to_string(),
    };
    let mut text = format!("{log}: {used} rows used, {repeated} duplicates of the previous frame");
    if skipped > 0 {
        text += &format!(", {skipped} bad rows left out");
    }
    Remark::Note(text)
}

pub fn moved_zero(log: &Path, zero: &ZeroMove) -> Option<Remark> {
    let text = zero.in_words()?;
    Some(Remark::Warning(format!("`{}`: {text}", log.display())))
}

pub fn about_fit(fit: &Fit) -> Vec<Remark> {
    let mut remarks: Vec<Remark> = absent_axes(fit.calibration.axes).into_iter().collect();
    remarks.extend(fit.found_groups.map(found_groups));
    if let Some(means) = fit.means {
        let (groups, rows) = (means.groups, means.rows);
        let mut text = format!("a row is the mean of a group: {groups} of {rows} rows");
        if means.skipped_rows > 0 {
            text += &format!(", {} skipped", means.skipped_rows);
        }
        remarks.push(Remark::Note(text));
    }
    remarks.extend(found_or_why(&fit.dynamics, "lag and memory were not searched for"));
    remarks.extend(found_or_why(&fit.comparison, "the physics model was not compared"));
    remarks.extend(fit.warnings.iter().map(|warning| match warning {
        Warning::OutOfRange { .. } => Remark::Note(warning.to_string()),
        _ => Remark::Warning(warning.to_string()),
    }));
    if let Some(reason) = fit.outliers.reason() {
        let text = format!("some rows stand out, and were not looked at: {reason}");
        remarks.push(Remark::Note(text));
    }
    remarks
}

fn found_or_why(asked: &Outcome<impl Display, impl Display>, not_found: &str) -> Option<Remark> {
    Some(Remark::Note(match asked {
        Outcome::NotAsked => return None,
        Outcome::NotPossible(reason) => format!("{not_found}: {reason}"),
        Outcome::Found(found) => found.to_string(),
    }))
}
