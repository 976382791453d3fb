//! Tables of which only some columns matter.

use std::path::{Path, PathBuf};

use csv::StringRecord;
use shell_data::hint::quoted;

/// A table that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum CsvTableError {
    /// It cannot be read as CSV.
    #[error("cannot read `{}`", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What went wrong.
        source: csv::Error,
    },
    /// What it lacks, and where.
    #[error("`{}`{problem}", path.display())]
    Unusable {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        problem: String,
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
        names.iter().find_map(position).ok_or_else(|| {
            let (wanted, found) = (quoted(names, " or "), quoted(&self.header, ", "));
            self.unusable(format!(", line 1: no column {wanted}; found {found}"))
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
            _ => {
                let line = record.position().map_or(0, csv::Position::line);
                let column = &self.header[column];
                let problem = format!("`{text}` in column `{column}` is not a finite number");
                Err(self.unusable(format!(", line {line}: {problem}")))
            }
        }
    }

    /// What is said of a table without a value in a column.
    pub(super) fn empty(&self, column: usize) -> CsvTableError {
        self.unusable(format!(" has no rows with a value in column `{}`", self.header[column]))
    }

    fn unusable(&self, problem: String) -> CsvTableError {
        CsvTableError::Unusable { path: self.path.clone(), problem }
    }
}
