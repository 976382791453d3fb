//! Why a table cannot be read.

use std::io;

use shell_data::hint::quoted;

use crate::kind::FileKind;

/// A table that cannot be read. The file is named by whoever reports it.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TableError {
    /// The file cannot be read.
    #[error("cannot read the file")]
    Io(#[from] io::Error),
    /// The file is cut short or contradicts itself.
    #[error("a damaged {kind}: {what}")]
    Damaged { kind: FileKind, what: String },
    /// The file is right but holds what is not read here.
    #[error("{} that is not read: {what}", kind.with_article())]
    Unsupported { kind: FileKind, what: String },
    /// The file holds several tables, which are called `part` in it, or none of the name that was asked for.
    #[error(
        "{} {}; it has {}",
        kind.with_article(),
        match wanted { Some(name) => format!("without a {part} `{name}`"), None => format!("with more than one {part}") },
        if found.is_empty() { "none".to_owned() } else { quoted(found, ", ") }
    )]
    Choice { kind: FileKind, part: &'static str, wanted: Option<String>, found: Vec<String> },
}

/// The error of reading a table as text.
impl From<TableError> for io::Error {
    fn from(error: TableError) -> Self {
        match error {
            TableError::Io(error) => error,
            error => Self::new(io::ErrorKind::InvalidData, error),
        }
    }
}

impl FileKind {
    /// The error of a file of this kind that is cut short or contradicts itself.
    pub(crate) fn damaged(self, what: impl Into<String>) -> TableError {
        TableError::Damaged { kind: self, what: what.into() }
    }

    /// The error of a file of this kind that is right, but holds what is not read.
    pub(crate) fn unsupported(self, what: impl Into<String>) -> TableError {
        TableError::Unsupported { kind: self, what: what.into() }
    }

    /// The error of a file of this kind that has several parts, or none of the name that is wanted.
    pub(crate) fn choice(
        self,
        part: &'static str,
        wanted: Option<&str>,
        found: Vec<String>,
    ) -> TableError {
        TableError::Choice { kind: self, part, wanted: wanted.map(str::to_owned), found }
    }

    /// The error of bytes that cannot be read: damage, if the file ends before them.
    pub(crate) fn unread(self, error: io::Error, what: impl Into<String>) -> TableError {
        match error.kind() {
            io::ErrorKind::UnexpectedEof => self.damaged(what),
            _ => TableError::Io(error),
        }
    }
}
