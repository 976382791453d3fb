//! A reader over TCP, which is never waited for.

use std::collections::VecDeque;
use std::io::{self, Write};
use std::net::TcpStream;
use std::time::Duration;

use crate::batch::FrameBatch;

/// Bytes that wait beside those of the system, at most: two seconds at 1 kHz.
const WAITING: usize = 1 << 20;

/// A connection, and the batches that wait to be sent to it.
#[derive(Debug)]
pub(crate) struct TcpReader {
    stream: TcpStream,
    waiting: VecDeque<FrameBatch>,
    bytes: usize,
    /// Bytes of the first batch that are sent.
    begun: usize,
    /// Rows that it has taken.
    pub(crate) taken: u64,
}

impl TcpReader {
    pub(crate) fn new(stream: TcpStream) -> io::Result<Self> {
        stream.set_nonblocking(true)?;
        stream.set_nodelay(true)?;
        Ok(Self { stream, waiting: VecDeque::new(), bytes: 0, begun: 0, taken: 0 })
    }

    /// Takes a batch; `false` if there is no room.
    ///
    /// # Errors
    /// The reader is gone.
    pub(crate) fn send(&mut self, batch: FrameBatch) -> io::Result<bool> {
        if !self.waiting.is_empty() {
            self.write()?;
        }
        if self.bytes + batch.bytes.len() > WAITING {
            return Ok(false);
        }
        self.bytes += batch.bytes.len();
        self.waiting.push_back(batch);
        if self.waiting.len() == 1 {
            self.write()?;
        }
        Ok(true)
    }

    fn write(&mut self) -> io::Result<()> {
        while let Some(first) = self.waiting.front() {
            match self.stream.write(&first.bytes[self.begun..]) {
                Ok(0) => return Err(io::ErrorKind::WriteZero.into()),
                Ok(count) => self.begun += count,
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => return Ok(()),
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
            if self.begun == first.bytes.len() {
                self.bytes -= first.bytes.len();
                self.begun = 0;
                self.taken += first.rows;
                self.waiting.pop_front();
            }
        }
        Ok(())
    }

    /// Waits a little for the reader to take what waits; how many rows it has taken in all.
    pub(crate) fn finish(&mut self, patience: Duration) -> u64 {
        let patient = self.stream.set_nonblocking(false);
        if patient.and_then(|()| self.stream.set_write_timeout(Some(patience))).is_ok() {
            // Who does not read to the end does not want the rest.
            let _ = self.write();
        }
        self.taken
    }
}
