//! Tables as files, row after row.
//!
//! MCAP and Parquet are written as the rows come; NumPy and MATLAB, which begin with the number of rows, when all
//! are there.

mod mat5;
pub mod mcap;
mod npy;
mod parquet;

use std::borrow::Cow;
use std::io;

pub use mat5::write_matlab;
pub use npy::write_numpy;
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

/// The error of a column with missing numbers, for formats that have none.
fn incomplete() -> io::Error {
    io::ErrorKind::Unsupported.into()
}
