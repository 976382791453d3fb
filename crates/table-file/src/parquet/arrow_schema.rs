//! The units in Arrow's schema, which Arrow's writers store in addition to Parquet's schema: a message in Arrow's IPC
//! format ("Arrow Columnar Format", "Schema.fbs", "Message.fbs"), in base64.

use serde_json::Value;

/// The key of the schema in a file's metadata.
pub(super) const KEY: &str = "ARROW:schema";

/// The largest number of fields, and the deepest nesting, that are read.
const FIELDS: usize = 4096;
const DEPTH: usize = 8;

/// Returns the units of fields by their path in the schema, such as `wrench.force.x`; none if the message is damaged.
pub(super) fn units(text: &str) -> Vec<(String, String)> {
    let mut units = Vec::new();
    let bytes = from_base64(text);
    // The message follows its length, which may follow a continuation marker.
    let start = if bytes.starts_with(&[0xff; 4]) { 8 } else { 4 };
    let buffer = FlatBuffer(bytes.get(start..).unwrap_or_default());
    let schema = buffer.root().and_then(|message| buffer.table(message, 2));
    if let Some(fields) = schema.and_then(|schema| buffer.vector(schema, 1)) {
        add(&buffer, fields, "", DEPTH, &mut units);
    }
    units
}

fn add(
    buffer: &FlatBuffer<'_>,
    (at, count): (usize, usize),
    above: &str,
    depth: usize,
    units: &mut Vec<(String, String)>,
) {
    for field in (0..count.min(FIELDS)).filter_map(|index| buffer.element(at, index)) {
        let name = buffer.text(field, 0).unwrap_or_default();
        let path = if above.is_empty() { name } else { format!("{above}.{name}") };
        let (pairs, of) = buffer.vector(field, 6).unwrap_or_default();
        let is_unit = |key: &str| ["unit", "units"].iter().any(|it| key.eq_ignore_ascii_case(it));
        let pairs = (0..of.min(FIELDS)).filter_map(|index| buffer.element(pairs, index));
        let unit = pairs.filter_map(|pair| Some((buffer.text(pair, 0)?, buffer.text(pair, 1)?)));
        let unit = unit.filter(|(key, _)| is_unit(key)).map(|(_, unit)| unit).next();
        units.extend(unit.map(|unit| (path.clone(), unit)));
        if let Some(children) =
            buffer.vector(field, 5).filter(|_| depth > 0 && units.len() < FIELDS)
        {
            add(buffer, children, &path, depth - 1, units);
        }
    }
}

/// Keys and values of a file: texts, and members of JSON objects.
pub(super) fn attributes(key: &str, value: &str) -> Vec<(String, String)> {
    let json = || serde_json::from_str::<Value>(value).ok().filter(Value::is_object);
    let mut pairs = Vec::new();
    match (key, json()) {
        (KEY, _) => {}
        // Attributes of a pandas data frame, without attributes of its columns.
        ("pandas", Some(value)) => attributes_of("", &value["attributes"], &mut pairs),
        ("PANDAS_ATTRS", Some(value)) => attributes_of("", &value, &mut pairs),
        (key, Some(value)) => attributes_of(key, &value, &mut pairs),
        (key, None) => pairs.push((key.to_owned(), value.to_owned())),
    }
    pairs
}

/// Decodes base64 up to the first byte that is not part of it.
fn from_base64(text: &str) -> Vec<u8> {
    let value = |byte: u8| {
        Some(match byte {
            b'A'..=b'Z' => byte - b'A',
            b'a'..=b'z' => byte - b'a' + 26,
            b'0'..=b'9' => byte - b'0' + 52,
            b'+' => 62,
            b'/' => 63,
            _ => return None,
        })
    };
    let digits: Vec<u8> = text.bytes().map_while(value).collect();
    let bytes = |group: &[u8]| {
        let all = group.iter().fold(0_u32, |all, digit| all << 6 | u32::from(*digit));
        let all = all << (6 * (4 - group.len()));
        all.to_be_bytes()[1..group.len()].to_vec()
    };
    digits.chunks(4).flat_map(bytes).collect()
}

/// Tables of a FlatBuffer by their positions. Every access is checked.
struct FlatBuffer<'a>(&'a [u8]);

impl FlatBuffer<'_> {
    fn u32(&self, at: usize) -> Option<usize> {
        let bytes = self.0.get(at..)?.first_chunk()?;
        usize::try_from(u32::from_le_bytes(*bytes)).ok()
    }

    fn u16(&self, at: usize) -> Option<usize> {
        Some(u16::from_le_bytes(*self.0.get(at..)?.first_chunk()?).into())
    }

    /// Follows the offset at a position.
    fn target(&self, at: usize) -> Option<usize> {
        at.checked_add(self.u32(at)?)
    }

    fn root(&self) -> Option<usize> {
        self.target(0)
    }

    /// Returns the position of a table's field; `None` if it is absent.
    fn field(&self, table: usize, number: usize) -> Option<usize> {
        let back = i32::from_le_bytes(*self.0.get(table..)?.first_chunk()?);
        let directory = usize::try_from(i64::try_from(table).ok()? - i64::from(back)).ok()?;
        let entry = 4 + 2 * number;
        if entry >= self.u16(directory)? {
            return None;
        }
        let offset = self.u16(directory.checked_add(entry)?)?;
        (offset > 0).then(|| table.checked_add(offset)).flatten()
    }

    fn table(&self, table: usize, number: usize) -> Option<usize> {
        self.target(self.field(table, number)?)
    }

    /// Returns the position of a vector's first element, and the number of elements.
    fn vector(&self, table: usize, number: usize) -> Option<(usize, usize)> {
        let at = self.table(table, number)?;
        Some((at.checked_add(4)?, self.u32(at)?))
    }

    /// Returns a table in a vector.
    fn element(&self, vector: usize, index: usize) -> Option<usize> {
        self.target(vector.checked_add(4 * index)?)
    }

    fn text(&self, table: usize, number: usize) -> Option<String> {
        let (at, length) = self.vector(table, number)?;
        let bytes = self.0.get(at..at.checked_add(length)?)?;
        Some(String::from_utf8_lossy(bytes).into_owned())
    }
}

/// Appends the members of a JSON object with joined names: `units.fx`.
fn attributes_of(name: &str, value: &Value, pairs: &mut Vec<(String, String)>) {
    match value {
        Value::Object(members) => members.iter().for_each(|(key, value)| {
            let name = if name.is_empty() { key.clone() } else { format!("{name}.{key}") };
            attributes_of(&name, value, pairs);
        }),
        Value::String(text) => pairs.push((name.to_owned(), text.clone())),
        Value::Number(number) => pairs.push((name.to_owned(), number.to_string())),
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The schema of a time in ms, a list in mN and mN·m, and a struct with a force in kN, by pyarrow 25.
    const SCHEMA: &str = "/////9ABAAAQAAAAAAAKAAwABgAFAAgACgAAAAABBAAMAAAACAAIAAAABAAIAAAABAAAAAMAAAA8AQAAiAAAAAQAAAAg////AAAB\
         DRQAAAAcAAAABAAAAAEAAAAUAAAAAQAAAHcAAAAEAAQABAAAAA7///8AAAEDFAAAAEAAAAAIAAAAEAAAAAAAAAACAAAAZngAAAEA\
         AAAEAAAA/P7//xAAAAAEAAAAAgAAAGtOAAAEAAAAdW5pdAAAAAD2/v//AAACAGL///8AAAEQGAAAAEwAAAAIAAAAFAAAAAEAAABU\
         AAAAAgAAAGZ0AAABAAAABAAAAFT///8UAAAABAAAAAcAAABtTiwgbU5tAAUAAAB1bml0cwAGAAgABAAGAAAAAgAAABAAFAAIAAYA\
         BwAMAAAAEAAQAAAAAAABAxAAAAAcAAAABAAAAAAAAAAEAAAAaXRlbQAABgAGAAQABgAAAAEAEgAYAAgABgAHAAwAAAAQABQAEgAA\
         AAAAAQMUAAAATAAAAAgAAAAQAAAAAAAAAAEAAAB0AAAAAQAAAAwAAAAIAAwABAAIAAgAAAAQAAAABAAAAAIAAABtcwAABAAAAHVu\
         aXQAAAYACAAGAAYAAAAAAAIAAAAAAA==";

    #[test]
    fn fields_have_the_units_of_their_metadata() {
        let expected = [("t", "ms"), ("ft", "mN, mNm"), ("w.fx", "kN")];
        let expected = expected.map(|(path, unit)| (path.to_owned(), unit.to_owned()));
        assert_eq!(units(SCHEMA), expected);
        // Damage can only remove or change units; it never causes a panic.
        for at in 0..SCHEMA.len() {
            units(&SCHEMA[..at]);
            let mut damaged = SCHEMA.as_bytes().to_vec();
            damaged[at] = b'/';
            units(&String::from_utf8_lossy(&damaged));
        }
        let json = attributes("PANDAS_ATTRS", "{\"units\": {\"fx\": \"mN\"}, \"rate\": 100}");
        let expected = [("rate", "100"), ("units.fx", "mN")];
        assert_eq!(json, expected.map(|(key, value)| (key.to_owned(), value.to_owned())));
    }

    #[test]
    fn damaged_messages_have_no_units() {
        assert_eq!(from_base64("TWFu"), b"Man");
        assert_eq!(from_base64("TWE="), b"Ma");
        assert!(units("").is_empty());
        let long = "/////".repeat(400);
        for text in ["////", "AAAAAAAA", long.as_str(), "/////3gAAAAQAAAAAAAK"] {
            assert!(units(text).is_empty(), "{text}");
        }
    }
}
