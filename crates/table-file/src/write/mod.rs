//! Writers of tables, and tables of results as CSV and Parquet.
//!
//! MCAP and Parquet are written as rows arrive. NumPy and MATLAB files begin with the number of rows, so all rows
//! must be present.

pub mod mcap;
mod npy;
mod parquet;

use std::io;

use shell_data::escape;

pub use self::npy::write_numpy;
pub use self::parquet::ParquetWriter;
pub use crate::format::Cells;
pub use crate::mat5::write_matlab;

const GROUP_ROWS: usize = 1 << 16;

/// Columns of equal length with names that include the unit. Numbers in CSV have the fewest digits that read back
/// equal. Missing values are empty in CSV and null in Parquet.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NamedTable {
    columns: Vec<(String, Cells<'static>)>,
}

impl NamedTable {
    /// # Panics
    /// If the columns differ in length.
    pub fn new<'a>(columns: impl IntoIterator<Item = (&'a str, Cells<'static>)>) -> Self {
        let columns = columns.into_iter().map(|(name, cells)| (name.to_owned(), cells)).collect();
        let table = Self { columns };
        assert!(table.columns.iter().all(|(_, cells)| cells.rows() == table.rows()), "one length");
        table
    }

    pub fn rows(&self) -> usize {
        self.columns.first().map_or(0, |(_, cells)| cells.rows())
    }

    pub fn to_csv(&self) -> Vec<u8> {
        let mut text = Vec::with_capacity(20 * self.columns.len() * (1 + self.rows()));
        let names = self.columns.iter().map(|(name, _)| name.as_str());
        text.extend_from_slice(names.collect::<Vec<_>>().join(",").as_bytes());
        text.push(b'\n');
        let mut digits = zmij::Buffer::new();
        for row in 0..self.rows() {
            for (position, (_, column)) in self.columns.iter().enumerate() {
                if position > 0 {
                    text.push(b',');
                }
                match column {
                    Cells::Text(values) => {
                        text.extend_from_slice(escape::csv_field(&values[row]).as_bytes())
                    }
                    Cells::Full(values) => {
                        text.extend_from_slice(digits.format(values[row]).as_bytes());
                    }
                    Cells::Number(values) => {
                        let value = values[row].map(|value| digits.format(value));
                        text.extend_from_slice(value.unwrap_or_default().as_bytes());
                    }
                    Cells::Count(values) => {
                        let value = values[row].map(|value| value.to_string());
                        text.extend_from_slice(value.unwrap_or_default().as_bytes());
                    }
                }
            }
            text.push(b'\n');
        }
        text
    }

    /// Returns the table as a Parquet file.
    ///
    /// # Errors
    /// [`io::Error`] if a page would exceed 2 GB, the format's limit.
    pub fn to_parquet(&self) -> io::Result<Vec<u8>> {
        let mut bytes = Vec::new();
        let mut writer = ParquetWriter::new(&mut bytes, &self.columns)?;
        for start in (0..self.rows()).step_by(GROUP_ROWS) {
            writer.write(&self.columns, start..self.rows().min(start + GROUP_ROWS))?;
        }
        writer.finish()?;
        Ok(bytes)
    }
}

#[cfg(test)]
mod tests {
    use crate::FileKind;

    use super::*;

    fn table() -> NamedTable {
        NamedTable::new([
            ("file", Cells::Text(vec!["a, \"b\"".to_owned(), String::new()].into())),
            ("drag_n", Cells::Number(vec![Some(0.1), None].into())),
            ("t_s", Cells::Full(vec![1.0, -1e-300].into())),
            ("rows", Cells::Count(vec![None, Some(7)].into())),
        ])
    }

    #[test]
    fn csv_reads_back_as_what_it_was_made_from() {
        let text = table().to_csv();
        let mut reader = csv::Reader::from_reader(&*text);
        assert_eq!(reader.headers().unwrap(), vec!["file", "drag_n", "t_s", "rows"]);
        let rows: Vec<_> = reader.records().map(Result::unwrap).collect();
        assert_eq!(rows[0], vec!["a, \"b\"", "0.1", "1.0", ""]);
        assert_eq!(rows[1], vec!["", "", "-1e-300", "7"]);
    }
    #[test]
    fn parquet_reads_back_as_what_it_was_made_from() {
        // A row group has fewer rows.
        let many = 70_000;
        let names = (0..many).map(|row| format!("trial {}", row / 1000));
        let drag = (0..many).map(|row| (row % 3 > 0).then_some(f64::from(row) / 7.0));
        let long = NamedTable::new([
            ("file", Cells::Text(names.collect())),
            ("drag_n", Cells::Number(drag.collect())),
        ]);
        let file = tempfile::NamedTempFile::new().unwrap();
        for (table, line) in [(table(), 1), (long, 65_537)] {
            std::fs::write(file.path(), table.to_parquet().unwrap()).unwrap();
            let read = crate::Table::open(
                &crate::FileSource::Disk(file.path().to_owned()),
                FileKind::Parquet,
                None,
            )
            .unwrap();
            let text = read.head(None, usize::MAX, usize::MAX).unwrap();
            let text = String::from_utf8(text).unwrap();
            // The reader formats floating-point numbers with integer values as integers.
            let expected = String::from_utf8(table.to_csv()).unwrap();
            let expected = expected.replace(".0,", ",").replace(".0\n", "\n");
            assert!(text == expected, "{:?}", text.lines().nth(line));
        }
    }
}
