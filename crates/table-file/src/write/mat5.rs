//! MATLAB 5 files: one variable for each column.

use std::io::{self, Write};

use super::{Cells, incomplete};

/// Kinds of elements.
const INT8: u32 = 1;
const UINT16: u32 = 4;
const INT32: u32 = 5;
const UINT32: u32 = 6;
const DOUBLE: u32 = 9;
const MATRIX: u32 = 14;

/// Classes of arrays.
const CHARACTERS: u32 = 4;
const DOUBLES: u32 = 6;

/// An array of so many rows and columns; its elements are of `kind`, `bytes` of them, written by
/// `content`.
fn array(
    out: &mut dyn Write,
    name: &str,
    class: u32,
    size: [usize; 2],
    kind: u32,
    content: &[u8],
) -> io::Result<()> {
    let long = |length: usize| {
        let error = || io::Error::other("a variable of a MATLAB file has at most 2 GB");
        i32::try_from(length).map_err(|_| error()).map(|length| length as u32)
    };
    let [rows, columns] = [long(size[0])?, long(size[1])?];
    let mut head = Vec::new();
    element(&mut head, UINT32, &[class.to_le_bytes(), [0; 4]].concat());
    element(&mut head, INT32, &[rows.to_le_bytes(), columns.to_le_bytes()].concat());
    element(&mut head, INT8, name.as_bytes());
    let padding = content.len().next_multiple_of(8) - content.len();
    let bytes = long(head.len() + 8 + content.len() + padding)?;
    for word in [MATRIX, bytes] {
        out.write_all(&word.to_le_bytes())?;
    }
    out.write_all(&head)?;
    for word in [kind, long(content.len())?] {
        out.write_all(&word.to_le_bytes())?;
    }
    out.write_all(content)?;
    out.write_all(&[0; 8][..padding])
}

/// An element, its content filled up to a multiple of eight bytes.
fn element(bytes: &mut Vec<u8>, kind: u32, content: &[u8]) {
    bytes.extend(kind.to_le_bytes());
    bytes.extend((content.len() as u32).to_le_bytes());
    bytes.extend(content);
    bytes.resize(bytes.len().next_multiple_of(8), 0);
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
        let (name, rows) = (variable(name), cells.len());
        match cells {
            Cells::Full(numbers) => {
                let content = numbers.iter().flat_map(|value| value.to_le_bytes());
                array(out, &name, DOUBLES, [rows, 1], DOUBLE, &content.collect::<Vec<_>>())?;
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
                array(out, &name, CHARACTERS, [rows, width], UINT16, &content)?;
            }
            Cells::Number(_) | Cells::Count(_) => return Err(incomplete()),
        }
    }
    Ok(())
}
