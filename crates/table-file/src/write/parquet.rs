//! Parquet files ("Apache Parquet format"): numbers uncompressed, texts compressed with Snappy, a checksum per page.
//!
//! Rows written together become a row group with one page per column. Only descriptions of groups are kept in memory.

use std::io::{self, Write};
use std::ops::Range;

use super::Cells;
use crate::bytes::push_varint;
use crate::thrift::Value::{self, Int, List, Struct, Whole};

const MAGIC: &[u8] = b"PAR1";

/// Physical types of values, and the converted type of text.
const INT64: i32 = 2;
const DOUBLE: i32 = 5;
const BYTE_ARRAY: i32 = 6;
const UTF8: i32 = 0;

const REQUIRED: i32 = 0;
const OPTIONAL: i32 = 1;

const PLAIN: i32 = 0;
const RUNS: i32 = 3;

const DATA_PAGE: i32 = 0;

const UNCOMPRESSED: i32 = 0;
const SNAPPY: i32 = 1;

/// Returns the type of a column, and whether values may be missing.
fn column_type(cells: &Cells<'_>) -> (i32, i32) {
    match cells {
        Cells::Text(_) => (BYTE_ARRAY, REQUIRED),
        Cells::Number(_) => (DOUBLE, OPTIONAL),
        Cells::Full(_) => (DOUBLE, REQUIRED),
        Cells::Count(_) => (INT64, OPTIONAL),
    }
}

pub struct ParquetWriter<W> {
    out: W,
    at: u64,
    /// The root of the schema, followed by its columns.
    schema: Vec<Value>,
    rows: u64,
    groups: Vec<Value>,
}

impl<W: Write> ParquetWriter<W> {
    /// # Errors
    /// [`io::Error`] of the system.
    pub fn new(mut out: W, columns: &[(String, Cells<'_>)]) -> io::Result<Self> {
        out.write_all(MAGIC)?;
        let mut schema = vec![Struct(vec![(4, "schema".into()), (5, Int(columns.len() as i32))])];
        schema.extend(columns.iter().map(|(name, cells)| {
            let (physical, repetition) = column_type(cells);
            let mut element =
                vec![(1, Int(physical)), (3, Int(repetition)), (4, name.as_str().into())];
            if physical == BYTE_ARRAY {
                element.push((6, Int(UTF8)));
                element.push((10, Struct(vec![(1, Struct(Vec::new()))])));
            }
            Struct(element)
        }));
        Ok(Self { out, at: MAGIC.len() as u64, schema, rows: 0, groups: Vec::new() })
    }

    /// Writes rows as a row group. The columns must match the file's in number and types.
    /// # Errors
    /// [`io::Error`] of the system.
    pub fn write(&mut self, columns: &[(String, Cells<'_>)], rows: Range<usize>) -> io::Result<()> {
        if rows.is_empty() {
            return Ok(());
        }
        let start = self.at;
        let (mut chunks, mut unpacked_bytes) = (Vec::new(), 0);
        for (name, cells) in columns {
            let at = self.at as i64;
            let (bytes, unpacked, column) = column_chunk(name, cells, rows.clone(), at)?;
            self.out.write_all(&bytes)?;
            chunks.push(Struct(vec![(2, Whole(at)), (3, column)]));
            unpacked_bytes += unpacked;
            self.at += bytes.len() as u64;
        }
        let bytes = (self.at - start) as i64;
        self.groups.push(Struct(vec![
            (1, List(chunks)),
            (2, Whole(unpacked_bytes)),
            (3, Whole(rows.len() as i64)),
            (5, Whole(start as i64)),
            (6, Whole(bytes)),
        ]));
        self.rows += rows.len() as u64;
        Ok(())
    }

    /// Writes the footer.
    ///
    /// # Errors
    /// [`io::Error`] of the system.
    pub fn finish(&mut self) -> io::Result<()> {
        let description = Struct(vec![
            (1, Int(1)),
            (2, List(std::mem::take(&mut self.schema))),
            (3, Whole(self.rows as i64)),
            (4, List(std::mem::take(&mut self.groups))),
            (6, concat!("shellcal version ", env!("CARGO_PKG_VERSION")).into()),
        ]);
        let mut footer = Vec::new();
        description.write(&mut footer);
        let length = u32::try_from(footer.len())
            .map_err(|_| io::Error::other("the footer of a Parquet file has at most 4 GB"))?;
        self.out.write_all(&footer)?;
        self.out.write_all(&length.to_le_bytes())?;
        self.out.write_all(MAGIC)?;
        self.out.flush()
    }
}

/// Makes a column's page in a row group that begins at `at` in the file. Returns its bytes with the header, its
/// uncompressed size, and the footer's entry for it.
fn column_chunk(
    name: &str,
    cells: &Cells<'_>,
    rows: Range<usize>,
    at: i64,
) -> io::Result<(Vec<u8>, i64, Value)> {
    let count = rows.len();
    let mut values = Vec::new();
    let (mut missing, mut codec) = (0, UNCOMPRESSED);
    match cells {
        Cells::Full(numbers) => {
            plain(&mut values, numbers[rows].iter().map(|value| value.to_le_bytes()));
        }
        Cells::Number(numbers) => {
            let numbers = &numbers[rows];
            missing = levels(&mut values, numbers)?;
            plain(&mut values, numbers.iter().flatten().map(|value| value.to_le_bytes()));
        }
        Cells::Count(counts) => {
            let counts = &counts[rows];
            missing = levels(&mut values, counts)?;
            plain(&mut values, counts.iter().flatten().map(|&count| count.to_le_bytes()));
        }
        Cells::Text(texts) => {
            codec = SNAPPY;
            for text in &texts[rows] {
                let length = u32::try_from(text.len()).map_err(io::Error::other)?;
                values.extend(length.to_le_bytes());
                values.extend_from_slice(text.as_bytes());
            }
        }
    }
    let long = |_| io::Error::other("a page of a Parquet file has at most 2 GB");
    let unpacked = i32::try_from(values.len()).map_err(long)?;
    let content = match codec {
        UNCOMPRESSED => values,
        _ => snap::raw::Encoder::new().compress_vec(&values).map_err(io::Error::other)?,
    };
    let packed = i32::try_from(content.len()).map_err(long)?;
    let mut bytes = Vec::new();
    let page = vec![(1, Int(count as i32)), (2, Int(PLAIN)), (3, Int(RUNS)), (4, Int(RUNS))];
    let head = Struct(vec![
        (1, Int(DATA_PAGE)),
        (2, Int(unpacked)),
        (3, Int(packed)),
        (4, Int(crc32fast::hash(&content) as i32)),
        (5, Struct(page)),
    ]);
    head.write(&mut bytes);
    let unpacked_bytes = bytes.len() as i64 + i64::from(unpacked);
    bytes.extend_from_slice(&content);
    let column = Struct(vec![
        (1, Int(column_type(cells).0)),
        (2, List(vec![Int(PLAIN), Int(RUNS)])),
        (3, List(vec![name.into()])),
        (4, Int(codec)),
        (5, Whole(count as i64)),
        (6, Whole(unpacked_bytes)),
        (7, Whole(bytes.len() as i64)),
        (9, Whole(at)),
        (12, Struct(vec![(3, Whole(missing))])),
    ]);
    Ok((bytes, unpacked_bytes, column))
}

fn plain(bytes: &mut Vec<u8>, values: impl Iterator<Item = [u8; 8]>) {
    bytes.reserve(8 * values.size_hint().0);
    values.for_each(|value| bytes.extend_from_slice(&value));
}

/// Appends a length and one bit per value, which is set if the value is present. Returns the number of missing values.
fn levels<T>(bytes: &mut Vec<u8>, values: &[Option<T>]) -> io::Result<i64> {
    let groups = values.chunks(8);
    let mut bits = Vec::with_capacity(groups.len() + 5);
    // One bit-packed run, in groups of eight values.
    push_varint(&mut bits, (groups.len() as u64) << 1 | 1);
    bits.extend(groups.map(|group| {
        let bit = |(position, value): (usize, &Option<T>)| u8::from(value.is_some()) << position;
        group.iter().enumerate().map(bit).sum::<u8>()
    }));
    bytes.extend(u32::try_from(bits.len()).map_err(io::Error::other)?.to_le_bytes());
    bytes.extend(bits);
    Ok(values.iter().filter(|value| value.is_none()).count() as i64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parquet::encoding::Integers;

    #[test]
    fn levels_read_back_as_the_values_that_are_there() {
        for count in [1, 7, 8, 9, 70_000] {
            let values: Vec<Option<u64>> =
                (0..count).map(|row| (row % 3 > 0).then_some(row)).collect();
            let mut bytes = Vec::new();
            let missing = levels(&mut bytes, &values).unwrap();
            assert_eq!(missing, count.div_ceil(3) as i64);
            let (length, bits) = bytes.split_first_chunk().unwrap();
            assert_eq!(u32::from_le_bytes(*length) as usize, bits.len());
            let (mut reader, mut found) = (Integers::new(bits.to_vec(), 1).unwrap(), Vec::new());
            while found.len() < values.len() {
                reader.read(values.len() - found.len(), &mut found).unwrap();
            }
            assert!(found.iter().zip(&values).all(|(bit, value)| (*bit == 1) == value.is_some()));
        }
    }
}
