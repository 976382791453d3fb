//! Rewrites rows with blanks, labels, JSON or arrows as separated values; every line keeps its position and
//! length.

use serde_json::Value;

/// The notation of a row's values in its line.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct RowForm {
    /// True if a time and an arrow precede the values, as in text from the Arduino serial monitor.
    pub(crate) has_arrow: bool,
    /// The notation of the values after the arrow.
    pub(crate) body: RowBody,
}

/// The notation of a row's values.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) enum RowBody {
    /// Values between separators.
    #[default]
    Separated,
    /// Values between one or more blanks.
    Blanks,
    /// Values after these labels: `A:1856 B:1239`.
    Labels(Vec<String>),
    /// Values of these names in a JSON object.
    Json(Vec<String>),
}

/// The mark between a time and a row.
const ARROW: &str = " -> ";

impl RowForm {
    /// Returns true if lines need no rewriting.
    pub(crate) fn is_plain(&self) -> bool {
        *self == Self::default()
    }

    /// Returns the separator of the rewritten lines.
    pub(crate) fn separator(&self, of_text: u8) -> u8 {
        if self.body == RowBody::Separated { of_text } else { b'\t' }
    }

    /// Rewrites lines as separated values. Each line keeps its length, so that positions stay valid; a line
    /// in another notation is unchanged.
    pub(crate) fn separated(&self, lines: &[u8], separator: u8) -> Vec<u8> {
        let mut made = Vec::with_capacity(lines.len());
        for line in lines.split_inclusive(|&byte| byte == b'\n') {
            let text = line.strip_suffix(b"\n").unwrap_or(line);
            let text = text.strip_suffix(b"\r").unwrap_or(text);
            let row = str::from_utf8(text).ok().and_then(|text| self.row(text, separator));
            let row = row.filter(|row| row.len() <= text.len());
            let start = made.len();
            made.extend_from_slice(row.as_deref().map_or(text, str::as_bytes));
            made.resize(start + text.len(), b' ');
            made.extend_from_slice(&line[text.len()..]);
        }
        made
    }

    /// Rewrites the values of a line.
    fn row(&self, line: &str, separator: u8) -> Option<String> {
        let separator = char::from(self.separator(separator));
        let (time, line) = match self.has_arrow {
            true => line.split_once(ARROW).map(|(time, rest)| (Some(time), rest))?,
            false => (None, line),
        };
        let tab = |values: Vec<String>| values.join("\t");
        let row = match &self.body {
            RowBody::Separated => line.to_owned(),
            RowBody::Blanks if line.trim_start().starts_with(['#', '%']) => return None,
            RowBody::Blanks => tab(line.split_whitespace().map(str::to_owned).collect()),
            RowBody::Labels(names) => {
                let (labels, values): (Vec<_>, Vec<_>) = labelled(line)?.into_iter().unzip();
                (labels == *names).then(|| tab(values))?
            }
            RowBody::Json(names) => {
                let mut fields = object(line)?.into_iter().enumerate().collect::<Vec<_>>();
                let mut value = |(at, name): (usize, &String)| {
                    // Usually all lines have the same order.
                    let of_name = |(place, (key, _)): &(usize, (String, String))| {
                        (*place >= at, key) == (true, name)
                    };
                    let found = fields.iter().position(of_name);
                    let found =
                        found.or_else(|| fields.iter().position(|(_, (key, _))| key == name));
                    found.map_or_else(String::new, |found| fields.swap_remove(found).1.1)
                };
                tab(names.iter().enumerate().map(&mut value).collect())
            }
        };
        Some(match time {
            Some(time) => format!("{}{separator}{row}", time.trim()),
            None => row,
        })
    }
}

/// Splits a line at the arrow.
pub(crate) fn behind_arrow(line: &str) -> Option<(&str, &str)> {
    line.split_once(ARROW)
}

/// Returns labels and their values, if a line contains nothing else.
pub(crate) fn labelled(line: &str) -> Option<Vec<(String, String)>> {
    let line = line.replace(": ", ":").replace("= ", "=");
    let items = line.split([' ', '\t', ',', ';']).filter(|item| !item.is_empty());
    let pair = |item: &str| {
        let (label, value) = item.split_once([':', '='])?;
        let is_label = label.starts_with(|first: char| first.is_alphabetic() || first == '_');
        let is_value = value.parse::<f64>().is_ok();
        (is_label && is_value).then(|| (label.to_owned(), value.to_owned()))
    };
    items.map(pair).collect::<Option<Vec<_>>>().filter(|pairs| !pairs.is_empty())
}

/// Returns the fields of a JSON object, nested ones with joined names; `None` if the line is not an object.
pub(crate) fn object(line: &str) -> Option<Vec<(String, String)>> {
    let line = line.trim();
    let value: Value = line.starts_with('{').then(|| serde_json::from_str(line).ok())??;
    let mut fields = Vec::new();
    flatten(String::new(), value, &mut fields);
    Some(fields)
}

fn flatten(name: String, value: Value, fields: &mut Vec<(String, String)>) {
    let text = match value {
        Value::Object(object) => {
            let joined = |key: String| if name.is_empty() { key } else { format!("{name}.{key}") };
            return object.into_iter().for_each(|(key, of)| flatten(joined(key), of, fields));
        }
        Value::Array(list) => {
            let each = (1..).zip(list);
            return each.for_each(|(number, of)| flatten(format!("{name}{number}"), of, fields));
        }
        Value::Null => String::new(),
        Value::String(text) => text.replace(|c: char| c.is_control() || c == '"', " "),
        other => other.to_string(),
    };
    fields.push((name, text));
}

#[cfg(test)]
mod tests {
    use super::*;

    fn made(body: RowBody, has_arrow: bool, lines: &str) -> String {
        let form = RowForm { has_arrow, body };
        String::from_utf8(form.separated(lines.as_bytes(), b',')).unwrap()
    }

    #[test]
    fn rows_of_any_form_become_separated_values_in_their_places() {
        let names = |all: &[&str]| all.iter().map(|&name| name.to_owned()).collect::<Vec<_>>();
        let labels = RowBody::Labels(names(&["A", "B"]));
        let json = RowBody::Json(names(&["t", "f.x", "q1", "q2", "note"]));
        for (body, has_arrow, lines, expected) in [
            (RowBody::Blanks, false, "  1.5   2\r\n3 4\n", "1.5\t2\n3\t4"),
            (labels.clone(), false, "A:1 B:2\nA: 3,B:4\nB:1 A:2\n", "1\t2\n3\t4\nB:1 A:2"),
            (labels, true, "10:00:01.5 -> A:1 B:2", "10:00:01.5\t1\t2"),
            (RowBody::Separated, true, "10:00:01 -> 1,2", "10:00:01,1,2"),
            (
                json,
                false,
                "{\"t\":0.50,\"f\":{\"x\":-1},\"q\":[7,8],\"note\":\"a\\tb\"}",
                "0.5\t-1\t7\t8\ta b",
            ),
        ] {
            let made = made(body, has_arrow, lines);
            let trimmed: Vec<&str> = made.lines().map(str::trim_end).collect();
            assert_eq!(trimmed.join("\n"), expected);
            assert_eq!(made.len(), lines.len(), "{lines}");
        }
    }

    #[test]
    fn keys_of_objects_are_found_in_any_order() {
        let json = RowBody::Json(vec!["b".to_owned(), "a".to_owned()]);
        assert_eq!(made(json, false, "{\"a\":1,\"b\":2}").trim_end(), "2\t1");
    }
}
