//! Tables of which only some columns matter.

use std::path::{Path, PathBuf};

use csv::StringRecord;
use shell_data::hint::quoted;

/// A table that cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CsvTableError {
    /// It cannot be read as CSV.
    #[error("cannot read `{}`", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What went wrong.
        source: csv::Error,
    },
    /// A column is missing.
    #[error("`{}`, line 1: no column {wanted}; found {found}", path.display())]
    NoColumn {
        /// The file.
        path: PathBuf,
        /// Names that would do.
        wanted: String,
        /// The names there are.
        found: String,
    },
    /// A field is no number.
    #[error("`{}`, line {line}: `{text}` in column `{column}` is not a finite number", path.display())]
    NotANumber {
        /// The file.
        path: PathBuf,
        /// Counted from 1.
        line: u64,
        /// The column.
        column: String,
        /// What stands there.
        text: String,
    },
    /// There are no rows.
    #[error("`{}` has no rows with a value in column `{column}`", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
        /// The column.
        column: String,
    },
}

/// A table with its header read.
pub(super) struct CsvTable {
    path: PathBuf,
    reader: csv::Reader<std::fs::File>,
    header: Vec<String>,
}

impl CsvTable {
    pub(super) fn open(path: &Path) -> Result<Self, CsvTableError> {
        let failed = |source| CsvTableError::Read { path: path.to_path_buf(), source };
        let mut builder = csv::ReaderBuilder::new();
        builder.trim(csv::Trim::All).flexible(true);
        let mut reader = builder.from_path(path).map_err(failed)?;
        let header = reader.headers().map_err(failed)?;
        let header =
            header.iter().map(|name| name.trim_start_matches('\u{feff}').to_owned()).collect();
        Ok(Self { path: path.to_path_buf(), reader, header })
    }

    /// The position and name of the first of `names` that is there.
    pub(super) fn column(&self, names: &[&str]) -> Result<usize, CsvTableError> {
        let position = |name: &&str| self.header.iter().position(|h| h.eq_ignore_ascii_case(name));
        names.iter().find_map(position).ok_or_else(|| CsvTableError::NoColumn {
            path: self.path.clone(),
            wanted: quoted(names, " or "),
            found: quoted(&self.header, ", "),
        })
    }

    pub(super) fn name(&self, column: usize) -> &str {
        &self.header[column]
    }

    /// The next row.
    pub(super) fn next(&mut self) -> Result<Option<StringRecord>, CsvTableError> {
        let mut record = StringRecord::new();
        match self.reader.read_record(&mut record) {
            Ok(true) => Ok(Some(record)),
            Ok(false) => Ok(None),
            Err(source) => Err(CsvTableError::Read { path: self.path.clone(), source }),
        }
    }

    /// `None` where nothing stands.
    pub(super) fn number(
        &self,
        record: &StringRecord,
        column: usize,
    ) -> Result<Option<f64>, CsvTableError> {
        let text = record.get(column).unwrap_or_default();
        if text.is_empty() {
            return Ok(None);
        }
        match text.parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(Some(value)),
            _ => Err(CsvTableError::NotANumber {
                path: self.path.clone(),
                line: record.position().map_or(0, csv::Position::line),
                column: self.header[column].clone(),
                text: text.to_owned(),
            }),
        }
    }

    /// What is said of a table without a value in a column.
    pub(super) fn empty(&self, column: usize) -> CsvTableError {
        CsvTableError::Empty { path: self.path.clone(), column: self.header[column].clone() }
    }
}
