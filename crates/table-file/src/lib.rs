//! Tables in binary files, read as columns.
//!
//! [`recognise()`] determines the format from a file's first bytes. [`Table::open`] finds its columns, and
//! [`Table::rows`] streams the requested ones part by part as numbers, times in seconds, or text. Other columns are
//! not decoded, and memory does not grow with the number of rows.
//!
//! Files are not trusted: sizes are checked against a budget before memory is allocated, and damage is an error with
//! its position. No unsafe code.

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
mod npy;
mod ods;
mod parquet;
mod recognise;
mod recording;
mod sheet;
mod sqlite;
mod table;
mod tdms;
mod thrift;
pub mod write;
mod xdf;
mod xlsx;
mod xml;
mod zip;

pub use arrays::Array;
pub use calendar::{iso_of_seconds, seconds_of_iso};
pub use format::{
    Cell, ColumnPart, FileBytes, FileSource, OpenFile, TableColumn, TablePart, WantedColumn,
};
pub use kind::{FileKind, TableError};
pub use mat5::arrays;
pub use recognise::{RECOGNISED_BYTES, Recognised, recognise};
pub use table::{Table, TableStream};
