//! The pages of one column, one at a time.

use std::io::{Read, Seek, SeekFrom};
use std::sync::Arc;

use super::encoding::{deltas, integers, single_bits};
use super::schema::{Leaf, LeafType};
use super::{ColumnChunk, KIND, ParquetSource};
use crate::budget;
use crate::bytes::ByteReader;
use crate::calendar::iso_of;
use crate::codec::{Codec, unpack};
use crate::element::Element;
use crate::format::{Cell, OpenFile};
use crate::kind::TableError;
use crate::thrift::{self, Value};

/// The longest head of a page: statistics may be in it.
const HEAD: u64 = 1 << 20;

/// The column of a row group that is being read.
pub(super) struct ColumnReader {
    /// What has not been read.
    chunk: ColumnChunk,
    dictionary: Arc<Vec<Cell>>,
    dictionary_bytes: u64,
    page: Option<Page>,
}

/// A page that is being read.
struct Page {
    left: u64,
    cells: PageCells,
    bytes: u64,
}

/// The cells of a page, or those of them that are there.
type PageCells = Box<dyn Iterator<Item = Cell> + Send>;

const DATA: i64 = 0;
const DICTIONARY: i64 = 2;
const DATA_2: i64 = 3;

impl ColumnReader {
    pub(super) fn new(chunk: ColumnChunk) -> Self {
        Self { chunk, dictionary: Arc::default(), dictionary_bytes: 0, page: None }
    }

    /// How much memory its page and dictionary take.
    pub(super) fn held(&self) -> u64 {
        self.dictionary_bytes + self.page.as_ref().map_or(0, |page| page.bytes)
    }

    /// Adds the next cells.
    pub(super) fn read(
        &mut self,
        source: &mut ParquetSource,
        leaf: &Leaf,
        count: usize,
        cells: &mut Vec<Cell>,
    ) -> Result<(), TableError> {
        let wrong = || KIND.damaged(format!("column `{}`: a page of values", leaf.name));
        while cells.len() < count {
            let Some(page) = self.page.as_mut().filter(|page| page.left > 0) else {
                self.next_page(source, leaf)?;
                continue;
            };
            page.left -= 1;
            cells.push(page.cells.next().ok_or_else(wrong)?);
        }
        Ok(())
    }

    fn next_page(&mut self, source: &mut ParquetSource, leaf: &Leaf) -> Result<(), TableError> {
        self.page = None;
        let name = &leaf.name;
        let ParquetSource { file, length: stored, held: others, unpacked } = source;
        let (stored, others) = (*stored, *others);
        let (head, head_bytes) = self.head(file, name)?;
        let wrong = || KIND.damaged(format!("column `{name}`: the head of a page"));
        let size = |number| head.whole(number).and_then(|size| u64::try_from(size).ok());
        let page_bytes = size(2).ok_or_else(wrong)?;
        let left = self.chunk.end.saturating_sub(self.chunk.at + head_bytes);
        let packed_bytes = size(3).filter(|size| *size <= left).ok_or_else(wrong)?;
        unpacked.add(KIND, page_bytes, stored)?;
        let held = others + self.dictionary_bytes + page_bytes;
        budget::check(KIND, format_args!("column `{name}`"), held, stored)?;
        file.seek(SeekFrom::Start(self.chunk.at + head_bytes))?;
        let mut packed = vec![0; packed_bytes as usize];
        file.read_exact(&mut packed)?;
        // CRC-32 of the page as it is stored, if its writer gave it.
        if head.whole(4).is_some_and(|checksum| checksum as u32 != crc32fast::hash(&packed)) {
            return Err(KIND.damaged(format!("column `{name}`: the checksum of a page is wrong")));
        }
        self.chunk.at += head_bytes + packed_bytes;
        let (kind, details) = match head.whole(1).ok_or_else(wrong)? {
            DATA => (DATA, 5),
            DICTIONARY => (DICTIONARY, 7),
            DATA_2 => (DATA_2, 8),
            // An index.
            _ => return Ok(()),
        };
        let details = head.field(details).ok_or_else(wrong)?;
        let whole = |number: i16| details.whole(number);
        let count = |number| whole(number).and_then(|count| u64::try_from(count).ok());
        let unpack = |packed: &[u8], codec, size: u64| {
            unpack(codec, packed, size as usize)
                .map_err(|what| KIND.damaged(format!("column `{name}`, a compressed page: {what}")))
        };
        let (bytes, levels, encoding) = match kind {
            DICTIONARY => {
                let bytes = unpack(&packed, self.chunk.codec, page_bytes)?;
                let values = count(1).ok_or_else(wrong)?;
                self.dictionary_bytes =
                    page_bytes + values.saturating_mul(size_of::<Cell>() as u64);
                let held = others + self.dictionary_bytes;
                budget::check(KIND, format_args!("column `{name}`"), held, stored)?;
                let mut plain = plain(bytes, leaf.kind);
                let cells = (0..values).map(|_| plain.next().ok_or_else(wrong));
                self.dictionary = Arc::new(cells.collect::<Result<_, _>>()?);
                return Ok(());
            }
            DATA => {
                let mut bytes = unpack(&packed, self.chunk.codec, page_bytes)?;
                let mut levels = Vec::new();
                if leaf.levels > 0 {
                    if whole(3) != Some(3) {
                        return Err(KIND.unsupported(format!("column `{name}`: levels as bits")));
                    }
                    let mut rest = ByteReader::new(&bytes);
                    let level_bytes = rest.u32().and_then(|length| rest.take(length as usize));
                    levels.extend_from_slice(level_bytes.ok_or_else(wrong)?);
                    bytes.drain(..4 + levels.len());
                }
                (bytes, levels, whole(2))
            }
            _ => {
                let size = |number| count(number).and_then(|size| usize::try_from(size).ok());
                let (definition, repetition) = size(5).zip(size(6)).ok_or_else(wrong)?;
                let before = definition.checked_add(repetition).ok_or_else(wrong)?;
                let (levels, values) = packed.split_at_checked(before).ok_or_else(wrong)?;
                let is_packed = details.field(7) != Some(&Value::Truth(false));
                let codec = if is_packed { self.chunk.codec } else { Codec::None };
                let unpacked = page_bytes.checked_sub(before as u64).ok_or_else(wrong)?;
                let values = match values.is_empty() {
                    true => Vec::new(),
                    false => unpack(values, codec, unpacked)?,
                };
                (values, levels[repetition..].to_vec(), whole(4))
            }
        };
        let left = count(1).ok_or_else(wrong)?;
        let mut cells = self.values(bytes, encoding, leaf)?;
        let most = leaf.levels;
        if most > 0 {
            // As many bits as the highest has.
            let levels = integers(levels, u8::BITS - most.leading_zeros());
            let (mut levels, mut values) = (levels.ok_or_else(wrong)?, cells);
            cells = Box::new(std::iter::from_fn(move || match levels.next()? {
                level if level == u64::from(most) => values.next(),
                _ => Some(Cell::Missing),
            }));
        }
        self.page = Some(Page { left, cells, bytes: page_bytes });
        Ok(())
    }

    /// The head of the next page, and how many bytes it has.
    fn head(&self, file: &mut OpenFile, name: &str) -> Result<(Value, u64), TableError> {
        let there = self.chunk.end.saturating_sub(self.chunk.at);
        if there == 0 {
            return Err(KIND.damaged(format!("column `{name}` has fewer values than rows")));
        }
        // As a rule short; once more where it is not.
        for most in [1 << 10, HEAD] {
            let mut bytes = vec![0; there.min(most) as usize];
            file.seek(SeekFrom::Start(self.chunk.at))?;
            file.read_exact(&mut bytes)?;
            let mut rest = ByteReader::new(&bytes);
            if let Some(head) = thrift::read(&mut rest) {
                return Ok((head, (bytes.len() - rest.rest.len()) as u64));
            }
        }
        Err(KIND.damaged(format!("column `{name}`: the head of a page")))
    }

    fn values(
        &self,
        bytes: Vec<u8>,
        encoding: Option<i64>,
        leaf: &Leaf,
    ) -> Result<PageCells, TableError> {
        let wrong = || KIND.damaged(format!("column `{}`: a page of values", leaf.name));
        let kind = leaf.kind;
        let is_truth = kind == LeafType::Number(Element::Truth);
        let is_whole = matches!(
            kind,
            LeafType::Number(Element::Signed(_) | Element::Unsigned(_) | Element::Time { .. })
        );
        Ok(match (encoding, kind.size()) {
            (Some(0), _) if is_truth => truths(single_bits(bytes)),
            (Some(0), _) => plain(bytes, kind),
            (Some(2 | 8), _) => match bytes.split_first() {
                // A page without values.
                None => Box::new(std::iter::empty()),
                Some((&width, rest)) => {
                    let indices = integers(rest.to_vec(), width.into()).ok_or_else(wrong)?;
                    let dictionary = Arc::clone(&self.dictionary);
                    let value =
                        move |index: u64| dictionary.get(usize::try_from(index).ok()?).cloned();
                    Box::new(indices.map_while(value))
                }
            },
            (Some(3), _) if is_truth => {
                let runs = bytes.get(4..).ok_or_else(wrong)?.to_vec();
                truths(integers(runs, 1).ok_or_else(wrong)?)
            }
            (Some(5), Some(size)) if is_whole => {
                let values = deltas(bytes).ok_or_else(wrong)?;
                // The lowest bytes of the difference are those of shorter numbers.
                Box::new(values.map(move |value| cell(&value.to_le_bytes()[..size], kind)))
            }
            // The first bytes of all values, then the second, ….
            (Some(9), Some(size)) => {
                let count = bytes.len() / size;
                let value = move |at: usize| -> Vec<u8> {
                    (0..size).map(|byte: usize| bytes[byte * count + at]).collect()
                };
                Box::new((0..count).map(move |at| cell(&value(at), kind)))
            }
            (other, _) => {
                let name = match other {
                    Some(6) => "DELTA_LENGTH_BYTE_ARRAY".to_owned(),
                    Some(7) => "DELTA_BYTE_ARRAY".to_owned(),
                    other => other.unwrap_or(-1).to_string(),
                };
                let what = format!("column `{}` has the encoding {name}", leaf.name);
                return Err(KIND.unsupported(what));
            }
        })
    }
}

fn truths(bits: impl Iterator<Item = u64> + Send + 'static) -> PageCells {
    Box::new(bits.map(|bit| Cell::Whole(i64::from(bit != 0))))
}

/// Values one after the other, texts with their lengths before them.
fn plain(bytes: Vec<u8>, kind: LeafType) -> PageCells {
    let mut at = 0;
    Box::new(std::iter::from_fn(move || {
        let mut rest = ByteReader::new(bytes.get(at..)?);
        let size = match kind.size() {
            Some(size) => size,
            None => usize::try_from(rest.u32()?).ok()?,
        };
        let value = rest.take(size)?;
        at = bytes.len() - rest.rest.len();
        Some(cell(value, kind))
    }))
}

/// The value in some bytes, of which there are as many as its type has.
fn cell(bytes: &[u8], kind: LeafType) -> Cell {
    match kind {
        LeafType::Number(element) => element.cell(bytes, true),
        LeafType::Text => Cell::Text(String::from_utf8_lossy(bytes).into_owned()),
        LeafType::DayAndTime => {
            // Nanoseconds of the day, and the Julian day, of which 2,440,588 began in 1970.
            let mut rest = ByteReader::new(bytes);
            let (of_day, day) = (rest.i64().unwrap_or(0), rest.i32().unwrap_or(0));
            let seconds = (i64::from(day) - 2_440_588) * 86_400;
            let at = seconds.saturating_mul(1_000_000_000).saturating_add(of_day);
            Cell::Text(iso_of(at, 1_000_000_000))
        }
        LeafType::Opaque(_) => Cell::Missing,
    }
}
