//! Manifests as TOML.

use std::collections::BTreeMap;

use serde::Deserialize;
use toml::{Spanned, Value};

use super::entry::{Manifest, Placed};
use super::fields::{EntryFields, KEYS};
use crate::cell_position::{CellPosition, ManifestProblem};
use crate::toml_position::parse as parse_toml;
use shell_data::hint::did_you_mean;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct TomlManifest {
    conditions: Option<Vec<String>>,
    #[serde(default)]
    trial: Vec<Spanned<BTreeMap<String, Spanned<Value>>>>,
}

pub(super) fn parse(text: &str) -> Result<Manifest, ManifestProblem> {
    let document: TomlManifest = parse_toml(text)?;
    let position = |byte: usize| CellPosition::of_byte(text, byte);
    let row = |trial: &Spanned<BTreeMap<String, Spanned<Value>>>| {
        let at = position(trial.span().start);
        for (key, value) in trial.get_ref() {
            let message = if !KEYS.contains(&key.as_str()) {
                format!("unknown key `{key}`{}", did_you_mean(key, KEYS))
            } else if text_of(value.get_ref()).is_none() {
                format!("`{key}` is no single value")
            } else {
                continue;
            };
            return Err(ManifestProblem::new(position(value.span().start), message));
        }
        let get = |key: &str| {
            let value = trial.get_ref().get(key)?;
            let text = text_of(value.get_ref()).filter(|text| !text.is_empty())?;
            Some(Placed { value: text, position: position(value.span().start) })
        };
        EntryFields { position: at, get: &get }.entry()
    };
    Ok(Manifest { rows: document.trial.iter().map(row).collect(), conditions: document.conditions })
}

/// A single value as a cell of a table has it.
fn text_of(value: &Value) -> Option<String> {
    match value {
        Value::String(text) => Some(text.trim().to_owned()),
        Value::Integer(number) => Some(number.to_string()),
        Value::Float(number) => Some(number.to_string()),
        Value::Boolean(flag) => Some(flag.to_string()),
        Value::Datetime(_) | Value::Array(_) | Value::Table(_) => None,
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
        assert_eq!((first.condition.value.as_str(), first.exclude), ("3", true));
        assert_eq!(first.exit.value, Some(2.5));
        assert_eq!(first.exit.position, CellPosition { line: 8, column: 12 });
        let problem = |row: usize| manifest.rows[row].clone().unwrap_err().to_string();
        assert_eq!(problem(1), "15:12: `t_exit_s` is `soon`, expected a time in s or `auto`");
        assert_eq!(problem(2), "19:12: unknown key `conditon`, did you mean `condition`?");
        assert_eq!(manifest.conditions, Some(vec!["free".to_owned(), "3".to_owned()]));
        let error = Manifest::parse("trials = 3", true).unwrap_err().to_string();
        assert!(error.starts_with("1:1: unknown field `trials`"), "{error}");
    }
}
