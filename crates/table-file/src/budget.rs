//! How much memory a file may ask for.

use std::fmt::Display;

use crate::kind::{FileKind, TableError};

/// What any part of a file may take.
const ANY: u64 = 48 << 20;

/// The longest file, or part of one, that is held in memory.
pub(crate) const IN_MEMORY: u64 = 2 << 30;

/// How many times its length on disk a part may take beyond that: numbers that were measured take
/// a third to a thirtieth of their memory when compressed.
const RATIO: u64 = 32;

/// What is unpacked of a file in all, part after part: time is a budget, too.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Unpacked(u64);

impl Unpacked {
    /// Counts `bytes` more of a file of so many bytes, before they are unpacked.
    pub(crate) fn add(
        &mut self,
        kind: FileKind,
        bytes: u64,
        file_bytes: u64,
    ) -> Result<(), TableError> {
        self.0 = self.0.saturating_add(bytes);
        check(kind, "what is compressed", self.0, file_bytes.saturating_mul(16)).map(drop)
    }
}

/// The longest header, footer, directory or other description of a table.
pub(crate) const DESCRIPTION: u64 = 16 << 20;

/// The most columns of a table.
pub(crate) const COLUMNS: usize = 4096;

/// How many bytes may be made of a part that has `stored` bytes in the file.
pub(crate) const fn limit(stored: u64) -> u64 {
    ANY.saturating_add(stored.saturating_mul(RATIO))
}

/// Checks that so many `bytes` may be made of a part that has `stored` bytes in the file.
pub(crate) fn check(
    kind: FileKind,
    what: impl Display,
    bytes: u64,
    stored: u64,
) -> Result<usize, TableError> {
    within(kind, what, bytes, limit(stored))
}

/// Checks that a part takes no more than `limit`.
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

/// Checks the number of columns.
pub(crate) fn check_columns(kind: FileKind, columns: usize) -> Result<(), TableError> {
    match columns <= COLUMNS {
        true => Ok(()),
        false => Err(kind.unsupported(format!("{columns} columns, more than {COLUMNS}"))),
    }
}
