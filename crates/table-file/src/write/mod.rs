//! Tables as files, row after row.
//!
//! MCAP and Parquet are written as the rows come; NumPy and MATLAB, which begin with the number of rows, when all
//! are there.

pub mod mcap;
mod npy;
mod parquet;

pub use crate::mat5::write_matlab;
pub use crate::rows::Cells;
pub use npy::write_numpy;
pub use parquet::ParquetWriter;
pub(crate) use parquet::parquet_file;
