//! Files in a zip archive (APPNOTE.TXT), stored or deflated, found through the central directory at its end.

use std::io::{BufReader, Read, Seek, SeekFrom};

use flate2::bufread::DeflateDecoder;

use crate::budget;
use crate::bytes::ByteReader;
use crate::format::FileSource;
use crate::kind::{FileKind, TableError};

#[derive(Clone, Debug)]
pub(crate) struct ZipEntry {
    pub(crate) name: String,
    method: u16,
    is_encrypted: bool,
    pub(crate) packed: u64,
    start: u64,
}

/// Largest distance from the start of the end record, which a comment may follow, to the end of the archive.
const END: u64 = 22 + 0xffff;

pub(crate) fn entries(kind: FileKind, file: &FileSource) -> Result<Vec<ZipEntry>, TableError> {
    let (mut file, length) = (file.open()?, file.length()?);
    let start = length.saturating_sub(END);
    file.seek(SeekFrom::Start(start))?;
    let mut end = Vec::new();
    (&mut file).take(END).read_to_end(&mut end)?;
    let cut = || kind.damaged("it is cut off: the directory of the archive is missing");
    let at = end.windows(4).rposition(|window| window == b"PK\x05\x06").ok_or_else(cut)?;
    let record = end[at + 4..].first_chunk::<18>().ok_or_else(cut)?;
    let mut record = ByteReader::new(&record[8..]);
    let (size, offset) = record.u32().zip(record.u32()).ok_or_else(cut)?;
    let (size, offset) = (u64::from(size), u64::from(offset));
    if offset == u64::from(u32::MAX) {
        return Err(kind.unsupported("it is larger than 4 GB"));
    }
    let bytes = budget::within(kind, "the directory of the archive", size, budget::DESCRIPTION)?;
    if offset.checked_add(size).is_none_or(|end| end > length) {
        return Err(cut());
    }
    file.seek(SeekFrom::Start(offset))?;
    let mut directory = vec![0; bytes];
    file.read_exact(&mut directory)?;
    let mut entries = Vec::new();
    let mut rest = ByteReader::new(&directory);
    while !rest.rest.is_empty() {
        entries.push(entry(&mut rest).ok_or_else(|| kind.damaged("the directory of the archive"))?);
    }
    Ok(entries)
}

fn entry(bytes: &mut ByteReader<'_>) -> Option<ZipEntry> {
    if bytes.take(4)? != b"PK\x01\x02" {
        return None;
    }
    bytes.take(4)?;
    let (flags, method) = (bytes.u16()?, bytes.u16()?);
    bytes.take(8)?;
    let (packed, size) = (bytes.u32()?, bytes.u32()?);
    let [name, extra, comment] = [bytes.u16()?, bytes.u16()?, bytes.u16()?].map(usize::from);
    bytes.take(8)?;
    let start = bytes.u32()?;
    let name = String::from_utf8_lossy(bytes.take(name)?).into_owned();
    let extra = bytes.take(extra)?;
    bytes.take(comment)?;
    let (packed, start) = in_64_bits(extra, size, packed, start)?;
    Some(ZipEntry { name, method, is_encrypted: flags & 1 == 1, packed, start })
}

/// Returns the compressed length and the position of the header. Numbers beyond 32 bits are in an extra field, after
/// the uncompressed length if it exceeds 32 bits, too.
fn in_64_bits(extra: &[u8], size: u32, packed: u32, start: u32) -> Option<(u64, u64)> {
    let mut fields = ByteReader::new(extra);
    let mut long = ByteReader::new(&[]);
    while let (Some(kind), Some(length)) = (fields.u16(), fields.u16()) {
        let content = fields.take(usize::from(length))?;
        if kind == 1 {
            long = ByteReader::new(content);
        }
    }
    let mut value = |short: u32| match short {
        u32::MAX => long.u64(),
        short => Some(u64::from(short)),
    };
    value(size)?;
    Some((value(packed)?, value(start)?))
}

impl ZipEntry {
    /// Opens the content as a stream, which may have any length.
    pub(crate) fn open(
        &self,
        kind: FileKind,
        archive: &FileSource,
    ) -> Result<Box<dyn Read + Send>, TableError> {
        let wrong = || kind.damaged(format!("`{}` in the archive", self.name));
        if self.is_encrypted {
            return Err(kind.unsupported("it is encrypted"));
        }
        let (mut file, length) = (archive.open()?, archive.length()?);
        let mut header = [0; 30];
        file.seek(SeekFrom::Start(self.start))?;
        file.read_exact(&mut header).map_err(|_| wrong())?;
        let mut sizes = ByteReader::new(&header[26..]);
        let (name, extra) = sizes.u16().zip(sizes.u16()).ok_or_else(wrong)?;
        let data = self.start + 30 + u64::from(name) + u64::from(extra);
        let is_there = data.checked_add(self.packed).is_some_and(|end| end <= length);
        if !header.starts_with(b"PK\x03\x04") || !is_there {
            return Err(wrong());
        }
        file.seek(SeekFrom::Start(data))?;
        let packed = BufReader::with_capacity(1 << 16, file.take(self.packed));
        match self.method {
            0 => Ok(Box::new(packed)),
            8 => Ok(Box::new(DeflateDecoder::new(packed))),
            method => {
                let what = format!("`{}` is compressed by method {method}", self.name);
                Err(kind.unsupported(what))
            }
        }
    }
}
