//! A reader that is written to by a thread of its own, since a pipe or a disk may hold it up.

use std::io::{self, Write};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, OnceLock};
use std::thread;
use std::time::{Duration, Instant};

/// Rows that wait, at most: four seconds at 1 kHz.
const WAITING: usize = 4096;

/// Most bytes of one write.
const PIECE: usize = 1 << 16;

/// The end of the pipe that rows are put in.
#[derive(Debug)]
pub(crate) struct PipeReader {
    rows: Option<SyncSender<Vec<u8>>>,
    shared: Arc<Shared>,
}

#[derive(Debug, Default)]
struct Shared {
    /// Pieces that have been written.
    written: AtomicU64,
    /// How it has ended.
    ended: OnceLock<io::Result<()>>,
}

impl PipeReader {
    pub(crate) fn new(name: &str, out: impl Write + Send + 'static) -> io::Result<Self> {
        let (rows, receiver) = sync_channel(WAITING);
        let shared = Arc::new(Shared::default());
        let of_thread = Arc::clone(&shared);
        let run = move || {
            let result = write_all(out, &receiver, &of_thread.written);
            let _ = of_thread.ended.set(result);
        };
        thread::Builder::new().name(name.to_owned()).spawn(run)?;
        Ok(Self { rows: Some(rows), shared })
    }

    /// Hands a piece over; `false` if there is no room.
    ///
    /// # Errors
    /// That of the last write: the reader is gone.
    pub(crate) fn send(&mut self, piece: Vec<u8>) -> io::Result<bool> {
        let Some(rows) = &self.rows else { return Ok(false) };
        match rows.try_send(piece) {
            Ok(()) => Ok(true),
            Err(TrySendError::Full(_)) => Ok(false),
            Err(TrySendError::Disconnected(_)) => {
                self.rows = None;
                while self.shared.ended.get().is_none() {
                    thread::yield_now();
                }
                self.result().map(|()| false)
            }
        }
    }

    /// Waits a little for what is on its way; how many pieces have been written in all.
    pub(crate) fn finish(&mut self, patience: Duration) -> (u64, io::Result<()>) {
        self.rows = None;
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

fn write_all(mut out: impl Write, rows: &Receiver<Vec<u8>>, written: &AtomicU64) -> io::Result<()> {
    while let Ok(mut bytes) = rows.recv() {
        let mut pieces = 1;
        while bytes.len() < PIECE
            && let Ok(next) = rows.try_recv()
        {
            bytes.extend_from_slice(&next);
            pieces += 1;
        }
        out.write_all(&bytes)?;
        out.flush()?;
        written.fetch_add(pieces, Ordering::Release);
    }
    Ok(())
}
