//! Tables as files, row after row.
//!
//! MCAP and Parquet are written as the rows come; NumPy and MATLAB, which begin with the number of rows,
//! are held in memory until then.

mod mat5;
pub mod mcap;
mod npy;
mod parquet;

use std::borrow::Cow;
use std::io::{self, Write};

pub use parquet::ParquetWriter;
pub(crate) use parquet::parquet_file;

/// Some rows of a column.
#[derive(Clone, Debug, PartialEq)]
pub enum Cells<'a> {
    /// Names and remarks.
    Text(Cow<'a, [String]>),
    /// Numbers, some of which may be missing.
    Number(Cow<'a, [Option<f64>]>),
    /// Numbers that are all there.
    Full(Cow<'a, [f64]>),
    /// Counts, some of which may be missing.
    Count(Cow<'a, [Option<u64>]>),
}

impl Cells<'_> {
    pub(crate) fn len(&self) -> usize {
        match self {
            Self::Text(values) => values.len(),
            Self::Number(values) => values.len(),
            Self::Full(values) => values.len(),
            Self::Count(values) => values.len(),
        }
    }
}

/// What writes a table: as many columns as it was made with, of the same types.
pub trait TableWriter {
    /// Adds rows; to [`HeldTable`] those of columns without missing numbers.
    ///
    /// # Errors
    /// What the system says.
    fn write(&mut self, columns: &[Cells<'_>]) -> io::Result<()>;

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
    rows: usize,
    format: Format<W>,
}

/// Writes so many rows of columns.
type Format<W> = fn(&mut W, &[HeldColumn], usize) -> io::Result<()>;

/// A column: its values are in the one list or in the other.
struct HeldColumn {
    name: String,
    is_text: bool,
    numbers: Vec<f64>,
    texts: Vec<String>,
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

    fn new(out: W, columns: &[(String, bool)], format: Format<W>) -> Self {
        let column = |(name, is_text): &(String, bool)| HeldColumn {
            name: name.clone(),
            is_text: *is_text,
            numbers: Vec::new(),
            texts: Vec::new(),
        };
        Self { out, columns: columns.iter().map(column).collect(), rows: 0, format }
    }
}

impl<W: Write> TableWriter for HeldTable<W> {
    fn write(&mut self, columns: &[Cells<'_>]) -> io::Result<()> {
        self.rows += columns.first().map_or(0, Cells::len);
        for (held, values) in self.columns.iter_mut().zip(columns) {
            match values {
                Cells::Full(values) => held.numbers.extend_from_slice(values),
                Cells::Text(values) => held.texts.extend_from_slice(values),
                // These formats cannot store a missing number.
                Cells::Number(_) | Cells::Count(_) => {
                    return Err(io::ErrorKind::Unsupported.into());
                }
            }
        }
        Ok(())
    }

    fn finish(&mut self) -> io::Result<()> {
        (self.format)(&mut self.out, &self.columns, self.rows)?;
        self.out.flush()
    }
}
