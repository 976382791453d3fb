//! Parquet files ("Apache Parquet format"): columns of numbers, texts and times, also within structs.
//!
//! ```text
//! footer ─▶ schema, row groups ─▶ pages of a column, unpacked ─▶ levels, values ─▶ cells
//! ```
//!
//! Every column holds one page at a time. Columns of lists, decimals and bytes are listed and not read.

pub(crate) mod encoding;
mod page;
mod schema;

use std::io::{Read, Seek, SeekFrom};
use std::ops::Range;
use std::sync::Arc;

use self::page::ColumnReader;
use self::schema::Leaf;
use crate::budget::{self, Unpacked};
use crate::bytes::ByteReader;
use crate::codec::Codec;
use crate::format::{Cell, FileSource, NamedRows, OpenFile, RowSource, RowStream, batch_rows};
use crate::kind::{FileKind, TableError};
use crate::thrift::{self, Value};

const KIND: FileKind = FileKind::Parquet;

/// The longest footer: its values take up to 32 times its length.
const FOOTER: u64 = 4 << 20;

/// So many values may be in a byte of a file, beyond some millions.
const VALUES_PER_BYTE: u64 = 2048;

/// A table in a file.
#[derive(Debug)]
struct ParquetTable {
    file: FileSource,
    leaves: Vec<Leaf>,
    groups: Vec<RowGroup>,
}

/// Rows that are stored together.
#[derive(Debug)]
struct RowGroup {
    rows: u64,
    chunks: Vec<ColumnChunk>,
}

/// The pages of a column in a row group, from one position in the file to another.
#[derive(Clone, Copy, Debug)]
struct ColumnChunk {
    codec: Codec,
    at: u64,
    end: u64,
}

pub(crate) fn open(source: &FileSource) -> Result<NamedRows, TableError> {
    let mut file = source.open()?;
    let length = source.length()?;
    let footer = footer(&mut file, length)?;
    let leaves = schema::leaves(&footer)?;
    let groups = footer.list(4).ok_or_else(|| KIND.damaged("its footer lists no row groups"))?;
    let groups = (1..).zip(groups).map(|(number, group)| row_group(group, number, &leaves, length));
    let groups = groups.collect::<Result<Vec<_>, _>>()?;
    let rows = groups.iter().fold(0, |all: u64, group| all.saturating_add(group.rows));
    let values = rows.saturating_mul(leaves.len() as u64);
    if values > (1 << 22) + length.saturating_mul(VALUES_PER_BYTE) {
        let columns = leaves.len();
        return Err(KIND.damaged(format!("{rows} rows of {columns} columns in {length} bytes")));
    }
    if rows > 0 && !leaves.iter().any(|leaf| leaf.kind.opaque().is_none()) {
        return Err(KIND.unsupported("no column of numbers or texts"));
    }
    let names = leaves.iter().map(|leaf| leaf.name.clone()).collect();
    Ok((Some(names), Arc::new(ParquetTable { file: source.clone(), leaves, groups })))
}

fn footer(file: &mut OpenFile, length: u64) -> Result<Value, TableError> {
    let cut = || KIND.damaged("it is cut off: its end is missing");
    let before = length.checked_sub(12).ok_or_else(cut)? + 4;
    file.seek(SeekFrom::Start(before))?;
    let mut end = [0; 8];
    file.read_exact(&mut end)?;
    match &end[4..] {
        b"PAR1" => {}
        b"PARE" => return Err(KIND.unsupported("it is encrypted")),
        _ => return Err(cut()),
    }
    let bytes = u64::from(u32::from_le_bytes([end[0], end[1], end[2], end[3]]));
    let size = budget::within(KIND, "its footer", bytes, FOOTER)?;
    let start = before.checked_sub(bytes).ok_or_else(cut)?;
    file.seek(SeekFrom::Start(start))?;
    let mut footer = vec![0; size];
    file.read_exact(&mut footer)?;
    thrift::read(&mut ByteReader::new(&footer)).ok_or_else(|| KIND.damaged("its footer"))
}

fn row_group(
    group: &Value,
    number: usize,
    leaves: &[Leaf],
    length: u64,
) -> Result<RowGroup, TableError> {
    let wrong = || KIND.damaged(format!("row group {number}"));
    let rows = group.whole(3).and_then(|rows| u64::try_from(rows).ok()).ok_or_else(wrong)?;
    let chunks = group.list(1).filter(|chunks| chunks.len() == leaves.len()).ok_or_else(wrong)?;
    let chunks = chunks.iter().zip(leaves).map(|(chunk, leaf)| {
        if chunk.text(1).is_some_and(|path| !path.is_empty()) {
            return Err(KIND.unsupported("its columns are in files of their own"));
        }
        let data = chunk.field(3).ok_or_else(wrong)?;
        let position = |number| data.whole(number).and_then(|at| u64::try_from(at).ok());
        let (first, bytes) = (position(9).ok_or_else(wrong)?, position(7).ok_or_else(wrong)?);
        // The dictionary comes first, if there is one.
        let at = position(11).filter(|&at| at > 0).map_or(first, |at| at.min(first));
        let beyond = || KIND.damaged(format!("column `{}` lies beyond its end", leaf.name));
        let end = at.checked_add(bytes).filter(|&end| end <= length).ok_or_else(beyond)?;
        let codec = match data.whole(4) {
            Some(0) => Codec::None,
            Some(1) => Codec::Snappy,
            Some(2) => Codec::Gzip,
            Some(6) => Codec::Zstd,
            Some(7) => Codec::Lz4Block,
            other => {
                let method = match other {
                    Some(3) => "LZO",
                    Some(4) => "Brotli",
                    Some(5) => "LZ4 as Hadoop does",
                    _ => "an unknown method",
                };
                return Err(KIND.unsupported(format!(
                    "column `{}` is compressed with {method}, not Snappy, Zstandard or gzip",
                    leaf.name
                )));
            }
        };
        Ok(ColumnChunk { codec, at, end })
    });
    Ok(RowGroup { rows, chunks: chunks.collect::<Result<_, _>>()? })
}

impl RowSource for ParquetTable {
    fn unread(&self, column: usize) -> Option<&'static str> {
        self.leaves.get(column)?.kind.opaque()
    }

    fn parts(&self) -> usize {
        self.groups.len()
    }

    fn rows(
        self: Arc<Self>,
        mut parts: Range<usize>,
        unpacked: Unpacked,
    ) -> Result<RowStream, TableError> {
        let (file, length) = (self.file.open()?, self.file.length()?);
        let mut source = ParquetSource { file, length, held: 0, unpacked };
        // Of the current row group.
        let (mut rows_left, mut columns): (u64, Vec<ColumnReader>) = (0, Vec::new());
        Ok(Box::new(move |batch| {
            while rows_left == 0 {
                let Some(group) = parts.next().and_then(|part| self.groups.get(part)) else {
                    return Ok(false);
                };
                rows_left = group.rows;
                columns = group.chunks.iter().map(|chunk| ColumnReader::new(*chunk)).collect();
            }
            let leaves = &self.leaves;
            let rows = (batch_rows(leaves.len()) as u64).min(rows_left);
            batch.resize_with(leaves.len(), Vec::new);
            // What the pages of all columns hold at a time.
            source.held = columns.iter().map(ColumnReader::held).sum();
            for ((cells, leaf), column) in batch.iter_mut().zip(leaves).zip(&mut columns) {
                cells.clear();
                match leaf.kind.opaque() {
                    Some(_) => cells.resize(rows as usize, Cell::Missing),
                    None => {
                        source.held -= column.held();
                        column.read(&mut source, leaf, rows as usize, cells)?;
                        source.held += column.held();
                    }
                }
            }
            rows_left -= rows;
            Ok(true)
        }))
    }
}

/// The file, and what has been made of it.
struct ParquetSource {
    file: OpenFile,
    length: u64,
    /// What the pages of other columns hold.
    held: u64,
    unpacked: Unpacked,
}
