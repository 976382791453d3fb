//! Limits on the memory that a file may use.

use std::fmt::Display;
use std::sync::atomic::{AtomicU64, Ordering};

use crate::kind::{FileKind, TableError};

/// Bytes that any part of a file may use, regardless of its length.
const ANY: u64 = 48 << 20;

/// The longest file, or part of one, that is held in memory.
pub(crate) const IN_MEMORY: u64 = 2 << 30;

/// Additional bytes per byte on disk: measured numbers compress to between a third and a thirtieth of their size.
const RATIO: u64 = 32;

/// Total number of bytes unpacked from a file, which is limited to bound the time.
#[derive(Debug, Default)]
pub(crate) struct Unpacked(AtomicU64);

impl Unpacked {
    /// Counts `bytes` more before they are unpacked from a file of length `file_bytes`.
    pub(crate) fn add(
        &self,
        kind: FileKind,
        bytes: u64,
        file_bytes: u64,
    ) -> Result<(), TableError> {
        // A single addition cannot overflow: the sum so far was within the limit.
        let all = self.0.fetch_add(bytes, Ordering::Relaxed).saturating_add(bytes);
        check(kind, "what is compressed", all, file_bytes.saturating_mul(16)).map(drop)
    }
}

/// The longest header, footer, directory or other description of a table, in bytes.
pub(crate) const DESCRIPTION: u64 = 16 << 20;

pub(crate) const COLUMNS: usize = 4096;

/// Returns the largest size of a part that takes `stored` bytes in the file.
pub(crate) const fn limit(stored: u64) -> u64 {
    ANY.saturating_add(stored.saturating_mul(RATIO))
}

/// Checks that a part which takes `stored` bytes in the file may have the size `bytes`.
pub(crate) fn check(
    kind: FileKind,
    what: impl Display,
    bytes: u64,
    stored: u64,
) -> Result<usize, TableError> {
    within(kind, what, bytes, limit(stored))
}

pub(crate) fn within(
    kind: FileKind,
    what: impl Display,
    bytes: u64,
    limit: u64,
) -> Result<usize, TableError> {
    match usize::try_from(bytes) {
        Ok(size) if bytes <= limit => Ok(size),
        _ => {
            let allowed = format!("more than the {limit} allowed");
            Err(kind.unsupported(format!("{what} takes {bytes} bytes, {allowed}")))
        }
    }
}

pub(crate) fn check_columns(kind: FileKind, columns: usize) -> Result<(), TableError> {
    match columns <= COLUMNS {
        true => Ok(()),
        false => Err(kind.unsupported(format!("{columns} columns, more than {COLUMNS}"))),
    }
}
