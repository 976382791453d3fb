//! Streaming readers for logs: recordings of readings, wrenches and robot telemetry.
//!
//! [`Log::open`] reads the first lines and recognises the [`LogFormat`] and the meanings of the columns; a
//! [`Mapping`] supplies the rest. [`Log::read`] streams the rows as [`Block`]s in SI units. It parses only the
//! [`Wanted`] columns, on one thread per core, in memory that does not grow with the file. Gzip and Zstandard are
//! unpacked on the fly; binary files (Parquet, MATLAB, NumPy, Excel, MCAP) are read as tables.
//!
//! ```text
//! ByteStream ─▶ ChunkStream ─▶ FieldEnds ─▶ numbers ─▶ Block ─▶ map ─▶ fold
//! any container  whole lines    └── any thread, with a state of its own ──┘   in order
//! ```
//!
//! Block boundaries depend on the file alone and `fold` receives the blocks in order: results do not depend on the
//! number of threads.
//!
//! Not supported: quoted fields that span lines, and text that is not UTF-8, UTF-16 or ASCII.
//!
//! ```
//! use log_file::{Log, LogError, Mapping, ReadOptions, Wanted};
//!
//! let path = std::env::temp_dir().join(format!("log-file-{}.csv", std::process::id()));
//! std::fs::write(&path, "t_s,s1,s2\n0.00,2011,1987\n0.01,2012,1987\n0.02,2012,1987\n")?;
//! let log = Log::open(&path, &Mapping::default())?;
//! assert_eq!(log.channels(), 2);
//!
//! let wanted = Wanted { readings: true, ..Wanted::default() };
//! let mut first_channel = Vec::new();
//! let summary = log.read(
//!     &wanted,
//!     &ReadOptions::default(),
//!     |block| std::mem::take(&mut block.readings[0]),
//!     |column| {
//!         first_channel.extend(column);
//!         Ok::<_, LogError>(())
//!     },
//! )?;
//! assert_eq!(first_channel, [2011.0, 2012.0, 2012.0]);
//! assert_eq!((summary.rows, summary.repeated_rows), (3, 1));
//! # std::fs::remove_file(&path)?;
//! # Ok::<_, Box<dyn std::error::Error>>(())
//! ```
//!
//! [`Block`]: shell_data::Block

#![allow(clippy::disallowed_methods, clippy::disallowed_types, reason = "reads files")]
#![forbid(unsafe_code)]

pub mod checksum;
mod error;
mod format;
mod line;
mod log;
mod parse;
mod read;
mod stream;
pub mod summary;

pub use error::{FieldProblem, LogError, LogPosition, PlacedProblem, RowMismatch, RowProblem};
pub use format::choice::{Comparison, Interleaving, RowCondition, parse_condition};
pub use format::columns::{Column, Wanted};
pub use format::mapping::{
    ColumnRef, FORMATS, LogFormat, Mapping, MomentUnit, TIME_UNITS, TimeUnit, parse_column,
    parse_columns, parse_units, parse_wrench,
};
pub use format::meaning::{Meaning, StatedUnit, meaning_of};
pub use log::Log;
pub use read::all::{ReadOptions, read_all, read_dataset, read_logs, sample_logs, threads_for};
pub use shell_data::ReadSummary;
pub use stream::pipeline;
pub use table_file::{FileKind, TableError};
