//! The kinds of file, and why a table in one cannot be read.

use std::fmt;
use std::io;

use shell_data::hint::quoted;

/// A kind of file whose tables can be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum FileKind {
    /// HDF5, and MATLAB since 7.3.
    Hdf5,
    /// MATLAB, level 5.
    Matlab,
    /// MCAP, a recording of messages.
    Mcap,
    /// An array of NumPy.
    NumPy,
    /// Parquet.
    Parquet,
    /// A recording of Lab Streaming Layer.
    Xdf,
    /// A workbook of Excel.
    Xlsx,
}

impl FileKind {
    /// Its name in documents, and what people call it, with an article.
    const fn names(self) -> [&'static str; 2] {
        match self {
            Self::Hdf5 => ["hdf5", "an HDF5 file"],
            Self::Matlab => ["matlab", "a MATLAB 5 file"],
            Self::Mcap => ["mcap", "an MCAP file"],
            Self::NumPy => ["numpy", "a NumPy file"],
            Self::Parquet => ["parquet", "a Parquet file"],
            Self::Xdf => ["xdf", "an XDF recording"],
            Self::Xlsx => ["xlsx", "an Excel workbook"],
        }
    }

    /// What people call it, with an article.
    pub(crate) const fn with_article(self) -> &'static str {
        self.names()[1]
    }

    /// Its name in documents.
    pub const fn key(self) -> &'static str {
        self.names()[0]
    }
}

impl fmt::Display for FileKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.with_article().trim_start_matches("an ").trim_start_matches("a "))
    }
}

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
