//! Tables as files, row after row.
//!
//! MCAP and Parquet are written as the rows come; NumPy and MATLAB, which begin with the number of rows,
//! are held in memory until then.

mod mat5;
pub mod mcap;
mod npy;
mod parquet;

use std::io::{self, Write};

pub use parquet::{Cells, ParquetWriter, parquet_file};

/// Some rows of a column.
#[derive(Clone, Copy, Debug)]
pub enum ColumnValues<'a> {
    /// Numbers.
    Numbers(&'a [f64]),
    /// Texts.
    Texts(&'a [String]),
}

impl ColumnValues<'_> {
    fn len(&self) -> usize {
        match self {
            Self::Numbers(values) => values.len(),
            Self::Texts(values) => values.len(),
        }
    }
}

/// What writes a table: as many columns as it was made with, of the same types.
pub trait TableWriter {
    /// Adds rows.
    ///
    /// # Errors
    /// What the system says.
    fn write(&mut self, columns: &[ColumnValues<'_>]) -> io::Result<()>;

    /// Writes what is left, and the end.
    ///
    /// # Errors
    /// What the system says.
    fn finish(&mut self) -> io::Result<()>;
}

/// A table that is held in memory until all rows are there, in a file that begins with their number.
pub struct HeldTable<W> {
    out: W,
    columns: Vec<HeldColumn>,
    format: fn(&mut W, &[HeldColumn]) -> io::Result<()>,
}

/// A column: its values are in the one list or in the other.
struct HeldColumn {
    name: String,
    is_text: bool,
    numbers: Vec<f64>,
    texts: Vec<String>,
}

impl HeldColumn {
    fn rows(&self) -> usize {
        self.numbers.len().max(self.texts.len())
    }
}

impl<W: Write> HeldTable<W> {
    /// An array of NumPy, one record for each row, of these columns; whether each holds texts.
    pub fn numpy(out: W, columns: &[(String, bool)]) -> Self {
        Self::new(out, columns, npy::write)
    }

    /// A MATLAB 5 file, one variable for each of these columns; whether each holds texts. Names become those of
    /// variables.
    pub fn matlab(out: W, columns: &[(String, bool)]) -> Self {
        Self::new(out, columns, mat5::write)
    }

    fn new(
        out: W,
        columns: &[(String, bool)],
        format: fn(&mut W, &[HeldColumn]) -> io::Result<()>,
    ) -> Self {
        let column = |(name, is_text): &(String, bool)| HeldColumn {
            name: name.clone(),
            is_text: *is_text,
            numbers: Vec::new(),
            texts: Vec::new(),
        };
        Self { out, columns: columns.iter().map(column).collect(), format }
    }
}

impl<W: Write> TableWriter for HeldTable<W> {
    fn write(&mut self, columns: &[ColumnValues<'_>]) -> io::Result<()> {
        for (held, values) in self.columns.iter_mut().zip(columns) {
            match values {
                ColumnValues::Numbers(values) => held.numbers.extend_from_slice(values),
                ColumnValues::Texts(values) => held.texts.extend_from_slice(values),
            }
        }
        Ok(())
    }

    fn finish(&mut self) -> io::Result<()> {
        (self.format)(&mut self.out, &self.columns)?;
        self.out.flush()
    }
}
