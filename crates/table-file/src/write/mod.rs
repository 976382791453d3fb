//! Tables as files, row after row.
//!
//! MCAP and Parquet are written as the rows come; NumPy and MATLAB, which begin with the number of rows,
//! are held in memory until then.

mod mat5;
pub mod mcap;
mod npy;
mod parquet;
mod thrift;

use std::io;

pub use mat5::MatWriter;
pub use npy::NpyWriter;
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

/// The columns of a table in memory.
#[derive(Debug, Default)]
struct Columns {
    numbers: Vec<Vec<f64>>,
    texts: Vec<Vec<String>>,
}

impl Columns {
    /// Adds rows; a column is in the one list or in the other.
    fn add(&mut self, columns: &[ColumnValues<'_>]) {
        self.numbers.resize_with(columns.len(), Vec::new);
        self.texts.resize_with(columns.len(), Vec::new);
        for (position, values) in columns.iter().enumerate() {
            match values {
                ColumnValues::Numbers(values) => self.numbers[position].extend_from_slice(values),
                ColumnValues::Texts(values) => self.texts[position].extend_from_slice(values),
            }
        }
    }

    fn rows(&self) -> usize {
        let lengths = self.numbers.iter().map(Vec::len);
        lengths.zip(self.texts.iter().map(Vec::len)).map(|(a, b)| a.max(b)).max().unwrap_or(0)
    }
}
