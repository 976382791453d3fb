//! Reading the pages of one column, one at a time.

use std::io::{Read, Seek, SeekFrom};
use std::sync::Arc;
use std::sync::atomic::Ordering;

use super::encoding::{DeltaTexts, Deltas, Integers};
use super::schema::{Leaf, LeafType, ListLeaf};
use super::{ColumnChunk, KIND, ParquetSource};
use crate::budget;
use crate::bytes::ByteReader;
use crate::codec::{Codec, unpack};
use crate::element::{Element, Strided};
use crate::format::{Cell, ColumnPart, OpenFile};
use crate::kind::TableError;
use crate::thrift::{self, Value};

/// The longest page header; it may contain statistics.
const HEAD: u64 = 1 << 20;

pub(super) struct ColumnReader {
    /// The pages that have not been read.
    chunk: ColumnChunk,
    dictionary: ColumnPart,
    dictionary_bytes: u64,
    page: Option<Page>,
    /// Number of elements read from the current row's list.
    elements: usize,
}

struct Page {
    left: u64,
    /// Repetition levels of a list: 0 where the next row begins.
    repeats: Option<Integers>,
    /// Definition levels, if values may be missing.
    levels: Option<Integers>,
    values: PageValues,
    bytes: u64,
}

/// The present values of a page.
enum PageValues {
    /// Consecutive values, and the position of the next one.
    Plain(Vec<u8>, usize),
    Indices(Integers),
    Truths(Integers),
    Deltas(Box<Deltas>),
    DeltaTexts(Box<DeltaTexts>),
}

/// Number of list elements that are checked for the lengths of lists.
const LOOKED_AT: u64 = 1 << 14;

/// Largest number of bytes of texts in a part of a column: a few bytes of a file can repeat a long text for every row.
const TEXTS: usize = 64 << 20;

const DATA: i64 = 0;
const DICTIONARY: i64 = 2;
const DATA_2: i64 = 3;

impl ColumnReader {
    pub(super) fn new(chunk: ColumnChunk) -> Self {
        let dictionary = ColumnPart::default();
        Self { chunk, dictionary, dictionary_bytes: 0, page: None, elements: 0 }
    }

    /// Returns true if the next `rows` rows need another page.
    pub(super) fn needs_page(&self, rows: usize) -> bool {
        self.page.as_ref().is_none_or(|page| page.left < rows as u64)
    }

    fn held(&self) -> u64 {
        self.dictionary_bytes + self.page.as_ref().map_or(0, |page| page.bytes)
    }

    pub(super) fn read(
        &mut self,
        source: &mut ParquetSource,
        leaf: &Leaf,
        count: usize,
        part: &mut ColumnPart,
    ) -> Result<(), TableError> {
        let (mut left, mut levels, mut text_bytes) = (count, Vec::new(), TEXTS);
        while left > 0 {
            let Some(page) = self.page.as_mut().filter(|page| page.left > 0) else {
                let is_text = matches!(part, ColumnPart::Cells(_));
                self.next_page(source, leaf, is_text)?;
                continue;
            };
            let mut count = left.min(usize::try_from(page.left).unwrap_or(usize::MAX));
            let read = match &mut page.levels {
                None => page.values.read(count, leaf.kind, &self.dictionary, &mut text_bytes, part),
                Some(integers) => {
                    levels.clear();
                    let read = integers.read(count, &mut levels);
                    count = levels.len();
                    let is_there = |level: &u64| *level == u64::from(leaf.levels);
                    let mut runs = levels.chunk_by(|a, b| is_there(a) == is_there(b));
                    read.and_then(|()| {
                        runs.try_for_each(|run| match is_there(&run[0]) {
                            true => page.values.read(
                                run.len(),
                                leaf.kind,
                                &self.dictionary,
                                &mut text_bytes,
                                part,
                            ),
                            false => {
                                run.iter().for_each(|_| part.push(Cell::Missing));
                                Some(())
                            }
                        })
                    })
                }
            };
            read.ok_or_else(|| unread_values(leaf, text_bytes))?;
            page.left -= count as u64;
            left -= count;
        }
        Ok(())
    }

    /// Reads the elements of the lists in the next rows, row by row.
    pub(super) fn read_lists(
        &mut self,
        source: &mut ParquetSource,
        leaf: &Leaf,
        list: &ListLeaf,
        rows: usize,
        part: &mut ColumnPart,
    ) -> Result<(), TableError> {
        let wrong = || KIND.damaged(format!("column `{}`: a page of values", leaf.name));
        let different =
            || KIND.unsupported(format!("column `{}` holds lists of different lengths", leaf.name));
        let (mut row, mut levels, mut text_bytes) = (0, Vec::new(), TEXTS);
        while row < rows {
            let Some(page) = self.page.as_mut().filter(|page| page.left > 0) else {
                if self.elements > 0 && self.chunk.at >= self.chunk.end {
                    return Err(different());
                }
                let is_text = matches!(part, ColumnPart::Cells(_));
                self.next_page(source, leaf, is_text)?;
                continue;
            };
            levels.clear();
            let repeats = page.repeats.as_mut().ok_or_else(wrong)?;
            repeats.read(1, &mut levels).ok_or_else(wrong)?;
            page.levels.as_mut().ok_or_else(wrong)?.read(1, &mut levels).ok_or_else(wrong)?;
            page.left -= 1;
            let (begins, level) = (levels[0] == 0, levels[1]);
            let has_element = level >= u64::from(list.level);
            if begins != (self.elements == 0) || !begins && !has_element {
                return Err(different());
            }
            let count = if has_element { 1 } else { list.length };
            if level == u64::from(leaf.levels) {
                let dictionary = &self.dictionary;
                let read = page.values.read(1, leaf.kind, dictionary, &mut text_bytes, part);
                read.ok_or_else(|| unread_values(leaf, text_bytes))?;
            } else {
                (0..count).for_each(|_| part.push(Cell::Missing));
            }
            self.elements = (self.elements + count) % list.length.max(1);
            row += usize::from(self.elements == 0);
        }
        Ok(())
    }

    /// Returns the common length of the lists in the first page, 0 if all are missing; `None` if they differ.
    pub(super) fn list_length(
        &mut self,
        source: &mut ParquetSource,
        leaf: &Leaf,
    ) -> Result<Option<usize>, TableError> {
        while self.page.is_none() {
            self.next_page(source, leaf, true)?;
        }
        let (Some(list), Some(page)) = (&leaf.list, &mut self.page) else { return Ok(None) };
        let Page { left, repeats: Some(repeats), levels: Some(definitions), .. } = page else {
            return Ok(None);
        };
        // Enough elements to find lists that are longer than a row of a table may be.
        let most = (*left).min(LOOKED_AT) as usize;
        let read = |integers: &mut Integers| {
            let mut levels = Vec::new();
            while levels.len() < most && integers.read(most - levels.len(), &mut levels).is_some() {
            }
            levels
        };
        let (repeats, levels) = (read(repeats), read(definitions));
        let elements: Vec<(u64, u64)> = repeats.into_iter().zip(levels).collect();
        let lists = elements.chunk_by(|_, (repeat, _)| *repeat != 0);
        let is_there = |(_, level): &(u64, u64)| *level >= u64::from(list.level);
        let lengths: Vec<usize> =
            lists.filter(|list| list.iter().all(is_there)).map(<[_]>::len).collect();
        // The last list may continue in the next page.
        let only = match lengths.split_last() {
            None => Some(0),
            Some((last, [])) => Some(*last),
            Some((_, whole)) => whole.iter().all(|length| *length == whole[0]).then_some(whole[0]),
        };
        Ok(only.filter(|length| *length <= budget::COLUMNS))
    }

    fn next_page(
        &mut self,
        source: &mut ParquetSource,
        leaf: &Leaf,
        is_text: bool,
    ) -> Result<(), TableError> {
        let memory = Arc::clone(&source.memory);
        memory.held.fetch_sub(self.held(), Ordering::Relaxed);
        self.page = None;
        let read = self.read_page(source, leaf, is_text);
        memory.held.fetch_add(self.held(), Ordering::Relaxed);
        read
    }

    fn read_page(
        &mut self,
        source: &mut ParquetSource,
        leaf: &Leaf,
        is_text: bool,
    ) -> Result<(), TableError> {
        let name = &leaf.name;
        let ParquetSource { file, length, memory } = source;
        let (stored, others) = (*length, memory.held.load(Ordering::Relaxed));
        let (head, head_bytes) = self.head(file, name)?;
        let wrong = || KIND.damaged(format!("column `{name}`: the head of a page"));
        let size = |number| head.whole(number).and_then(|size| u64::try_from(size).ok());
        let page_bytes = size(2).ok_or_else(wrong)?;
        let left = self.chunk.end.saturating_sub(self.chunk.at + head_bytes);
        let packed_bytes = size(3).filter(|size| *size <= left).ok_or_else(wrong)?;
        memory.unpacked.add(KIND, page_bytes, stored)?;
        let held = others + self.dictionary_bytes + page_bytes;
        budget::check(KIND, format_args!("column `{name}`"), held, stored)?;
        file.seek(SeekFrom::Start(self.chunk.at + head_bytes))?;
        let mut packed = vec![0; packed_bytes as usize];
        file.read_exact(&mut packed)?;
        // CRC-32 of the page as stored, if the writer provided it.
        if head.whole(4).is_some_and(|checksum| checksum as u32 != crc32fast::hash(&packed)) {
            return Err(KIND.damaged(format!("column `{name}`: the checksum of a page is wrong")));
        }
        self.chunk.at += head_bytes + packed_bytes;
        let (kind, details) = match head.whole(1).ok_or_else(wrong)? {
            DATA => (DATA, 5),
            DICTIONARY => (DICTIONARY, 7),
            DATA_2 => (DATA_2, 8),
            // An index page.
            _ => return Ok(()),
        };
        let details = head.field(details).ok_or_else(wrong)?;
        let whole = |number: i16| details.whole(number);
        let count = |number| whole(number).and_then(|count| u64::try_from(count).ok());
        let unpack = |packed: &[u8], codec, size: u64| {
            unpack(codec, packed, size as usize)
                .map_err(|what| KIND.damaged(format!("column `{name}`, a compressed page: {what}")))
        };
        let (bytes, repeats, levels, encoding) = match kind {
            DICTIONARY => {
                let bytes = unpack(&packed, self.chunk.codec, page_bytes)?;
                let values = count(1).ok_or_else(wrong)?;
                self.dictionary_bytes =
                    page_bytes + values.saturating_mul(size_of::<Cell>() as u64);
                let held = others + self.dictionary_bytes;
                budget::check(KIND, format_args!("column `{name}`"), held, stored)?;
                let mut dictionary = ColumnPart::default();
                if is_text {
                    dictionary.cells();
                }
                let mut text_bytes = TEXTS;
                PageValues::Plain(bytes, 0)
                    .read(
                        values as usize,
                        leaf.kind,
                        &self.dictionary,
                        &mut text_bytes,
                        &mut dictionary,
                    )
                    .ok_or_else(wrong)?;
                self.dictionary = dictionary;
                return Ok(());
            }
            DATA => {
                let bytes = unpack(&packed, self.chunk.codec, page_bytes)?;
                let mut rest = ByteReader::new(&bytes);
                let mut levels = |is_there: bool, encoding: i16| {
                    if !is_there {
                        return Ok(Vec::new());
                    }
                    if whole(encoding) != Some(3) {
                        return Err(KIND.unsupported(format!("column `{name}`: levels as bits")));
                    }
                    let level_bytes = rest.u32().and_then(|length| rest.take(length as usize));
                    level_bytes.map(<[u8]>::to_vec).ok_or_else(wrong)
                };
                let repeats = levels(leaf.list.is_some(), 4)?;
                let levels = levels(leaf.levels > 0, 3)?;
                (rest.rest.to_vec(), repeats, levels, whole(2))
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
                let (repeats, levels) = levels.split_at(repetition);
                (values, repeats.to_vec(), levels.to_vec(), whole(4))
            }
        };
        let left = count(1).ok_or_else(wrong)?;
        let values = values(bytes, encoding, leaf)?;
        // The bit width of the highest level.
        let width = u8::BITS - leaf.levels.leading_zeros();
        let levels = (leaf.levels > 0).then(|| Integers::new(levels, width).ok_or_else(wrong));
        let levels = levels.transpose()?;
        let repeats = leaf.list.as_ref().and_then(|_| Integers::new(repeats, 1));
        self.page = Some(Page { left, repeats, levels, values, bytes: page_bytes });
        Ok(())
    }

    /// Reads the header of the next page; returns it with its length in bytes.
    fn head(&self, file: &mut OpenFile, name: &str) -> Result<(Value, u64), TableError> {
        let there = self.chunk.end.saturating_sub(self.chunk.at);
        if there == 0 {
            return Err(KIND.damaged(format!("column `{name}` has fewer values than rows")));
        }
        // Headers are usually short; a longer piece is read if necessary.
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
}

/// Prepares the values of a page for decoding, depending on their encoding.
fn values(bytes: Vec<u8>, encoding: Option<i64>, leaf: &Leaf) -> Result<PageValues, TableError> {
    let wrong = || KIND.damaged(format!("column `{}`: a page of values", leaf.name));
    let kind = leaf.kind;
    let is_truth = kind == LeafType::Number(Element::Truth);
    let is_whole = matches!(
        kind,
        LeafType::Number(Element::Signed(_) | Element::Unsigned(_) | Element::Time { .. })
    );
    Ok(match (encoding, kind.size()) {
        (Some(0), _) if is_truth => PageValues::Truths(Integers::of_bits(bytes)),
        (Some(0), _) => PageValues::Plain(bytes, 0),
        (Some(2 | 8), _) => match bytes.split_first() {
            // A page without values.
            None => PageValues::Plain(Vec::new(), 0),
            Some((&width, rest)) => {
                let indices = Integers::new(rest.to_vec(), width.into());
                PageValues::Indices(indices.ok_or_else(wrong)?)
            }
        },
        (Some(3), _) if is_truth => {
            let runs = bytes.get(4..).ok_or_else(wrong)?.to_vec();
            PageValues::Truths(Integers::new(runs, 1).ok_or_else(wrong)?)
        }
        (Some(5), Some(_)) if is_whole => {
            PageValues::Deltas(Box::new(Deltas::new(bytes).ok_or_else(wrong)?))
        }
        // A page without values may be empty.
        (Some(6 | 7), None) if bytes.is_empty() => PageValues::Plain(bytes, 0),
        (Some(encoding @ (6 | 7)), None) => {
            let texts = DeltaTexts::new(bytes, encoding == 7).ok_or_else(wrong)?;
            PageValues::DeltaTexts(Box::new(texts))
        }
        // Byte stream split: the first bytes of all values, then the second bytes, ….
        (Some(9), Some(size)) => {
            let count = bytes.len() / size;
            let in_order = |at: usize| bytes[at % size * count + at / size];
            PageValues::Plain((0..count * size).map(in_order).collect(), 0)
        }
        (other, _) => {
            let other = other.unwrap_or(-1);
            let what = format!("column `{}` has the encoding {other}", leaf.name);
            return Err(KIND.unsupported(what));
        }
    })
}

fn unread_values(leaf: &Leaf, text_bytes: usize) -> TableError {
    match text_bytes {
        0 => KIND.unsupported(format!("column `{}` has very long texts", leaf.name)),
        _ => KIND.damaged(format!("column `{}`: a page of values", leaf.name)),
    }
}

impl PageValues {
    /// Reads the next `count` values; `None` if there are fewer, or if their texts exceed `text_bytes` bytes.
    fn read(
        &mut self,
        count: usize,
        kind: LeafType,
        dictionary: &ColumnPart,
        text_bytes: &mut usize,
        part: &mut ColumnPart,
    ) -> Option<()> {
        let mut count_text = |text: &str| {
            *text_bytes = text_bytes.saturating_sub(text.len());
            (*text_bytes > 0).then_some(())
        };
        match self {
            Self::Plain(bytes, at) => {
                let mut rest = ByteReader::new(bytes.get(*at..)?);
                match kind {
                    LeafType::Number(element) => {
                        let size = element.size();
                        let bytes = rest.take(count.checked_mul(size)?)?;
                        let from = Strided { bytes, stride: size, rows: count };
                        element.read(from, true, part);
                    }
                    LeafType::DayAndTime => {
                        for _ in 0..count {
                            part.push(day_and_time(&mut rest)?);
                        }
                    }
                    LeafType::Text | LeafType::Opaque(_) => {
                        let cells = part.cells();
                        for _ in 0..count {
                            let length = usize::try_from(rest.u32()?).ok()?;
                            let text = String::from_utf8_lossy(rest.take(length)?);
                            cells.push(Cell::Text(text.into_owned()));
                        }
                    }
                }
                *at = bytes.len() - rest.rest.len();
            }
            Self::Indices(indices) => {
                let indices = exactly(indices, count)?;
                let indices = indices.into_iter().map(|index| usize::try_from(index).ok());
                match (dictionary, part) {
                    (
                        ColumnPart::Numbers { values: known, missing },
                        ColumnPart::Numbers { values, .. },
                    ) if missing.is_empty() => {
                        for at in indices {
                            values.push(*known.get(at?)?);
                        }
                    }
                    (ColumnPart::Numbers { values: known, missing }, part) => {
                        for at in indices {
                            let at = at?;
                            let value = Cell::Real(*known.get(at)?);
                            let is_missing = missing.contains(&at);
                            part.push(if is_missing { Cell::Missing } else { value });
                        }
                    }
                    (ColumnPart::Cells(known), part) => {
                        let cells = part.cells();
                        for at in indices {
                            let cell = known.get(at?)?;
                            if let Cell::Text(text) = cell {
                                count_text(text)?;
                            }
                            cells.push(cell.clone());
                        }
                    }
                }
            }
            Self::Truths(bits) => {
                let bits = exactly(bits, count)?.into_iter();
                bits.for_each(|bit| part.push(Cell::Whole(i64::from(bit != 0))));
            }
            Self::DeltaTexts(texts) => {
                let cells = part.cells();
                for _ in 0..count {
                    let text = String::from_utf8_lossy(texts.next()?);
                    count_text(&text)?;
                    cells.push(Cell::Text(text.into_owned()));
                }
            }
            Self::Deltas(values) => {
                let LeafType::Number(element) = kind else { return None };
                for _ in 0..count {
                    // Shorter numbers are the lowest bytes of the 64-bit result.
                    let bytes = values.next()?.to_le_bytes();
                    part.push(element.cell(&bytes[..element.size()], true));
                }
            }
        }
        Some(())
    }
}

fn exactly(integers: &mut Integers, count: usize) -> Option<Vec<u64>> {
    let mut values = Vec::new();
    while values.len() < count {
        integers.read(count - values.len(), &mut values)?;
    }
    Some(values)
}

/// Reads the nanoseconds of the day and the Julian day; Julian day 2,440,588 is 1970-01-01.
fn day_and_time(bytes: &mut ByteReader<'_>) -> Option<Cell> {
    let (of_day, day) = (bytes.i64()?, bytes.i32()?);
    let seconds = (i64::from(day) - 2_440_588) * 86_400;
    let units = seconds.saturating_mul(1_000_000_000).saturating_add(of_day);
    Some(Cell::Time { units, per_second: 1_000_000_000 })
}
