//! File formats, and errors of reading a table.

use std::fmt;
use std::io;

use shell_data::hint::quoted;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum FileKind {
    /// HDF5, including MATLAB 7.3 and later.
    Hdf5,
    Matlab,
    Mcap,
    NumPy,
    Ods,
    Parquet,
    Rosbag,
    /// A bag of ROS 2 in SQLite.
    Sqlite,
    /// A measurement file of LabVIEW.
    Tdms,
    /// A recording of Lab Streaming Layer.
    Xdf,
    Xlsx,
}

impl FileKind {
    /// Returns a short name for documents, and a name with an article for messages.
    const fn names(self) -> [&'static str; 2] {
        match self {
            Self::Hdf5 => ["hdf5", "an HDF5 file"],
            Self::Matlab => ["matlab", "a MATLAB 5 file"],
            Self::Mcap => ["mcap", "an MCAP file"],
            Self::NumPy => ["numpy", "a NumPy file"],
            Self::Ods => ["ods", "an OpenDocument spreadsheet"],
            Self::Parquet => ["parquet", "a Parquet file"],
            Self::Rosbag => ["rosbag", "a ROS 1 bag"],
            Self::Sqlite => ["sqlite", "an SQLite database"],
            Self::Tdms => ["tdms", "a TDMS file"],
            Self::Xdf => ["xdf", "an XDF recording"],
            Self::Xlsx => ["xlsx", "an Excel workbook"],
        }
    }

    pub(crate) const fn with_article(self) -> &'static str {
        self.names()[1]
    }

    pub const fn key(self) -> &'static str {
        self.names()[0]
    }
}

impl fmt::Display for FileKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.with_article().trim_start_matches("an ").trim_start_matches("a "))
    }
}

/// An error of reading a table, to which the caller adds the name of the file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TableError {
    #[error("cannot read the file")]
    Io(#[from] io::Error),
    /// The file is truncated or inconsistent.
    #[error("a damaged {kind}: {what}")]
    Damaged { kind: FileKind, what: String },
    /// The file is valid but its content is not supported.
    #[error("{} that is not read: {what}", kind.with_article())]
    Unsupported { kind: FileKind, what: String },
    /// The file has several tables, or none with the requested name. `part` is the format's word for a table.
    #[error(
        "{} {}; it has {}",
        kind.with_article(),
        match wanted { Some(name) => format!("without a {part} `{name}`"), None => format!("with more than one {part}") },
        if found.is_empty() { "none".to_owned() } else { quoted(found, ", ") }
    )]
    Choice { kind: FileKind, part: &'static str, wanted: Option<String>, found: Vec<String> },
}

/// Wraps an error for reading a table as text.
impl From<TableError> for io::Error {
    fn from(error: TableError) -> Self {
        match error {
            TableError::Io(error) => error,
            error => Self::new(io::ErrorKind::InvalidData, error),
        }
    }
}

impl FileKind {
    pub(crate) fn damaged(self, what: impl Into<String>) -> TableError {
        TableError::Damaged { kind: self, what: what.into() }
    }

    pub(crate) fn unsupported(self, what: impl Into<String>) -> TableError {
        TableError::Unsupported { kind: self, what: what.into() }
    }

    /// Returns the error for a file with several parts, or without the requested one.
    pub(crate) fn choice(
        self,
        part: &'static str,
        wanted: Option<&str>,
        found: Vec<String>,
    ) -> TableError {
        TableError::Choice { kind: self, part, wanted: wanted.map(str::to_owned), found }
    }

    /// Returns the error for bytes that cannot be read. If the file ends before them, it is damaged.
    pub(crate) fn unread(self, error: io::Error, what: impl Into<String>) -> TableError {
        match error.kind() {
            io::ErrorKind::UnexpectedEof => self.damaged(what),
            _ => TableError::Io(error),
        }
    }
}
