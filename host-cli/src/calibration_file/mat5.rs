//! Arrays of numbers in MATLAB 5 files: "MAT-File Format" (MathWorks), chapter "Level 5".

use std::io::Read;

use flate2::read::ZlibDecoder;

/// An array.
#[derive(Debug)]
pub(super) struct Array {
    pub(super) name: String,
    pub(super) size: Vec<usize>,
    /// Column by column; `None` where they are complex, or no floating-point numbers.
    pub(super) values: Option<Vec<f64>>,
}

/// The most that a compressed element may hold: a megabyte can hold a gigabyte of zeros.
const BUDGET: u64 = 16 << 20;

/// Text, version and byte order.
const HEADER: usize = 128;

/// Kinds of elements that are not numbers.
const MATRIX: u32 = 14;
const COMPRESSED: u32 = 15;

/// Classes of arrays, and the flag of complex ones.
const DOUBLE: u32 = 6;
const SINGLE: u32 = 7;
const COMPLEX: u32 = 0x0800;

/// The arrays of a file; what else there is, is left out.
///
/// # Errors
/// What is wrong with the file.
pub(super) fn arrays(file: &[u8]) -> Result<Vec<Array>, String> {
    let is_little = file.get(126..HEADER) == Some(b"IM");
    let mut arrays = Vec::new();
    let mut elements = Elements { rest: file.get(HEADER..).unwrap_or_default(), is_little };
    while let Some((kind, content)) = elements.next()? {
        match kind {
            MATRIX => arrays.push(array(content, is_little)?),
            COMPRESSED => {
                let inflated = inflate(content)?;
                let mut inner = Elements { rest: &inflated, is_little };
                if let Some((MATRIX, content)) = inner.next()? {
                    arrays.push(array(content, is_little)?);
                }
            }
            _ => {}
        }
    }
    Ok(arrays)
}

fn inflate(compressed: &[u8]) -> Result<Vec<u8>, String> {
    let mut inflated = Vec::new();
    let mut stream = ZlibDecoder::new(compressed).take(BUDGET + 1);
    stream.read_to_end(&mut inflated).map_err(|error| error.to_string())?;
    match inflated.len() as u64 > BUDGET {
        true => Err(format!("a variable is larger than {} MB", BUDGET >> 20)),
        false => Ok(inflated),
    }
}

fn array(content: &[u8], is_little: bool) -> Result<Array, String> {
    let mut parts = Elements { rest: content, is_little };
    let mut part = || parts.next()?.ok_or_else(|| CUT_OFF.to_owned());
    let flags = integers(part()?.1, is_little).next().ok_or(CUT_OFF)?;
    let size: Vec<usize> =
        integers(part()?.1, is_little).map(|side| usize::try_from(side).unwrap_or(0)).collect();
    let name = String::from_utf8_lossy(part()?.1).into_owned();
    let is_real = matches!(flags & 0xFF, DOUBLE | SINGLE) && flags & COMPLEX == 0;
    let values = match is_real {
        true => {
            let (kind, content) = part()?;
            Some(numbers(kind, content, is_little)?)
        }
        false => None,
    };
    Ok(Array { name, size, values })
}

const CUT_OFF: &str = "it is cut off";

/// Elements one after the other.
struct Elements<'a> {
    rest: &'a [u8],
    is_little: bool,
}

impl<'a> Elements<'a> {
    /// Kind and content of the next one; `None` at the end.
    fn next(&mut self) -> Result<Option<(u32, &'a [u8])>, String> {
        if self.rest.is_empty() {
            return Ok(None);
        }
        let word = |at: usize| self.rest.get(at..).and_then(|b| integers(b, self.is_little).next());
        let first = word(0).ok_or(CUT_OFF)?;
        // Up to four bytes stand in the tag itself.
        let (kind, start, length) = match first >> 16 {
            0 => (first, 8, word(4).ok_or(CUT_OFF)? as usize),
            length => (first & 0xFFFF, 4, length as usize),
        };
        let content = self.rest.get(start..).and_then(|content| content.get(..length));
        let content = content.ok_or(CUT_OFF)?;
        let end = start + length;
        let padded = if kind == COMPRESSED { end } else { end.next_multiple_of(8) };
        self.rest = self.rest.get(padded..).unwrap_or_default();
        Ok(Some((kind, content)))
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
fn numbers(kind: u32, content: &[u8], is_little: bool) -> Result<Vec<f64>, String> {
    macro_rules! of {
        ($type:ty) => {{
            let (numbers, _) = content.as_chunks::<{ size_of::<$type>() }>();
            let number = |&bytes| match is_little {
                true => <$type>::from_le_bytes(bytes),
                false => <$type>::from_be_bytes(bytes),
            };
            numbers.iter().map(|bytes| number(bytes) as f64).collect()
        }};
    }
    Ok(match kind {
        1 => of!(i8),
        2 => of!(u8),
        3 => of!(i16),
        4 => of!(u16),
        5 => of!(i32),
        6 => of!(u32),
        7 => of!(f32),
        9 => of!(f64),
        12 => of!(i64),
        13 => of!(u64),
        _ => return Err(format!("elements of kind `{kind}` are not numbers")),
    })
}
