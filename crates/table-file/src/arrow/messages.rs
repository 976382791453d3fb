//! The messages of a file, one after the other.

use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use super::KIND;
use crate::budget;
use crate::error::TableError;
use crate::flatbuffer::Object;

/// A message: what it is, and how long its body is.
pub(super) struct Message {
    pub(super) metadata: Vec<u8>,
    pub(super) body_bytes: u64,
}

/// The messages of a file: one after the other in a stream, where the footer says in a file.
pub(super) struct Messages {
    file: BufReader<File>,
    pub(super) at: u64,
    pub(super) length: u64,
    /// Where messages start in a file, in the order in which they are read.
    blocks: Option<std::vec::IntoIter<u64>>,
}

/// The end of a file: its name again, and before that the length of the footer.
const END: u64 = 10;

impl Messages {
    /// Also gives the footer of a file.
    pub(super) fn open(path: &Path) -> Result<(Self, Option<Vec<u8>>), TableError> {
        let file = File::open(path)?;
        let length = file.metadata()?.len();
        let file = BufReader::with_capacity(1 << 16, file);
        let mut messages = Self { file, at: 0, length, blocks: None };
        let mut start = [0; 6];
        messages.read_into(&mut start)?;
        if start != *b"ARROW1" {
            messages.seek(0)?;
            return Ok((messages, None));
        }
        let cut = || KIND.damaged("it is cut off: its end is missing");
        let before = length.checked_sub(END).ok_or_else(cut)?;
        messages.seek(before)?;
        let mut end = [0; END as usize];
        messages.read_into(&mut end)?;
        if !end.ends_with(b"ARROW1") {
            return Err(cut());
        }
        let bytes = u64::from(u32::from_le_bytes([end[0], end[1], end[2], end[3]]));
        let size = budget::check_description(KIND, "its footer", bytes)?;
        messages.seek(before.checked_sub(bytes).ok_or_else(cut)?)?;
        let mut footer = vec![0; size];
        messages.read_into(&mut footer)?;
        let root = Object::root(&footer).ok_or_else(|| KIND.damaged("its footer"))?;
        // Dictionaries come first, as rows refer to them.
        let blocks = root.structs::<3>(2).zip(root.structs::<3>(3));
        let (dictionaries, records) = blocks.ok_or_else(|| KIND.damaged("its footer"))?;
        let starts =
            dictionaries.into_iter().chain(records).map(|[start, ..]| u64::try_from(start));
        let starts =
            starts.collect::<Result<Vec<_>, _>>().map_err(|_| KIND.damaged("its footer"))?;
        messages.blocks = Some(starts.into_iter());
        Ok((messages, Some(footer)))
    }

    fn seek(&mut self, at: u64) -> Result<(), TableError> {
        self.file.seek(SeekFrom::Start(at))?;
        self.at = at;
        Ok(())
    }

    fn read_into(&mut self, bytes: &mut [u8]) -> Result<(), TableError> {
        let read = self.file.read_exact(bytes);
        read.map_err(|error| KIND.unread(error, format!("it is cut off at byte {}", self.at)))?;
        self.at += bytes.len() as u64;
        Ok(())
    }

    /// The next message, without its body; `None` at the end.
    pub(super) fn next(&mut self) -> Result<Option<Message>, TableError> {
        let next_block = self.blocks.as_mut().map(Iterator::next);
        match next_block {
            Some(None) => return Ok(None),
            Some(Some(start)) => self.seek(start)?,
            // Some writers end a stream with its file.
            None if self.at == self.length => return Ok(None),
            None => {}
        }
        let at = self.at;
        let mut start = [0; 8];
        self.read_into(&mut start)?;
        let (mark, length) = start.split_at(4);
        if mark != [0xff; 4] {
            return Err(
                KIND.damaged(format!("no message at byte {at}; written before version 0.15?"))
            );
        }
        let length = u32::from_le_bytes([length[0], length[1], length[2], length[3]]);
        if length == 0 {
            return Ok(None);
        }
        let size = budget::check_description(KIND, "a message", u64::from(length))?;
        if u64::from(length) > self.length.saturating_sub(self.at) {
            return Err(KIND.damaged(format!("it is cut off in the message at byte {at}")));
        }
        let mut metadata = vec![0; size];
        self.read_into(&mut metadata)?;
        let message = Object::root(&metadata);
        let body = message.map(|message| message.long(3).unwrap_or(0));
        let body = body.and_then(|bytes| u64::try_from(bytes).ok());
        let body_bytes = body.ok_or_else(|| KIND.damaged(format!("the message at byte {at}")))?;
        let there = self.length.saturating_sub(self.at);
        if body_bytes > there {
            return Err(KIND.damaged(format!(
                "{body_bytes} bytes expected at byte {}, {there} are there",
                self.at
            )));
        }
        Ok(Some(Message { metadata, body_bytes }))
    }

    /// The body of the message just read, which the file is long enough for.
    pub(super) fn body(&mut self, message: &Message) -> Result<Vec<u8>, TableError> {
        let mut body = vec![0; usize::try_from(message.body_bytes).unwrap_or(0)];
        self.read_into(&mut body)?;
        Ok(body)
    }
}
