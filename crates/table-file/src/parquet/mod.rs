//! Parquet files ("Apache Parquet format"): columns of numbers, texts and times, also within structs.
//!
//! ```text
//! footer ─▶ schema, row groups ─▶ pages of a column, unpacked ─▶ levels, values ─▶ cells
//! ```
//!
//! One page of each column is held at a time. Nested lists, decimals and bytes are listed but not read.

mod arrow_schema;
pub(crate) mod encoding;
mod page;
mod schema;

use std::io::{Read, Seek, SeekFrom};
use std::mem::take;
use std::panic::resume_unwind;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use self::page::ColumnReader;
use self::schema::{Leaf, LeafType};
use crate::budget::{self, Unpacked};
use crate::bytes::ByteReader;
use crate::codec::Codec;
use crate::format::{
    ColumnPart, FileSource, FoundTable, OpenFile, RowSource, RowStream, TableColumn, WantedColumn,
};
use crate::kind::{FileKind, TableError};
use crate::thrift::{self, Value};

const KIND: FileKind = FileKind::Parquet;

/// The longest footer in bytes; decoded values take up to 32 times as much.
const FOOTER: u64 = 4 << 20;

/// Number of row groups that are searched for a row with a list.
const LISTS_LOOKED_AT: usize = 64;

/// The largest number of values per byte of a file with more than a few million values.
const VALUES_PER_BYTE: u64 = 2048;

#[derive(Debug)]
struct ParquetTable {
    file: FileSource,
    leaves: Vec<Leaf>,
    /// For each column, the index of its leaf and of the element in a list.
    columns: Vec<(usize, usize)>,
    groups: Vec<RowGroup>,
}

#[derive(Debug)]
struct RowGroup {
    rows: u64,
    chunks: Vec<ColumnChunk>,
}

/// A column's pages in a row group: a range of positions in the file.
#[derive(Clone, Copy, Debug)]
struct ColumnChunk {
    codec: Codec,
    at: u64,
    end: u64,
}

pub(crate) fn open(source: &FileSource) -> Result<FoundTable, TableError> {
    let mut file = source.open()?;
    let length = source.length()?;
    let footer = footer(&mut file, length)?;
    let mut leaves = schema::leaves(&footer)?;
    let groups = footer.list(4).ok_or_else(|| KIND.damaged("its footer lists no row groups"))?;
    let groups = (1..).zip(groups);
    let groups = groups.map(|(number, group)| row_group(group, number, &mut leaves, length));
    let groups = groups.collect::<Result<Vec<_>, _>>()?;
    let rows = groups.iter().fold(0, |all: u64, group| all.saturating_add(group.rows));
    let values = rows.saturating_mul(leaves.len() as u64);
    if values > (1 << 22) + length.saturating_mul(VALUES_PER_BYTE) {
        let columns = leaves.len();
        return Err(KIND.damaged(format!("{rows} rows of {columns} columns in {length} bytes")));
    }
    if rows > 0 && leaves.iter().all(|leaf| leaf.unread().is_some()) {
        let first = leaves.first().and_then(|leaf| Some((&leaf.name, leaf.unread()?)));
        let why = first.map(|(name, why)| format!(": column `{name}` {why}")).unwrap_or_default();
        return Err(KIND.unsupported(format!("no column of numbers or texts{why}")));
    }
    let mut pages = ParquetSource { file, length, memory: Arc::default() };
    for (at, leaf) in leaves.iter_mut().enumerate().filter(|(_, leaf)| leaf.list.is_some()) {
        let filled = groups.iter().filter(|group| group.rows > 0 && leaf.unread().is_none());
        let mut length = None;
        for chunk in filled.take(LISTS_LOOKED_AT).filter_map(|group| group.chunks.get(at)) {
            length = match ColumnReader::new(*chunk).list_length(&mut pages, leaf) {
                // The column may not be wanted.
                Err(TableError::Unsupported { .. }) => None,
                length => length?,
            };
            if length != Some(0) {
                break;
            }
        }
        let length = length.filter(|length| *length > 0);
        match (length, &mut leaf.list) {
            (Some(length), Some(list)) => list.length = length,
            _ => {
                leaf.list = None;
                leaf.kind = LeafType::Opaque(leaf.kind.opaque().unwrap_or("list"));
            }
        }
    }
    let (mut columns, mut names) = (Vec::new(), Vec::new());
    for (at, leaf) in leaves.iter().enumerate() {
        for (element, name) in leaf.columns().into_iter().enumerate() {
            columns.push((at, element));
            names.push(TableColumn::from(name));
        }
    }
    budget::check_columns(KIND, columns.len())?;
    let mut attributes = Vec::new();
    for pair in footer.list(5).unwrap_or_default() {
        let (key, value) = (pair.text(1).unwrap_or_default(), pair.text(2).unwrap_or_default());
        if key == arrow_schema::KEY {
            set_units(&arrow_schema::units(&value), &leaves, &columns, &mut names);
        }
        attributes.extend(arrow_schema::attributes(&key, &value));
    }
    let file = source.clone();
    let table = ParquetTable { file, leaves, columns, groups };
    Ok(FoundTable { attributes, ..FoundTable::new(Some(names), table) })
}

/// Gives columns the units of their fields in Arrow's schema, or else of a field that contains theirs. A list may have
/// one unit for each element.
fn set_units(
    units: &[(String, String)],
    leaves: &[Leaf],
    columns: &[(usize, usize)],
    names: &mut [TableColumn],
) {
    for ((leaf, element), column) in columns.iter().zip(names) {
        let leaf = &leaves[*leaf];
        let is_of = |path: &str| {
            leaf.name.strip_prefix(path).is_some_and(|it| it.is_empty() || it.starts_with('.'))
        };
        let unit = units.iter().filter(|(path, _)| is_of(path)).max_by_key(|(path, _)| path.len());
        let each = |unit: &str| -> Option<String> {
            let parts: Vec<&str> = unit.split([',', ';']).map(str::trim).collect();
            let is_list = parts.len() == leaf.columns().len();
            Some(if is_list { parts.get(*element)? } else { unit }.to_owned())
        };
        column.unit = unit.and_then(|(_, unit)| each(unit));
    }
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
    leaves: &mut [Leaf],
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
        // The dictionary, if present, comes first.
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
                leaf.packed = Some(method);
                Codec::None
            }
        };
        Ok(ColumnChunk { codec, at, end })
    });
    Ok(RowGroup { rows, chunks: chunks.collect::<Result<_, _>>()? })
}

/// A column of the file (leaf), the table columns that it fills, and the values read for a part.
struct WantedLeaf {
    at: usize,
    is_text: bool,
    /// Positions in a part and elements in a list.
    places: Vec<(usize, usize)>,
    reader: Option<ColumnReader>,
    read: Vec<ColumnPart>,
}

impl WantedLeaf {
    fn new(at: usize, is_text: bool, place: (usize, usize)) -> Self {
        Self { at, is_text, places: vec![place], reader: None, read: Vec::new() }
    }

    /// Appends the next `rows` rows.
    fn read(
        &mut self,
        source: &mut ParquetSource,
        leaf: &Leaf,
        rows: usize,
    ) -> Result<(), TableError> {
        let Some(reader) = &mut self.reader else { return Ok(()) };
        match (&leaf.list, self.read.as_mut_slice()) {
            (None, [column]) => reader.read(source, leaf, rows, column),
            (Some(list), columns) => {
                let mut all = ColumnPart::default();
                if self.is_text {
                    all.cells();
                }
                reader.read_lists(source, leaf, list, rows, &mut all)?;
                for (column, &(_, element)) in columns.iter_mut().zip(&self.places) {
                    column.extend_by_step(&all, element, list.length);
                }
                Ok(())
            }
            _ => Ok(()),
        }
    }
}

impl RowSource for ParquetTable {
    fn unread(&self, column: usize) -> Option<String> {
        self.leaves.get(self.columns.get(column)?.0)?.unread()
    }

    fn is_time(&self, column: usize) -> bool {
        let leaf = self.columns.get(column).and_then(|(at, _)| self.leaves.get(*at));
        leaf.is_some_and(|leaf| leaf.kind.is_time())
    }

    fn columns(&self) -> usize {
        self.columns.len()
    }

    fn is_real(&self, column: usize) -> bool {
        let leaf = self.columns.get(column).and_then(|(at, _)| self.leaves.get(*at));
        leaf.is_some_and(|leaf| leaf.kind.is_real())
    }

    fn rows(self: Arc<Self>, wanted: Vec<WantedColumn>) -> Result<RowStream, TableError> {
        self.rows_on(wanted, 1)
    }

    fn rows_on(
        self: Arc<Self>,
        wanted: Vec<WantedColumn>,
        threads: usize,
    ) -> Result<RowStream, TableError> {
        let mut leaves: Vec<WantedLeaf> = Vec::new();
        for (place, column) in wanted.iter().enumerate() {
            let Some(&(at, element)) = self.columns.get(column.at) else { continue };
            let is_list = self.leaves[at].list.is_some();
            let same =
                |leaf: &&mut WantedLeaf| is_list && leaf.at == at && leaf.is_text == column.is_text;
            match leaves.iter_mut().find(same) {
                Some(leaf) => leaf.places.push((place, element)),
                None => leaves.push(WantedLeaf::new(at, column.is_text, (place, element))),
            }
        }
        let threads = threads.clamp(1, leaves.len().max(1));
        let sources = (0..threads).map(|_| ParquetSource::open(&self.file));
        let mut sources = sources.collect::<Result<Vec<_>, _>>()?;
        let memory = Arc::clone(&sources[0].memory);
        sources.iter_mut().for_each(|source| source.memory = Arc::clone(&memory));
        let (mut groups, mut rows_left) = (0..self.groups.len(), 0);
        Ok(Box::new(move |rows, part| {
            for leaf in &mut leaves {
                let column = |(place, _): &(usize, usize)| take(&mut part.columns[*place]);
                leaf.read = leaf.places.iter().map(column).collect();
            }
            while part.rows < rows {
                if rows_left == 0 {
                    let Some(group) = groups.next().and_then(|at| self.groups.get(at)) else {
                        break;
                    };
                    rows_left = group.rows;
                    memory.held.store(0, Ordering::Relaxed);
                    for leaf in &mut leaves {
                        leaf.reader = group.chunks.get(leaf.at).map(|at| ColumnReader::new(*at));
                    }
                }
                let count =
                    (rows - part.rows).min(usize::try_from(rows_left).unwrap_or(usize::MAX));
                self.read_leaves(&mut sources, &mut leaves, count)?;
                part.rows += count;
                rows_left -= count as u64;
            }
            for leaf in &mut leaves {
                for ((place, _), column) in leaf.places.iter().zip(leaf.read.drain(..)) {
                    part.columns[*place] = column;
                }
            }
            Ok(())
        }))
    }
}

impl ParquetTable {
    /// Reads the next rows of all leaves; on several threads if pages have to be unpacked.
    fn read_leaves(
        &self,
        sources: &mut [ParquetSource],
        leaves: &mut [WantedLeaf],
        rows: usize,
    ) -> Result<(), TableError> {
        let read = |source: &mut ParquetSource, leaves: &mut [WantedLeaf]| {
            leaves.iter_mut().try_for_each(|wanted| {
                let leaf = &self.leaves[wanted.at];
                wanted.read(source, leaf, rows)
            })
        };
        let needs_page =
            |leaf: &&WantedLeaf| leaf.reader.as_ref().is_some_and(|reader| reader.needs_page(rows));
        if sources.len() == 1 || leaves.iter().filter(needs_page).count() < 2 {
            return read(&mut sources[0], leaves);
        }
        let share = leaves.len().div_ceil(sources.len());
        std::thread::scope(|scope| {
            let shares = sources.iter_mut().zip(leaves.chunks_mut(share));
            let readers: Vec<_> =
                shares.map(|(source, leaves)| scope.spawn(|| read(source, leaves))).collect();
            // The first error in the order of columns is returned, for any number of threads.
            readers
                .into_iter()
                .map(|reader| reader.join().unwrap_or_else(|panic| resume_unwind(panic)))
                .fold(Ok(()), Result::and)
        })
    }
}

/// A reader of the file, with the memory that all its readers share.
struct ParquetSource {
    file: OpenFile,
    length: u64,
    memory: Arc<Memory>,
}

impl ParquetSource {
    fn open(file: &FileSource) -> Result<Self, TableError> {
        Ok(Self { file: file.open()?, length: file.length()?, memory: Arc::default() })
    }
}

/// Bytes that are held in pages, and bytes unpacked so far.
#[derive(Default)]
struct Memory {
    held: AtomicU64,
    unpacked: Unpacked,
}
