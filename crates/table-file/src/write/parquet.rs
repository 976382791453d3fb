//! Parquet files ("Apache Parquet format"): numbers as they are, texts by a dictionary, nothing
//! compressed.
//!
//! Rows that are written together become a row group, with one page of each column. The footer, which
//! describes the groups, is all that is kept of them.

use std::collections::HashMap;
use std::io::{self, Write};

use super::thrift::{Fields, structure, varint};
use super::{TableWriter, Values};

const MAGIC: &[u8] = b"PAR1";

/// Types of values, and that of texts beside it.
const INT64: i32 = 2;
const DOUBLE: i32 = 5;
const BYTE_ARRAY: i32 = 6;
const UTF8: i32 = 0;

const REQUIRED: i32 = 0;
const OPTIONAL: i32 = 1;

/// Encodings of values.
const PLAIN: i32 = 0;
const RUNS: i32 = 3;
const DICTIONARY: i32 = 8;

const DATA_PAGE: i32 = 0;
const DICTIONARY_PAGE: i32 = 2;

const UNCOMPRESSED: i32 = 0;

/// How many rows of a table in memory become one row group.
const GROUP_ROWS: usize = 1 << 16;

/// Some rows of a column.
#[derive(Clone, Copy, Debug)]
pub enum Cells<'a> {
    /// Numbers.
    Numbers(&'a [f64]),
    /// Numbers, some of which may be missing.
    OptionalNumbers(&'a [Option<f64>]),
    /// Counts, some of which may be missing.
    OptionalCounts(&'a [Option<u64>]),
    /// Texts.
    Texts(&'a [String]),
}

impl<'a> From<Values<'a>> for Cells<'a> {
    fn from(values: Values<'a>) -> Self {
        match values {
            Values::Numbers(values) => Self::Numbers(values),
            Values::Texts(values) => Self::Texts(values),
        }
    }
}

impl Cells<'_> {
    fn len(&self) -> usize {
        match self {
            Self::Numbers(values) => values.len(),
            Self::OptionalNumbers(values) => values.len(),
            Self::OptionalCounts(values) => values.len(),
            Self::Texts(values) => values.len(),
        }
    }

    fn slice(self, start: usize, end: usize) -> Self {
        match self {
            Self::Numbers(values) => Self::Numbers(&values[start..end]),
            Self::OptionalNumbers(values) => Self::OptionalNumbers(&values[start..end]),
            Self::OptionalCounts(values) => Self::OptionalCounts(&values[start..end]),
            Self::Texts(values) => Self::Texts(&values[start..end]),
        }
    }

    fn kind(self) -> Kind {
        match self {
            Self::Numbers(_) => Kind { physical: DOUBLE, repetition: REQUIRED },
            Self::OptionalNumbers(_) => Kind { physical: DOUBLE, repetition: OPTIONAL },
            Self::OptionalCounts(_) => Kind { physical: INT64, repetition: OPTIONAL },
            Self::Texts(_) => Kind { physical: BYTE_ARRAY, repetition: REQUIRED },
        }
    }
}

/// What a column is in the schema.
#[derive(Clone, Copy, Debug)]
struct Kind {
    physical: i32,
    repetition: i32,
}

/// A table in memory as a Parquet file.
///
/// # Errors
/// [`io::Error`] if a page takes more than the 2 GB that it may have.
pub fn parquet_file(columns: &[(&str, Cells<'_>)]) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let kinds = columns.iter().map(|(name, cells)| ((*name).to_owned(), cells.kind())).collect();
    let mut writer = ParquetWriter::of_kinds(&mut bytes, kinds)?;
    let rows = columns.first().map_or(0, |(_, cells)| cells.len());
    for start in (0..rows).step_by(GROUP_ROWS) {
        let end = rows.min(start + GROUP_ROWS);
        writer.group(columns.iter().map(|(_, cells)| cells.slice(start, end)))?;
    }
    writer.finish()?;
    Ok(bytes)
}

/// Writes a Parquet file, a row group at a time.
pub struct ParquetWriter<W> {
    out: W,
    at: u64,
    columns: Vec<(String, Kind)>,
    rows: u64,
    /// What the footer says of each row group.
    groups: Vec<Vec<u8>>,
}

impl<W: Write> ParquetWriter<W> {
    /// A file of these columns; whether each holds texts.
    ///
    /// # Errors
    /// What the system says.
    pub fn new(out: W, columns: &[(String, bool)]) -> io::Result<Self> {
        let kind = |is_text| if is_text { Cells::Texts(&[]) } else { Cells::Numbers(&[]) }.kind();
        let columns = columns.iter().map(|(name, is_text)| (name.clone(), kind(*is_text)));
        Self::of_kinds(out, columns.collect())
    }

    fn of_kinds(mut out: W, columns: Vec<(String, Kind)>) -> io::Result<Self> {
        out.write_all(MAGIC)?;
        Ok(Self { out, at: MAGIC.len() as u64, columns, rows: 0, groups: Vec::new() })
    }

    /// Writes rows as a group.
    fn group<'a>(&mut self, columns: impl Iterator<Item = Cells<'a>>) -> io::Result<()> {
        let start = self.at;
        let (mut rows, mut chunks) = (0, Vec::new());
        for cells in columns {
            rows = cells.len() as i64;
            let chunk = Chunk::new(cells)?;
            self.out.write_all(&chunk.bytes)?;
            chunks.push((self.at as i64, chunk));
            self.at += chunks.last().map_or(0, |(_, chunk)| chunk.bytes.len() as u64);
        }
        let bytes = (self.at - start) as i64;
        let mut group = Vec::new();
        structure(&mut group, |fields| {
            let columns = self.columns.iter().zip(&chunks);
            fields.structures(1, columns, |fields, ((name, kind), (at, chunk))| {
                fields.long(2, *at);
                fields.structure(3, |fields| chunk.describe(fields, name, *kind, *at, rows));
            });
            fields.long(2, bytes);
            fields.long(3, rows);
            fields.long(5, start as i64);
            fields.long(6, bytes);
        });
        self.groups.push(group);
        self.rows += rows as u64;
        Ok(())
    }

    fn footer(&self) -> Vec<u8> {
        let mut footer = Vec::new();
        structure(&mut footer, |fields| {
            fields.int(1, 1);
            // The root of the schema, then its columns.
            let elements: Vec<_> =
                std::iter::once(None).chain(self.columns.iter().map(Some)).collect();
            fields.structures(2, elements.into_iter(), |fields, element| match element {
                None => {
                    fields.bytes(4, b"schema");
                    fields.int(5, self.columns.len() as i32);
                }
                Some((name, kind)) => {
                    fields.int(1, kind.physical);
                    fields.int(3, kind.repetition);
                    fields.bytes(4, name.as_bytes());
                    if kind.physical == BYTE_ARRAY {
                        fields.int(6, UTF8);
                        fields.structure(10, |logical| logical.structure(1, |_| {}));
                    }
                }
            });
            fields.long(3, self.rows as i64);
            fields.written_structures(4, &self.groups);
            let creator = concat!("shellcal version ", env!("CARGO_PKG_VERSION"));
            fields.bytes(6, creator.as_bytes());
            // The least and greatest values below are by the order of their types.
            fields.structures(7, self.columns.iter(), |order, _| order.structure(1, |_| {}));
        });
        footer
    }
}

impl<W: Write> TableWriter for ParquetWriter<W> {
    fn write(&mut self, columns: &[Values<'_>]) -> io::Result<()> {
        match columns.first().map_or(0, Values::len) {
            0 => Ok(()),
            _ => self.group(columns.iter().map(|&values| values.into())),
        }
    }

    fn finish(&mut self) -> io::Result<()> {
        let footer = self.footer();
        let length = u32::try_from(footer.len())
            .map_err(|_| io::Error::other("the footer of a Parquet file has at most 4 GB"))?;
        self.out.write_all(&footer)?;
        self.out.write_all(&length.to_le_bytes())?;
        self.out.write_all(MAGIC)?;
        self.out.flush()
    }
}

/// The pages of a column in a row group.
struct Chunk {
    bytes: Vec<u8>,
    /// How long the dictionary before the values is; 0 if there is none.
    dictionary_bytes: i64,
    missing: i64,
    /// The least and greatest value, as they are stored.
    range: Option<[[u8; 8]; 2]>,
}

impl Chunk {
    fn new(cells: Cells<'_>) -> io::Result<Self> {
        let (mut bytes, mut values) = (Vec::new(), Vec::new());
        let (mut dictionary_bytes, mut missing, mut range) = (0, 0, None);
        let mut encoding = PLAIN;
        match cells {
            Cells::Numbers(numbers) => {
                range = range_of_numbers(numbers.iter().copied());
                plain(&mut values, numbers.iter().map(|value| value.to_le_bytes()));
            }
            Cells::OptionalNumbers(numbers) => {
                missing = levels(&mut values, numbers)?;
                range = range_of_numbers(numbers.iter().flatten().copied());
                plain(&mut values, numbers.iter().flatten().map(|value| value.to_le_bytes()));
            }
            Cells::OptionalCounts(counts) => {
                missing = levels(&mut values, counts)?;
                let counts = || counts.iter().flatten().map(|&count| count as i64);
                let ends = counts().min().zip(counts().max());
                range = ends.map(|(least, most)| [least.to_le_bytes(), most.to_le_bytes()]);
                plain(&mut values, counts().map(i64::to_le_bytes));
            }
            Cells::Texts(texts) => {
                let Dictionary { content, size, indices } = Dictionary::new(texts);
                page(&mut bytes, DICTIONARY_PAGE, &content, |fields| {
                    fields.structure(7, |fields| {
                        fields.int(1, size as i32);
                        fields.int(2, PLAIN);
                    });
                })?;
                dictionary_bytes = bytes.len() as i64;
                encoding = DICTIONARY;
                // A width of no bits, of a single text, is not what every reader expects.
                let width = (usize::BITS - size.saturating_sub(1).leading_zeros()).max(1);
                values.push(width as u8);
                runs(&mut values, &indices, width);
            }
        }
        page(&mut bytes, DATA_PAGE, &values, |fields| {
            fields.structure(5, |fields| {
                fields.int(1, cells.len() as i32);
                fields.int(2, encoding);
                fields.int(3, RUNS);
                fields.int(4, RUNS);
            });
        })?;
        Ok(Self { bytes, dictionary_bytes, missing, range })
    }

    /// What the footer says of it, where it begins at a place in the file.
    fn describe(&self, fields: &mut Fields<'_>, name: &str, kind: Kind, at: i64, rows: i64) {
        let has_dictionary = self.dictionary_bytes > 0;
        let bytes = self.bytes.len() as i64;
        fields.int(1, kind.physical);
        fields.ints(2, if has_dictionary { &[PLAIN, RUNS, DICTIONARY] } else { &[PLAIN, RUNS] });
        fields.texts_of_one(3, name);
        fields.int(4, UNCOMPRESSED);
        fields.long(5, rows);
        fields.long(6, bytes);
        fields.long(7, bytes);
        fields.long(9, at + self.dictionary_bytes);
        if has_dictionary {
            fields.long(11, at);
        }
        fields.structure(12, |fields| {
            fields.long(3, self.missing);
            if let Some([least, most]) = &self.range {
                fields.bytes(5, most);
                fields.bytes(6, least);
            }
        });
    }
}

/// A page: its head, with what is said of its kind added by `head`, and its content.
fn page(
    bytes: &mut Vec<u8>,
    kind: i32,
    content: &[u8],
    head: impl FnOnce(&mut Fields<'_>),
) -> io::Result<()> {
    let size = i32::try_from(content.len())
        .map_err(|_| io::Error::other("a page of a Parquet file has at most 2 GB"))?;
    structure(bytes, |fields| {
        fields.int(1, kind);
        fields.int(2, size);
        fields.int(3, size);
        head(fields);
    });
    bytes.extend_from_slice(content);
    Ok(())
}

fn plain(bytes: &mut Vec<u8>, values: impl Iterator<Item = [u8; 8]>) {
    bytes.reserve(8 * values.size_hint().0);
    values.for_each(|value| bytes.extend_from_slice(&value));
}

/// Which values are there, by runs with their length before them; how many are not.
fn levels<T>(bytes: &mut Vec<u8>, values: &[Option<T>]) -> io::Result<i64> {
    let there: Vec<u32> = values.iter().map(|value| u32::from(value.is_some())).collect();
    let start = bytes.len();
    bytes.extend([0; 4]);
    runs(bytes, &there, 1);
    let length = u32::try_from(bytes.len() - start - 4).map_err(io::Error::other)?;
    bytes[start..start + 4].copy_from_slice(&length.to_le_bytes());
    Ok(there.iter().filter(|&&there| there == 0).count() as i64)
}

/// The least and the greatest of all that are numbers. Zeros are equal for the format, whatever their signs,
/// so that both are within.
fn range_of_numbers(values: impl Iterator<Item = f64>) -> Option<[[u8; 8]; 2]> {
    let ends = |[least, most]: [f64; 2], value: f64| [least.min(value), most.max(value)];
    let [least, most] = values.fold([f64::INFINITY, f64::NEG_INFINITY], ends);
    let least = if least == 0.0 { -0.0 } else { least };
    let most = if most == 0.0 { 0.0 } else { most };
    (least <= most).then(|| [least.to_le_bytes(), most.to_le_bytes()])
}

/// The different texts of a column, and which of them each row has.
struct Dictionary {
    content: Vec<u8>,
    size: usize,
    indices: Vec<u32>,
}

impl Dictionary {
    fn new<'a>(texts: &'a [String]) -> Self {
        let mut content = Vec::new();
        let mut known: HashMap<&'a str, u32> = HashMap::new();
        let index = |text: &'a String| {
            let next = known.len() as u32;
            *known.entry(text).or_insert_with(|| {
                content.extend((text.len() as u32).to_le_bytes());
                content.extend_from_slice(text.as_bytes());
                next
            })
        };
        let indices = texts.iter().map(index).collect();
        Self { size: known.len(), content, indices }
    }
}

/// Integers of `width` bits: a value and its number where it comes often in a row, else packed.
fn runs(bytes: &mut Vec<u8>, values: &[u32], width: u32) {
    // What a run takes is worth some packed values.
    const WORTHWHILE: usize = 16;
    // Values are packed by eight; only the last may be fewer.
    let (mut packed_from, mut at) = (0, 0);
    while let Some(first) = values.get(at) {
        let length = values[at..].iter().take_while(|value| *value == first).count();
        if length < WORTHWHILE {
            at = values.len().min(at + 8);
            continue;
        }
        pack(bytes, &values[packed_from..at], width);
        varint(bytes, (length as u64) << 1);
        bytes.extend_from_slice(&first.to_le_bytes()[..width.div_ceil(8) as usize]);
        at += length;
        packed_from = at;
    }
    pack(bytes, &values[packed_from..], width);
}

/// Values bit by bit, the lowest bit first, filled up with zeros to a multiple of eight.
fn pack(bytes: &mut Vec<u8>, values: &[u32], width: u32) {
    if values.is_empty() {
        return;
    }
    let groups = values.chunks(8);
    varint(bytes, (groups.len() as u64) << 1 | 1);
    for group in groups {
        let (mut word, mut bits) = (0_u64, 0);
        for place in 0..8 {
            word |= u64::from(group.get(place).copied().unwrap_or(0)) << bits;
            bits += width;
            while bits >= 8 {
                bytes.push(word as u8);
                (word, bits) = (word >> 8, bits - 8);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parquet::encoding::Hybrid;

    #[test]
    fn runs_read_back_as_the_values_they_were_made_of() {
        let long = |value: u32, count: usize| std::iter::repeat_n(value, count);
        let mixed = (0..13).chain(long(5, 100)).chain(0..3).chain(long(31, 16)).chain([1, 2]);
        for (width, values) in [
            (1, vec![1]),
            (1, [0, 1].repeat(50)),
            (1, vec![0; 70_000]),
            (5, mixed.collect::<Vec<_>>()),
            (17, (0..100_000).collect()),
            (32, vec![u32::MAX, 0, u32::MAX]),
        ] {
            let mut bytes = Vec::new();
            runs(&mut bytes, &values, width);
            let mut reader = Hybrid::new(bytes, width).unwrap();
            let found: Vec<_> = (0..values.len()).map(|_| reader.next().unwrap() as u32).collect();
            assert_eq!(found, values, "{width} bits");
        }
        let mut bytes = Vec::new();
        runs(&mut bytes, &[3; 1000], 9);
        assert_eq!(bytes, [0xd0, 0x0f, 3, 0], "a run of one value is short");
    }

    #[test]
    fn ranges_leave_out_what_is_no_number_and_hold_both_zeros() {
        let range = |values: &[f64]| {
            range_of_numbers(values.iter().copied()).map(|ends| ends.map(f64::from_le_bytes))
        };
        assert_eq!(range(&[1.0, f64::NAN, -2.0]), Some([-2.0, 1.0]));
        assert_eq!(range(&[f64::NAN]), None);
        assert_eq!(range(&[]), None);
        let [least, most] = range(&[0.0, -0.0]).unwrap();
        assert!(least.is_sign_negative() && most.is_sign_positive());
        assert_eq!(range(&[f64::INFINITY, 0.5]), Some([0.5, f64::INFINITY]));
    }
}
