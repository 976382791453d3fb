//! Tables of values by condition, as found in publications: one row per stride or trial.

use std::collections::HashMap;
use std::hash::Hash;

use super::manifest::{CellPosition, ManifestProblem};
use super::statistics::{MeanDifference, Statistics, ValueSample};
use shell_data::hint::did_you_mean;

#[derive(Clone, Debug, PartialEq)]
pub struct ValueTable {
    pub by: String,
    /// The column whose rows with the same entry are strides of one trial.
    pub trial: Option<String>,
    pub quantities: Vec<String>,
    /// Number of empty cells in the column of each quantity. They are missing values.
    pub empty: Vec<usize>,
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
    /// `trial`, or else in `file`, are strides of one trial, which resemble each other.
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
        let mut reader = csv::ReaderBuilder::new();
        let mut reader =
            reader.trim(csv::Trim::All).comment(Some(b'#')).from_reader(text.as_bytes());
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
        let usual = |name: &str| header.iter().position(|column| column == name);
        let by = by.map_or_else(|| Ok(usual("condition").unwrap_or(0)), find)?;
        let trial = trial.map(find).or_else(|| usual("file").map(Ok)).transpose()?;
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
        let number = |field: &str| field.parse::<f64>().ok().filter(|value| value.is_finite());
        // An empty field is a missing value.
        let is_number = |column: &usize| {
            rows.iter().all(|row| row[*column].is_empty() || number(&row[*column]).is_some())
        };
        let columns = (0..header.len()).filter(|column| *column != by && Some(*column) != trial);
        let columns: Vec<usize> = columns.filter(is_number).collect();
        if let Some(text) = of.iter().flatten().find(|position| !columns.contains(position)) {
            return Err(at(1, format!("column `{}` does not hold numbers alone", header[*text])));
        }
        let columns = of.unwrap_or(columns);
        if columns.is_empty() {
            return Err(at(1, "no column holds numbers alone".to_owned()));
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
            empty: columns
                .iter()
                .map(|&column| rows.iter().filter(|row| row[column].is_empty()).count())
                .collect(),
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
        assert_eq!(error.message, "column `who` does not hold numbers alone");
        let error = ValueTable::parse("a,b\nx,1\ny\n", None, None, None).unwrap_err();
        assert_eq!(error.position.line, 3);
    }
}
