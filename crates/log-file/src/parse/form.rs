//! Rewrites rows with blanks, labels, JSON or arrows as separated values; lines keep their position and length.

use serde_json::Value;
use shell_data::unit::Unit;

use super::date::is_date;
use crate::line::without_returns;

#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct RowForm {
    /// True if a serial monitor wrote a time before the values, followed by an arrow or in brackets.
    pub(crate) has_arrow: bool,
    /// True if brackets around values are ignored: `(1.0 2.0)`.
    pub(crate) has_brackets: bool,
    pub(crate) body: RowBody,
}

#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) enum RowBody {
    #[default]
    Separated,
    /// Values separated by one or more blanks.
    Blanks,
    /// Values after these labels: `A:1856 B:1239`.
    Labels(Vec<String>),
    Json(Vec<String>),
}

const ARROW: &str = " -> ";

impl RowForm {
    pub(crate) fn is_plain(&self) -> bool {
        *self == Self::default()
    }

    pub(crate) fn separator(&self, of_text: u8) -> u8 {
        if self.body == RowBody::Separated { of_text } else { b'\t' }
    }

    /// Rewrites lines as separated values. Lines keep their length, so that positions stay valid. Lines in another
    /// notation are unchanged.
    pub(crate) fn separated(&self, lines: &[u8], separator: u8) -> Vec<u8> {
        let mut made = Vec::with_capacity(lines.len());
        for line in lines.split_inclusive(|&byte| byte == b'\n') {
            let text = line.strip_suffix(b"\n").unwrap_or(line);
            let text = without_returns(text);
            let row = str::from_utf8(text).ok().and_then(|text| self.row(text, separator));
            let row = row.filter(|row| row.len() <= text.len());
            let start = made.len();
            made.extend_from_slice(row.as_deref().map_or(text, str::as_bytes));
            made.resize(start + text.len(), b' ');
            made.extend_from_slice(&line[text.len()..]);
        }
        made
    }

    fn row(&self, line: &str, separator: u8) -> Option<String> {
        let separator = char::from(self.separator(separator));
        let (time, line) = match self.has_arrow {
            true => behind_arrow(line).map(|(time, rest)| (Some(time), rest))?,
            false => (None, line),
        };
        let bare = self.has_brackets.then(|| without_brackets(line));
        let line = bare.as_deref().unwrap_or(line);
        let tab = |values: Vec<String>| values.join("\t");
        let row = match &self.body {
            RowBody::Separated => line.to_owned(),
            RowBody::Blanks if line.trim_start().starts_with(['#', '%']) => return None,
            RowBody::Blanks => tab(blank_fields(line).map(str::to_owned).collect()),
            RowBody::Labels(names) => {
                let (labels, values): (Vec<_>, Vec<_>) = labelled(line)?.into_iter().unzip();
                (labels == *names).then(|| tab(values))?
            }
            RowBody::Json(names) => {
                let mut fields = object(line)?.into_iter().enumerate().collect::<Vec<_>>();
                let mut value = |(at, name): (usize, &String)| {
                    // Usually all lines have their fields in the same order.
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

/// Splits a line at blanks outside quotes.
pub(crate) fn blank_fields(line: &str) -> impl Iterator<Item = &str> {
    let mut is_quoted = false;
    let parts = line.split(move |c: char| {
        is_quoted ^= c == '"';
        c.is_whitespace() && !is_quoted
    });
    parts.filter(|part| !part.is_empty())
}

/// Splits a line at the arrow, or after a time in brackets.
pub(crate) fn behind_arrow(line: &str) -> Option<(&str, &str)> {
    match line.strip_prefix('[') {
        Some(inner) => inner.split_once("] ").filter(|(time, _)| is_date(time.as_bytes())),
        None => line
            .split_once(ARROW)
            .or_else(|| line.split_once(": ").filter(|(time, _)| is_date(time.as_bytes()))),
    }
}

pub(crate) fn without_brackets(line: &str) -> String {
    line.replace(['(', ')', '[', ']', '{', '}'], " ")
}

const MARKS: [char; 5] = [' ', '\t', ',', ';', '|'];

/// Returns labels and values, if the line consists of them. A unit after a value becomes part of its label:
/// `Reading: 1.5 lbs` is the column `Reading (lbs)`.
pub(crate) fn labelled(line: &str) -> Option<Vec<(String, String)>> {
    let (mut rest, mut pairs) = (line.trim_matches(MARKS), Vec::new());
    // Scales print a number and its unit.
    if let Some((number, unit)) = rest.split_once([' ', '\t'])
        && number.parse::<f64>().is_ok()
        && Unit::is_spelled(unit)
    {
        return Some(vec![(format!("value ({})", unit.trim()), number.to_owned())]);
    }
    while !rest.is_empty() {
        let (label, after) = rest.split_once([':', '='])?;
        let is_part = |c: char| c.is_alphanumeric() || " _.-/#()[]".contains(c);
        let is_label = label.starts_with(|first: char| first.is_alphabetic() || first == '_')
            && label.chars().all(is_part);
        let after = after.trim_start_matches([' ', '\t']);
        let (value, after) = after.split_at(after.find(MARKS).unwrap_or(after.len()));
        // A unit may follow without a blank: `Fx:1.5N`.
        let digits = value.rfind(|c: char| c.is_ascii_digit() || c == '.').map_or(0, |at| at + 1);
        let (value, unit) = match value.parse::<f64>() {
            Ok(_) => (value, ""),
            Err(_) => value.split_at(digits),
        };
        if !is_label
            || value.parse::<f64>().is_err()
            || !(unit.is_empty() || Unit::is_spelled(unit))
        {
            return None;
        }
        rest = after.trim_start_matches(MARKS);
        let mut label = label.trim().to_owned();
        if !unit.is_empty() {
            label = format!("{label} ({unit})");
        }
        // A unit is a word that is not a label itself.
        let (word, behind) = rest.split_at(rest.find(MARKS).unwrap_or(rest.len()));
        if unit.is_empty()
            && !word.is_empty()
            && !word.contains([':', '='])
            && Unit::is_spelled(word)
        {
            label = format!("{label} ({word})");
            rest = behind.trim_start_matches(MARKS);
        }
        pairs.push((label, value.to_owned()));
    }
    Some(pairs).filter(|pairs| !pairs.is_empty())
}

/// Returns the fields of a JSON object; the names of nested fields are joined. `None` if the line is not an object.
pub(crate) fn object(line: &str) -> Option<Vec<(String, String)>> {
    let line = line.trim();
    let value: Value = line.starts_with('{').then(|| serde_json::from_str(line).ok())??;
    let mut fields = Vec::new();
    flatten(String::new(), value, &mut fields);
    Some(fields)
}

fn seconds(object: &serde_json::Map<String, Value>) -> Option<String> {
    let number = |names: [&str; 2]| names.iter().find_map(|&name| object.get(name)?.as_u64());
    let (whole, parts) = (number(["sec", "secs"])?, number(["nanosec", "nsecs"])?);
    (object.len() == 2).then(|| format!("{whole}.{parts:09}"))
}

fn flatten(name: String, value: Value, fields: &mut Vec<(String, String)>) {
    let text = match value {
        // A ROS time is a single field.
        Value::Object(object) if seconds(&object).is_some() => seconds(&object).unwrap_or_default(),
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
        let form = RowForm { has_arrow, body, ..RowForm::default() };
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
            (RowBody::Separated, true, "10:00:01.5: 1,2", "10:00:01.5,1,2"),
            (RowBody::Separated, true, "[2026-03-01 10:00:01.5] 1,2", "2026-03-01 10:00:01.5,1,2"),
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
    fn labels_have_spaces_and_units() {
        let pairs = |line: &str| {
            let pairs = labelled(line)?.into_iter();
            Some(
                pairs
                    .map(|(label, value)| format!("{label}={value}"))
                    .collect::<Vec<_>>()
                    .join("; "),
            )
        };
        for (line, expected) in [
            ("one reading:\t-0.1\t| average:\t0.25", Some("one reading=-0.1; average=0.25")),
            (
                "Reading: 1.5 lbs calibration_factor: -7050",
                Some("Reading (lbs)=1.5; calibration_factor=-7050"),
            ),
            ("Weight: 12.5 g", Some("Weight (g)=12.5")),
            ("A:1 B:2", Some("A=1; B=2")),
            ("x=1,y= 2", Some("x=1; y=2")),
            ("12.345 kg", Some("value (kg)=12.345")),
            ("12.345 kg 3", None),
            ("10:22:33,1", None),
            ("Date: 3 May", None),
            ("a,b", None),
            ("", None),
        ] {
            assert_eq!(pairs(line).as_deref(), expected, "{line}");
        }
    }

    #[test]
    fn brackets_are_passed_over_and_stamps_are_seconds() {
        let form = RowForm { has_brackets: true, body: RowBody::Blanks, ..RowForm::default() };
        let made = form.separated(b"7 1400.5 (0.1 0.2)\n", b'\t');
        assert_eq!(String::from_utf8(made).unwrap().trim_end(), "7\t1400.5\t0.1\t0.2");
        let fields = object("{\"stamp\":{\"sec\":17,\"nanosec\":5000000},\"x\":1}").unwrap();
        assert_eq!(fields[0], ("stamp".to_owned(), "17.005000000".to_owned()));
    }

    #[test]
    fn keys_of_objects_are_found_in_any_order() {
        let json = RowBody::Json(vec!["b".to_owned(), "a".to_owned()]);
        assert_eq!(made(json, false, "{\"a\":1,\"b\":2}").trim_end(), "2\t1");
    }
}
