//! Tables as Parquet: one row group, no compression, doubles and 64-bit counts.

use std::io::{self, Write};
use std::sync::{Arc, Mutex, PoisonError};

use parquet::basic::{LogicalType, Repetition, Type as Physical};
use parquet::data_type::{ByteArray, ByteArrayType, DoubleType, Int64Type};
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::schema::types::Type;

use table_file::write::{TableWriter, Values};

use super::{Column, Table};

/// A table that could not be put into Parquet.
#[derive(Debug, thiserror::Error)]
#[error("cannot make Parquet: {0}")]
pub struct ParquetError(#[from] parquet::errors::ParquetError);

impl Table {
    /// The table as a Parquet file.
    ///
    /// # Errors
    /// [`ParquetError`] if the writer refuses the table.
    pub fn to_parquet(&self) -> Result<Vec<u8>, ParquetError> {
        let fields = self.columns.iter().map(|(name, column)| field(name, column));
        let fields = fields.collect::<Result<Vec<_>, _>>()?;
        let schema = Type::group_type_builder("schema").with_fields(fields).build()?;
        let mut bytes = Vec::new();
        let mut writer = SerializedFileWriter::new(&mut bytes, Arc::new(schema), Arc::default())?;
        let mut group = writer.next_row_group()?;
        for (_, column) in &self.columns {
            write(&mut group, column)?;
        }
        group.close()?;
        writer.close()?;
        Ok(bytes)
    }
}

fn field(name: &str, column: &Column) -> Result<Arc<Type>, ParquetError> {
    let (physical, logical, repetition) = match column {
        Column::Text(_) => (Physical::BYTE_ARRAY, Some(LogicalType::String), Repetition::REQUIRED),
        Column::Full(_) => (Physical::DOUBLE, None, Repetition::REQUIRED),
        Column::Number(_) => (Physical::DOUBLE, None, Repetition::OPTIONAL),
        Column::Count(_) => (Physical::INT64, None, Repetition::OPTIONAL),
    };
    let builder = Type::primitive_type_builder(name, physical);
    let field = builder.with_logical_type(logical).with_repetition(repetition).build()?;
    Ok(Arc::new(field))
}

fn write<W: std::io::Write + Send>(
    group: &mut SerializedRowGroupWriter<'_, W>,
    column: &Column,
) -> Result<(), ParquetError> {
    let Some(mut writer) = group.next_column()? else { return Ok(()) };
    match column {
        Column::Text(values) => {
            let values: Vec<_> = values.iter().map(|text| ByteArray::from(text.as_str())).collect();
            writer.typed::<ByteArrayType>().write_batch(&values, None, None)?;
        }
        Column::Full(values) => {
            writer.typed::<DoubleType>().write_batch(values, None, None)?;
        }
        Column::Number(values) => {
            let (present, levels) = present(values);
            writer.typed::<DoubleType>().write_batch(&present, Some(&levels), None)?;
        }
        Column::Count(values) => {
            let (present, levels) = present(values);
            let present: Vec<i64> = present.into_iter().map(|count| count as i64).collect();
            writer.typed::<Int64Type>().write_batch(&present, Some(&levels), None)?;
        }
    }
    writer.close()?;
    Ok(())
}

/// The values that are there, and for every row whether it is among them.
fn present<T: Copy>(values: &[Option<T>]) -> (Vec<T>, Vec<i16>) {
    let levels = values.iter().map(|value| i16::from(value.is_some())).collect();
    (values.iter().flatten().copied().collect(), levels)
}

/// Writes Parquet as rows come, a row group at a time.
pub struct ParquetWriter<'a> {
    out: &'a mut dyn Write,
    /// What the writer below has written and `out` has not.
    bytes: Shared,
    writer: Option<SerializedFileWriter<Shared>>,
}

/// Bytes that are taken while they are written: the writer below keeps what it writes to.
#[derive(Clone, Default)]
struct Shared(Arc<Mutex<Vec<u8>>>);

impl Write for Shared {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl<'a> ParquetWriter<'a> {
    /// A file of these columns; whether each holds texts.
    ///
    /// # Errors
    /// What the writer or the system says.
    pub fn new(out: &'a mut dyn Write, columns: &[(String, bool)]) -> io::Result<Self> {
        let column = |is_text: bool| match is_text {
            true => Column::Text(Vec::new()),
            false => Column::Full(Vec::new()),
        };
        let fields = columns.iter().map(|(name, is_text)| field(name, &column(*is_text)));
        let fields = fields.collect::<Result<Vec<_>, _>>().map_err(io::Error::other)?;
        let schema = Type::group_type_builder("schema").with_fields(fields).build();
        let schema = Arc::new(schema.map_err(io::Error::other)?);
        let bytes = Shared::default();
        let writer = SerializedFileWriter::new(bytes.clone(), schema, Arc::default());
        Ok(Self { out, bytes, writer: Some(writer.map_err(io::Error::other)?) })
    }

    fn pass_on(&mut self) -> io::Result<()> {
        let bytes =
            std::mem::take(&mut *self.bytes.0.lock().unwrap_or_else(PoisonError::into_inner));
        self.out.write_all(&bytes)
    }
}

impl TableWriter for ParquetWriter<'_> {
    fn write(&mut self, columns: &[Values<'_>]) -> io::Result<()> {
        if let Some(writer) = &mut self.writer {
            let mut group = writer.next_row_group().map_err(io::Error::other)?;
            for values in columns {
                let column = match values {
                    Values::Numbers(values) => Column::Full(values.to_vec()),
                    Values::Texts(values) => Column::Text(values.to_vec()),
                };
                write(&mut group, &column).map_err(io::Error::other)?;
            }
            group.close().map_err(io::Error::other)?;
        }
        self.pass_on()
    }

    fn finish(&mut self) -> io::Result<()> {
        if let Some(writer) = self.writer.take() {
            writer.close().map_err(io::Error::other)?;
        }
        self.pass_on()
    }
}

#[cfg(test)]
mod tests {
    use parquet::file::reader::{FileReader, SerializedFileReader};
    use parquet::record::Field;

    use super::super::tests::table;

    #[test]
    fn what_was_written_reads_back() {
        // The reader takes bytes of this kind.
        let bytes = bytes::Bytes::from(table().to_parquet().unwrap());
        let reader = SerializedFileReader::new(bytes).unwrap();
        let rows = reader.get_row_iter(None).unwrap().map(Result::unwrap);
        let fields = |row: parquet::record::Row| {
            row.get_column_iter().map(|(_, field)| field.clone()).collect()
        };
        let rows: Vec<Vec<Field>> = rows.map(fields).collect();
        let text = |text: &str| Field::Str(text.to_owned());
        assert_eq!(
            rows[0],
            [text("a, \"b\""), Field::Double(0.1), Field::Double(1.0), Field::Null]
        );
        assert_eq!(rows[1], [text(""), Field::Null, Field::Double(-1e-300), Field::Long(7)]);
    }
}
