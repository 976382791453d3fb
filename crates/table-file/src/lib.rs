//! Tables in binary files, read row by row.
//!
//! [`recognise()`] tells from the first bytes what a file is. [`Table::open`] finds its columns, and
//! [`Table::text`] streams its rows as the text of a CSV file, in memory that does not grow with their
//! number: what reads text logs reads these as well, to the same bits, as every number is written with
//! the digits that read back as the same.
//!
//! Files are not trusted: what a file says about its sizes is checked against a budget before
//! memory is taken, and damage is an error that names the position. No unsafe code.

#![allow(clippy::disallowed_methods, clippy::disallowed_types, reason = "reads files")]
#![forbid(unsafe_code)]

mod arrays;
mod budget;
mod bytes;
mod calendar;
mod codec;
mod element;
mod format;
mod hdf5;
mod kind;
mod mat5;
mod mcap;
mod npy;
mod parquet;
mod recognise;
mod text;
mod thrift;
pub mod write;
mod xlsx;
mod xml;
mod zip;

pub use arrays::Array;
pub use calendar::{iso_of_seconds, seconds_of_iso};
pub use format::{Cell, FileBytes, FileSource, OpenFile};
pub use kind::{FileKind, TableError};
pub use mat5::arrays;
pub use recognise::{RECOGNISED_BYTES, Recognised, recognise};
pub use text::{Table, TextStream};
