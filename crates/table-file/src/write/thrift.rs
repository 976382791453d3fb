//! The compact protocol of Thrift, as far as Parquet's metadata needs it written.

/// Types of values.
const INT: u8 = 5;
const LONG: u8 = 6;
const BYTES: u8 = 8;
const LIST: u8 = 9;
const STRUCT: u8 = 12;

/// Writes a struct, whose fields are added by `write`.
pub(super) fn structure(bytes: &mut Vec<u8>, write: impl FnOnce(&mut Fields<'_>)) {
    let mut fields = Fields { bytes, last: 0 };
    write(&mut fields);
    fields.bytes.push(0);
}

/// The fields of a struct, to be added in the order of their numbers.
pub(super) struct Fields<'a> {
    bytes: &'a mut Vec<u8>,
    last: u8,
}

impl Fields<'_> {
    /// A field's number is written as its distance to the one before, of four bits.
    fn head(&mut self, number: u8, kind: u8) {
        debug_assert!((self.last + 1..self.last + 16).contains(&number), "fields in order");
        self.bytes.push((number - self.last) << 4 | kind);
        self.last = number;
    }

    fn list(&mut self, number: u8, kind: u8, count: usize) {
        self.head(number, LIST);
        match u8::try_from(count) {
            Ok(count @ 0..15) => self.bytes.push(count << 4 | kind),
            _ => {
                self.bytes.push(0xf0 | kind);
                varint(self.bytes, count as u64);
            }
        }
    }

    pub(super) fn int(&mut self, number: u8, value: i32) {
        self.head(number, INT);
        zigzag(self.bytes, value.into());
    }

    pub(super) fn long(&mut self, number: u8, value: i64) {
        self.head(number, LONG);
        zigzag(self.bytes, value);
    }

    pub(super) fn bytes(&mut self, number: u8, value: &[u8]) {
        self.head(number, BYTES);
        varint(self.bytes, value.len() as u64);
        self.bytes.extend_from_slice(value);
    }

    pub(super) fn structure(&mut self, number: u8, write: impl FnOnce(&mut Fields<'_>)) {
        self.head(number, STRUCT);
        structure(self.bytes, write);
    }

    pub(super) fn ints(&mut self, number: u8, values: &[i32]) {
        self.list(number, INT, values.len());
        values.iter().for_each(|&value| zigzag(self.bytes, value.into()));
    }

    /// A list of one text.
    pub(super) fn texts_of_one(&mut self, number: u8, text: &str) {
        self.list(number, BYTES, 1);
        varint(self.bytes, text.len() as u64);
        self.bytes.extend_from_slice(text.as_bytes());
    }

    /// A list of structs, the fields of each added by `write`.
    pub(super) fn structures<T>(
        &mut self,
        number: u8,
        items: impl ExactSizeIterator<Item = T>,
        write: impl Fn(&mut Fields<'_>, T),
    ) {
        self.list(number, STRUCT, items.len());
        items.for_each(|item| structure(self.bytes, |fields| write(fields, item)));
    }

    /// A list of structs that have been written already.
    pub(super) fn written_structures(&mut self, number: u8, structures: &[Vec<u8>]) {
        self.list(number, STRUCT, structures.len());
        structures.iter().for_each(|structure| self.bytes.extend_from_slice(structure));
    }
}

/// A number in groups of seven bits, the lowest first.
pub(super) fn varint(bytes: &mut Vec<u8>, mut value: u64) {
    while value >= 0x80 {
        bytes.push(value as u8 | 0x80);
        value >>= 7;
    }
    bytes.push(value as u8);
}

/// Small numbers of either sign become small numbers.
fn zigzag(bytes: &mut Vec<u8>, value: i64) {
    varint(bytes, (value << 1 ^ value >> 63) as u64);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bytes::ByteReader;
    use crate::thrift::{Value, read};

    #[test]
    fn what_is_written_reads_back() {
        let mut bytes = Vec::new();
        let numbers = [i64::MIN, -1, 0, 127, 128, i64::MAX];
        structure(&mut bytes, |fields| {
            fields.int(1, i32::MIN);
            fields.structures(2, numbers.iter(), |fields, &number| fields.long(15, number));
            fields.bytes(3, &[b'x'; 300]);
            fields.structure(18, |fields| fields.texts_of_one(3, "ab"));
            fields.ints(19, &[-7; 20]);
        });
        let value = read(&mut ByteReader::new(&bytes)).unwrap();
        assert_eq!(value.whole(1), Some(i32::MIN.into()));
        let found: Vec<_> = value.list(2).unwrap().iter().map(|it| it.whole(15).unwrap()).collect();
        assert_eq!(found, numbers);
        assert_eq!(value.text(3), Some("x".repeat(300)));
        let inner = value.field(18).unwrap();
        assert_eq!(inner.list(3), Some(&[Value::Bytes(b"ab".to_vec())][..]));
        assert_eq!(value.list(19), Some(&[const { Value::Whole(-7) }; 20][..]));
    }
}
