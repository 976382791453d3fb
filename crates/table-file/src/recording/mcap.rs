//! MCAP ("MCAP File Format Specification"): records in order, inside and outside chunks.

use std::collections::HashMap;
use std::io::{BufReader, Read, Seek, SeekFrom};

use super::message::FieldKind;
use super::{MESSAGE, Record};
use crate::budget::{self, Unpacked};
use crate::bytes::ByteReader;
use crate::codec::{Codec, unpack};
use crate::format::{FileSource, OpenFile};
use crate::kind::{FileKind, TableError};

const KIND: FileKind = FileKind::Mcap;

const MAGIC: [u8; 8] = *b"\x89MCAP0\r\n";

pub(super) fn records(file: &FileSource) -> Result<super::Records, TableError> {
    let mut records = Records::open(file)?;
    Ok(Box::new(move || records.next()))
}

struct Records {
    file: BufReader<OpenFile>,
    /// Names and definitions of message types, by number.
    schemas: HashMap<u16, (String, String)>,
    at: u64,
    length: u64,
    records: Vec<u8>,
    /// Position of the next record in `records`.
    next: usize,
    unpacked: Unpacked,
    ended: bool,
    /// Position of the record that is cut off, if the file has no end.
    cut_at: Option<u64>,
}

impl Records {
    fn open(file: &FileSource) -> Result<Self, TableError> {
        let length = file.length()?;
        let file = BufReader::with_capacity(1 << 16, file.open()?);
        let (records, unpacked, schemas) = (Vec::new(), Unpacked::default(), HashMap::new());
        let (next, ended, cut_at) = (0, false, None);
        let mut records =
            Self { file, schemas, at: 0, length, records, next, unpacked, ended, cut_at };
        let mut magic = [0; 8];
        records.read(&mut magic)?;
        match magic == MAGIC {
            true => Ok(records),
            false => Err(KIND.damaged("it does not begin as one")),
        }
    }

    fn read(&mut self, bytes: &mut [u8]) -> Result<(), TableError> {
        let read = self.file.read_exact(bytes);
        read.map_err(|error| KIND.unread(error, format!("it is cut off at byte {}", self.at)))?;
        self.at += bytes.len() as u64;
        Ok(())
    }

    /// Returns the next relevant record; `None` at the end of the messages.
    fn next(&mut self) -> Result<Option<Record>, TableError> {
        loop {
            let rest = &self.records[self.next..];
            if rest.is_empty() {
                if self.ended {
                    return Ok(self.cut_at.take().map(|at| Record::Cut { at }));
                }
                self.next_at_top()?;
                continue;
            }
            let damaged = || KIND.damaged(format!("a record before byte {}", self.at));
            let mut bytes = ByteReader::new(rest);
            let kind = bytes.u8().ok_or_else(damaged)?;
            let length = bytes.u64().and_then(|length| usize::try_from(length).ok());
            let content = length.and_then(|length| bytes.take(length)).ok_or_else(damaged)?;
            let next = self.records.len() - bytes.rest.len();
            let record = record(&mut self.schemas, kind, content).ok_or_else(damaged)?;
            self.next = next;
            if record.is_some() {
                return Ok(record);
            }
        }
    }

    /// Reads the next record or chunk of records from the file.
    fn next_at_top(&mut self) -> Result<(), TableError> {
        let at = self.at;
        self.next = 0;
        self.records.clear();
        let mut head = [0; 9];
        let has_head = self.length - at >= head.len() as u64;
        if has_head {
            self.read(&mut head)?;
        }
        let length = ByteReader::new(&head[1..]).u64().unwrap_or(u64::MAX);
        if !has_head || length > self.length - self.at {
            let mut end = [0; MAGIC.len()];
            self.file.seek(SeekFrom::End(-(end.len() as i64)))?;
            self.file.read_exact(&mut end)?;
            if end == MAGIC {
                return Err(KIND.damaged(format!("the length of the record at byte {at}")));
            }
            // A recorder that was killed leaves whole chunks, and part of the next one.
            (self.ended, self.cut_at) = (true, Some(at));
            return Ok(());
        }
        match head[0] {
            // The record is the end of the data section, or the footer of a file without that record.
            0x02 | 0x0f => self.ended = true,
            0x03..=0x05 => {
                let what = format_args!("the message at byte {at}");
                let mut content = vec![0; budget::within(KIND, what, length, MESSAGE)?];
                self.read(&mut content)?;
                self.records = [&head[..], &content].concat();
            }
            0x06 => {
                let mut content = vec![0; length as usize];
                self.read(&mut content)?;
                self.records =
                    chunk(&content, at, |bytes| self.unpacked.add(KIND, bytes, self.length))?;
            }
            _ => {
                let mut skipped = self.file.by_ref().take(length);
                self.at += std::io::copy(&mut skipped, &mut std::io::sink())?;
            }
        }
        Ok(())
    }
}

fn chunk(
    content: &[u8],
    at: u64,
    count: impl FnOnce(u64) -> Result<(), TableError>,
) -> Result<Vec<u8>, TableError> {
    let wrong = || KIND.damaged(format!("the chunk at byte {at}"));
    let mut bytes = ByteReader::new(content);
    bytes.take(16).ok_or_else(wrong)?;
    let size = bytes.u64().ok_or_else(wrong)?;
    let checksum = bytes.u32().ok_or_else(wrong)?;
    let codec = match bytes.text().ok_or_else(wrong)? {
        "" => Codec::None,
        "lz4" => Codec::Lz4Frame,
        "zstd" => Codec::Zstd,
        other => return Err(KIND.unsupported(format!("chunks compressed with `{other}`"))),
    };
    let packed = bytes.u64().and_then(|length| bytes.take(usize::try_from(length).ok()?));
    let packed = packed.ok_or_else(wrong)?;
    count(size)?;
    let what = format_args!("the chunk at byte {at}");
    let size = budget::check(KIND, what, size, content.len() as u64)?;
    let records = unpack(codec, packed, size)
        .map_err(|what| KIND.damaged(format!("the chunk at byte {at}: {what}")))?;
    match checksum {
        // 0 stands for no checksum.
        0 => Ok(records),
        _ if crc32fast::hash(&records) == checksum => Ok(records),
        _ => Err(KIND.damaged(format!("the chunk at byte {at}: its checksum is another"))),
    }
}

/// Decodes a record: `Some(None)` if it is not relevant, `None` if it is damaged.
fn record(
    schemas: &mut HashMap<u16, (String, String)>,
    kind: u8,
    content: &[u8],
) -> Option<Option<Record>> {
    let mut bytes = ByteReader::new(content);
    Some(match kind {
        0x03 => {
            let (id, name) = (bytes.u16()?, bytes.text()?.to_owned());
            let _encoding = bytes.text()?;
            // Only ROS definitions are used, and these are text.
            let length = usize::try_from(bytes.u32()?).ok()?;
            let definition = String::from_utf8_lossy(bytes.take(length)?).into_owned();
            schemas.insert(id, (name, definition));
            None
        }
        0x04 => {
            let (id, schema) = (u32::from(bytes.u16()?), bytes.u16()?);
            let (topic, encoding) = (bytes.text()?.to_owned(), bytes.text()?);
            let (name, definition) =
                schemas.get(&schema).map_or(("", ""), |(name, text)| (name, text));
            Some(Record::Channel { id, topic, kind: FieldKind::new(name, definition, encoding) })
        }
        0x05 => {
            let (channel, _sequence) = (u32::from(bytes.u16()?), bytes.u32()?);
            let (log_time, _published) = (bytes.u64()?, bytes.u64()?);
            Some(Record::Message { channel, log_time, data: bytes.rest.to_vec() })
        }
        _ => None,
    })
}
