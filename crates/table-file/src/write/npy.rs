//! An array of NumPy: one record for each row, with named fields.

use std::io::{self, Write};

use super::{ColumnValues, Columns, TableWriter};

/// Writes an `.npy` file, when all rows are there.
pub struct NpyWriter<W> {
    out: W,
    names: Vec<(String, bool)>,
    columns: Columns,
}

impl<W: Write> NpyWriter<W> {
    /// A file of these columns; whether each holds texts.
    pub fn new(out: W, columns: &[(String, bool)]) -> Self {
        Self { out, names: columns.to_vec(), columns: Columns::default() }
    }
}

impl<W: Write> TableWriter for NpyWriter<W> {
    fn write(&mut self, columns: &[ColumnValues<'_>]) -> io::Result<()> {
        self.columns.add(columns);
        Ok(())
    }

    fn finish(&mut self) -> io::Result<()> {
        let rows = self.columns.rows();
        let mut fields = Vec::new();
        let mut widths = Vec::new();
        for ((name, is_text), texts) in self.names.iter().zip(&self.columns.texts) {
            let width = texts.iter().map(|text| text.chars().count()).max().unwrap_or(0).max(1);
            widths.push(width);
            // What would end the name or the line of the header.
            let is_special = |c: char| c.is_control() || matches!(c, '\\' | '\'');
            let name = name.replace(is_special, "_");
            fields.push(match is_text {
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
        self.out.write_all(b"\x93NUMPY\x03\x00")?;
        self.out.write_all(&(header.len() as u32).to_le_bytes())?;
        self.out.write_all(header.as_bytes())?;
        for row in 0..rows {
            for (position, (_, is_text)) in self.names.iter().enumerate() {
                if !is_text {
                    self.out.write_all(&self.columns.numbers[position][row].to_le_bytes())?;
                    continue;
                }
                let characters =
                    self.columns.texts[position][row].chars().chain(std::iter::repeat('\0'));
                for character in characters.take(widths[position]) {
                    self.out.write_all(&u32::from(character).to_le_bytes())?;
                }
            }
        }
        self.out.flush()
    }
}
