//! Tables of values by condition, as found in publications: one row per stride or trial.

use std::collections::HashMap;
use std::hash::Hash;

use super::manifest::{CellPosition, Lexed, ManifestProblem, separator};
use super::statistics::{MeanDifference, Statistics, ValueSample};
use shell_data::hint::did_you_mean;

#[derive(Clone, Debug, PartialEq)]
pub struct ValueTable {
    pub by: String,
    /// The column whose rows with the same entry are strides of one trial.
    pub trial: Option<String>,
    pub quantities: Vec<String>,
    /// Number of missing values in the column of each quantity: cells that are empty, `nan` or `NA`.
    pub missing: Vec<usize>,
    /// The first cell without a number, for each column that mostly has numbers and was not asked for.
    pub left_out: Vec<ManifestProblem>,
    /// Conditions in order of first occurrence, with one sample per quantity.
    pub conditions: Vec<(String, Vec<ValueSample>)>,
}

#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct ValueRow {
    pub condition: String,
    pub quantity: String,
    #[serde(flatten)]
    pub statistics: Statistics,
    /// `None` for the reference itself.
    pub difference: Option<MeanDifference>,
}

/// Names of the column whose rows with the same entry are strides of one trial, in order of preference.
const TRIAL_NAMES: [&str; 5] = ["file", "trial", "run", "log", "session"];

/// Groups items by key, in the order in which the keys first occur.
fn groups<T, K: Eq + Hash>(
    items: impl IntoIterator<Item = T>,
    key: impl Fn(&T) -> K,
) -> Vec<Vec<T>> {
    let mut groups: Vec<Vec<T>> = Vec::new();
    let mut positions = HashMap::new();
    for item in items {
        let position = *positions.entry(key(&item)).or_insert(groups.len());
        groups.resize_with(groups.len().max(position + 1), Vec::new);
        groups[position].push(item);
    }
    groups
}

impl ValueTable {
    /// Reads a table with a header. Conditions are in the column `by`, or else in `condition` or the first column.
    /// Values are in the columns `of`, or else in all others with only numbers. Rows with the same entry in the column
    /// `trial`, or else in the first of `file`, `trial`, `run`, `log` and `session`, are strides of one trial, which
    /// resemble each other. Fields are separated as in a manifest; with semicolons or tabs, commas may be decimal.
    ///
    /// # Errors
    /// [`ManifestProblem`] if such a column, a column of numbers, a field or any row is missing.
    pub fn parse(
        text: &str,
        by: Option<&str>,
        trial: Option<&str>,
        of: Option<&[String]>,
    ) -> Result<Self, ManifestProblem> {
        let at = |line: usize, message: String| ManifestProblem {
            position: CellPosition { line, column: 1 },
            message,
        };
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        let separator = separator(text);
        let mut reader = csv::ReaderBuilder::new();
        let reader = reader.trim(csv::Trim::All).comment(Some(b'#')).delimiter(separator);
        let mut reader = reader.from_reader(text.as_bytes());
        let line_of =
            |error: &csv::Error| error.position().map_or(1, |position| position.line() as usize);
        let header = reader.headers().map_err(|error| at(line_of(&error), error.to_string()))?;
        let header: Vec<String> = header.iter().map(str::to_owned).collect();
        let find = |name: &str| {
            header.iter().position(|column| column == name).ok_or_else(|| {
                let hint = did_you_mean(name, header.iter().map(String::as_str));
                at(1, format!("no column `{name}`{hint}"))
            })
        };
        let usual = |name: &str| header.iter().position(|column| column.eq_ignore_ascii_case(name));
        let by = by.map_or_else(|| Ok(usual("condition").unwrap_or(0)), find)?;
        let trials = TRIAL_NAMES.into_iter().filter_map(usual).filter(|column| *column != by);
        let trials: Vec<usize> = trials.collect();
        let trial = trial.map(find).transpose()?.or_else(|| trials.first().copied());
        let trial = trial.filter(|column| *column != by);
        let of = of.map(|names| names.iter().map(|name| find(name)).collect::<Result<Vec<_>, _>>());
        let of = of.transpose()?;
        let mut rows = Vec::new();
        for record in reader.records() {
            rows.push(record.map_err(|error| at(line_of(&error), error.to_string()))?);
        }
        if rows.is_empty() {
            return Err(at(1, "the table has no rows".to_owned()));
        }
        let is_missing = |field: &str| {
            ["", "nan", "na", "n/a", "-"].iter().any(|missing| field.eq_ignore_ascii_case(missing))
        };
        let number = |field: &str| {
            let with_point = (separator != b',').then(|| field.replace(',', "."));
            let number = with_point.as_deref().unwrap_or(field).parse::<f64>().ok();
            number.filter(|value| value.is_finite())
        };
        let is_fault = |field: &str| !is_missing(field) && number(field).is_none();
        let fault = |column: usize| {
            let row = rows.iter().find(|row| is_fault(&row[column]))?;
            let start = row.position().map_or(0, |position| position.byte() as usize);
            let position = Lexed::new(text, start, separator).field(column);
            let (name, cell) = (&header[column], &row[column]);
            let message = format!("`{name}` is `{cell}`, expected a number or nothing");
            Some(ManifestProblem { position, message })
        };
        if let Some(problem) = of.iter().flatten().find_map(|&column| fault(column)) {
            return Err(problem);
        }
        let is_value = |column: &usize| *column != by && Some(*column) != trial;
        let columns = (0..header.len()).filter(is_value);
        let columns = columns.filter(|column| !trials.contains(column));
        let mostly_numbers = |column: &usize| {
            let count =
                |is: &dyn Fn(&str) -> bool| rows.iter().filter(|row| is(&row[*column])).count();
            count(&|field| number(field).is_some()) > count(&is_fault)
        };
        let (columns, faulty): (Vec<usize>, Vec<usize>) =
            columns.partition(|&column| fault(column).is_none());
        let left_out = match of {
            Some(_) => Vec::new(),
            None => faulty.into_iter().filter(mostly_numbers).filter_map(fault).collect(),
        };
        let columns = of.unwrap_or(columns);
        if columns.is_empty() {
            let fault = left_out.into_iter().next();
            return Err(fault.unwrap_or_else(|| at(1, "no column holds numbers alone".to_owned())));
        }
        let conditions = groups(rows.iter().enumerate(), |(_, row)| &row[by]).into_iter();
        let conditions = conditions.map(|rows| {
            let condition = rows[0].1[by].to_owned();
            // Without names of trials, each row is a trial.
            let trials = groups(rows, |(at, row)| trial.map(|column| &row[column]).ok_or(*at));
            let sample = |&column: &usize| {
                let mut sample = ValueSample::default();
                for rows in &trials {
                    sample.add_cluster(rows.iter().filter_map(|(_, row)| number(&row[column])));
                }
                sample
            };
            (condition, columns.iter().map(sample).collect())
        });
        Ok(Self {
            by: header[by].clone(),
            trial: trial.map(|column| header[column].clone()),
            missing: columns
                .iter()
                .map(|&column| rows.iter().filter(|row| is_missing(&row[column])).count())
                .collect(),
            left_out,
            conditions: conditions.collect(),
            quantities: columns.iter().map(|&column| header[column].clone()).collect(),
        })
    }

    /// The statistics of all quantities and conditions; differences are from `reference`.
    pub fn statistics(&self, reference: Option<&str>, seed: u64) -> Vec<ValueRow> {
        let mut rows = Vec::new();
        for (at, quantity) in self.quantities.iter().enumerate() {
            let other = reference
                .and_then(|name| self.conditions.iter().find(|(condition, _)| condition == name));
            for (condition, samples) in &self.conditions {
                let Some(statistics) = samples[at].statistics(seed) else { continue };
                let other = other.filter(|(name, _)| name != condition);
                let difference = other.and_then(|(name, samples_of_other)| {
                    samples[at].difference(&samples_of_other[at], name, seed)
                });
                let (condition, quantity) = (condition.clone(), quantity.clone());
                rows.push(ValueRow { condition, quantity, statistics, difference });
            }
        }
        rows
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_of_numbers_are_grouped_by_condition_and_trial() {
        let text = "cond,run,x,who\nb,1,1,me\na,1,2,you\nb,2,5,me\nb,2,,me\n";
        let table = ValueTable::parse(text, None, Some("run"), None).unwrap();
        assert_eq!(
            (table.by.as_str(), table.quantities.as_slice()),
            ("cond", &["x".to_owned()][..])
        );
        let rows = table.statistics(Some("a"), 1);
        assert_eq!((rows[0].condition.as_str(), rows[0].statistics.mean), ("b", 3.0));
        assert_eq!(rows[0].statistics.trials, 2);
        assert_eq!(rows[0].difference.as_ref().unwrap().mean, 1.0);
        assert_eq!(rows[1].difference, None);
    }

    #[test]
    fn tables_of_a_batch_are_read_by_condition_and_file() {
        let text = "file,condition,x\n1.txt,b,1\n1.txt,b,2\n2.txt,b,4\n";
        let table = ValueTable::parse(text, None, None, None).unwrap();
        assert_eq!((table.by.as_str(), table.trial.as_deref()), ("condition", Some("file")));
        assert_eq!(table.statistics(None, 1)[0].statistics.trials, 2);
        let by_file = ValueTable::parse(text, Some("file"), None, None).unwrap();
        assert_eq!((by_file.by.as_str(), by_file.trial), ("file", None));
    }

    #[test]
    fn the_column_of_trials_is_found_by_its_name_and_holds_no_values() {
        for (header, expected) in [
            ("trial,condition,x", "trial"),
            ("Session,condition,x", "Session"),
            ("run,condition,x,log", "run"),
        ] {
            let log = if header.ends_with("log") { ",7" } else { "" };
            let text = format!("{header}\n1,b,1{log}\n1,b,2{log}\n2,b,4{log}\n");
            let table = ValueTable::parse(&text, None, None, None).unwrap();
            assert_eq!(table.trial.as_deref(), Some(expected));
            assert_eq!(table.quantities, ["x"], "{header}");
            assert_eq!(table.statistics(None, 1)[0].statistics.trials, 2);
        }
    }

    #[test]
    fn missing_values_are_counted_and_a_column_with_a_fault_is_named() {
        let text = "condition,x,y\na,1,2\na,nan,3\n\na,NA,4 mJ\na,3,5\n";
        let table = ValueTable::parse(text, None, None, None).unwrap();
        assert_eq!((&*table.quantities, &*table.missing), (&["x".to_owned()][..], &[2][..]));
        assert_eq!(table.statistics(None, 1)[0].statistics.mean, 2.0);
        let left_out: Vec<String> = table.left_out.iter().map(ToString::to_string).collect();
        assert_eq!(left_out, ["5:6: `y` is `4 mJ`, expected a number or nothing"]);
    }

    #[test]
    fn semicolons_and_decimal_commas_are_read() {
        let text = "condition;value\na;1,5\na;1,7\n";
        let table = ValueTable::parse(text, None, None, None).unwrap();
        // (1.5 + 1.7) / 2, to a rounding.
        assert!((table.statistics(None, 1)[0].statistics.mean - 1.6).abs() < 1e-15);
    }

    #[test]
    fn tables_without_values_are_refused() {
        for (text, by, message) in [
            ("a,b\n1,x\n", None, "1:1: no column holds numbers alone"),
            ("a,b\n", None, "1:1: the table has no rows"),
            ("cond,b\nx,1\n", Some("con"), "1:1: no column `con`, did you mean `cond`?"),
        ] {
            assert_eq!(ValueTable::parse(text, by, None, None).unwrap_err().to_string(), message);
        }
        let of = ["who".to_owned()];
        let error = ValueTable::parse("a,b,who\nx,1,me\n", None, None, Some(&of)).unwrap_err();
        assert_eq!(error.to_string(), "2:5: `who` is `me`, expected a number or nothing");
        let error = ValueTable::parse("a,b\nx,1\ny\n", None, None, None).unwrap_err();
        assert_eq!(error.position.line, 3);
    }
}
