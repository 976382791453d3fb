//! A reader that is written to by a thread of its own, since a pipe, a disk or a network may hold it up.

use std::io::{self, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

/// Rows that wait, at most: four seconds at 1 kHz.
const WAITING: u64 = 4096;

/// Most bytes of one write.
const PIECE: usize = 1 << 16;

/// Rows that are handed over together: they arrive as a whole, or are lost as a whole.
#[derive(Debug, Default)]
pub(crate) struct FrameBatch {
    pub(crate) bytes: Vec<u8>,
    pub(crate) rows: u64,
}

/// The end of the pipe that rows are put in.
#[derive(Debug)]
pub(crate) struct PipeReader {
    batches: Option<Sender<FrameBatch>>,
    /// Rows that have been written.
    written: Arc<AtomicU64>,
    /// `None` once it has been joined.
    thread: Option<JoinHandle<io::Result<()>>>,
}

impl PipeReader {
    pub(crate) fn new(name: &str, out: impl Write + Send + 'static) -> io::Result<Self> {
        let (batches, receiver) = channel();
        let written = Arc::new(AtomicU64::new(0));
        let of_thread = Arc::clone(&written);
        let run = move || write_all(out, &receiver, &of_thread);
        let thread = Some(thread::Builder::new().name(name.to_owned()).spawn(run)?);
        Ok(Self { batches: Some(batches), written, thread })
    }

    /// Hands a batch over after so many rows; `false` if there is no room.
    ///
    /// # Errors
    /// That of the last write: the reader is gone.
    pub(crate) fn send(&mut self, batch: FrameBatch, handed: u64) -> io::Result<bool> {
        let Some(batches) = &self.batches else { return Ok(false) };
        if handed + batch.rows - self.written.load(Ordering::Acquire) > WAITING && !self.has_ended()
        {
            return Ok(false);
        }
        if batches.send(batch).is_ok() {
            return Ok(true);
        }
        self.batches = None;
        self.end().map(|()| false)
    }

    /// Waits for what is on its way, as long as it goes on within `patience`; how many rows have been written in all.
    pub(crate) fn finish(&mut self, patience: Duration) -> (u64, io::Result<()>) {
        self.batches = None;
        let (mut written, mut since) = (self.written.load(Ordering::Acquire), Instant::now());
        while !self.has_ended() && since.elapsed() < patience {
            thread::sleep(Duration::from_millis(1));
            let now_written = self.written.load(Ordering::Acquire);
            if now_written > written {
                (written, since) = (now_written, Instant::now());
            }
        }
        let ended = if self.has_ended() { self.end() } else { Ok(()) };
        (self.written.load(Ordering::Acquire), ended)
    }

    fn has_ended(&self) -> bool {
        self.thread.as_ref().is_none_or(JoinHandle::is_finished)
    }

    /// Waits for the thread to end and returns its result.
    fn end(&mut self) -> io::Result<()> {
        self.thread.take().and_then(|thread| thread.join().ok()).unwrap_or(Ok(()))
    }
}

fn write_all(
    mut out: impl Write,
    batches: &Receiver<FrameBatch>,
    written: &AtomicU64,
) -> io::Result<()> {
    while let Ok(FrameBatch { mut bytes, mut rows }) = batches.recv() {
        while bytes.len() < PIECE
            && let Ok(next) = batches.try_recv()
        {
            bytes.extend_from_slice(&next.bytes);
            rows += next.rows;
        }
        out.write_all(&bytes)?;
        out.flush()?;
        written.fetch_add(rows, Ordering::Release);
    }
    Ok(())
}
