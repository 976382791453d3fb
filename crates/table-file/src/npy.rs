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

/// Limit on the nesting of records.
const DEPTH: u8 = 8;

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
#[derive(Clone, Debug)]
struct ValueOffset {
    offset: usize,
    kind: NumberKind,
    is_little: bool,
}

#[derive(Clone, Debug)]
enum NumberKind {
    Number(Element),
    /// A string of this number of bytes.
    Bytes(usize),
    /// A string of this number of four-byte characters.
    Characters(usize),
    /// A value of another type, with its number of bytes.
    Unread {
        size: usize,
        name: String,
    },
}

impl NumberKind {
    fn size(&self) -> usize {
        match self {
            Self::Number(element) => element.size(),
            Self::Bytes(count) => *count,
            Self::Characters(count) => 4 * count,
            Self::Unread { size, .. } => *size,
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
    // Latin 1, and in version 3 UTF-8.
    let header = match start[6] {
        3 => String::from_utf8_lossy(&header).into_owned(),
        _ => header.iter().map(|&byte| char::from(byte)).collect(),
    };
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
        // A plain array is treated as a record with a single field.
        (Value::String(kind), [_, sides @ ..]) if sides.len() < 2 => {
            let field = Value::Array(vec!["values".into(), kind.as_str().into(), sides.into()]);
            let record = Record::new(&[field])?;
            (record.columns, None, record.offset)
        }
        (Value::Array(fields), [_]) => {
            let record = Record::new(fields)?;
            (record.columns, Some(record.names), record.offset)
        }
        (Value::String(_) | Value::Array(_), _) => {
            return Err(KIND.unsupported(format!(
                "an array of shape {shape:?}, expected one of rows and columns"
            )));
        }
        _ => return Err(KIND.damaged("its `descr` is no type")),
    };
    if let [ValueOffset { kind: NumberKind::Unread { name, .. }, .. }, ..] = &columns[..]
        && columns.iter().all(|column| column.unread().is_some())
    {
        return Err(KIND.unsupported(format!("values of type `{name}`")));
    }
    let row_bytes = row_bytes as u64;
    let by_column = by_column && columns.len() > 1 && names.is_none();
    let rows = shape.first().copied().unwrap_or(0);
    let file = file.clone();
    Ok((names, Npy { file, start, rows, row_bytes, columns, by_column }))
}

fn shape(shape: &Value) -> Option<Vec<u64>> {
    shape.as_array()?.iter().map(Value::as_u64).collect()
}

/// The columns of records, one field after the other.
#[derive(Default)]
struct Record {
    columns: Vec<ValueOffset>,
    names: Vec<String>,
    offset: usize,
}

impl Record {
    fn new(fields: &[Value]) -> Result<Self, TableError> {
        let mut record = Self::default();
        record.add(fields, "", DEPTH)?;
        Ok(record)
    }

    /// Adds fields, whose names follow `prefix`.
    fn add(&mut self, fields: &[Value], prefix: &str, depth: u8) -> Result<(), TableError> {
        for field in fields {
            let Value::Array(parts) = field else {
                return Err(KIND.damaged("a field is no tuple"));
            };
            let (name, kind, sides) = match parts.as_slice() {
                [name, kind] => (name, kind, None),
                [name, kind, sides] => (name, kind, Some(sides)),
                _ => return Err(KIND.damaged("a field is no name and type")),
            };
            // A name may be preceded by a title.
            let name = match name {
                Value::Array(names) => names.last(),
                name => Some(name),
            };
            let name =
                name.and_then(Value::as_str).ok_or_else(|| KIND.damaged("a field's name"))?;
            let count = match sides {
                None => None,
                Some(sides) => {
                    let sides = shape(sides);
                    let sides =
                        sides.ok_or_else(|| KIND.damaged("the shape of a field is none"))?;
                    let count = sides.iter().fold(1, |all: u64, side| all.saturating_mul(*side));
                    let count = usize::try_from(count).unwrap_or(usize::MAX);
                    budget::check_columns(KIND, count)?;
                    Some(count)
                }
            };
            for at in 1..=count.unwrap_or(1) {
                let number = count.map(|_| at.to_string()).unwrap_or_default();
                let (start, columns) = (self.offset, self.columns.len());
                self.add_value(&format!("{prefix}{name}{number}"), kind, depth)?;
                if self.columns.len() == columns {
                    // A field without a name is padding, and may be repeated.
                    let size = self.offset - start;
                    self.offset = start.saturating_add(size.saturating_mul(count.unwrap_or(1)));
                    break;
                }
            }
        }
        Ok(())
    }

    fn add_value(&mut self, name: &str, kind: &Value, depth: u8) -> Result<(), TableError> {
        let kind = match kind {
            Value::Array(fields) if depth > 0 => {
                return self.add(fields, &format!("{name}."), depth - 1);
            }
            Value::String(kind) => kind,
            _ => return Err(KIND.unsupported("records within records without end")),
        };
        let (kind, is_little) = self::kind(kind)?;
        let size = kind.size();
        if !(name.is_empty() && matches!(kind, NumberKind::Unread { .. })) {
            self.names.push(name.to_owned());
            self.columns.push(ValueOffset { offset: self.offset, kind, is_little });
        }
        self.offset = self.offset.saturating_add(size);
        budget::check_columns(KIND, self.columns.len())
    }
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
    let unread = |size| NumberKind::Unread { size, name: name.to_owned() };
    if let Some(unit) = name_of.strip_prefix("M8") {
        return Ok((time(unit).map_or(unread(8), NumberKind::Number), is_little));
    }
    if name_of.starts_with("m8") {
        return Ok((unread(8), is_little));
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
        // Complex numbers, long doubles, and bytes.
        (b'c' | b'f' | b'V', _) => unread(usize::from(size)),
        _ => return Err(wrong()),
    };
    Ok((kind, is_little))
}

/// Parses the unit of times, such as `[ns]` or `[25ms]`; `None` for months and years, whose lengths differ.
fn time(unit: &str) -> Option<Element> {
    let unit = unit.strip_prefix('[')?.strip_suffix(']')?;
    let digits = unit.find(|c: char| !c.is_ascii_digit())?;
    let count: i64 = if digits == 0 { 1 } else { unit[..digits].parse().ok()? };
    let (seconds, per_second) = match &unit[digits..] {
        "W" => (7 * 86_400, 1),
        "D" => (86_400, 1),
        "h" => (3_600, 1),
        "m" => (60, 1),
        "s" => (1, 1),
        "ms" => (1, 1_000),
        "us" => (1, 1_000_000),
        "ns" => (1, 1_000_000_000),
        "ps" => (1, 1_000_000_000_000),
        _ => return None,
    };
    Some(Element::Time { size: 8, units: count.checked_mul(seconds)?, per_second })
}

impl RowSource for Npy {
    fn unread(&self, column: usize) -> Option<String> {
        self.columns.get(column)?.unread()
    }

    fn is_time(&self, column: usize) -> bool {
        let kind = self.columns.get(column).map(|column| &column.kind);
        matches!(kind, Some(NumberKind::Number(Element::Time { .. })))
    }

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
    /// Returns the reason why the column cannot be read.
    fn unread(&self) -> Option<String> {
        let NumberKind::Unread { name, .. } = &self.kind else { return None };
        Some(format!("holds values of type `{name}`"))
    }

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
    fn records_within_records_are_columns() {
        let file = FileSource::Memory(Vec::new().into());
        let layout = |fields: &str| {
            let header = format!("{{'descr': [{fields}], 'fortran_order': False, 'shape': (3,)}}");
            layout(&file, &header, 128)
        };
        let fields = "('t', '<f8'), ('w', [('x', '>i2'), ('c', '<c8')], (2,)), ('', '|V2'), \
                      (('a title', 'z'), '<M8[25ms]')";
        let (names, npy) = layout(fields).unwrap();
        assert_eq!(names.unwrap(), ["t", "w1.x", "w1.c", "w2.x", "w2.c", "z"]);
        let offsets: Vec<usize> = npy.columns.iter().map(|column| column.offset).collect();
        assert_eq!((&offsets[..], npy.row_bytes), (&[0, 8, 10, 18, 20, 30][..], 38));
        let is_unread = |at: usize| npy.unread(at).is_some();
        assert!((0..6).all(|at| is_unread(at) == [2, 4].contains(&at)) && npy.is_time(5));
        // The deepest and longest arrays of empty records within the limits take no time.
        let nothing = (0..DEPTH)
            .fold("('a', [], (4096,))".to_owned(), |inner, _| format!("('a', [{inner}], (4096,))"));
        assert!(layout(&nothing).is_err() || layout(&nothing).unwrap().1.columns.is_empty());
    }

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
