//! A reader that is written to by a thread of its own, since a pipe or a disk may hold it up.

use std::io::{self, Write};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, OnceLock};
use std::thread;
use std::time::{Duration, Instant};

use crate::batch::FrameBatch;

/// Rows that wait, at most: four seconds at 1 kHz.
const WAITING: u64 = 4096;

/// Most bytes of one write.
const PIECE: usize = 1 << 16;

/// The end of the pipe that rows are put in.
#[derive(Debug)]
pub(crate) struct PipeReader {
    batches: Option<Sender<FrameBatch>>,
    /// Rows that were handed over.
    handed: u64,
    shared: Arc<PipeState>,
}

#[derive(Debug, Default)]
struct PipeState {
    /// Rows that have been written.
    written: AtomicU64,
    /// How it has ended.
    ended: OnceLock<io::Result<()>>,
}

impl PipeReader {
    pub(crate) fn new(name: &str, out: impl Write + Send + 'static) -> io::Result<Self> {
        let (batches, receiver) = channel();
        let shared = Arc::new(PipeState::default());
        let of_thread = Arc::clone(&shared);
        let run = move || {
            let result = write_all(out, &receiver, &of_thread.written);
            let _ = of_thread.ended.set(result);
        };
        thread::Builder::new().name(name.to_owned()).spawn(run)?;
        Ok(Self { batches: Some(batches), handed: 0, shared })
    }

    /// Hands a batch over; `false` if there is no room.
    ///
    /// # Errors
    /// That of the last write: the reader is gone.
    pub(crate) fn send(&mut self, batch: FrameBatch) -> io::Result<bool> {
        let Some(batches) = &self.batches else { return Ok(false) };
        let handed = self.handed + batch.rows;
        if handed - self.shared.written.load(Ordering::Acquire) > WAITING
            && self.shared.ended.get().is_none()
        {
            return Ok(false);
        }
        if batches.send(batch).is_ok() {
            self.handed = handed;
            return Ok(true);
        }
        self.batches = None;
        while self.shared.ended.get().is_none() {
            thread::yield_now();
        }
        self.result().map(|()| false)
    }

    /// Waits a little for what is on its way; how many rows have been written in all.
    pub(crate) fn finish(&mut self, patience: Duration) -> (u64, io::Result<()>) {
        self.batches = None;
        let deadline = Instant::now() + patience;
        while self.shared.ended.get().is_none() && Instant::now() < deadline {
            thread::sleep(Duration::from_millis(1));
        }
        (self.shared.written.load(Ordering::Acquire), self.result())
    }

    fn result(&self) -> io::Result<()> {
        match self.shared.ended.get() {
            Some(Err(error)) => Err(io::Error::new(error.kind(), error.to_string())),
            Some(Ok(())) | None => Ok(()),
        }
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
