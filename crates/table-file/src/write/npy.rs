//! An array of NumPy: one record for each row, with named fields.

use std::io::{self, Write};

use super::HeldColumn;

/// Writes an `.npy` file.
pub(super) fn write<W: Write>(out: &mut W, columns: &[HeldColumn], rows: usize) -> io::Result<()> {
    let mut fields = Vec::new();
    let mut widths = Vec::new();
    for column in columns {
        let texts = column.texts.iter();
        let width = texts.map(|text| text.chars().count()).max().unwrap_or(0).max(1);
        widths.push(width);
        // What would end the name or the line of the header.
        let is_special = |c: char| c.is_control() || matches!(c, '\\' | '\'');
        let name = column.name.replace(is_special, "_");
        fields.push(match column.is_text {
            true => format!("('{name}', '<U{width}')"),
            false => format!("('{name}', '<f8')"),
        });
    }
    let fields = fields.join(", ");
    let mut header =
        format!("{{'descr': [{fields}], 'fortran_order': False, 'shape': ({rows},), }}");
    // The header ends a line, at a multiple of 64 bytes from the start of the file.
    let before = 12;
    let padded = (before + header.len() + 1).next_multiple_of(64);
    header.push_str(&" ".repeat(padded - before - header.len() - 1));
    header.push('\n');
    out.write_all(b"\x93NUMPY\x03\x00")?;
    out.write_all(&(header.len() as u32).to_le_bytes())?;
    out.write_all(header.as_bytes())?;
    for row in 0..rows {
        for (column, width) in columns.iter().zip(&widths) {
            if !column.is_text {
                out.write_all(&column.numbers[row].to_le_bytes())?;
                continue;
            }
            let characters = column.texts[row].chars().chain(std::iter::repeat('\0'));
            for character in characters.take(*width) {
                out.write_all(&u32::from(character).to_le_bytes())?;
            }
        }
    }
    Ok(())
}
