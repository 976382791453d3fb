//! Arrow's interchange format (IPC), as a file, which is also Feather version 2, or as a stream:
//! "Arrow Columnar Format", chapter "Serialization and Interprocess Communication".
//!
//! ```text
//! file ─▶ messages ─▶ schema, once; then record batches ─▶ buffers, unpacked ─▶ cells
//! ```
//!
//! A stream is read from its start, a file by its footer. Structs become columns `outer.inner`; lists and
//! other types without a number or text per row become columns that name their type.

mod messages;
mod records;
mod schema;

use std::collections::HashMap;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use self::messages::{Message, Messages};
use self::records::{Column, RecordBatch, Stop, record_batch};
use self::schema::Field;
use crate::budget::{self, Unpacked};
use crate::error::TableError;
use crate::flatbuffer::Object;
use crate::kind::FileKind;
use crate::rows::{Batch, Cell, Layout, Rows, batch_rows};

const KIND: FileKind = FileKind::Arrow;

/// What messages hold.
const SCHEMA: u8 = 1;
const DICTIONARY: u8 = 2;
const RECORDS: u8 = 3;

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
        None => (messages.next()?.ok_or_else(|| KIND.damaged("it has no schema"))?.metadata, 2),
    };
    let schema = Object::root(&buffer).and_then(|root| root.object(place));
    let fields = schema::fields(&schema.ok_or_else(|| KIND.damaged("its schema"))?)?;
    let mut names = Vec::new();
    fields.iter().for_each(|field| schema::leaves(field, "", &mut names));
    budget::check_columns(KIND, names.len())?;
    Ok(Arc::new(ArrowTable { path: path.to_owned(), fields: Arc::new(fields), names }))
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
                    let records = records.ok_or_else(|| KIND.damaged(&place))?;
                    let batch = record_batch(&self.fields, &records, &body)
                        .map_err(|stop| stop.at(&place))?;
                    self.unpacked.add(KIND, batch.unpacked, self.messages.length)?;
                    (self.columns, self.rows) = (batch.columns, batch.rows);
                }
                _ => return Err(KIND.damaged(place)),
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
