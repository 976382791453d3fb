//! The rows of a record batch: its buffers, and the cells in them.

use std::collections::HashMap;
use std::ops::Range;
use std::sync::Arc;

use super::KIND;
use super::schema::{Field, Kind};
use crate::budget;
use crate::bytes::part;
use crate::calendar::iso_of;
use crate::codec::{Codec, unpack};
use crate::element::Element;
use crate::error::TableError;
use crate::flatbuffer::Object;
use crate::rows::Cell;

/// The values of a column in a record batch.
pub(super) struct Column {
    kind: Kind,
    dictionary: Option<(i64, Element)>,
    /// One bit for each row, or none where all are there.
    valid: Buffer,
    /// Values, indices, offsets or views.
    values: Buffer,
    /// What offsets and views point into.
    texts: Vec<Buffer>,
}

/// A part of the body of a message, unpacked.
#[derive(Clone)]
struct Buffer {
    bytes: Arc<Vec<u8>>,
    range: Range<usize>,
}

impl Buffer {
    fn bytes(&self) -> &[u8] {
        &self.bytes[self.range.clone()]
    }
}

/// What is left of the nodes and buffers of a record batch.
struct Walk<'a> {
    nodes: std::vec::IntoIter<[i64; 2]>,
    buffers: std::vec::IntoIter<[i64; 2]>,
    views: std::vec::IntoIter<[i64; 1]>,
    body: &'a Arc<Vec<u8>>,
    codec: Option<Codec>,
    rows: u64,
    /// Bytes that have been unpacked.
    unpacked: u64,
}

/// Why a walk ends.
pub(super) enum Stop {
    Damaged,
    Error(TableError),
}

impl Stop {
    /// The error, where `place` is what is damaged.
    pub(super) fn at(self, place: &str) -> TableError {
        match self {
            Self::Damaged => KIND.damaged(place),
            Self::Error(error) => error,
        }
    }
}

/// Some rows.
pub(super) struct RecordBatch {
    pub(super) columns: Vec<Column>,
    pub(super) rows: Range<usize>,
    /// How many bytes were unpacked.
    pub(super) unpacked: u64,
}

pub(super) fn record_batch(
    fields: &[Field],
    records: &Object<'_>,
    body: &Arc<Vec<u8>>,
) -> Result<RecordBatch, Stop> {
    let rows = u64::try_from(records.long(0).unwrap_or(0)).map_err(|_| Stop::Damaged)?;
    let codec = records.object(3).map(|compression| match compression.byte(0).unwrap_or(0) {
        0 => Codec::Lz4Frame,
        _ => Codec::Zstd,
    });
    let mut walk = Walk {
        nodes: records.structs(1).ok_or(Stop::Damaged)?.into_iter(),
        buffers: records.structs(2).ok_or(Stop::Damaged)?.into_iter(),
        views: records.structs(4).ok_or(Stop::Damaged)?.into_iter(),
        body,
        codec,
        rows,
        unpacked: 0,
    };
    let mut columns = Vec::new();
    fields.iter().try_for_each(|field| walk.field(field, true, &mut columns))?;
    let has_values =
        columns.iter().any(|column| !matches!(column.kind, Kind::Null | Kind::Opaque(..)));
    if rows > 0 && !has_values {
        return Err(Stop::Error(KIND.unsupported("no column of numbers or texts")));
    }
    let rows = 0..usize::try_from(rows).map_err(|_| Stop::Damaged)?;
    Ok(RecordBatch { columns, rows, unpacked: walk.unpacked })
}

impl Walk<'_> {
    /// Takes a field off; `is_wanted` unless it is within a list.
    fn field(
        &mut self,
        field: &Field,
        is_wanted: bool,
        columns: &mut Vec<Column>,
    ) -> Result<(), Stop> {
        let [length, _] = self.nodes.next().ok_or(Stop::Damaged)?;
        if is_wanted && u64::try_from(length).ok() != Some(self.rows) {
            return Err(Stop::Damaged);
        }
        if let Some((_, index)) = field.dictionary {
            return self.column(field, Kind::Number(index), is_wanted, columns);
        }
        match field.kind {
            Kind::Struct => {
                self.skip(1)?;
                field.children.iter().try_for_each(|child| self.field(child, is_wanted, columns))
            }
            Kind::Null | Kind::Opaque(..) => {
                self.skip(if let Kind::Opaque(_, buffers) = field.kind { buffers } else { 0 })?;
                if is_wanted {
                    let empty = Buffer { bytes: Arc::new(Vec::new()), range: 0..0 };
                    columns.push(Column {
                        kind: field.kind,
                        dictionary: None,
                        valid: empty.clone(),
                        values: empty,
                        texts: Vec::new(),
                    });
                }
                field.children.iter().try_for_each(|child| self.field(child, false, columns))
            }
            kind => self.column(field, kind, is_wanted, columns),
        }
    }

    fn skip(&mut self, buffers: usize) -> Result<(), Stop> {
        (0..buffers).try_for_each(|_| self.buffers.next().map(drop).ok_or(Stop::Damaged))
    }

    fn column(
        &mut self,
        field: &Field,
        kind: Kind,
        is_wanted: bool,
        columns: &mut Vec<Column>,
    ) -> Result<(), Stop> {
        let views = match kind {
            Kind::TextView => {
                let [count] = self.views.next().ok_or(Stop::Damaged)?;
                usize::try_from(count).map_err(|_| Stop::Damaged)?
            }
            Kind::Text(_) => 1,
            _ => 0,
        };
        if !is_wanted {
            return self.skip(2 + views.min(self.buffers.len() + 1));
        }
        let (valid, values) = (self.buffer()?, self.buffer()?);
        // Taken one by one: there are no more than the message lists.
        let mut texts = Vec::new();
        for _ in 0..views {
            texts.push(self.buffer()?);
        }
        let rows = usize::try_from(self.rows).map_err(|_| Stop::Damaged)?;
        let needed = match kind {
            Kind::Number(element) | Kind::Time(_, element) => rows.checked_mul(element.size()),
            Kind::Days => rows.checked_mul(4),
            Kind::Truth => Some(rows.div_ceil(8)),
            Kind::Text(_) if rows == 0 => Some(0),
            Kind::Text(offset) => rows.checked_add(1).and_then(|it| it.checked_mul(offset.size())),
            _ => rows.checked_mul(16),
        };
        let fits = |buffer: &Buffer, needed| buffer.range.len() >= needed;
        let has_valid = valid.range.is_empty() || fits(&valid, rows.div_ceil(8));
        if !has_valid || !needed.is_some_and(|needed| fits(&values, needed)) {
            return Err(Stop::Damaged);
        }
        columns.push(Column { kind, dictionary: field.dictionary, valid, values, texts });
        Ok(())
    }

    fn buffer(&mut self) -> Result<Buffer, Stop> {
        let [offset, length] = self.buffers.next().ok_or(Stop::Damaged)?;
        let (offset, length) = (u64::try_from(offset).ok(), u64::try_from(length).ok());
        let (offset, length) = offset.zip(length).ok_or(Stop::Damaged)?;
        let stored = part(self.body, offset, length).ok_or(Stop::Damaged)?;
        let start = offset as usize;
        let plain = |from: usize| Buffer {
            bytes: Arc::clone(self.body),
            range: start + from..start + stored.len(),
        };
        let Some(codec) = self.codec else { return Ok(plain(0)) };
        let Some((size, packed)) = stored.split_first_chunk::<8>() else {
            // Nothing is not compressed.
            return if stored.is_empty() { Ok(plain(0)) } else { Err(Stop::Damaged) };
        };
        let size = match i64::from_le_bytes(*size) {
            -1 => return Ok(plain(8)),
            size => u64::try_from(size).map_err(|_| Stop::Damaged)?,
        };
        self.unpacked = self.unpacked.saturating_add(size);
        let stored = self.body.len() as u64;
        budget::check(KIND, || "a record batch".to_owned(), self.unpacked, stored)
            .map_err(Stop::Error)?;
        let bytes = unpack(codec, packed, size as usize)
            .map_err(|what| Stop::Error(KIND.damaged(format!("a compressed part: {what}"))))?;
        let range = 0..bytes.len();
        Ok(Buffer { bytes: Arc::new(bytes), range })
    }
}

impl Column {
    pub(super) fn cell(&self, row: usize, dictionaries: &HashMap<i64, Vec<Cell>>) -> Cell {
        let bit = |bytes: &[u8]| bytes.get(row / 8).is_some_and(|byte| byte >> (row % 8) & 1 == 1);
        if !self.valid.range.is_empty() && !bit(self.valid.bytes()) {
            return Cell::Missing;
        }
        let values = self.values.bytes();
        let number = |element: Element, at: usize| {
            let size = element.size();
            values
                .get(at * size..)
                .and_then(|rest| rest.get(..size))
                .map_or(Cell::Missing, |bytes| element.cell(bytes, true))
        };
        let place = |at: usize, element| match number(element, at) {
            Cell::Whole(offset) => usize::try_from(offset).ok(),
            _ => None,
        };
        match self.kind {
            Kind::Number(element) => match self.dictionary {
                None => number(element, row),
                Some((id, _)) => {
                    let words = dictionaries.get(&id);
                    let word = words.and_then(|words| words.get(place(row, element)?));
                    word.cloned().unwrap_or_default()
                }
            },
            Kind::Truth => Cell::Whole(i64::from(bit(values))),
            Kind::Time(per_second, element) => match number(element, row) {
                Cell::Whole(units) => Cell::Text(iso_of(units, per_second)),
                cell => cell,
            },
            Kind::Days => match number(Element::Signed(4), row) {
                Cell::Whole(days) => Cell::Text(iso_of(days * 86_400, 1)),
                cell => cell,
            },
            Kind::Text(offset) => {
                let ends = place(row, offset).zip(place(row + 1, offset));
                let text =
                    ends.and_then(|(start, end)| self.texts.first()?.bytes().get(start..end));
                text_cell(text)
            }
            Kind::TextView => text_cell(self.view(row)),
            Kind::Opaque(what, _) => Cell::Text(what.to_owned()),
            Kind::Null | Kind::Struct => Cell::Missing,
        }
    }

    /// The text that a view of 16 bytes shows: in itself where it is short.
    fn view(&self, row: usize) -> Option<&[u8]> {
        let view = self.values.bytes().get(16 * row..)?.get(..16)?;
        let word = |at: usize| {
            let bytes = view.get(at..).and_then(|rest| rest.first_chunk())?;
            usize::try_from(i32::from_le_bytes(*bytes)).ok()
        };
        let length = word(0)?;
        match length <= 12 {
            true => view.get(4..4 + length),
            false => self.texts.get(word(8)?)?.bytes().get(word(12)?..)?.get(..length),
        }
    }
}

fn text_cell(text: Option<&[u8]>) -> Cell {
    text.map_or(Cell::Missing, |text| Cell::Text(String::from_utf8_lossy(text).into_owned()))
}
