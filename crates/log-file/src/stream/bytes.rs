//! Streams of bytes of a file: counted, and guarded against files that unpack to far more than their size.

use std::io::{self, Read};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

use shell_data::lock::lock;
use twox_hash::XxHash3_128;

use crate::checksum;

/// Largest ratio of unpacked to compressed size, which applies above 64 MB. Logs of measured numbers compress to
/// between a third and a twentieth of their text. A file that unpacks to a thousand times its size only takes time.
pub(super) const UNPACKED_RATIO: u64 = 128;

/// A decoder that may return `left` more bytes.
pub(super) struct Unpacked<D> {
    pub(super) decoder: D,
    pub(super) left: u64,
}

impl<D: Read> Read for Unpacked<D> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.decoder.read(buffer)?;
        self.left = self.left.checked_sub(read as u64).ok_or_else(|| {
            let text = format!(
                "it unpacks to more than {UNPACKED_RATIO} times its size and 64 MB; if it is a log, unpack it \
                 first: a file as it is may be of any size"
            );
            io::Error::new(io::ErrorKind::FileTooLarge, text)
        })?;
        Ok(read)
    }
}

/// The text of a log from its start.
pub(crate) type ByteStream = Box<dyn Read + Send>;

/// Counters of the bytes read from files on disk.
#[derive(Clone, Default)]
pub(crate) struct ReadMeter {
    pub(crate) bytes: Arc<AtomicU64>,
    checksum: Option<Arc<Mutex<XxHash3_128>>>,
}

impl ReadMeter {
    pub(crate) fn begin(&mut self, checksum: bool) {
        self.checksum = checksum.then(Arc::default);
    }

    /// Returns a meter that only computes the checksum of the current file, if requested, and
    /// counts no bytes.
    pub(super) fn of_checksum(&self) -> Option<Self> {
        let checksum = self.checksum.clone()?;
        Some(Self { bytes: Arc::default(), checksum: Some(checksum) })
    }

    pub(crate) fn count(&self, bytes: u64) {
        self.bytes.fetch_add(bytes, Ordering::Relaxed);
    }

    /// Returns the checksum of a file that has been read to its end.
    pub(crate) fn checksum(&self) -> Option<String> {
        self.checksum.as_ref().map(|checksum| checksum::text(&lock(checksum)))
    }
}

/// A file whose bytes are counted.
pub(super) struct CountedStream<R> {
    pub(super) stream: R,
    pub(super) meter: ReadMeter,
    /// Number of bytes of the file that have not been counted.
    pub(super) left: u64,
}

impl<R: Read> Read for CountedStream<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.stream.read(buffer)?;
        let counted = if read == 0 { self.left } else { self.left.min(read as u64) };
        self.left -= counted;
        self.meter.count(counted);
        if let Some(checksum) = &self.meter.checksum {
            lock(checksum).write(&buffer[..read]);
        }
        Ok(read)
    }
}
