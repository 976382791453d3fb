//! The parts of a table made into text on several threads, and handed out in order.
//!
//! ```text
//! thread of part 0 ─▶ pieces of text ─┐
//! thread of part 1 ─▶ pieces of text ─┴▶ one part after the other
//! ```
//!
//! As many parts are read at once as there are threads. One waits while as many of its pieces wait as there is room
//! for, so memory does not grow with the parts.

use std::collections::VecDeque;
use std::io;
use std::ops::Range;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;

use super::write_rows;
use crate::budget::Unpacked;
use crate::format::{RowBatch, RowSource};
use crate::kind::TableError;

/// How many pieces of text may wait in all; one takes about half a megabyte.
const WAITING_PIECES: usize = 48;

/// The text of a part, piece by piece, and the thread that makes it.
type PartReader = (Receiver<Vec<u8>>, JoinHandle<Result<(), TableError>>);

/// The text of all parts, piece by piece. Threads are started when the first piece is asked for.
pub(super) struct TextOfParts {
    rows: Arc<dyn RowSource>,
    threads: usize,
    /// Of all parts.
    unpacked: Unpacked,
    /// The parts that have not been begun.
    next: Range<usize>,
    /// Those of the parts that are read, in their order.
    readers: VecDeque<PartReader>,
}

impl TextOfParts {
    pub(super) fn new(rows: Arc<dyn RowSource>, threads: usize) -> Self {
        let (unpacked, next, readers) = (Unpacked::default(), 0..rows.parts(), VecDeque::new());
        Self { rows, threads, unpacked, next, readers }
    }

    /// Puts the next piece into `text`; `false` if there are no more.
    pub(super) fn next(&mut self, text: &mut Vec<u8>) -> Result<bool, TableError> {
        loop {
            while self.readers.len() < self.threads
                && let Some(part) = self.next.next()
            {
                self.start(part)?;
            }
            let Some((pieces, thread)) = self.readers.pop_front() else { return Ok(false) };
            if let Ok(piece) = pieces.recv() {
                *text = piece;
                self.readers.push_front((pieces, thread));
                return Ok(true);
            }
            // The part has ended.
            let panicked = |_| io::Error::other("a thread that read the table has panicked");
            thread.join().map_err(panicked)??;
        }
    }

    fn start(&mut self, part: usize) -> io::Result<()> {
        let (pieces, received) = sync_channel((WAITING_PIECES / self.threads).max(1));
        let (rows, unpacked) = (Arc::clone(&self.rows), self.unpacked.clone());
        let thread = std::thread::Builder::new().name("table part".to_owned());
        let thread = thread.spawn(move || send_part(rows, part, unpacked, &pieces))?;
        self.readers.push_back((received, thread));
        Ok(())
    }
}

impl Drop for TextOfParts {
    fn drop(&mut self) {
        for (pieces, thread) in self.readers.drain(..) {
            // A thread ends when nobody takes its text, and nobody asks any more how.
            drop(pieces);
            let _ = thread.join();
        }
    }
}

/// Sends the text of a part until nobody wants more.
fn send_part(
    rows: Arc<dyn RowSource>,
    part: usize,
    unpacked: Unpacked,
    pieces: &SyncSender<Vec<u8>>,
) -> Result<(), TableError> {
    let mut rows = rows.rows(part..part + 1, unpacked)?;
    let mut batch = RowBatch::new();
    while rows(&mut batch)? {
        let mut text = Vec::new();
        write_rows(&batch, &mut text);
        if pieces.send(text).is_err() {
            break;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::io::Read;
    use std::ops::Range;
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;
    use crate::format::{Cell, RowStream};
    use crate::kind::FileKind;
    use crate::text::TextStream;

    /// Parts of so many batches of a thousand rows each; the last one is damaged, if that is asked.
    #[derive(Debug)]
    struct Numbers {
        batches: Vec<usize>,
        is_damaged: bool,
        begun: Arc<AtomicUsize>,
    }

    impl RowSource for Numbers {
        fn parts(&self) -> usize {
            self.batches.len()
        }

        fn rows(
            self: Arc<Self>,
            Range { start: part, .. }: Range<usize>,
            _: Unpacked,
        ) -> Result<RowStream, TableError> {
            self.begun.fetch_add(1, Ordering::Relaxed);
            let mut batches = 0..self.batches[part];
            Ok(Box::new(move |batch| {
                let Some(number) = batches.next() else {
                    return match self.is_damaged && part + 1 == self.batches.len() {
                        true => Err(FileKind::Parquet.damaged("the last part")),
                        false => Ok(false),
                    };
                };
                let of = |row: usize| (part * 1_000_000 + number * 1000 + row) as f64 + 0.5;
                let column: Vec<Cell> = (0..1000).map(|row| Cell::Real(of(row))).collect();
                // Wide, so that little waits at a time.
                batch.clear();
                batch.resize(40, column);
                Ok(true)
            }))
        }
    }

    fn stream(numbers: Numbers, threads: usize) -> impl Read {
        let mut parts = TextOfParts::new(Arc::new(numbers), threads);
        TextStream::new(Vec::new(), move |text| Ok(parts.next(text)?))
    }

    fn text(numbers: Numbers, threads: usize) -> (Vec<u8>, Option<String>) {
        let mut text = Vec::new();
        let mut stream = stream(numbers, threads);
        let error = stream.read_to_end(&mut text).err().map(|error| error.to_string());
        (text, error)
    }

    #[test]
    fn parts_are_handed_out_in_order_whatever_their_lengths_and_the_number_of_threads() {
        let numbers = |is_damaged| {
            let begun = Arc::default();
            // The second part alone is more than may wait.
            Numbers { batches: vec![3, 90, 0, 1, 7, 0], is_damaged, begun }
        };
        let (one, none) = text(numbers(false), 1);
        assert!(one.starts_with(b"0.5,0.5,") && none.is_none());
        assert_eq!(one.iter().filter(|&&byte| byte == b'\n').count(), 101_000);
        for threads in [2, 3, 16] {
            assert!(text(numbers(false), threads) == (one.clone(), None), "{threads}");
            let (damaged, error) = text(numbers(true), threads);
            assert!(damaged == one, "{threads}");
            assert!(error.unwrap().contains("the last part"), "{threads}");
        }
    }

    #[test]
    fn what_is_not_wanted_ends_the_threads() {
        let begun = Arc::new(AtomicUsize::new(0));
        let numbers =
            Numbers { batches: vec![90; 9], is_damaged: false, begun: Arc::clone(&begun) };
        let mut stream = stream(numbers, 3);
        assert_eq!(begun.load(Ordering::Relaxed), 0);
        stream.read_exact(&mut [0; 100]).unwrap();
        drop(stream);
        assert!((1..=3).contains(&begun.load(Ordering::Relaxed)));
        // No thread holds the parts any more.
        assert_eq!(Arc::strong_count(&begun), 1);
    }
}
