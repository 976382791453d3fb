//! Tables of SQLite databases ("Database File Format", sqlite.org): their rows in the order of row numbers.
//!
//! The file is read page by page. Indexes, and tables without row numbers, are not read.

use std::io::{BufReader, Read, Seek, SeekFrom};

use crate::budget;
use crate::format::{FileSource, OpenFile};
use crate::kind::{FileKind, TableError};

const KIND: FileKind = FileKind::Sqlite;

/// Maximum size of a row, bytes.
const ROW: u64 = 16 << 20;

/// Length of the header of the file, which precedes the content of the first page.
const HEADER: usize = 100;

const INTERIOR: u8 = 5;
const LEAF: u8 = 13;

pub(crate) struct Database {
    file: BufReader<OpenFile>,
    page_bytes: usize,
    /// Number of bytes of a page, without the end that is reserved for extensions.
    usable: usize,
    pages: u32,
    file_bytes: u64,
}

pub(crate) struct DatabaseTable {
    pub(crate) name: String,
    /// Number of the table's first page.
    pub(crate) root: u32,
}

#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Value {
    Null,
    Integer(i64),
    Real(f64),
    Text(String),
    Blob(Vec<u8>),
}

impl Database {
    pub(crate) fn open(source: &FileSource) -> Result<Self, TableError> {
        let mut file = BufReader::new(source.open()?);
        let file_bytes = source.length()?;
        let mut header = [0; HEADER];
        let read = file.read_exact(&mut header);
        read.map_err(|error| KIND.unread(error, "its header is cut off"))?;
        let page_bytes = match u16::from_be_bytes([header[16], header[17]]) {
            1 => 1 << 16,
            bytes => usize::from(bytes),
        };
        let reserved = usize::from(header[20]);
        if page_bytes < 512 || !page_bytes.is_power_of_two() || page_bytes - reserved < 480 {
            return Err(KIND.damaged("its pages have an impossible size"));
        }
        if header[56..60] != [0, 0, 0, 1] && header[56..60] != [0; 4] {
            return Err(KIND.unsupported("texts in UTF-16"));
        }
        let pages = (file_bytes / page_bytes as u64).min(u64::from(u32::MAX)) as u32;
        if u32::from_be_bytes([header[28], header[29], header[30], header[31]]) > pages {
            return Err(KIND.damaged("it is cut off"));
        }
        if let FileSource::Disk(path) = source {
            let mut log = path.as_os_str().to_owned();
            log.push("-wal");
            if std::fs::metadata(&log).is_ok_and(|log| log.len() > 0) {
                return Err(KIND.unsupported(
                    "its last rows are still in a log beside it: `sqlite3 FILE 'PRAGMA wal_checkpoint'` moves them",
                ));
            }
        }
        Ok(Self { file, page_bytes, usable: page_bytes - reserved, pages, file_bytes })
    }

    pub(crate) fn tables(&mut self) -> Result<Vec<DatabaseTable>, TableError> {
        let mut tables = Vec::new();
        let mut rows = self.rows(1);
        while let Some((_, row)) = rows.next(self)? {
            if let [Value::Text(kind), Value::Text(name), _, Value::Integer(root), ..] =
                row.as_slice()
                && kind == "table"
                && !name.starts_with("sqlite_")
            {
                let root = u32::try_from(*root).unwrap_or(0);
                tables.push(DatabaseTable { name: name.clone(), root });
                budget::check_columns(KIND, tables.len())?;
            }
        }
        Ok(tables)
    }

    pub(crate) fn rows(&self, root: u32) -> TableRows {
        TableRows { waiting: vec![root], cells: Vec::new(), page: Vec::new(), left: self.pages }
    }

    fn page(&mut self, number: u32, page: &mut Vec<u8>) -> Result<(), TableError> {
        if number == 0 || number > self.pages {
            return Err(KIND.damaged(format!("page {number} of {} is missing", self.pages)));
        }
        page.resize(self.page_bytes, 0);
        let at = u64::from(number - 1) * self.page_bytes as u64;
        self.file.seek(SeekFrom::Start(at))?;
        let read = self.file.read_exact(page);
        read.map_err(|error| KIND.unread(error, format!("it is cut off in page {number}")))
    }
}

pub(crate) struct TableRows {
    /// Pages to be read; the next one is last.
    waiting: Vec<u32>,
    /// Positions of rows in the current page; the next one is last.
    cells: Vec<usize>,
    page: Vec<u8>,
    /// Number of pages that may still be read: a table does not visit a page twice.
    left: u32,
}

impl TableRows {
    /// Returns the number and the values of the next row; `None` at the end.
    pub(crate) fn next(
        &mut self,
        database: &mut Database,
    ) -> Result<Option<(i64, Vec<Value>)>, TableError> {
        loop {
            if let Some(at) = self.cells.pop() {
                return self.row(database, at).map(Some);
            }
            let Some(number) = self.waiting.pop() else { return Ok(None) };
            self.open(database, number)?;
        }
    }

    /// Reads a page: the positions of its rows, or the numbers of the pages below it.
    fn open(&mut self, database: &mut Database, number: u32) -> Result<(), TableError> {
        let wrong = || KIND.damaged(format!("page {number}"));
        self.left = self.left.checked_sub(1).ok_or_else(wrong)?;
        database.page(number, &mut self.page)?;
        let start = if number == 1 { HEADER } else { 0 };
        let content = &self.page[start..];
        let kind = content[0];
        let count = usize::from(u16::from_be_bytes([content[3], content[4]]));
        let pointers = match kind {
            LEAF => content.get(8..8 + 2 * count),
            INTERIOR => content.get(12..12 + 2 * count),
            _ => None,
        };
        let pointers = pointers.ok_or_else(wrong)?.as_chunks::<2>().0.iter().rev();
        let cells = pointers.map(|at| usize::from(u16::from_be_bytes(*at)));
        if kind == LEAF {
            self.cells = cells.collect();
            return Ok(());
        }
        let child = |at: usize| {
            let bytes = self.page.get(at..)?.first_chunk()?;
            Some(u32::from_be_bytes(*bytes))
        };
        self.waiting.push(child(start + 8).ok_or_else(wrong)?);
        for at in cells {
            self.waiting.push(child(at).ok_or_else(wrong)?);
        }
        match self.waiting.len() as u64 <= u64::from(database.pages) {
            true => Ok(()),
            false => Err(wrong()),
        }
    }

    /// Reads the row at a position of the current page.
    fn row(&self, database: &mut Database, at: usize) -> Result<(i64, Vec<Value>), TableError> {
        let wrong = || KIND.damaged(format!("a row at byte {at} of a page"));
        let usable = database.usable;
        let page = self.page.get(..usable).ok_or_else(wrong)?;
        let mut bytes = page.get(at..).ok_or_else(wrong)?;
        let (length, id) = varint(&mut bytes).zip(varint(&mut bytes)).ok_or_else(wrong)?;
        let most = ROW.min(database.file_bytes);
        let length = budget::within(KIND, format_args!("row {id}"), length, most)?;
        // "B-tree Pages": a row that is too long for a page continues on other pages.
        let (largest, smallest) = (usable - 35, (usable - 12) * 32 / 255 - 23);
        let mut here = length;
        if length > largest {
            let part = smallest + (length - smallest) % (usable - 4);
            here = if part <= largest { part } else { smallest };
        }
        let mut payload = bytes.get(..here).ok_or_else(wrong)?.to_vec();
        if here < length {
            let next = bytes[here..].first_chunk().ok_or_else(wrong)?;
            let (mut next, mut page) = (u32::from_be_bytes(*next), Vec::new());
            // Each page adds bytes, so that a loop of pages ends.
            while payload.len() < length {
                database.page(next, &mut page)?;
                let (number, content) = page.split_first_chunk::<4>().ok_or_else(wrong)?;
                next = u32::from_be_bytes(*number);
                let part = (length - payload.len()).min(usable - 4);
                payload.extend_from_slice(&content[..part]);
            }
        }
        Ok((id as i64, values(&payload).ok_or_else(wrong)?))
    }
}

/// Decodes the values of a row ("Record Format").
fn values(payload: &[u8]) -> Option<Vec<Value>> {
    let mut rest = payload;
    let length = usize::try_from(varint(&mut rest)?).ok()?;
    let mut types = payload.get(payload.len() - rest.len()..length)?;
    let mut content = payload.get(length..)?;
    let mut values = Vec::new();
    while !types.is_empty() {
        let kind = varint(&mut types)?;
        let size = match kind {
            0 | 8 | 9 => 0,
            1..=4 => kind as usize,
            5 => 6,
            6 | 7 => 8,
            10 | 11 => return None,
            _ => usize::try_from((kind - 12) / 2).ok()?,
        };
        let (bytes, rest) = content.split_at_checked(size)?;
        content = rest;
        let whole = || {
            let sign = if bytes.first().is_some_and(|&byte| byte >= 0x80) { -1 } else { 0 };
            bytes.iter().fold(sign, |whole: i64, &byte| whole << 8 | i64::from(byte))
        };
        values.push(match kind {
            0 => Value::Null,
            1..=6 => Value::Integer(whole()),
            7 => Value::Real(f64::from_bits(whole() as u64)),
            8 | 9 => Value::Integer((kind - 8) as i64),
            _ if kind % 2 == 0 => Value::Blob(bytes.to_vec()),
            _ => Value::Text(String::from_utf8_lossy(bytes).into_owned()),
        });
    }
    Some(values)
}

/// Takes an integer in groups of seven bits, highest first; the ninth byte has eight.
fn varint(bytes: &mut &[u8]) -> Option<u64> {
    let mut value = 0;
    for at in 0..9 {
        let (&byte, rest) = bytes.split_first()?;
        *bytes = rest;
        if at == 8 {
            return Some(value << 8 | u64::from(byte));
        }
        value = value << 7 | u64::from(byte & 0x7f);
        if byte < 0x80 {
            return Some(value);
        }
    }
    None
}
