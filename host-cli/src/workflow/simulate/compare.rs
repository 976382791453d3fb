//! Measured trials beside the model.

use std::path::Path;

use serde::Serialize;

use super::csv_columns::{CsvTable, CsvTableError};

/// The trials of one condition.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MeasuredCondition {
    /// Its name in the table.
    #[serde(rename = "condition")]
    pub name: String,
    /// Trials with a drag.
    pub trials: usize,
    /// Trials without.
    pub without_drag: usize,
    /// Mean of the trials' mean drags in N.
    pub mean_drag_n: f64,
    /// Standard deviation between trials in N; none of a single trial.
    pub sd_drag_n: Option<f64>,
}

/// Reads a table of trials, one row each, with the columns `condition` and `drag_mean_n`, in the
/// order in which the conditions appear.
///
/// # Errors
/// [`CsvTableError`] naming file, line and column.
pub fn read_trials(path: &Path) -> Result<Vec<MeasuredCondition>, CsvTableError> {
    let mut table = CsvTable::open(path)?;
    let condition = table.column(&["condition"])?;
    let drag = table.column(&["drag_mean_n"])?;
    let mut groups: Vec<(String, Vec<f64>, usize)> = Vec::new();
    while let Some(record) = table.next()? {
        let name = record.get(condition).unwrap_or_default();
        let at = groups.iter().position(|group| group.0 == name).unwrap_or_else(|| {
            groups.push((name.to_owned(), Vec::new(), 0));
            groups.len() - 1
        });
        match table.number(&record, drag)? {
            Some(drag) => groups[at].1.push(drag),
            None => groups[at].2 += 1,
        }
    }
    let conditions: Vec<MeasuredCondition> =
        groups.into_iter().filter_map(MeasuredCondition::new).collect();
    if conditions.is_empty() {
        return Err(table.empty(drag));
    }
    Ok(conditions)
}

impl MeasuredCondition {
    /// `None` if no trial has a drag.
    fn new((name, drags, without_drag): (String, Vec<f64>, usize)) -> Option<Self> {
        let trials = drags.len();
        let mean_drag_n = drags.iter().sum::<f64>() / trials as f64;
        let squares: f64 = drags.iter().map(|drag| (drag - mean_drag_n).powi(2)).sum();
        let sd_drag_n = (trials > 1).then(|| (squares / (trials as f64 - 1.0)).sqrt());
        (trials > 0).then_some(Self { name, trials, without_drag, mean_drag_n, sd_drag_n })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Vec<MeasuredCondition>, CsvTableError> {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), text).unwrap();
        read_trials(file.path())
    }

    #[test]
    fn trials_are_grouped_in_the_order_of_the_table() {
        let text = "file,condition,drag_mean_n,lift\n\
                    a,3 cm,0.12,1\nb,free,0.01,1\nc,3 cm,0.14,1\nd,3 cm,,1\n";
        let [deep, free] = &read(text).unwrap()[..] else { panic!("two conditions") };
        assert_eq!((deep.name.as_str(), deep.trials, deep.without_drag), ("3 cm", 2, 1));
        assert!((deep.mean_drag_n - 0.13).abs() < 1e-15);
        assert!((deep.sd_drag_n.unwrap() - 0.02 / 2_f64.sqrt()).abs() < 1e-15);
        assert_eq!((free.name.as_str(), free.sd_drag_n), ("free", None));
    }

    #[test]
    fn a_table_that_does_not_fit_is_named() {
        let error = |text| {
            let error = read(text).unwrap_err().to_string();
            error.split_once('`').unwrap().1.split_once('`').unwrap().1.to_owned()
        };
        let expected = ", line 1: no column `drag_mean_n`; found `condition`, `fx_n`";
        assert_eq!(error("condition,fx_n\n1 cm,2\n"), expected);
        let expected = ", line 3: `x` in column `drag_mean_n` is not a finite number";
        assert_eq!(error("condition,drag_mean_n\n1 cm,2\n1 cm,x\n"), expected);
        let expected = " has no rows with a value in column `drag_mean_n`";
        assert_eq!(error("condition,drag_mean_n\n1 cm,\n"), expected);
    }
}
