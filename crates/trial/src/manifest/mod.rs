//! Manifests: lists of trials, in CSV or TOML.
//!
//! ```csv
//! file,condition,t_enter_s,t_exit_s,velocity_m_s,mass_kg,channel_length_m,notes,exclude
//! logs/run1.txt,3 cm,4.2,8.9,,,,,
//! logs/run2.txt,3 cm,auto,auto,,0.091,,new battery,
//! logs/run3.txt,2 cm,3.1,6.0,,,,fell over,yes
//! ```
//!
//! The first four columns are required. TOML has a table `[[trial]]` with the same keys for each trial. An optional
//! `conditions = ["free", "3 cm"]` lists the allowed conditions.

mod csv;
mod faults;

pub(crate) use self::csv::{Lexed, separator};

use std::collections::BTreeMap;
use std::fmt;
use std::ops::Range;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use toml::{Spanned, Value};

use crate::Trial;
use shell_data::hint::did_you_mean;

#[derive(Clone, Debug, Default, PartialEq)]
pub struct Manifest {
    pub rows: Vec<Result<Entry, ManifestProblem>>,
    pub conditions: Option<Vec<String>>,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    pub position: CellPosition,
    /// The trial without its times. Its log is relative to the manifest's folder.
    pub trial: Trial,
    pub file_position: CellPosition,
    pub condition_position: CellPosition,
    /// Entry, s on the log's clock; `None` if it is to be found from the forces.
    pub enter: Placed<Option<f64>>,
    pub exit: Placed<Option<f64>>,
    pub exclude: bool,
}

/// A line and a column of a manifest or a profile, from 1; columns in characters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub struct CellPosition {
    pub line: usize,
    pub column: usize,
}

impl CellPosition {
    const START: Self = Self { line: 1, column: 1 };

    fn of_byte(text: &str, byte: usize) -> Self {
        let before = text.get(..byte).unwrap_or(text);
        let line_start = before.rfind('\n').map_or(0, |at| at + 1);
        let column = 1 + before[line_start..].chars().count();
        Self { line: 1 + before.matches('\n').count(), column }
    }
}

impl fmt::Display for CellPosition {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}", self.line, self.column)
    }
}

#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{position}: {message}")]
pub struct ManifestProblem {
    pub position: CellPosition,
    pub message: String,
}

impl ManifestProblem {
    fn new(position: CellPosition, message: String) -> Self {
        Self { position, message }
    }

    pub(crate) fn at(text: &str, byte: usize, message: String) -> Self {
        Self { position: CellPosition::of_byte(text, byte), message }
    }

    pub(crate) fn at_key(text: &str, table: &str, key: &str, message: String) -> Self {
        let header = text.find(&format!("[{table}]")).unwrap_or(0);
        let byte = header + text[header..].find(key).unwrap_or(0);
        Self::at(text, byte, message)
    }
}

pub(crate) fn parse_toml<T: DeserializeOwned>(text: &str) -> Result<T, ManifestProblem> {
    toml::from_str(text).map_err(|error| {
        let byte = error.span().map_or(0, |span| span.start);
        // On one line, as all messages are.
        ManifestProblem::at(text, byte, error.message().replace('\n', ", "))
    })
}

#[derive(Clone, Debug, PartialEq)]
pub struct Placed<T> {
    pub value: T,
    pub position: CellPosition,
}

type Cells<'a> = BTreeMap<&'a str, Placed<String>>;

/// Keys of a trial. The first four are required.
const KEYS: [&str; 9] = [
    "file",
    "condition",
    "t_enter_s",
    "t_exit_s",
    "velocity_m_s",
    "mass_kg",
    "channel_length_m",
    "notes",
    "exclude",
];

/// Says what an unknown key of a trial should be. One that differs in its unit only asks for other numbers, too.
fn hint_for(key: &str) -> String {
    const UNITS: [(&str, &str, &str); 6] = [
        ("t_enter", "t_enter_s", "s"),
        ("t_exit", "t_exit_s", "s"),
        ("velocity", "velocity_m_s", "m/s"),
        ("mass", "mass_kg", "kg"),
        ("channel_length", "channel_length_m", "m"),
        ("length", "channel_length_m", "m"),
    ];
    let is_of = |stem: &str| {
        key.strip_prefix(stem).is_some_and(|unit| !unit.starts_with(char::is_alphanumeric))
    };
    match UNITS.iter().find(|(stem, ..)| is_of(stem)) {
        Some((_, name, unit)) => format!(": convert its values to {unit}, and call it `{name}`"),
        None => did_you_mean(key, KEYS),
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct TomlManifest {
    conditions: Option<Vec<String>>,
    #[serde(default)]
    trial: Vec<Spanned<BTreeMap<String, Spanned<Value>>>>,
}

impl Manifest {
    /// Reads a manifest: TOML if `is_toml`, otherwise CSV.
    ///
    /// # Errors
    /// [`ManifestProblem`] if the text is not TOML, lacks trials or columns, or has unknown columns. The problem of a
    /// single trial is in its row.
    pub fn parse(text: &str, is_toml: bool) -> Result<Self, ManifestProblem> {
        let manifest = if is_toml { Self::from_toml(text)? } else { csv::parse(text)? };
        if manifest.rows.is_empty() {
            let message = "the manifest has no trials".to_owned();
            return Err(ManifestProblem::new(CellPosition::START, message));
        }
        Ok(manifest)
    }

    fn from_toml(text: &str) -> Result<Self, ManifestProblem> {
        let TomlManifest { conditions, trial: trials } = parse_toml(text)?;
        let row = |trial: &Spanned<BTreeMap<String, Spanned<Value>>>| {
            let mut cells = Cells::new();
            for (key, value) in trial.get_ref() {
                let position = CellPosition::of_byte(text, value.span().start);
                let refused = |message| Err(ManifestProblem::new(position, message));
                if !KEYS.contains(&key.as_str()) {
                    return refused(format!("unknown key `{key}`{}", hint_for(key)));
                }
                let value = match value.get_ref() {
                    Value::String(text) => text.trim().to_owned(),
                    Value::Integer(number) => number.to_string(),
                    Value::Float(number) => number.to_string(),
                    Value::Boolean(flag) => flag.to_string(),
                    _ => return refused(format!("`{key}` is no single value")),
                };
                cells.insert(key, Placed { value, position });
            }
            Entry::new(CellPosition::of_byte(text, trial.span().start), cells)
        };
        Ok(Self { rows: trials.iter().map(row).collect(), conditions })
    }
}

impl Entry {
    /// Parses the cells; empty cells count as absent.
    fn new(position: CellPosition, mut cells: Cells<'_>) -> Result<Self, ManifestProblem> {
        cells.retain(|_, cell| !cell.value.is_empty());
        let text = |key: &str| {
            let missing = || ManifestProblem::new(position, format!("`{key}` is missing"));
            cells.get(key).cloned().ok_or_else(missing)
        };
        let moment = |key: &str| {
            let cell = text(key)?;
            let value = cell.read(key, "a time in s or `auto`", |text| match text.parse::<f64>() {
                _ if text.eq_ignore_ascii_case("auto") => Some(None),
                Ok(time) if time.is_finite() => Some(Some(time)),
                _ => None,
            });
            Ok(Placed { value: value?, position: cell.position })
        };
        let positive = |key: &str| {
            let number = |text: &str| text.parse().ok().filter(|&x: &f64| x > 0.0 && x.is_finite());
            let cell = cells.get(key);
            cell.map(|cell| cell.read(key, "a positive number", number)).transpose()
        };
        let flag = |cell: &Placed<String>| {
            cell.read("exclude", "`yes`, `no` or nothing", |text| {
                match text.to_ascii_lowercase().as_str() {
                    "yes" | "true" | "x" | "1" => Some(true),
                    "no" | "false" | "0" => Some(false),
                    _ => None,
                }
            })
        };
        let (file, condition) = (text("file")?, text("condition")?);
        let entry = Self {
            position,
            file_position: file.position,
            condition_position: condition.position,
            enter: moment("t_enter_s")?,
            exit: moment("t_exit_s")?,
            trial: Trial {
                file: file.value,
                condition: condition.value,
                velocity_m_s: positive("velocity_m_s")?,
                mass_kg: positive("mass_kg")?,
                channel_length_m: positive("channel_length_m")?,
                notes: cells.get("notes").map(|notes| notes.value.clone()),
                ..Trial::default()
            },
            exclude: cells.get("exclude").map_or(Ok(false), flag)?,
        };
        if let (Some(enter), Some(exit)) = (entry.enter.value, entry.exit.value)
            && exit <= enter
        {
            let message = format!("the exit at `{exit}` s is not after the entry at `{enter}` s");
            return Err(ManifestProblem::new(entry.exit.position, message));
        }
        Ok(entry)
    }
}

impl Placed<String> {
    /// Parses the value with `meaning`. The problem of an invalid text says what is `expected`.
    fn read<T>(
        &self,
        key: &str,
        expected: &str,
        meaning: impl Fn(&str) -> Option<T>,
    ) -> Result<T, ManifestProblem> {
        let is_number = |text: &str| text.parse::<f64>().is_ok();
        let has_comma = !is_number(&self.value) && is_number(&self.value.replace(',', "."));
        let comma = if has_comma { ", with a decimal point in place of the comma" } else { "" };
        let refused = || format!("`{key}` is `{}`, expected {expected}{comma}", self.value);
        meaning(&self.value).ok_or_else(|| ManifestProblem::new(self.position, refused()))
    }
}

/// One of several shares of consecutive rows, which together make up the whole.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    number: usize,
    of: usize,
}

impl Shard {
    /// The largest number of shares, so that their names sort by number.
    pub const MOST: usize = 99_999;

    /// Share `number`, from 1, of `of`; `None` if the number is out of range, or there are too many shares.
    pub fn new(number: usize, of: usize) -> Option<Self> {
        (1 <= number && number <= of && of <= Self::MOST).then_some(Self { number, of })
    }

    /// The part of this share in a number of rows; sizes differ by at most one row.
    pub fn rows(self, rows: usize) -> Range<usize> {
        let end = |number: usize| (rows as u128 * number as u128 / self.of as u128) as usize;
        end(self.number - 1)..end(self.number)
    }

    /// File name without an extension. Names sort in the order of the shares.
    pub fn stem(self) -> String {
        format!("part-{:05}-of-{:05}", self.number, self.of)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn trials_are_tables_and_problems_have_places() {
        let text = r#"
conditions = ["free", "3"]

[[trial]]
file = "a.txt"
condition = 3
t_enter_s = 1
t_exit_s = 2.5
exclude = true

[[trial]]
file = "b.txt"
condition = "free"
t_enter_s = "auto"
t_exit_s = "soon"

[[trial]]
file = "b.txt"
conditon = "free"
"#;
        let manifest = Manifest::parse(text, true).unwrap();
        let first = manifest.rows[0].clone().unwrap();
        assert_eq!((first.trial.condition.as_str(), first.exclude), ("3", true));
        assert_eq!(first.exit.value, Some(2.5));
        assert_eq!(first.exit.position, CellPosition { line: 8, column: 12 });
        let problem = |row: usize| manifest.rows[row].clone().unwrap_err().to_string();
        assert_eq!(problem(1), "15:12: `t_exit_s` is `soon`, expected a time in s or `auto`");
        assert_eq!(problem(2), "19:12: unknown key `conditon`, did you mean `condition`?");
        assert_eq!(manifest.conditions, Some(vec!["free".to_owned(), "3".to_owned()]));
        let error = Manifest::parse("trials = 3", true).unwrap_err().to_string();
        assert!(error.starts_with("1:1: unknown field `trials`"), "{error}");
    }

    #[test]
    fn shares_are_even_and_partition_the_trials_in_order() {
        for (rows, of) in [(0, 3), (2, 5), (25, 4), (1000, 7), (5, 5), (3, 1)] {
            let shards: Vec<Shard> = (1..=of).map(|k| Shard::new(k, of).unwrap()).collect();
            let parts = shards.iter().flat_map(|shard| shard.rows(rows));
            assert_eq!(parts.collect::<Vec<_>>(), (0..rows).collect::<Vec<_>>());
            let sizes = || shards.iter().map(|shard| shard.rows(rows).len());
            assert!(sizes().max().unwrap() - sizes().min().unwrap() <= 1);
            assert!(shards.iter().map(|shard| shard.stem()).is_sorted());
        }
        for (number, of) in [(0, 3), (4, 3), (0, 0), (1, 100_000)] {
            assert_eq!(Shard::new(number, of), None);
        }
    }
}
