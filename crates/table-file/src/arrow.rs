//! Arrow's interchange format (IPC), as a file, which is also Feather version 2, or as a stream:
//! "Arrow Columnar Format", chapter "Serialization and Interprocess Communication".
//!
//! A stream is read from its start, a file by its footer. Structs become columns `outer.inner`; lists and other types without a number or text per row become columns
//! that name their type.

use std::collections::HashMap;
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::budget::{self, Unpacked};
use crate::bytes::part;
use crate::calendar::iso_of;
use crate::codec::{Codec, unpack};
use crate::element::Element;
use crate::error::TableError;
use crate::flatbuffer::Object;
use crate::kind::FileKind;
use crate::rows::{Batch, Cell, Layout, Rows, batch_rows};

const KIND: FileKind = FileKind::Arrow;

/// How deep types may be nested.
const DEPTH: usize = 32;

fn damaged(what: impl Into<String>) -> TableError {
    TableError::Damaged { kind: KIND, what: what.into() }
}

fn unsupported(what: impl Into<String>) -> TableError {
    TableError::Unsupported { kind: KIND, what: what.into() }
}

/// A field of the schema.
#[derive(Clone, Debug)]
struct Field {
    name: String,
    kind: Kind,
    children: Vec<Field>,
    /// Where its values are indices, of which type, into which dictionary.
    dictionary: Option<(i64, Element)>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Null,
    Number(Element),
    Truth,
    /// Text by offsets of this type.
    Text(Element),
    TextView,
    /// So many of its unit make a second; of this type.
    Time(i64, Element),
    /// Days of 32 bits.
    Days,
    Struct,
    /// What is not read, with so many buffers of its own.
    Opaque(&'static str, usize),
}

/// A message: what it is, and how long its body is.
struct Message {
    metadata: Vec<u8>,
    body_bytes: u64,
}

const SCHEMA: u8 = 1;
const DICTIONARY: u8 = 2;
const RECORDS: u8 = 3;

/// The messages of a file: one after the other in a stream, where the footer says in a file.
struct Messages {
    file: BufReader<File>,
    at: u64,
    length: u64,
    /// Where messages start in a file, in the order in which they are read.
    blocks: Option<std::vec::IntoIter<u64>>,
}

/// The end of a file: its name again, and before that the length of the footer.
const END: u64 = 10;

impl Messages {
    /// Also gives the footer of a file.
    fn open(path: &Path) -> Result<(Self, Option<Vec<u8>>), TableError> {
        let file = File::open(path)?;
        let length = file.metadata()?.len();
        let file = BufReader::with_capacity(1 << 16, file);
        let mut messages = Self { file, at: 0, length, blocks: None };
        let mut start = [0; 6];
        messages.read_into(&mut start)?;
        if start != *b"ARROW1" {
            messages.seek(0)?;
            return Ok((messages, None));
        }
        let cut = || damaged("it is cut off: its end is missing");
        let before = length.checked_sub(END).ok_or_else(cut)?;
        messages.seek(before)?;
        let mut end = [0; END as usize];
        messages.read_into(&mut end)?;
        if !end.ends_with(b"ARROW1") {
            return Err(cut());
        }
        let bytes = u64::from(u32::from_le_bytes([end[0], end[1], end[2], end[3]]));
        let size = budget::check_description(KIND, "its footer", bytes)?;
        messages.seek(before.checked_sub(bytes).ok_or_else(cut)?)?;
        let mut footer = vec![0; size];
        messages.read_into(&mut footer)?;
        let root = Object::root(&footer).ok_or_else(|| damaged("its footer"))?;
        // Dictionaries come first, as rows refer to them.
        let blocks = root.structs::<3>(2).zip(root.structs::<3>(3));
        let (dictionaries, records) = blocks.ok_or_else(|| damaged("its footer"))?;
        let starts =
            dictionaries.into_iter().chain(records).map(|[start, ..]| u64::try_from(start));
        let starts = starts.collect::<Result<Vec<_>, _>>().map_err(|_| damaged("its footer"))?;
        messages.blocks = Some(starts.into_iter());
        Ok((messages, Some(footer)))
    }

    fn seek(&mut self, at: u64) -> Result<(), TableError> {
        self.file.seek(SeekFrom::Start(at))?;
        self.at = at;
        Ok(())
    }

    fn read_into(&mut self, bytes: &mut [u8]) -> Result<(), TableError> {
        self.file.read_exact(bytes).map_err(|error| match error.kind() {
            std::io::ErrorKind::UnexpectedEof => {
                damaged(format!("it is cut off at byte {}", self.at))
            }
            _ => TableError::Io(error),
        })?;
        self.at += bytes.len() as u64;
        Ok(())
    }

    /// The next message, without its body; `None` at the end.
    fn next(&mut self) -> Result<Option<Message>, TableError> {
        let next_block = self.blocks.as_mut().map(Iterator::next);
        match next_block {
            Some(None) => return Ok(None),
            Some(Some(start)) => self.seek(start)?,
            // Some writers end a stream with its file.
            None if self.at == self.length => return Ok(None),
            None => {}
        }
        let at = self.at;
        let mut start = [0; 8];
        self.read_into(&mut start)?;
        let (mark, length) = start.split_at(4);
        if mark != [0xff; 4] {
            return Err(damaged(format!("no message at byte {at}; written before version 0.15?")));
        }
        let length = u32::from_le_bytes([length[0], length[1], length[2], length[3]]);
        if length == 0 {
            return Ok(None);
        }
        let size = budget::check_description(KIND, "a message", u64::from(length))?;
        if u64::from(length) > self.length.saturating_sub(self.at) {
            return Err(damaged(format!("it is cut off in the message at byte {at}")));
        }
        let mut metadata = vec![0; size];
        self.read_into(&mut metadata)?;
        let message = Object::root(&metadata);
        let body = message.map(|message| message.long(3).unwrap_or(0));
        let body = body.and_then(|bytes| u64::try_from(bytes).ok());
        let body_bytes = body.ok_or_else(|| damaged(format!("the message at byte {at}")))?;
        let there = self.length.saturating_sub(self.at);
        if body_bytes > there {
            return Err(damaged(format!(
                "{body_bytes} bytes expected at byte {}, {there} are there",
                self.at
            )));
        }
        Ok(Some(Message { metadata, body_bytes }))
    }

    /// The body of the message just read, which the file is long enough for.
    fn body(&mut self, message: &Message) -> Result<Vec<u8>, TableError> {
        let mut body = vec![0; usize::try_from(message.body_bytes).unwrap_or(0)];
        self.read_into(&mut body)?;
        Ok(body)
    }
}

/// A table in a file.
#[derive(Debug)]
struct ArrowTable {
    path: PathBuf,
    fields: Arc<Vec<Field>>,
    names: Vec<String>,
}

pub(crate) fn open(path: &Path) -> Result<Arc<dyn Layout>, TableError> {
    let (mut messages, footer) = Messages::open(path)?;
    let (buffer, place) = match footer {
        Some(footer) => (footer, 1),
        None => (messages.next()?.ok_or_else(|| damaged("it has no schema"))?.metadata, 2),
    };
    let schema = Object::root(&buffer).and_then(|root| root.object(place));
    let fields = fields(&schema.ok_or_else(|| damaged("its schema"))?)?;
    let mut names = Vec::new();
    fields.iter().for_each(|field| leaves(field, "", &mut names));
    budget::check_columns(KIND, names.len())?;
    Ok(Arc::new(ArrowTable { path: path.to_owned(), fields: Arc::new(fields), names }))
}

/// The fields of a schema.
fn fields(schema: &Object<'_>) -> Result<Vec<Field>, TableError> {
    if schema.short(0).unwrap_or(0) != 0 {
        return Err(unsupported("numbers with the highest byte first"));
    }
    let mut left = budget::COLUMNS;
    let fields = schema.objects(1).and_then(|fields| {
        fields.into_iter().map(|it| field(it, DEPTH, &mut left)).collect::<Option<Vec<_>>>()
    });
    fields.ok_or_else(|| damaged("its schema"))
}

/// `left` is how many more fields there may be.
fn field(object: Object<'_>, depth: usize, left: &mut usize) -> Option<Field> {
    let depth = depth.checked_sub(1)?;
    *left = left.checked_sub(1)?;
    let name = object.text(0).unwrap_or_default().to_owned();
    let kind = kind(&object)?;
    let children = object.objects(5)?;
    let children = children.into_iter().map(|it| field(it, depth, left)).collect::<Option<_>>()?;
    let dictionary = match object.object(4) {
        None => None,
        Some(encoding) => {
            // Indices are of 32 bits where nothing is said.
            let index =
                encoding.object(1).map_or(Some(Element::Signed(4)), |index| integer(&index));
            Some((encoding.long(0).unwrap_or(0), index?))
        }
    };
    Some(Field { name, kind, children, dictionary })
}

fn integer(object: &Object<'_>) -> Option<Element> {
    let size = match object.int(0)? {
        8 => 1,
        16 => 2,
        32 => 4,
        64 => 8,
        _ => return None,
    };
    let is_signed = object.byte(1).unwrap_or(0) != 0;
    Some(if is_signed { Element::Signed(size) } else { Element::Unsigned(size) })
}

fn kind(field: &Object<'_>) -> Option<Kind> {
    let details = field.object(3);
    let short = |index| details.and_then(|details| details.short(index)).unwrap_or(0);
    let (int32, int64) = (Element::Signed(4), Element::Signed(8));
    Some(match field.byte(2)? {
        1 => Kind::Null,
        2 => Kind::Number(integer(&details?)?),
        3 => Kind::Number(match short(0) {
            0 => Element::Half,
            1 => Element::Single,
            _ => Element::Double,
        }),
        4 => Kind::Opaque("binary", 3),
        5 => Kind::Text(int32),
        6 => Kind::Truth,
        7 => Kind::Opaque("decimal", 2),
        8 => match details.and_then(|details| details.short(0)) {
            Some(0) => Kind::Days,
            _ => Kind::Time(1_000, int64),
        },
        9 => Kind::Opaque("time of day", 2),
        10 => {
            Kind::Time(1000_i64.pow(u32::try_from(short(0)).ok().filter(|unit| *unit < 4)?), int64)
        }
        11 => Kind::Opaque("interval", 2),
        12 | 17 => Kind::Opaque("list", 2),
        13 => Kind::Struct,
        14 => Kind::Opaque("union", if short(0) == 0 { 1 } else { 2 }),
        15 => Kind::Opaque("binary", 2),
        16 => Kind::Opaque("list", 1),
        18 => Kind::Opaque("duration", 2),
        19 => Kind::Opaque("binary", 3),
        20 => Kind::Text(int64),
        21 => Kind::Opaque("list", 2),
        22 => Kind::Opaque("run-end encoded", 0),
        23 | 24 => Kind::TextView,
        _ => return None,
    })
}

/// The names of the columns that a field makes.
fn leaves(field: &Field, before: &str, names: &mut Vec<String>) {
    let name = format!("{before}{}", field.name);
    match field.kind {
        Kind::Struct => {
            field.children.iter().for_each(|child| leaves(child, &format!("{name}."), names))
        }
        _ => names.push(name),
    }
}

impl Layout for ArrowTable {
    fn names(&self) -> Option<&[String]> {
        Some(&self.names)
    }

    fn rows(&self) -> Result<Box<dyn Rows>, TableError> {
        let (messages, _) = Messages::open(&self.path)?;
        let (fields, columns) = (Arc::clone(&self.fields), Vec::new());
        Ok(Box::new(ArrowRows {
            messages,
            fields,
            dictionaries: HashMap::new(),
            columns,
            rows: 0..0,
            unpacked: Unpacked::default(),
            has_begun: false,
        }))
    }
}

struct ArrowRows {
    messages: Messages,
    fields: Arc<Vec<Field>>,
    dictionaries: HashMap<i64, Vec<Cell>>,
    /// Those of the record batch that is being handed out, and its rows that are left.
    columns: Vec<Column>,
    rows: Range<usize>,
    unpacked: Unpacked,
    has_begun: bool,
}

/// The values of a column in a record batch.
struct Column {
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

impl Rows for ArrowRows {
    fn next(&mut self, batch: &mut Batch) -> Result<bool, TableError> {
        while self.rows.is_empty() {
            let Some(message) = self.messages.next()? else { return Ok(false) };
            let kind = Object::root(&message.metadata).and_then(|message| message.byte(1));
            let body = Arc::new(self.messages.body(&message)?);
            let place = format!("the message before byte {}", self.messages.at);
            match kind {
                // The first message, which is known.
                Some(SCHEMA) if !self.has_begun => self.has_begun = true,
                Some(DICTIONARY) => {
                    self.dictionary(&message, &body).map_err(|stop| stop.at(&place))?;
                }
                Some(RECORDS) => {
                    let records = Object::root(&message.metadata).and_then(|it| it.object(2));
                    let records = records.ok_or_else(|| damaged(&place))?;
                    let batch = record_batch(&self.fields, &records, &body)
                        .map_err(|stop| stop.at(&place))?;
                    self.unpacked.add(KIND, batch.unpacked, self.messages.length)?;
                    (self.columns, self.rows) = (batch.columns, batch.rows);
                }
                _ => return Err(damaged(place)),
            }
        }
        let count = batch_rows(self.columns.len()).min(self.rows.len());
        let rows = self.rows.start..self.rows.start + count;
        batch.clear();
        for column in &self.columns {
            batch.push(rows.clone().map(|row| column.cell(row, &self.dictionaries)).collect());
        }
        self.rows.start = rows.end;
        Ok(true)
    }
}

impl ArrowRows {
    /// Takes up a dictionary.
    fn dictionary(&mut self, message: &Message, body: &Arc<Vec<u8>>) -> Result<(), Stop> {
        let batch = Object::root(&message.metadata).and_then(|message| message.object(2));
        let batch = batch.ok_or(Stop::Damaged)?;
        let id = batch.long(0).unwrap_or(0);
        let field = self.fields.iter().find_map(|field| find(field, id)).ok_or(Stop::Damaged)?;
        let values = Field { dictionary: None, name: String::new(), ..field.clone() };
        let records = batch.object(1).ok_or(Stop::Damaged)?;
        let RecordBatch { columns, rows, unpacked } = record_batch(&[values], &records, body)?;
        self.unpacked.add(KIND, unpacked, self.messages.length).map_err(Stop::Error)?;
        let stored = message.body_bytes;
        let taken = rows.len() as u64 * size_of::<Cell>() as u64 + stored;
        budget::check(KIND, || "a dictionary".to_owned(), taken, stored).map_err(Stop::Error)?;
        let Some(column) = columns.first() else { return Err(Stop::Damaged) };
        let cells: Vec<Cell> = rows.map(|row| column.cell(row, &HashMap::new())).collect();
        match batch.byte(2).unwrap_or(0) {
            0 => drop(self.dictionaries.insert(id, cells)),
            _ => self.dictionaries.entry(id).or_default().extend(cells),
        }
        Ok(())
    }
}

fn find(field: &Field, id: i64) -> Option<&Field> {
    match field.dictionary {
        Some((of, _)) if of == id => Some(field),
        _ => field.children.iter().find_map(|child| find(child, id)),
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
enum Stop {
    Damaged,
    Error(TableError),
}

impl Stop {
    /// The error, where `place` is what is damaged.
    fn at(self, place: &str) -> TableError {
        match self {
            Self::Damaged => damaged(place),
            Self::Error(error) => error,
        }
    }
}

/// Some rows.
struct RecordBatch {
    columns: Vec<Column>,
    rows: Range<usize>,
    /// How many bytes were unpacked.
    unpacked: u64,
}

fn record_batch(
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
        return Err(Stop::Error(unsupported("no column of numbers or texts")));
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
            .map_err(|what| Stop::Error(damaged(format!("a compressed part: {what}"))))?;
        let range = 0..bytes.len();
        Ok(Buffer { bytes: Arc::new(bytes), range })
    }
}

impl Column {
    fn cell(&self, row: usize, dictionaries: &HashMap<i64, Vec<Cell>>) -> Cell {
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
