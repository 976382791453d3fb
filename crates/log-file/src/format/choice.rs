//! The selection of rows in a log, and detection of a column that distinguishes several sensors.

use super::column_name::{ColumnRef, parse_column, plain};
use crate::parse::number::parse_field;
use shell_data::Block;

#[derive(Clone, Debug, PartialEq)]
pub struct RowCondition {
    pub column: ColumnRef,
    pub comparison: Comparison,
    pub value: String,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Comparison {
    Equal,
    Unequal,
    Below,
    Above,
}

/// Parses a condition: `name=A`, `load>2` or `group!=7`.
///
/// # Errors
/// A message about the error.
pub fn parse_condition(text: &str) -> Result<RowCondition, String> {
    use Comparison::{Above, Below, Equal, Unequal};
    let marks = [("!=", Unequal), ("=", Equal), ("<", Below), (">", Above)];
    let found = marks.iter().filter_map(|(mark, of)| Some((text.find(mark)?, *mark, *of)));
    let Some((at, mark, comparison)) = found.min_by_key(|(at, ..)| *at) else {
        return Err("expected a column and a value, as in `name=A`, `load>2`".to_owned());
    };
    let value = text[at + mark.len()..].trim().to_owned();
    if matches!(comparison, Below | Above) && parse_field(value.as_bytes()).is_err() {
        return Err(format!("`{value}` is not a number, which `{mark}` compares"));
    }
    Ok(RowCondition { column: parse_column(&text[..at])?, comparison, value })
}

/// A condition with the position of its column.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct PlacedCondition {
    pub(crate) column: usize,
    pub(crate) comparison: Comparison,
    pub(crate) value: String,
}

impl PlacedCondition {
    pub(crate) fn is_met(&self, found: &str) -> bool {
        let number = |text: &str| parse_field(text.as_bytes()).ok();
        let numbers = number(found).zip(number(&self.value));
        let is_equal = found == self.value || numbers.is_some_and(|(found, value)| found == value);
        match self.comparison {
            Comparison::Equal => is_equal,
            Comparison::Unequal => !is_equal,
            Comparison::Below => numbers.is_some_and(|(found, value)| found < value),
            Comparison::Above => numbers.is_some_and(|(found, value)| found > value),
        }
    }
}

/// The number of rows that a condition removes, and the first distinct values of its column.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct ConditionTally {
    pub(crate) removed: u64,
    pub(crate) values: Vec<String>,
}

impl ConditionTally {
    /// The largest number of values that are kept for a message.
    const MOST: usize = 8;

    pub(crate) fn add(&mut self, other: Self) {
        self.removed += other.removed;
        other.values.into_iter().for_each(|value| self.add_value(&value));
    }

    fn add_value(&mut self, value: &str) {
        if self.values.len() < Self::MOST && !self.values.iter().any(|known| known == value) {
            self.values.push(value.to_owned());
        }
    }
}

/// Keeps the rows that meet all conditions. `values` are the columns of the conditions, run-length encoded. Returns a
/// tally of each condition.
pub(crate) fn keep_chosen(
    block: &mut Block,
    conditions: &[PlacedCondition],
    values: &[Vec<(String, usize)>],
) -> Vec<ConditionTally> {
    let mut is_kept = vec![true; block.rows];
    let mut tallies = vec![ConditionTally::default(); conditions.len()];
    for ((condition, runs), tally) in conditions.iter().zip(values).zip(&mut tallies) {
        let mut rows = is_kept.iter_mut();
        for (value, length) in runs {
            let is_met = condition.is_met(value);
            rows.by_ref().take(*length).for_each(|row| *row &= is_met);
            tally.removed += if is_met { 0 } else { *length as u64 };
            tally.add_value(value);
        }
    }
    let columns = std::iter::once(&mut block.time_s)
        .chain(&mut block.readings)
        .chain(&mut block.wrench)
        .chain(&mut block.others);
    for column in columns {
        let mut kept = is_kept.iter();
        column.retain(|_| kept.next().is_none_or(|is| *is));
    }
    for runs in std::iter::once(&mut block.groups).chain(&mut block.texts) {
        let mut kept = is_kept.iter();
        for (_, length) in runs.iter_mut() {
            *length = kept.by_ref().take(*length).filter(|is| **is).count();
        }
        runs.retain(|(_, length)| *length > 0);
    }
    // A removed row counts as a line between rows.
    let (mut passed, mut lines, mut rows) = (Vec::new(), 0, 0);
    let mut old = std::mem::take(&mut block.lines.passed).into_iter().peekable();
    for (row, is_kept) in is_kept.iter().enumerate() {
        while let Some((_, more)) = old.next_if(|(next, _)| *next <= row) {
            lines += more;
        }
        if !is_kept {
            lines += 1;
            continue;
        }
        if lines > 0 {
            passed.push((rows, std::mem::take(&mut lines)));
        }
        rows += 1;
    }
    block.rows = rows;
    block.lines.passed = passed;
    tallies
}

/// A column whose values distinguish the rows of several sensors that alternate.
#[derive(Clone, Debug, PartialEq)]
pub struct Interleaving {
    pub column: String,
    /// Its values in the first rows.
    pub values: Vec<String>,
}

const IDENTITIES: [&str; 8] =
    ["id", "sensorid", "deviceid", "boardid", "nodeid", "sensor", "device", "node"];

/// Names of text columns that do not identify sensors.
const REMARKS: [&str; 6] = ["flags", "note", "notes", "comment", "status", "event"];

impl Interleaving {
    /// The largest number of sensors.
    const MOST: usize = 8;

    /// Returns true if columns of this name identify sensors, even by numbers.
    pub(crate) fn is_identity(name: &str) -> bool {
        IDENTITIES.contains(&plain(name).as_str())
    }

    /// Finds a column that distinguishes sensors, among `columns` without a meaning: their names and first fields.
    pub(crate) fn find(columns: &[(&str, Vec<String>)]) -> Option<Self> {
        columns.iter().find_map(|(name, fields)| {
            let plain_name = plain(name);
            let is_text = fields
                .iter()
                .all(|field| !field.is_empty() && parse_field(field.as_bytes()).is_err());
            let changes = fields.windows(2).filter(|pair| pair[0] != pair[1]).count();
            let mut values = fields.clone();
            values.sort_unstable();
            values.dedup();
            let is_several = (2..=Self::MOST).contains(&values.len());
            let alternates = fields.len() >= 4 * values.len() && 5 * changes >= 2 * fields.len();
            let tells =
                Self::is_identity(name) || (is_text && !REMARKS.contains(&plain_name.as_str()));
            (tells && is_several && alternates).then(|| Self { column: (*name).to_owned(), values })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn conditions_compare_texts_and_numbers() {
        for (text, met, unmet) in [
            ("name=A", "A", "B"),
            ("name != A", "B", "A"),
            ("load=2", "2.0", "2.5"),
            ("load<-1.5", "-2", "-1"),
            ("load>2", "3", "x"),
        ] {
            let RowCondition { comparison, value, .. } = parse_condition(text).unwrap();
            let condition = PlacedCondition { column: 0, comparison, value };
            assert!(condition.is_met(met) && !condition.is_met(unmet), "{text}");
        }
        for text in ["name", "=A", "load<x"] {
            assert!(parse_condition(text).is_err(), "{text}");
        }
    }

    #[test]
    fn sensors_that_alternate_are_found_and_groups_are_not() {
        let column = |name: &'static str, text: &str| {
            (name, text.split(' ').map(str::to_owned).collect::<Vec<_>>())
        };
        let found = Interleaving::find(&[column("name", "A B A B A B A B")]);
        assert_eq!(found.unwrap().values, ["A", "B"]);
        assert!(Interleaving::find(&[column("id", "0 1 0 1 0 1 0 1")]).is_some());
        for other in [
            column("name", "A A A A B B B B"),
            column("flags", "A B A B A B A B"),
            column("count", "0 1 0 1 0 1 0 1"),
            column("name", "a b c d e f g h"),
        ] {
            assert_eq!(Interleaving::find(&[other]), None);
        }
    }
}
