//! ROS 1 bags ("Bags/Format/2.0"): records in order, inside and outside chunks.

use std::collections::HashMap;
use std::io::{BufReader, Read};

use super::message::FieldKind;
use super::{MESSAGE, Record, Records};
use crate::budget::{self, Unpacked};
use crate::bytes::ByteReader;
use crate::codec::{Codec, unpack};
use crate::format::{FileSource, OpenFile};
use crate::kind::{FileKind, TableError};

const KIND: FileKind = FileKind::Rosbag;

const MAGIC: [u8; 13] = *b"#ROSBAG V2.0\n";

/// Kinds of records.
const MESSAGE_DATA: u8 = 2;
const BAG_HEADER: u8 = 3;
const CHUNK: u8 = 5;
const CONNECTION: u8 = 7;

pub(super) fn records(file: &FileSource) -> Result<Records, TableError> {
    let length = file.length()?;
    let file = BufReader::with_capacity(1 << 16, file.open()?);
    let (chunk, unpacked) = (Vec::new(), Unpacked::default());
    let (at, index_at, is_in_chunk, is_short, next) = (0, 0, false, false, 0);
    let mut bag = Bag { file, at, length, index_at, is_in_chunk, is_short, chunk, next, unpacked };
    match bag.read(MAGIC.len() as u64)? {
        magic if magic == MAGIC => Ok(Box::new(move || bag.next())),
        magic => {
            let version = String::from_utf8_lossy(&magic);
            Err(KIND.unsupported(format!("format `{}`, not `#ROSBAG V2.0`", version.trim())))
        }
    }
}

struct Bag {
    file: BufReader<OpenFile>,
    at: u64,
    length: u64,
    /// Position of the index at the end; 0 if the recorder did not write it.
    index_at: u64,
    /// True within a chunk that the recorder did not finish.
    is_in_chunk: bool,
    /// True if a record reaches beyond the end of the file.
    is_short: bool,
    chunk: Vec<u8>,
    /// Position of the next record in the chunk.
    next: usize,
    unpacked: Unpacked,
}

impl Bag {
    fn read(&mut self, length: u64) -> Result<Vec<u8>, TableError> {
        if length > self.length - self.at {
            self.is_short = true;
            return Err(KIND.damaged(format!("it is cut off at byte {}", self.at)));
        }
        let most = budget::limit(self.length).min(budget::IN_MEMORY);
        let mut bytes = vec![0; budget::within(KIND, "a record", length, most)?];
        let read = self.file.read_exact(&mut bytes);
        read.map_err(|error| KIND.unread(error, format!("it is cut off at byte {}", self.at)))?;
        self.at += length;
        Ok(bytes)
    }

    /// Reads bytes that are preceded by their length.
    fn read_block(&mut self) -> Result<Vec<u8>, TableError> {
        let length = self.read_length()?;
        self.read(length)
    }

    fn read_length(&mut self) -> Result<u64, TableError> {
        let length = self.read(4)?;
        Ok(ByteReader::new(&length).u32().map_or(0, u64::from))
    }

    fn is_unfinished(&self) -> bool {
        self.index_at == 0 || self.index_at > self.length
    }

    /// Returns the next relevant record; `None` at the end.
    fn next(&mut self) -> Result<Option<Record>, TableError> {
        loop {
            if self.next < self.chunk.len() {
                let damaged = || KIND.damaged(format!("a record before byte {}", self.at));
                let mut bytes = ByteReader::new(&self.chunk[self.next..]);
                let (header, data) =
                    block(&mut bytes).zip(block(&mut bytes)).ok_or_else(damaged)?;
                let next = self.chunk.len() - bytes.rest.len();
                let record = Fields::new(header).and_then(|fields| record(&fields, data));
                self.next = next;
                match record.ok_or_else(damaged)? {
                    None => continue,
                    record => return Ok(record),
                }
            }
            let at = self.at;
            if at == self.length {
                // The missing index is reported once.
                let is_cut = self.is_unfinished();
                self.index_at = self.length;
                return Ok(is_cut.then_some(Record::Cut { at }));
            }
            match self.next_at_top() {
                Ok(None) => {}
                Err(TableError::Damaged { .. }) if self.ends_within(at) => {
                    (self.at, self.index_at) = (self.length, self.length);
                    self.chunk.clear();
                    return Ok(Some(Record::Cut { at }));
                }
                found => return found,
            }
        }
    }

    /// Returns true if the record at a position is invalid because the file ends too early: within a record or the
    /// index, or in a chunk without its length.
    fn ends_within(&self, at: u64) -> bool {
        self.is_in_chunk || self.is_short && (self.is_unfinished() || at >= self.index_at)
    }

    /// Reads the next record, or the next chunk, from the file; `None` if it is not relevant.
    fn next_at_top(&mut self) -> Result<Option<Record>, TableError> {
        let at = self.at;
        let header = self.read_block()?;
        let damaged = || KIND.damaged(format!("the record at byte {at}"));
        let fields = Fields::new(&header).ok_or_else(damaged)?;
        match fields.kind().ok_or_else(damaged)? {
            BAG_HEADER => {
                self.read_block()?;
                self.index_at = fields.number("index_pos", 8).ok_or_else(damaged)?;
            }
            CHUNK => {
                let length = self.read_length()?;
                // The recorder fills in the sizes when it ends the chunk. Until then, uncompressed records are read as
                // if they were outside a chunk.
                let is_empty = fields.number("size", 4) == Some(0);
                let is_cut = length > self.length - self.at;
                let is_raw = fields.get("compression") == Some(b"none");
                if self.is_unfinished() && (is_empty || is_cut && is_raw) {
                    self.is_in_chunk = true;
                } else {
                    let packed = self.read(length)?;
                    (self.chunk, self.next) = (self.unpack(&fields, &packed, at)?, 0);
                }
            }
            MESSAGE_DATA | CONNECTION => {
                let data = self.read_block()?;
                return record(&fields, &data).ok_or_else(damaged);
            }
            _ => {
                self.read_block()?;
            }
        }
        Ok(None)
    }

    fn unpack(
        &mut self,
        fields: &Fields<'_>,
        packed: &[u8],
        at: u64,
    ) -> Result<Vec<u8>, TableError> {
        let wrong = || KIND.damaged(format!("the chunk at byte {at}"));
        let size = fields.number("size", 4).ok_or_else(wrong)?;
        let codec = match fields.get("compression").ok_or_else(wrong)? {
            b"none" => Codec::None,
            b"bz2" => Codec::Bzip2,
            b"lz4" => Codec::Lz4Frame,
            other => {
                let other = String::from_utf8_lossy(other);
                return Err(KIND.unsupported(format!("chunks compressed with `{other}`")));
            }
        };
        self.unpacked.add(KIND, size, self.length)?;
        let size =
            budget::check(KIND, format_args!("the chunk at byte {at}"), size, packed.len() as u64)?;
        unpack(codec, packed, size)
            .map_err(|what| KIND.damaged(format!("the chunk at byte {at}: {what}")))
    }
}

/// Takes bytes that are preceded by their length.
fn block<'a>(bytes: &mut ByteReader<'a>) -> Option<&'a [u8]> {
    let length = usize::try_from(bytes.u32()?).ok()?;
    bytes.take(length)
}

struct Fields<'a>(HashMap<&'a [u8], &'a [u8]>);

impl<'a> Fields<'a> {
    /// Reads `name=value` pairs, each preceded by its length; `None` if they are damaged.
    fn new(header: &'a [u8]) -> Option<Self> {
        let (mut bytes, mut fields) = (ByteReader::new(header), HashMap::new());
        while !bytes.rest.is_empty() {
            let field = block(&mut bytes)?;
            let at = field.iter().position(|&byte| byte == b'=')?;
            fields.insert(&field[..at], &field[at + 1..]);
        }
        Some(Self(fields))
    }

    fn get(&self, name: &str) -> Option<&'a [u8]> {
        self.0.get(name.as_bytes()).copied()
    }

    fn text(&self, name: &str) -> Option<String> {
        self.get(name).map(|text| String::from_utf8_lossy(text).into_owned())
    }

    fn number(&self, name: &str, size: usize) -> Option<u64> {
        let value = self.get(name).filter(|value| value.len() == size)?;
        Some(value.iter().rev().fold(0, |number, &byte| number << 8 | u64::from(byte)))
    }

    fn kind(&self) -> Option<u8> {
        self.number("op", 1)?.try_into().ok()
    }
}

/// Decodes a record: `Some(None)` if it is not relevant, `None` if it is damaged.
fn record(fields: &Fields<'_>, data: &[u8]) -> Option<Option<Record>> {
    let channel = || fields.number("conn", 4).map(|channel| channel as u32);
    Some(match fields.kind()? {
        CONNECTION => {
            let connection = Fields::new(data)?;
            let schema = connection.text("type")?;
            let definition = connection.text("message_definition").unwrap_or_default();
            let kind = FieldKind::new(&schema, &definition, "ros1");
            Some(Record::Channel { id: channel()?, topic: fields.text("topic")?, kind })
        }
        MESSAGE_DATA if data.len() as u64 > MESSAGE => return None,
        MESSAGE_DATA => {
            let time = fields.number("time", 8)?;
            // Seconds in the lower half, nanoseconds in the upper half.
            let log_time = (time & 0xffff_ffff) * 1_000_000_000 + (time >> 32);
            Some(Record::Message { channel: channel()?, log_time, data: data.to_vec() })
        }
        _ => None,
    })
}
