//! MATLAB 5 files ("MAT-File Format", MathWorks, chapter "Level 5"): reads numeric arrays, writes columns as
//! variables.

use std::io::{self, Read, Write};
use std::ops::Range;
use std::sync::Arc;

use flate2::read::ZlibDecoder;

use crate::arrays::{Array, ArrayNumbers, ArrayValues, Labels, attributes_in, columns_of_log};
use crate::budget;
use crate::element::Element;
use crate::format::{Cells, FileSource, FoundTable};
use crate::kind::{FileKind, TableError};

const KIND: FileKind = FileKind::Matlab;

/// Length of the file header: text, version and byte order.
const HEADER: usize = 128;

const INT8: u32 = 1;
const UINT8: u32 = 2;
const UINT16: u32 = 4;
const INT32: u32 = 5;
const UINT32: u32 = 6;
const DOUBLE: u32 = 9;
const MATRIX: u32 = 14;
const COMPRESSED: u32 = 15;
const UTF8: u32 = 16;
const UTF16: u32 = 17;

/// Classes of arrays, and the flag of complex arrays.
const CELLS: u32 = 1;
const STRUCT: u32 = 2;
const CHARACTERS: u32 = 4;
const DOUBLES: u32 = 6;
const SINGLES: u32 = 7;
const INTEGERS: Range<u32> = 8..16;
const OPAQUE: u32 = 17;
const COMPLEX: u32 = 0x0800;

const DEPTH: u8 = 8;

const CUT_OFF: &str = "it is cut off";

/// Returns the arrays of a file; other contents are left out.
///
/// # Errors
/// [`TableError`] if the file is damaged or not supported.
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
            MATRIX => Matrix::read(&file, content, is_little)?.add(None, DEPTH, &mut arrays)?,
            COMPRESSED => {
                let inflated = inflate(&file[content], file.len(), &mut inflated_bytes)?;
                let inflated = Arc::new(inflated);
                let mut inner = Elements::new(&inflated, 0..inflated.len(), is_little);
                if let Some((MATRIX, content)) = inner.next()? {
                    let matrix = Matrix::read(&inflated, content, is_little)?;
                    matrix.add(None, DEPTH, &mut arrays)?;
                }
            }
            _ => {}
        }
    }
    Ok(arrays)
}

/// Inflates an element; `total` counts the bytes inflated from a file of `file_bytes`.
fn inflate(compressed: &[u8], file_bytes: usize, total: &mut u64) -> Result<Vec<u8>, TableError> {
    let mut inflated = Vec::new();
    let left = budget::limit(file_bytes as u64).saturating_sub(*total);
    let mut stream = ZlibDecoder::new(compressed).take(left + 1);
    stream.read_to_end(&mut inflated).map_err(|error| KIND.damaged(error.to_string()))?;
    *total += inflated.len() as u64;
    budget::check(KIND, "what is compressed", *total, file_bytes as u64)?;
    Ok(inflated)
}

/// An array in the file; `rest` is the range of bytes after its name.
struct Matrix<'a> {
    bytes: &'a Arc<Vec<u8>>,
    is_little: bool,
    class: u32,
    is_complex: bool,
    size: Vec<usize>,
    name: String,
    rest: Range<usize>,
}

impl<'a> Matrix<'a> {
    fn read(
        bytes: &'a Arc<Vec<u8>>,
        content: Range<usize>,
        is_little: bool,
    ) -> Result<Self, TableError> {
        let mut parts = Elements::new(bytes, content, is_little);
        let cut_off = || KIND.damaged(CUT_OFF);
        let mut part = || parts.next()?.ok_or_else(cut_off);
        let flags = integers(&bytes[part()?.1], is_little).next().ok_or_else(cut_off)?;
        let class = flags & 0xFF;
        let size: Vec<usize> = match class {
            OPAQUE => Vec::new(),
            _ => integers(&bytes[part()?.1], is_little).map(|side| side as usize).collect(),
        };
        let name = String::from_utf8_lossy(&bytes[part()?.1]).into_owned();
        let is_complex = flags & COMPLEX != 0;
        Ok(Self { bytes, is_little, class, is_complex, size, name, rest: parts.rest })
    }

    /// Adds the array, or the fields of a struct; `name` replaces the array's name.
    fn add(
        self,
        name: Option<String>,
        depth: u8,
        arrays: &mut Vec<Array>,
    ) -> Result<(), TableError> {
        let Self { bytes, is_little, .. } = self;
        let name = name.unwrap_or_else(|| self.name.clone());
        let count = self.size.iter().fold(1, |all: usize, side| all.saturating_mul(*side));
        let mut parts = Elements::new(bytes, self.rest.clone(), is_little);
        let mut size = self.size.clone();
        let values = match self.class {
            _ if self.is_complex => ArrayValues::Other("complex numbers"),
            STRUCT if count == 1 && depth > 0 => {
                let mut part = || parts.next()?.ok_or_else(|| KIND.damaged(CUT_OFF));
                let length = integers(&bytes[part()?.1], is_little).next().unwrap_or(0) as usize;
                let fields = part()?.1;
                budget::check_columns(KIND, arrays.len() + fields.len() / length.max(1))?;
                for field in bytes[fields].chunks(length.max(1)) {
                    let field: Vec<u8> = field.iter().copied().take_while(|&c| c != 0).collect();
                    let field = format!("{name}/{}", String::from_utf8_lossy(&field));
                    let Some((MATRIX, content)) = parts.next()? else { break };
                    let matrix = Self::read(bytes, content, is_little)?;
                    matrix.add(Some(field), depth - 1, arrays)?;
                }
                return Ok(());
            }
            STRUCT => ArrayValues::Other("an array of structs"),
            OPAQUE => ArrayValues::Other(
                "an object, such as a `table`: write it with `writetable(NAME, 'log.csv')`",
            ),
            CELLS if depth > 0 => {
                let mut texts = Some(Vec::new());
                while let Some((MATRIX, content)) = parts.next()? {
                    let matrix = Self::read(bytes, content, is_little)?;
                    let text = matrix.texts()?.filter(|texts| texts.len() < 2);
                    texts = texts.zip(text).map(|(mut texts, text)| {
                        texts.push(text.concat());
                        texts
                    });
                }
                match texts {
                    Some(texts) => ArrayValues::Texts(Arc::new(texts)),
                    None => ArrayValues::Other("cells that are not texts"),
                }
            }
            CHARACTERS => match self.texts()? {
                Some(texts) => {
                    size = vec![texts.len()];
                    ArrayValues::Texts(Arc::new(texts))
                }
                None => ArrayValues::Other("characters of an unknown kind"),
            },
            class if matches!(class, DOUBLES | SINGLES) || INTEGERS.contains(&class) => {
                let (kind, range) = parts.next()?.ok_or_else(|| KIND.damaged(CUT_OFF))?;
                let element = element(kind).ok_or_else(|| {
                    KIND.damaged(format!(
                        "`{name}` holds elements of kind {kind}, which are not numbers"
                    ))
                })?;
                let bytes = Arc::clone(bytes);
                ArrayValues::Numbers(ArrayNumbers { bytes, range, element, is_little })
            }
            _ => ArrayValues::Other("no numbers and no texts"),
        };
        arrays.push(Array {
            name,
            size,
            unit: None,
            labels: Labels::default(),
            is_by_row: false,
            values,
        });
        Ok(())
    }

    /// Returns the rows of a character matrix as texts; `None` if it is not one.
    fn texts(&self) -> Result<Option<Vec<String>>, TableError> {
        let mut parts = Elements::new(self.bytes, self.rest.clone(), self.is_little);
        let ([rows, _], CHARACTERS) = (&self.size[..], self.class) else { return Ok(None) };
        let Some((kind, range)) = parts.next()? else { return Ok(Some(Vec::new())) };
        let content = &self.bytes[range];
        // Characters are UTF-16, or ASCII stored as UTF-8.
        let characters: Vec<u16> = match kind {
            UINT16 | UTF16 => {
                let pairs = content.as_chunks::<2>().0.iter();
                let pair = if self.is_little { u16::from_le_bytes } else { u16::from_be_bytes };
                pairs.map(|&bytes| pair(bytes)).collect()
            }
            INT8 | UINT8 | UTF8 => String::from_utf8_lossy(content).encode_utf16().collect(),
            _ => return Ok(None),
        };
        let row = |row: usize| {
            let text: Vec<u16> =
                characters.iter().copied().skip(row).step_by((*rows).max(1)).collect();
            String::from_utf16_lossy(&text).trim_end().to_owned()
        };
        // The header may claim any number of rows; the characters limit it.
        Ok(Some((0..(*rows).min(characters.len())).map(row).collect()))
    }
}

struct Elements<'a> {
    bytes: &'a [u8],
    rest: Range<usize>,
    is_little: bool,
}

impl<'a> Elements<'a> {
    fn new(bytes: &'a [u8], rest: Range<usize>, is_little: bool) -> Self {
        Self { bytes, rest, is_little }
    }

    /// Returns the type and position of the next element; `None` at the end.
    fn next(&mut self) -> Result<Option<(u32, Range<usize>)>, TableError> {
        let rest = &self.bytes[self.rest.clone()];
        if rest.is_empty() {
            return Ok(None);
        }
        let cut_off = || KIND.damaged(format!("{CUT_OFF} at byte {}", self.rest.start));
        let word = |at: usize| rest.get(at..).and_then(|b| integers(b, self.is_little).next());
        let first = word(0).ok_or_else(cut_off)?;
        // Up to four bytes of data are stored in the tag itself.
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

fn integers(bytes: &[u8], is_little: bool) -> impl Iterator<Item = u32> + '_ {
    let (words, _) = bytes.as_chunks::<4>();
    words.iter().map(move |&word| match is_little {
        true => u32::from_le_bytes(word),
        false => u32::from_be_bytes(word),
    })
}

/// Returns the number type of an element: MATLAB stores doubles with integer values in fewer bytes.
fn element(kind: u32) -> Option<Element> {
    Some(match kind {
        INT8 => Element::Signed(1),
        UINT8 => Element::Unsigned(1),
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

pub(crate) fn open(file: &FileSource, part: Option<&str>) -> Result<FoundTable, TableError> {
    budget::within(KIND, "the file", file.length()?, budget::IN_MEMORY)?;
    let mut bytes = Vec::new();
    file.open()?.take(budget::IN_MEMORY).read_to_end(&mut bytes)?;
    let all = arrays(bytes)?;
    let attributes = attributes_in(&all);
    let (columns, rows, notes) = columns_of_log(KIND, all, part)?;
    Ok(FoundTable { columns, rows: Arc::new(rows), notes, is_cut_off: false, attributes })
}

/// Writes an array of elements of type `kind` with the bytes `content`.
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

/// Writes an element, padded to a multiple of eight bytes.
fn write_element(out: &mut dyn Write, kind: u32, content: &[u8]) -> io::Result<()> {
    out.write_all(&[kind.to_le_bytes(), length(content.len())?].concat())?;
    out.write_all(content)?;
    out.write_all(&[0; 8][..content.len().next_multiple_of(8) - content.len()])
}

fn length(length: usize) -> io::Result<[u8; 4]> {
    let error = |_| io::Error::other("a variable of a MATLAB file has at most 2 GB");
    i32::try_from(length).map_err(error).map(i32::to_le_bytes)
}

fn variable(name: &str) -> String {
    let plain = |c: char| if c.is_ascii_alphanumeric() { c } else { '_' };
    let name: String = name.chars().map(plain).take(63).collect();
    let begins = name.starts_with(|c: char| c.is_ascii_alphabetic());
    if begins { name } else { format!("x{name}").chars().take(63).collect() }
}

/// Writes columns of equal length to a `.mat` file, as variables with the columns' names.
///
/// # Errors
/// [`io::Error`] of the system, or if a column has missing numbers, which the format cannot store.
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
            // A character matrix, padded with spaces, stored column by column.
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
            // The format has no missing numbers.
            Cells::Number(_) | Cells::Count(_) => return Err(io::ErrorKind::Unsupported.into()),
        }
    }
    Ok(())
}
