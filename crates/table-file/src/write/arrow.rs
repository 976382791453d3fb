//! Arrow files, which are Feather version 2: doubles and texts, nothing compressed, nothing missing.

use std::io::{self, Write};

use super::flatbuffer::{Builder, Field, Pointer};
use super::{TableWriter, Values};

/// The fifth version of the metadata.
const VERSION: i16 = 4;

const SCHEMA: u8 = 1;
const RECORDS: u8 = 3;

/// The types of columns.
const FLOATING_POINT: u8 = 3;
const UTF8: u8 = 5;

/// Writes an Arrow file.
pub struct ArrowWriter<W> {
    out: W,
    at: u64,
    columns: Vec<(String, bool)>,
    /// Start, length of the metadata, length of the body.
    blocks: Vec<[i64; 3]>,
}

impl<W: Write> ArrowWriter<W> {
    /// A file of these columns; whether each holds texts.
    ///
    /// # Errors
    /// What the system says.
    pub fn new(out: W, columns: &[(String, bool)]) -> io::Result<Self> {
        let mut writer = Self { out, at: 0, columns: columns.to_vec(), blocks: Vec::new() };
        writer.bytes(b"ARROW1\0\0")?;
        let (mut builder, root) = Builder::new();
        let header = message(&mut builder, root, SCHEMA, 0);
        schema(&mut builder, header, &writer.columns);
        writer.message(&builder.finish())?;
        Ok(writer)
    }

    fn bytes(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.at += bytes.len() as u64;
        self.out.write_all(bytes)
    }

    fn message(&mut self, metadata: &[u8]) -> io::Result<()> {
        self.bytes(&[0xff; 4])?;
        self.bytes(&(metadata.len() as u32).to_le_bytes())?;
        self.bytes(metadata)
    }
}

fn message(builder: &mut Builder, root: Pointer, kind: u8, body_bytes: i64) -> Pointer {
    let fields = [
        Field::Short(0, VERSION),
        Field::Byte(1, kind),
        Field::Pointer(2),
        Field::Long(3, body_bytes),
    ];
    builder.table(root, &fields)[0]
}

fn schema(builder: &mut Builder, pointer: Pointer, columns: &[(String, bool)]) {
    let fields = builder.table(pointer, &[Field::Pointer(1)]);
    let fields = builder.pointers(fields[0], columns.len());
    for (pointer, (name, is_text)) in fields.into_iter().zip(columns) {
        let kind = if *is_text { UTF8 } else { FLOATING_POINT };
        let parts = builder.table(
            pointer,
            &[
                Field::Pointer(0),
                Field::Byte(1, 0),
                Field::Byte(2, kind),
                Field::Pointer(3),
                Field::Pointer(5),
            ],
        );
        builder.text(parts[0], name);
        // Doubles are the third precision.
        let details = [Field::Short(0, 2)];
        builder.table(parts[1], if *is_text { &[] } else { &details });
        builder.pointers(parts[2], 0);
    }
}

impl<W: Write> TableWriter for ArrowWriter<W> {
    fn write(&mut self, columns: &[Values<'_>]) -> io::Result<()> {
        let rows = columns.first().map_or(0, Values::len);
        if rows == 0 {
            return Ok(());
        }
        let (mut body, mut buffers) = (Vec::new(), Vec::new());
        let mut add = |bytes: &[u8], body: &mut Vec<u8>| {
            buffers.push([body.len() as i64, bytes.len() as i64]);
            body.extend_from_slice(bytes);
            body.resize(body.len().next_multiple_of(8), 0);
        };
        for values in columns {
            // All values are there.
            add(&[], &mut body);
            match values {
                Values::Numbers(values) => {
                    let bytes: Vec<u8> =
                        values.iter().flat_map(|value| value.to_le_bytes()).collect();
                    add(&bytes, &mut body);
                }
                Values::Texts(values) => {
                    let mut offsets = vec![0_i32];
                    let mut text = Vec::new();
                    for value in *values {
                        text.extend_from_slice(value.as_bytes());
                        let end = i32::try_from(text.len()).map_err(io::Error::other)?;
                        offsets.push(end);
                    }
                    let offsets: Vec<u8> =
                        offsets.iter().flat_map(|end| end.to_le_bytes()).collect();
                    add(&offsets, &mut body);
                    add(&text, &mut body);
                }
            }
        }
        let (mut builder, root) = Builder::new();
        let header = message(&mut builder, root, RECORDS, body.len() as i64);
        let fields = [Field::Long(0, rows as i64), Field::Pointer(1), Field::Pointer(2)];
        let parts = builder.table(header, &fields);
        builder.structs(parts[0], &vec![[rows as i64, 0]; columns.len()]);
        builder.structs(parts[1], &buffers);
        let metadata = builder.finish();
        let start = self.at as i64;
        self.message(&metadata)?;
        self.bytes(&body)?;
        self.blocks.push([start, 8 + metadata.len() as i64, body.len() as i64]);
        Ok(())
    }

    fn finish(&mut self) -> io::Result<()> {
        // The end of the stream in the file.
        self.bytes(&[0xff, 0xff, 0xff, 0xff, 0, 0, 0, 0])?;
        let (mut builder, root) = Builder::new();
        let fields =
            [Field::Short(0, VERSION), Field::Pointer(1), Field::Pointer(2), Field::Pointer(3)];
        let parts = builder.table(root, &fields);
        schema(&mut builder, parts[0], &self.columns);
        builder.structs::<3>(parts[1], &[]);
        builder.structs(parts[2], &self.blocks);
        let footer = builder.finish();
        self.bytes(&footer)?;
        self.bytes(&(footer.len() as u32).to_le_bytes())?;
        self.bytes(b"ARROW1")?;
        self.out.flush()
    }
}
