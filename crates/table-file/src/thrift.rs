//! The compact protocol of Thrift ("Thrift Compact protocol encoding"), which encodes Parquet's metadata as values with
//! numbered fields.

use crate::bytes::{ByteReader, push_varint};

#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Value {
    Truth(bool),
    /// A 32-bit integer to write. Any integer that is read becomes a [`Value::Whole`].
    Int(i32),
    Whole(i64),
    Bytes(Vec<u8>),
    List(Vec<Value>),
    Struct(Vec<(i16, Value)>),
}

const INT: u8 = 5;
const WHOLE: u8 = 6;
const BYTES: u8 = 8;
const LIST: u8 = 9;
const STRUCT: u8 = 12;

/// Maximum nesting of values.
const DEPTH: usize = 32;

impl Value {
    pub(crate) fn field(&self, number: i16) -> Option<&Value> {
        let Self::Struct(fields) = self else { return None };
        fields.iter().find(|(of, _)| *of == number).map(|(_, value)| value)
    }

    pub(crate) fn whole(&self, number: i16) -> Option<i64> {
        let Self::Whole(value) = self.field(number)? else { return None };
        Some(*value)
    }

    pub(crate) fn text(&self, number: i16) -> Option<String> {
        let Self::Bytes(bytes) = self.field(number)? else { return None };
        Some(String::from_utf8_lossy(bytes).into_owned())
    }

    pub(crate) fn list(&self, number: i16) -> Option<&[Value]> {
        let Self::List(values) = self.field(number)? else { return None };
        Some(values)
    }

    fn kind(&self) -> u8 {
        match self {
            Self::Truth(true) => 1,
            Self::Truth(false) => 2,
            Self::Int(_) => INT,
            Self::Whole(_) => WHOLE,
            Self::Bytes(_) => BYTES,
            Self::List(_) => LIST,
            Self::Struct(_) => STRUCT,
        }
    }

    /// Writes the value without its type. The elements of a list have the type of its first element.
    pub(crate) fn write(&self, bytes: &mut Vec<u8>) {
        match self {
            // The type code contains the value; no bytes follow.
            Self::Truth(_) => {}
            Self::Int(value) => push_varint(bytes, zigzag((*value).into())),
            Self::Whole(value) => push_varint(bytes, zigzag(*value)),
            Self::Bytes(value) => {
                push_varint(bytes, value.len() as u64);
                bytes.extend_from_slice(value);
            }
            Self::List(values) => {
                let kind = values.first().map_or(STRUCT, Self::kind);
                match values.len() {
                    count @ 0..15 => bytes.push((count as u8) << 4 | kind),
                    count => {
                        bytes.push(0xf0 | kind);
                        push_varint(bytes, count as u64);
                    }
                }
                values.iter().for_each(|value| value.write(bytes));
            }
            Self::Struct(fields) => {
                let mut last = 0;
                for (number, value) in fields {
                    // A field's number is written as its difference to the previous one, in four bits.
                    debug_assert!((last + 1..last + 16).contains(number), "fields in order");
                    bytes.push(((number - last) as u8) << 4 | value.kind());
                    value.write(bytes);
                    last = *number;
                }
                bytes.push(0);
            }
        }
    }
}

impl From<&str> for Value {
    fn from(text: &str) -> Self {
        Self::Bytes(text.as_bytes().to_vec())
    }
}

fn zigzag(value: i64) -> u64 {
    (value << 1 ^ value >> 63) as u64
}

/// Reads a struct; `None` if it is damaged or cut off.
pub(crate) fn read(bytes: &mut ByteReader<'_>) -> Option<Value> {
    structure(bytes, DEPTH)
}

fn structure(bytes: &mut ByteReader<'_>, depth: usize) -> Option<Value> {
    let depth = depth.checked_sub(1)?;
    let (mut fields, mut number) = (Vec::new(), 0_i16);
    loop {
        let head = bytes.u8()?;
        if head == 0 {
            return Some(Value::Struct(fields));
        }
        number = match head >> 4 {
            0 => i16::try_from(bytes.zigzag()?).ok()?,
            step => number.checked_add(i16::from(step))?,
        };
        let value = match head & 0xf {
            1 => Value::Truth(true),
            2 => Value::Truth(false),
            kind => value(bytes, kind, depth)?,
        };
        fields.push((number, value));
    }
}

fn value(bytes: &mut ByteReader<'_>, kind: u8, depth: usize) -> Option<Value> {
    Some(match kind {
        // Booleans have a byte only as elements of a list.
        1 | 2 => Value::Truth(bytes.u8()? == 1),
        3 => Value::Whole(i64::from(bytes.u8()? as i8)),
        4..=6 => Value::Whole(bytes.zigzag()?),
        // Floating-point values are skipped.
        7 => bytes.take(8).map(|_| Value::Bytes(Vec::new()))?,
        BYTES => {
            let length = usize::try_from(bytes.varint()?).ok()?;
            Value::Bytes(bytes.take(length)?.to_vec())
        }
        9 | 10 => {
            let depth = depth.checked_sub(1)?;
            let head = bytes.u8()?;
            let count = match head >> 4 {
                15 => usize::try_from(bytes.varint()?).ok()?,
                count => usize::from(count),
            };
            // Every element takes at least a byte.
            if count > bytes.rest.len() {
                return None;
            }
            let values = (0..count).map(|_| value(bytes, head & 0xf, depth));
            Value::List(values.collect::<Option<_>>()?)
        }
        STRUCT => structure(bytes, depth)?,
        // Parquet does not use maps.
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_are_found_by_number() {
        // 1: i32 = −1, 4: list<i32> = [1, 2], 20 (long form): binary "ab", 21: true.
        let bytes = [0x15, 0x01, 0x39, 0x25, 0x02, 0x04, 0x08, 0x28, 0x02, b'a', b'b', 0x11, 0];
        let value = read(&mut ByteReader::new(&bytes)).unwrap();
        assert_eq!(value.whole(1), Some(-1));
        assert_eq!(value.list(4), Some(&[Value::Whole(1), Value::Whole(2)][..]));
        assert_eq!(value.text(20).as_deref(), Some("ab"));
        assert_eq!(value.field(21), Some(&Value::Truth(true)));
        for length in 0..bytes.len() {
            assert_eq!(read(&mut ByteReader::new(&bytes[..length])), None);
        }
        assert_eq!(read(&mut ByteReader::new(&[0x1c; 1000])), None, "nested without end");
    }

    #[test]
    fn what_is_written_reads_back() {
        let numbers = [i64::MIN, -1, 0, 127, 128, i64::MAX];
        let structs = numbers.iter().map(|&number| Value::Struct(vec![(15, Value::Whole(number))]));
        let written = Value::Struct(vec![
            (1, Value::Int(i32::MIN)),
            (2, Value::List(structs.collect())),
            (3, Value::Bytes(vec![b'x'; 300])),
            (18, Value::Struct(vec![(3, Value::List(vec!["ab".into()]))])),
            (19, Value::List(vec![Value::Int(-7); 20])),
            (20, Value::Truth(true)),
        ]);
        let mut bytes = Vec::new();
        written.write(&mut bytes);
        let value = read(&mut ByteReader::new(&bytes)).unwrap();
        assert_eq!(value.whole(1), Some(i32::MIN.into()));
        let found: Vec<_> = value.list(2).unwrap().iter().map(|it| it.whole(15).unwrap()).collect();
        assert_eq!(found, numbers);
        assert_eq!(value.text(3), Some("x".repeat(300)));
        let inner = value.field(18).unwrap();
        assert_eq!(inner.list(3), Some(&[Value::Bytes(b"ab".to_vec())][..]));
        assert_eq!(value.list(19), Some(&[const { Value::Whole(-7) }; 20][..]));
        assert_eq!(value.field(20), Some(&Value::Truth(true)));
    }
}
