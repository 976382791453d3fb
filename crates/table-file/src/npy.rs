//! NumPy arrays: the `.npy` format, versions 1 to 3 (NumPy Enhancement Proposal 1), with one or two dimensions of
//! numbers or of records with named fields.

use std::io::{BufReader, Read, Seek, SeekFrom};
use std::sync::Arc;

use serde_json::Value;

use crate::budget;
use crate::element::{Element, Strided};
use crate::format::{
    Cell, ColumnPart, FileSource, FoundTable, RowSource, RowStream, TableColumn, WantedColumn,
};
use crate::kind::{FileKind, TableError};

const KIND: FileKind = FileKind::NumPy;

#[derive(Debug)]
struct Npy {
    file: FileSource,
    /// Position of the first value in the file.
    start: u64,
    rows: u64,
    row_bytes: u64,
    columns: Vec<ValueOffset>,
    /// True for storage column by column, false for row by row.
    by_column: bool,
}

/// A column's position in a row, and its type.
#[derive(Clone, Copy, Debug)]
struct ValueOffset {
    offset: usize,
    kind: NumberKind,
    is_little: bool,
}

#[derive(Clone, Copy, Debug)]
enum NumberKind {
    Number(Element),
    /// A string of this number of bytes.
    Bytes(usize),
    /// A string of this number of four-byte characters.
    Characters(usize),
}

impl NumberKind {
    fn size(self) -> usize {
        match self {
            Self::Number(element) => element.size(),
            Self::Bytes(count) => count,
            Self::Characters(count) => 4 * count,
        }
    }
}

pub(crate) fn open(source: &FileSource) -> Result<FoundTable, TableError> {
    let mut file = source.open()?;
    let cut = |error| KIND.unread(error, "its header is cut off");
    let mut start = [0; 12];
    file.read_exact(&mut start).map_err(cut)?;
    let length = u32::from_le_bytes([start[8], start[9], start[10], start[11]]);
    let (before, length) = match start[6] {
        1 => (10, u64::from(length as u16)),
        2 | 3 => (12, u64::from(length)),
        version => return Err(KIND.unsupported(format!("format version {version}"))),
    };
    let size = budget::within(KIND, "its header", length, budget::DESCRIPTION)?;
    let mut header = vec![0; size];
    file.seek(SeekFrom::Start(before))?;
    file.read_exact(&mut header).map_err(cut)?;
    let header = String::from_utf8_lossy(&header);
    let (names, npy) = layout(source, &header, before + length)?;
    let (expected, found) = (npy.rows.saturating_mul(npy.row_bytes), source.length()?);
    let found = found.saturating_sub(npy.start);
    if found < expected {
        return Err(
            KIND.damaged(format!("its {} rows take {expected} bytes, {found} are there", npy.rows))
        );
    }
    let columns = names.map(|names| names.into_iter().map(TableColumn::from).collect());
    Ok(FoundTable::new(columns, npy))
}

/// Evaluates a header: the column names, if there are any, and the columns' positions.
fn layout(
    file: &FileSource,
    header: &str,
    start: u64,
) -> Result<(Option<Vec<String>>, Npy), TableError> {
    let Some(Value::Object(entries)) = python_literal(header) else {
        return Err(KIND.damaged("its header is not a dictionary"));
    };
    let missing = |name: &str| KIND.damaged(format!("its header has no `{name}`"));
    let entry = |name: &str| entries.get(name).ok_or_else(|| missing(name));
    let shape = shape(entry("shape")?).ok_or_else(|| KIND.damaged("its shape is none"))?;
    let by_column = *entry("fortran_order")? == Value::Bool(true);
    let (columns, names, row_bytes) = match (entry("descr")?, &*shape) {
        // Treated as a record with a single field.
        (Value::String(kind), [_, sides @ ..]) if sides.len() < 2 => {
            let field = Value::Array(vec!["values".into(), kind.as_str().into(), sides.into()]);
            let (columns, _, row_bytes) = record(&[field])?;
            (columns, None, row_bytes)
        }
        (Value::Array(fields), [_]) => {
            let (columns, names, row_bytes) = record(fields)?;
            (columns, Some(names), row_bytes)
        }
        (Value::String(_) | Value::Array(_), _) => {
            return Err(KIND.unsupported(format!(
                "an array of shape {shape:?}, expected one of rows and columns"
            )));
        }
        _ => return Err(KIND.damaged("its `descr` is no type")),
    };
    let by_column = by_column && columns.len() > 1 && names.is_none();
    let rows = shape.first().copied().unwrap_or(0);
    let file = file.clone();
    Ok((names, Npy { file, start, rows, row_bytes, columns, by_column }))
}

fn shape(shape: &Value) -> Option<Vec<u64>> {
    shape.as_array()?.iter().map(Value::as_u64).collect()
}

fn record(fields: &[Value]) -> Result<(Vec<ValueOffset>, Vec<String>, u64), TableError> {
    let (mut columns, mut names, mut offset) = (Vec::new(), Vec::new(), 0);
    for field in fields {
        let Value::Array(parts) = field else { return Err(KIND.damaged("a field is no tuple")) };
        let (name, kind, count) = match parts.as_slice() {
            [Value::String(name), Value::String(kind)] => (name, kind, None),
            [Value::String(name), Value::String(kind), sides] => {
                let sides =
                    shape(sides).ok_or_else(|| KIND.damaged("the shape of a field is none"))?;
                let count = sides.iter().fold(1, |all: u64, side| all.saturating_mul(*side));
                let count = usize::try_from(count).unwrap_or(usize::MAX);
                budget::check_columns(KIND, count)?;
                (name, kind, Some(count))
            }
            _ => return Err(KIND.unsupported("records within records")),
        };
        let (kind, is_little) = match kind.strip_prefix("|V").map(str::parse::<usize>) {
            // Padding bytes.
            Some(Ok(size)) if name.is_empty() && size < 1 << 16 => {
                offset += size;
                continue;
            }
            _ => self::kind(kind)?,
        };
        match count {
            None => names.push(name.clone()),
            Some(count) => names.extend((1..=count).map(|position| format!("{name}{position}"))),
        }
        for _ in 0..count.unwrap_or(1) {
            columns.push(ValueOffset { offset, kind, is_little });
            offset += kind.size();
        }
        budget::check_columns(KIND, columns.len())?;
    }
    Ok((columns, names, offset as u64))
}

/// Parses a type such as `<f8`, `|b1` or `<M8[ns]`, and its byte order.
fn kind(name: &str) -> Result<(NumberKind, bool), TableError> {
    let wrong = || KIND.unsupported(format!("values of type `{name}`"));
    let order = name.chars().next().ok_or_else(wrong)?;
    let (is_little, name_of) = match order {
        '<' | '|' | '=' => (true, &name[1..]),
        '>' => (false, &name[1..]),
        _ => (true, name),
    };
    if let Some(unit) = name_of.strip_prefix("M8[").and_then(|unit| unit.strip_suffix(']')) {
        let per_second = match unit {
            "s" => 1,
            "ms" => 1_000,
            "us" => 1_000_000,
            "ns" => 1_000_000_000,
            _ => return Err(wrong()),
        };
        let time = Element::Time { size: 8, units: 1, per_second };
        return Ok((NumberKind::Number(time), is_little));
    }
    let size: u16 = name_of.get(1..).and_then(|size| size.parse().ok()).ok_or_else(wrong)?;
    let kind = match (name_of.as_bytes()[0], size) {
        (b'f', 2) => NumberKind::Number(Element::Half),
        (b'f', 4) => NumberKind::Number(Element::Single),
        (b'f', 8) => NumberKind::Number(Element::Double),
        (b'i', 1 | 2 | 4 | 8) => NumberKind::Number(Element::Signed(size as u8)),
        (b'u', 1 | 2 | 4 | 8) => NumberKind::Number(Element::Unsigned(size as u8)),
        (b'b' | b'?', 1) => NumberKind::Number(Element::Truth),
        (b'S' | b'a', 1..) => NumberKind::Bytes(usize::from(size)),
        (b'U', 1..=4096) => NumberKind::Characters(usize::from(size)),
        _ => return Err(wrong()),
    };
    Ok((kind, is_little))
}

impl RowSource for Npy {
    fn columns(&self) -> usize {
        self.columns.len()
    }

    fn rows(self: Arc<Self>, wanted: Vec<WantedColumn>) -> Result<RowStream, TableError> {
        let mut file = BufReader::with_capacity(1 << 16, self.file.open()?);
        file.seek(SeekFrom::Start(self.start))?;
        let (mut next, mut bytes) = (0, Vec::new());
        Ok(Box::new(move |rows, part| {
            let Self { columns, by_column, row_bytes, .. } = &*self;
            let rows = (rows as u64).min(self.rows - next);
            let cut = |error| KIND.unread(error, "its rows are cut off");
            if !by_column {
                bytes.resize(rows as usize * *row_bytes as usize, 0);
                file.read_exact(&mut bytes).map_err(cut)?;
            }
            for (part, wanted) in part.columns.iter_mut().zip(&wanted) {
                let Some(column) = columns.get(wanted.at) else { continue };
                let (mut offset, mut stride) = (column.offset, *row_bytes as usize);
                if *by_column {
                    (offset, stride) = (0, column.kind.size());
                    let before = (wanted.at as u64 * self.rows + next) * stride as u64;
                    file.seek(SeekFrom::Start(self.start + before))?;
                    bytes.resize(rows as usize * stride, 0);
                    file.read_exact(&mut bytes).map_err(cut)?;
                }
                let bytes = bytes.get(offset..).unwrap_or_default();
                column.read(Strided { bytes, stride, rows: rows as usize }, part);
            }
            next += rows;
            part.rows = rows as usize;
            Ok(())
        }))
    }
}

impl ValueOffset {
    fn read(&self, from: Strided<'_>, part: &mut ColumnPart) {
        let NumberKind::Number(element) = self.kind else {
            let texts = from.values(self.kind.size()).map(|bytes| Cell::Text(self.text(bytes)));
            part.cells().extend(texts);
            return;
        };
        element.read(from, self.is_little, part);
    }

    fn text(&self, bytes: &[u8]) -> String {
        if let NumberKind::Bytes(_) = self.kind {
            let end = bytes.iter().rposition(|&byte| byte != 0).map_or(0, |at| at + 1);
            return String::from_utf8_lossy(&bytes[..end]).into_owned();
        }
        let character = |bytes: &[u8; 4]| {
            let code = if self.is_little { u32::from_le_bytes } else { u32::from_be_bytes };
            char::from_u32(code(*bytes)).unwrap_or('\u{fffd}')
        };
        let text: String = bytes.as_chunks::<4>().0.iter().map(character).collect();
        text.trim_end_matches('\0').to_owned()
    }
}

/// Parses a Python literal that must span all of `text`. It is rewritten as JSON, with tuples as lists.
fn python_literal(text: &str) -> Option<Value> {
    let (mut json, mut rest) = (String::with_capacity(text.len()), text);
    while let Some(first) = rest.chars().next() {
        let after = &rest[first.len_utf8()..];
        rest = match first {
            '\'' | '"' => {
                let (text, after) = after.split_once(first)?;
                json.push_str(&Value::from(text).to_string());
                after
            }
            // JSON does not allow a comma before the end of a list.
            ',' if after.trim_start().starts_with([')', ']', '}']) => after,
            c if c.is_ascii_alphanumeric() => {
                let end = rest.find(|c: char| !c.is_ascii_alphanumeric()).unwrap_or(rest.len());
                let (word, after) = rest.split_at(end);
                json.push_str(&json_of_word(word)?);
                after
            }
            _ => {
                json.push(match first {
                    '(' => '[',
                    ')' => ']',
                    '[' | ']' | '{' | '}' | ':' | ',' => first,
                    c if c.is_whitespace() => ' ',
                    _ => return None,
                });
                after
            }
        };
    }
    serde_json::from_str(&json).ok()
}

fn json_of_word(word: &str) -> Option<String> {
    Some(match word {
        "True" => "true".to_owned(),
        "False" => "false".to_owned(),
        "None" => "null".to_owned(),
        // Python 2 wrote long integers with an L.
        number => number.trim_end_matches('L').parse::<u64>().ok()?.to_string(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headers_of_numpy_are_read() {
        let header = "{'descr': [('t', '<f8'), ('s', '<u2', (8,))], 'fortran_order': False, \
                      'shape': (3L,), }   \n";
        let Some(Value::Object(entries)) = python_literal(header) else { panic!("no dictionary") };
        assert_eq!(entries.len(), 3);
        assert_eq!(entries["fortran_order"], Value::Bool(false));
        assert_eq!(entries["shape"], Value::from([3]));
        let Value::Array(fields) = &entries["descr"] else { panic!("no list") };
        let eight = Value::from([8]);
        assert_eq!(fields[1], Value::Array(vec!["s".into(), "<u2".into(), eight]));
        assert_eq!(python_literal(r"('a\b',)"), Some(Value::from([r"a\b"])));
        for wrong in ["", "{", "(1", "{'a' 1}", "['a', ]]", "-1", "1 2", &"(".repeat(1000)] {
            assert_eq!(python_literal(wrong), None, "{wrong}");
        }
    }
}
