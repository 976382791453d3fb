//! MATLAB 5 files ("MAT-File Format", MathWorks, chapter "Level 5"): arrays of numbers are read, and tables written
//! with one variable for each column.

use std::io::{self, Read, Write};
use std::ops::Range;
use std::sync::Arc;

use flate2::read::ZlibDecoder;

use crate::arrays::{Array, ArrayNumbers, ArrayRows, columns_of_log};
use crate::budget;
use crate::element::Element;
use crate::format::{Cells, FileSource, NamedRows};
use crate::kind::{FileKind, TableError};

const KIND: FileKind = FileKind::Matlab;

/// Text, version and byte order.
const HEADER: usize = 128;

/// Kinds of elements.
const INT8: u32 = 1;
const UINT16: u32 = 4;
const INT32: u32 = 5;
const UINT32: u32 = 6;
const DOUBLE: u32 = 9;
const MATRIX: u32 = 14;
const COMPRESSED: u32 = 15;

/// Classes of arrays, and the flag of complex ones.
const CHARACTERS: u32 = 4;
const DOUBLES: u32 = 6;
const SINGLES: u32 = 7;
const INTEGERS: Range<u32> = 8..16;
const COMPLEX: u32 = 0x0800;

const CUT_OFF: &str = "it is cut off";

/// The arrays of a file; what else there is, is left out.
///
/// # Errors
/// What is wrong with the file.
pub fn arrays(file: Vec<u8>) -> Result<Vec<Array>, TableError> {
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
    let left = budget::limit(file_bytes as u64).saturating_sub(*total);
    let mut stream = ZlibDecoder::new(compressed).take(left + 1);
    stream.read_to_end(&mut inflated).map_err(|error| KIND.damaged(error.to_string()))?;
    *total += inflated.len() as u64;
    budget::check(KIND, "what is compressed", *total, file_bytes as u64)?;
    Ok(inflated)
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
    let is_number = matches!(class, DOUBLES | SINGLES) || INTEGERS.contains(&class);
    let numbers = match is_number && flags & COMPLEX == 0 {
        true => {
            let (kind, range) = part()?;
            let element = element(kind).ok_or_else(|| {
                KIND.damaged(format!(
                    "`{name}` holds elements of kind {kind}, which are not numbers"
                ))
            })?;
            let bytes = Arc::clone(bytes);
            Some(ArrayNumbers { bytes, range, element, is_little, is_by_row: false })
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

    /// Kind and position of the next one; `None` at the end.
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

/// The numbers of an element: MATLAB writes whole numbers in fewer bytes than a double has.
fn element(kind: u32) -> Option<Element> {
    Some(match kind {
        INT8 => Element::Signed(1),
        2 => Element::Unsigned(1),
        3 => Element::Signed(2),
        UINT16 => Element::Unsigned(2),
        INT32 => Element::Signed(4),
        UINT32 => Element::Unsigned(4),
        7 => Element::Single,
        DOUBLE => Element::Double,
        12 => Element::Signed(8),
        13 => Element::Unsigned(8),
        _ => return None,
    })
}

/// The arrays of a file that make up a log.
pub(crate) fn open(file: &FileSource, part: Option<&str>) -> Result<NamedRows, TableError> {
    budget::within(KIND, "the file", file.length()?, budget::IN_MEMORY)?;
    let mut bytes = Vec::new();
    file.open()?.take(budget::IN_MEMORY).read_to_end(&mut bytes)?;
    let arrays = arrays(bytes)?.into_iter().filter(Array::is_filled).collect();
    let (names, arrays) = columns_of_log(KIND, arrays, part)?;
    Ok((names, Arc::new(ArrayRows(arrays))))
}

/// An array of so many rows and columns; its elements are of `kind`, `content` their bytes.
fn write_array(
    out: &mut dyn Write,
    name: &str,
    class: u32,
    size: [usize; 2],
    kind: u32,
    content: &[u8],
) -> io::Result<()> {
    let [rows, columns] = [length(size[0])?, length(size[1])?];
    let mut array = Vec::with_capacity(content.len() + 128);
    write_element(&mut array, UINT32, &[class.to_le_bytes(), [0; 4]].concat())?;
    write_element(&mut array, INT32, &[rows, columns].concat())?;
    write_element(&mut array, INT8, name.as_bytes())?;
    write_element(&mut array, kind, content)?;
    write_element(out, MATRIX, &array)
}

/// An element, its content filled up to a multiple of eight bytes.
fn write_element(out: &mut dyn Write, kind: u32, content: &[u8]) -> io::Result<()> {
    out.write_all(&[kind.to_le_bytes(), length(content.len())?].concat())?;
    out.write_all(content)?;
    out.write_all(&[0; 8][..content.len().next_multiple_of(8) - content.len()])
}

fn length(length: usize) -> io::Result<[u8; 4]> {
    let error = |_| io::Error::other("a variable of a MATLAB file has at most 2 GB");
    i32::try_from(length).map_err(error).map(i32::to_le_bytes)
}

/// A name that a variable may have.
fn variable(name: &str) -> String {
    let plain = |c: char| if c.is_ascii_alphanumeric() { c } else { '_' };
    let name: String = name.chars().map(plain).take(63).collect();
    let begins = name.starts_with(|c: char| c.is_ascii_alphabetic());
    if begins { name } else { format!("x{name}").chars().take(63).collect() }
}

/// Writes a `.mat` file of columns of one length. Their names become those of variables.
///
/// # Errors
/// What the system says, and for columns with missing numbers, which the format cannot store.
pub fn write_matlab(out: &mut dyn Write, columns: &[(String, Cells<'_>)]) -> io::Result<()> {
    let mut header = b"MATLAB 5.0 MAT-file, written by shellcal".to_vec();
    header.resize(124, b' ');
    header.extend([0, 1, b'I', b'M']);
    out.write_all(&header)?;
    for (name, cells) in columns {
        let (name, rows) = (variable(name), cells.rows());
        match cells {
            Cells::Full(numbers) => {
                let content = numbers.iter().flat_map(|value| value.to_le_bytes());
                write_array(out, &name, DOUBLES, [rows, 1], DOUBLE, &content.collect::<Vec<_>>())?;
            }
            // A matrix of characters, filled up with spaces, column by column.
            Cells::Text(texts) => {
                let texts: Vec<Vec<u16>> =
                    texts.iter().map(|text| text.encode_utf16().collect()).collect();
                let width = texts.iter().map(Vec::len).max().unwrap_or(0);
                let mut content = Vec::with_capacity(2 * rows * width);
                for at in 0..width {
                    for text in &texts {
                        let character = text.get(at).copied().unwrap_or(u16::from(b' '));
                        content.extend(character.to_le_bytes());
                    }
                }
                write_array(out, &name, CHARACTERS, [rows, width], UINT16, &content)?;
            }
            // There are no missing numbers.
            Cells::Number(_) | Cells::Count(_) => return Err(io::ErrorKind::Unsupported.into()),
        }
    }
    Ok(())
}
