//! Arrays of numbers in MATLAB 5 files: "MAT-File Format" (MathWorks), chapter "Level 5".

use std::fs::File;
use std::io::Read;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use flate2::read::ZlibDecoder;

use crate::budget;
use crate::element::Element;
use crate::error::TableError;
use crate::kind::FileKind;
use crate::rows::{Cell, ColumnLayout, RowBatch, RowStream, batch_rows};

const KIND: FileKind = FileKind::Matlab;

/// The longest file that is read: it is held in memory.
const LONGEST: u64 = 2 << 30;

/// An array.
#[derive(Clone, Debug)]
pub struct Array {
    /// Its name.
    pub name: String,
    /// Rows, columns, and further sides.
    pub size: Vec<usize>,
    numbers: Option<MatNumbers>,
}

/// The numbers of an array as the file holds them, column by column.
#[derive(Clone, Debug)]
struct MatNumbers {
    bytes: Arc<Vec<u8>>,
    range: Range<usize>,
    element: Element,
    is_little: bool,
}

impl Array {
    /// Its values column by column; `None` where they are complex or no numbers.
    pub fn values(&self) -> Option<Vec<f64>> {
        let numbers = self.numbers.as_ref()?;
        let number = |at| match numbers.cell(at) {
            Cell::Real(value) => value,
            Cell::Whole(value) => value as f64,
            _ => f64::NAN,
        };
        Some((0..numbers.len()).map(number).collect())
    }

    /// Rows and columns; `None` where it has further sides, or is no array of real numbers.
    fn sides(&self) -> Option<(usize, usize)> {
        let &[rows, columns] = self.size.as_slice() else { return None };
        let numbers = self.numbers.as_ref()?;
        (rows.checked_mul(columns)? == numbers.len()).then_some((rows, columns))
    }
}

impl MatNumbers {
    fn len(&self) -> usize {
        self.range.len() / self.element.size()
    }

    fn cell(&self, at: usize) -> Cell {
        let size = self.element.size();
        self.element.cell(&self.bytes[self.range.start + at * size..][..size], self.is_little)
    }
}

/// Text, version and byte order.
const HEADER: usize = 128;

/// Kinds of elements that are not numbers.
const MATRIX: u32 = 14;
const COMPRESSED: u32 = 15;

/// Classes of arrays, and the flags of complex and of logical ones.
const DOUBLE: u32 = 6;
const SINGLE: u32 = 7;
const INTEGERS: Range<u32> = 8..16;
const COMPLEX: u32 = 0x0800;

const CUT_OFF: &str = "it is cut off";

/// The arrays of a file; what else there is, is left out.
///
/// # Errors
/// What is wrong with the file.
pub fn arrays(file: &[u8]) -> Result<Vec<Array>, TableError> {
    arrays_of(file.to_vec())
}

fn arrays_of(file: Vec<u8>) -> Result<Vec<Array>, TableError> {
    if file.len() < HEADER {
        return Err(KIND.damaged(format!("its header of {HEADER} bytes is cut off")));
    }
    let file = Arc::new(file);
    let is_little = file.get(126..HEADER) == Some(b"IM");
    let mut arrays = Vec::new();
    let mut inflated_bytes = 0;
    let mut elements = Elements::new(&file, HEADER..file.len(), is_little);
    while let Some((kind, content)) = elements.next()? {
        match kind {
            MATRIX => arrays.push(array(&file, content, is_little)?),
            COMPRESSED => {
                let inflated = inflate(&file[content], file.len(), &mut inflated_bytes)?;
                let inflated = Arc::new(inflated);
                let mut inner = Elements::new(&inflated, 0..inflated.len(), is_little);
                if let Some((MATRIX, content)) = inner.next()? {
                    arrays.push(array(&inflated, content, is_little)?);
                }
            }
            _ => {}
        }
    }
    Ok(arrays)
}

/// `total` counts what has been inflated of a file of `file_bytes`.
fn inflate(compressed: &[u8], file_bytes: usize, total: &mut u64) -> Result<Vec<u8>, TableError> {
    let mut inflated = Vec::new();
    let mut stream = ZlibDecoder::new(compressed);
    let mut piece = vec![0; 1 << 16];
    loop {
        let read = stream.read(&mut piece).map_err(|error| KIND.damaged(error.to_string()))?;
        if read == 0 {
            return Ok(inflated);
        }
        *total += read as u64;
        budget::check(KIND, || "what is compressed".to_owned(), *total, file_bytes as u64)?;
        inflated.extend_from_slice(&piece[..read]);
    }
}

fn array(
    bytes: &Arc<Vec<u8>>,
    content: Range<usize>,
    is_little: bool,
) -> Result<Array, TableError> {
    let mut parts = Elements::new(bytes, content, is_little);
    let mut part = || parts.next()?.ok_or_else(|| KIND.damaged(CUT_OFF));
    let flags =
        integers(&bytes[part()?.1], is_little).next().ok_or_else(|| KIND.damaged(CUT_OFF))?;
    let sides = integers(&bytes[part()?.1], is_little);
    let size: Vec<usize> = sides.map(|side| usize::try_from(side).unwrap_or(0)).collect();
    let name = String::from_utf8_lossy(&bytes[part()?.1]).into_owned();
    let class = flags & 0xFF;
    let is_number = matches!(class, DOUBLE | SINGLE) || INTEGERS.contains(&class);
    let numbers = match is_number && flags & COMPLEX == 0 {
        true => {
            let (kind, range) = part()?;
            let element = element(kind).ok_or_else(|| {
                KIND.damaged(format!(
                    "`{name}` holds elements of kind {kind}, which are not numbers"
                ))
            })?;
            Some(MatNumbers { bytes: Arc::clone(bytes), range, element, is_little })
        }
        false => None,
    };
    Ok(Array { name, size, numbers })
}

/// Elements one after the other.
struct Elements<'a> {
    bytes: &'a [u8],
    rest: Range<usize>,
    is_little: bool,
}

impl<'a> Elements<'a> {
    fn new(bytes: &'a [u8], rest: Range<usize>, is_little: bool) -> Self {
        Self { bytes, rest, is_little }
    }

    /// Kind and place of the next one; `None` at the end.
    fn next(&mut self) -> Result<Option<(u32, Range<usize>)>, TableError> {
        let rest = &self.bytes[self.rest.clone()];
        if rest.is_empty() {
            return Ok(None);
        }
        let cut_off = || KIND.damaged(format!("{CUT_OFF} at byte {}", self.rest.start));
        let word = |at: usize| rest.get(at..).and_then(|b| integers(b, self.is_little).next());
        let first = word(0).ok_or_else(cut_off)?;
        // Up to four bytes stand in the tag itself.
        let (kind, start, length) = match first >> 16 {
            0 => (first, 8, word(4).ok_or_else(cut_off)? as usize),
            length => (first & 0xFFFF, 4, length as usize),
        };
        if rest.len() < start || rest.len() - start < length {
            return Err(cut_off());
        }
        let begin = self.rest.start + start;
        let end = start + length;
        let padded = if kind == COMPRESSED { end } else { end.next_multiple_of(8) };
        self.rest.start += padded.min(rest.len());
        Ok(Some((kind, begin..begin + length)))
    }
}

/// Integers of 32 bits.
fn integers(bytes: &[u8], is_little: bool) -> impl Iterator<Item = u32> + '_ {
    let (words, _) = bytes.as_chunks::<4>();
    words.iter().map(move |&word| match is_little {
        true => u32::from_le_bytes(word),
        false => u32::from_be_bytes(word),
    })
}

/// Numbers of an element: MATLAB writes whole numbers in fewer bytes than a double has.
fn element(kind: u32) -> Option<Element> {
    Some(match kind {
        1 => Element::Signed(1),
        2 => Element::Unsigned(1),
        3 => Element::Signed(2),
        4 => Element::Unsigned(2),
        5 => Element::Signed(4),
        6 => Element::Unsigned(4),
        7 => Element::Single,
        9 => Element::Double,
        12 => Element::Signed(8),
        13 => Element::Unsigned(8),
        _ => return None,
    })
}

/// The arrays of a file that make up a log.
#[derive(Debug)]
struct MatTable {
    arrays: Arc<Vec<Array>>,
    rows: usize,
    names: Option<Vec<String>>,
}

pub(crate) fn open(path: &Path, part: Option<&str>) -> Result<Arc<dyn ColumnLayout>, TableError> {
    let file = File::open(path)?;
    let length = file.metadata()?.len();
    budget::within(KIND, || "the file".to_owned(), length, LONGEST)?;
    let mut bytes = Vec::new();
    file.take(LONGEST).read_to_end(&mut bytes)?;
    let arrays = arrays_of_log(&arrays_of(bytes)?, part)?;
    let rows = arrays.first().map_or(0, |array| length_of(array).0);
    let columns = arrays.iter().map(|array| length_of(array).1).sum();
    budget::check_columns(KIND, columns)?;
    // A matrix alone has columns without names.
    let names = (arrays.len() > 1 || columns == 1).then(|| arrays.iter().flat_map(names).collect());
    Ok(Arc::new(MatTable { arrays: Arc::new(arrays), rows, names }))
}

/// The arrays that are the columns of a log: the one of that name, or those that have as many rows as
/// the longest.
///
/// # Errors
/// [`TableError::Choice`] if there is none.
pub fn arrays_of_log(arrays: &[Array], name: Option<&str>) -> Result<Vec<Array>, TableError> {
    let is_table = |array: &&Array| array.sides().is_some_and(|(rows, columns)| rows * columns > 0);
    let longest = arrays.iter().filter(is_table).map(|array| length_of(array).0).max();
    let is_wanted = |array: &&Array| match name {
        Some(name) => array.name == name,
        None => Some(length_of(array).0) == longest,
    };
    let wanted: Vec<Array> = arrays.iter().filter(is_table).filter(is_wanted).cloned().collect();
    if wanted.is_empty() {
        let Some(name) = name else {
            return Err(KIND.unsupported("no matrix or vector of real numbers"));
        };
        return Err(TableError::Choice {
            kind: KIND,
            part: "matrix of real numbers",
            wanted: Some(name.to_owned()),
            found: arrays.iter().filter(is_table).map(|array| array.name.clone()).collect(),
        });
    }
    Ok(wanted)
}

/// Rows and columns, where a single row is taken for a column.
fn length_of(array: &Array) -> (usize, usize) {
    match array.sides() {
        Some((1, columns)) => (columns, 1),
        sides => sides.unwrap_or_default(),
    }
}

fn names(array: &Array) -> Vec<String> {
    match length_of(array).1 {
        1 => vec![array.name.clone()],
        columns => (1..=columns).map(|column| format!("{}{column}", array.name)).collect(),
    }
}

impl ColumnLayout for MatTable {
    fn names(&self) -> Option<&[String]> {
        self.names.as_deref()
    }

    fn rows(&self) -> Result<Box<dyn RowStream>, TableError> {
        Ok(Box::new(MatRows { arrays: Arc::clone(&self.arrays), rows: self.rows, row: 0 }))
    }
}

struct MatRows {
    arrays: Arc<Vec<Array>>,
    rows: usize,
    row: usize,
}

impl RowStream for MatRows {
    fn next(&mut self, batch: &mut RowBatch) -> Result<bool, TableError> {
        let columns: usize = self.arrays.iter().map(|array| length_of(array).1).sum();
        let rows = self.row..self.rows.min(self.row + batch_rows(columns));
        if rows.is_empty() {
            return Ok(false);
        }
        batch.clear();
        for array in self.arrays.iter() {
            let Some(numbers) = &array.numbers else { continue };
            for column in 0..length_of(array).1 {
                let start = column * self.rows;
                batch.push(rows.clone().map(|row| numbers.cell(start + row)).collect());
            }
        }
        self.row = rows.end;
        Ok(true)
    }
}
