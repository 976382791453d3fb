//! NumPy arrays with one record per row and named fields.

use std::io::{self, Write};

use super::Cells;

/// Writes columns of equal length to an `.npy` file.
///
/// # Errors
/// [`io::Error`] of the system, or if a column has missing numbers, which the format cannot store.
pub fn write_numpy(out: &mut dyn Write, columns: &[(String, Cells<'_>)]) -> io::Result<()> {
    let rows = columns.first().map_or(0, |(_, cells)| cells.rows());
    let mut fields = Vec::new();
    let mut widths = Vec::new();
    for (name, cells) in columns {
        // These characters would end the name or the header line.
        let is_special = |c: char| c.is_control() || matches!(c, '\\' | '\'');
        let name = name.replace(is_special, "_");
        let (kind, width) = match cells {
            Cells::Full(_) => ("f", 8),
            Cells::Text(texts) => {
                let widths = texts.iter().map(|text| text.chars().count());
                ("U", widths.max().unwrap_or(0).max(1))
            }
            // The format has no missing numbers.
            Cells::Number(_) | Cells::Count(_) => return Err(io::ErrorKind::Unsupported.into()),
        };
        fields.push(format!("('{name}', '<{kind}{width}')"));
        widths.push(width);
    }
    let fields = fields.join(", ");
    let mut header =
        format!("{{'descr': [{fields}], 'fortran_order': False, 'shape': ({rows},), }}");
    // The header ends with a line end at a multiple of 64 bytes from the start of the file.
    let before = 12;
    let padded = (before + header.len() + 1).next_multiple_of(64);
    header.push_str(&" ".repeat(padded - before - header.len() - 1));
    header.push('\n');
    out.write_all(b"\x93NUMPY\x03\x00")?;
    out.write_all(&(header.len() as u32).to_le_bytes())?;
    out.write_all(header.as_bytes())?;
    for row in 0..rows {
        for ((_, cells), width) in columns.iter().zip(&widths) {
            match cells {
                Cells::Full(numbers) => out.write_all(&numbers[row].to_le_bytes())?,
                Cells::Text(texts) => {
                    let characters = texts[row].chars().chain(std::iter::repeat('\0'));
                    for character in characters.take(*width) {
                        out.write_all(&u32::from(character).to_le_bytes())?;
                    }
                }
                Cells::Number(_) | Cells::Count(_) => {}
            }
        }
    }
    Ok(())
}
