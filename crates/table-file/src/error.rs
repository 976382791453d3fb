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
    Damaged {
        /// The kind of file.
        kind: FileKind,
        /// What is wrong, and where.
        what: String,
    },
    /// The file is right but holds what is not read here.
    #[error("{} that is not read: {what}", kind.with_article())]
    Unsupported {
        /// The kind of file.
        kind: FileKind,
        /// What it holds.
        what: String,
    },
    /// The file holds several tables, or none of the name asked for.
    #[error(
        "{} {}; it has {}",
        kind.with_article(),
        match wanted { Some(name) => format!("without a {part} `{name}`"), None => format!("with more than one {part}") },
        if found.is_empty() { "none".to_owned() } else { quoted(found, ", ") }
    )]
    Choice {
        /// The kind of file.
        kind: FileKind,
        /// What a table is called in it.
        part: &'static str,
        /// The name that was asked for.
        wanted: Option<String>,
        /// The names there are.
        found: Vec<String>,
    },
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
