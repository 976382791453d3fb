//! The compact protocol of Thrift ("Thrift Compact protocol encoding"), which Parquet's metadata is
//! written in, as values whose fields are looked up by number.

use crate::bytes::ByteReader;

/// A value.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Value {
    Truth(bool),
    Whole(i64),
    Real,
    Bytes(Vec<u8>),
    List(Vec<Value>),
    Struct(Vec<(i16, Value)>),
}

/// How deep values may be nested.
const DEPTH: usize = 32;

impl Value {
    /// The field of this number.
    pub(crate) fn field(&self, number: i16) -> Option<&Value> {
        let Self::Struct(fields) = self else { return None };
        fields.iter().find(|(of, _)| *of == number).map(|(_, value)| value)
    }

    pub(crate) fn whole(&self, number: i16) -> Option<i64> {
        match self.field(number)? {
            Self::Whole(value) => Some(*value),
            _ => None,
        }
    }

    pub(crate) fn text(&self, number: i16) -> Option<String> {
        match self.field(number)? {
            Self::Bytes(bytes) => Some(String::from_utf8_lossy(bytes).into_owned()),
            _ => None,
        }
    }

    pub(crate) fn list(&self, number: i16) -> Option<&[Value]> {
        match self.field(number)? {
            Self::List(values) => Some(values),
            _ => None,
        }
    }
}

/// Reads a struct; `None` where it is damaged or cut off.
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
        // In a list.
        1 | 2 => Value::Truth(bytes.u8()? == 1),
        3 => Value::Whole(i64::from(bytes.u8()? as i8)),
        4..=6 => Value::Whole(bytes.zigzag()?),
        7 => {
            bytes.take(8)?;
            Value::Real
        }
        8 => {
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
            // Every element takes a byte or more.
            if count > bytes.rest.len() {
                return None;
            }
            let mut values = Vec::new();
            for _ in 0..count {
                values.push(value(bytes, head & 0xf, depth)?);
            }
            Value::List(values)
        }
        11 => {
            // Maps are not needed.
            let depth = depth.checked_sub(1)?;
            let count = bytes.varint()?;
            if count > 0 {
                let kinds = bytes.u8()?;
                for _ in 0..count {
                    value(bytes, kinds >> 4, depth)?;
                    value(bytes, kinds & 0xf, depth)?;
                }
            }
            Value::Struct(Vec::new())
        }
        12 => structure(bytes, depth)?,
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
}
