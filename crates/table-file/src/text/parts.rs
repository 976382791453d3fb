//! The parts of a table made into text on several threads, each part by one of them, and handed out in order.
//!
//! ```text
//! part 0 ─▶ thread ─▶ text, text, … ─┐
//! part 1 ─▶ thread ─▶ text, text, … ─┴▶ one after the other
//! ```
//!
//! What is made ahead of its turn is bounded, so memory does not grow with the parts: a thread with a later
//! part waits when there is enough of it, and one with the part whose turn it is does so after a few pieces.

use std::collections::VecDeque;
use std::io;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;

use super::write_rows;
use crate::error::TableError;
use crate::rows::{Batch, Parts};

/// How many bytes of text may wait in all, for their turn or to be taken.
const AHEAD: usize = 24 << 20;

/// How many pieces of the part whose turn it is may wait.
const PIECES: usize = 2;

/// The text of all parts, piece by piece. Threads are started when the first piece is asked for.
pub(super) struct TextOfParts {
    shared: Arc<Shared>,
    to_start: usize,
    threads: Vec<JoinHandle<()>>,
}

struct Shared {
    parts: Box<dyn Parts>,
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Default)]
struct State {
    /// The part whose text is taken.
    current: usize,
    /// What there is of it and of those after it that have been begun.
    begun: VecDeque<Part>,
    /// The bytes that wait.
    waiting: usize,
    /// Nobody wants more, or a thread has panicked.
    stopped: bool,
}

/// A part that is being made into text.
#[derive(Default)]
struct Part {
    pieces: VecDeque<Vec<u8>>,
    /// How it ended, if it has.
    end: Option<Result<(), TableError>>,
}

impl TextOfParts {
    pub(super) fn new(parts: Box<dyn Parts>, threads: usize) -> Self {
        let to_start = threads.min(parts.count());
        let shared = Shared { parts, state: Mutex::default(), changed: Condvar::new() };
        Self { shared: Arc::new(shared), to_start, threads: Vec::new() }
    }

    /// Puts the next piece into `text`; `false` if there are no more.
    pub(super) fn next(&mut self, text: &mut Vec<u8>) -> Result<bool, TableError> {
        for _ in 0..std::mem::take(&mut self.to_start) {
            let shared = Arc::clone(&self.shared);
            let thread = std::thread::Builder::new().name("table part".to_owned());
            self.threads.push(thread.spawn(move || shared.work())?);
        }
        let mut state = self.shared.lock();
        while state.current < self.shared.parts.count() {
            let Some(part) = state.begun.front_mut() else {
                state = self.shared.wait(state)?;
                continue;
            };
            if let Some(piece) = part.pieces.pop_front() {
                state.waiting -= piece.len();
                *text = piece;
                self.shared.changed.notify_all();
                return Ok(true);
            }
            match part.end.take() {
                Some(end) => {
                    state.begun.pop_front();
                    state.current += 1;
                    self.shared.changed.notify_all();
                    end?;
                }
                None => state = self.shared.wait(state)?,
            }
        }
        Ok(false)
    }
}

impl Drop for TextOfParts {
    fn drop(&mut self) {
        self.shared.stop();
        for thread in self.threads.drain(..) {
            // A panic has been told where the text was asked for.
            let _ = thread.join();
        }
    }
}

impl Shared {
    /// Makes text of one part after another, those that no thread has begun.
    fn work(&self) {
        let _stop = StopOnPanic(self);
        while let Some(part) = self.begin() {
            let end = self.write(part);
            let mut state = self.lock();
            if state.stopped {
                return;
            }
            state.part(part).end = Some(end);
            self.changed.notify_all();
        }
    }

    /// The next part that no thread has begun.
    fn begin(&self) -> Option<usize> {
        let mut state = self.lock();
        let next = state.current + state.begun.len();
        if state.stopped || next >= self.parts.count() {
            return None;
        }
        state.begun.push_back(Part::default());
        Some(next)
    }

    fn write(&self, part: usize) -> Result<(), TableError> {
        let (mut rows, mut batch) = (self.parts.rows(part)?, Batch::new());
        while rows.next(&mut batch)? {
            let mut text = Vec::new();
            write_rows(&batch, &mut text);
            let mut state = self.lock();
            while !state.stopped && !state.has_room(part) {
                state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
            }
            if state.stopped {
                break;
            }
            state.waiting += text.len();
            state.part(part).pieces.push_back(text);
            self.changed.notify_all();
        }
        Ok(())
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        // Nothing is left half done where a thread may panic.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits for a change.
    fn wait<'a>(&self, state: MutexGuard<'a, State>) -> Result<MutexGuard<'a, State>, TableError> {
        if state.stopped {
            return Err(io::Error::other("a thread that read the table has panicked").into());
        }
        Ok(self.changed.wait(state).unwrap_or_else(PoisonError::into_inner))
    }

    fn stop(&self) {
        self.lock().stopped = true;
        self.changed.notify_all();
    }
}

impl State {
    /// A part that has been begun and not been taken to its end.
    fn part(&mut self, part: usize) -> &mut Part {
        let place = part - self.current;
        &mut self.begun[place]
    }

    /// Whether another piece of a part may wait: of the one whose turn it is always some.
    fn has_room(&mut self, part: usize) -> bool {
        match part == self.current {
            true => self.part(part).pieces.len() < PIECES || self.waiting < AHEAD,
            false => self.waiting < AHEAD,
        }
    }
}

/// Lets nobody wait for a thread that has panicked.
struct StopOnPanic<'a>(&'a Shared);

impl Drop for StopOnPanic<'_> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.0.stop();
        }
    }
}

#[cfg(test)]
mod tests {
    use std::io::Read;
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;
    use crate::kind::FileKind;
    use crate::rows::{Cell, Rows};
    use crate::text::TableText;

    /// Parts of so many batches of a thousand rows each; the last one is damaged, if that is asked.
    #[derive(Debug)]
    struct Numbers {
        batches: Vec<usize>,
        is_damaged: bool,
        begun: Arc<AtomicUsize>,
    }

    struct Batches {
        part: usize,
        next: usize,
        end: usize,
        is_damaged: bool,
    }

    impl Parts for Numbers {
        fn count(&self) -> usize {
            self.batches.len()
        }

        fn rows(&self, part: usize) -> Result<Box<dyn Rows>, TableError> {
            self.begun.fetch_add(1, Ordering::Relaxed);
            let is_damaged = self.is_damaged && part + 1 == self.batches.len();
            Ok(Box::new(Batches { part, next: 0, end: self.batches[part], is_damaged }))
        }
    }

    impl Rows for Batches {
        fn next(&mut self, batch: &mut Batch) -> Result<bool, TableError> {
            if self.next == self.end {
                return match self.is_damaged {
                    true => Err(FileKind::Parquet.damaged("the last part")),
                    false => Ok(false),
                };
            }
            let of = |row: usize| (self.part * 1_000_000 + self.next * 1000 + row) as f64 + 0.5;
            let column: Vec<Cell> = (0..1000).map(|row| Cell::Real(of(row))).collect();
            // Wide, so that little waits at a time.
            batch.clear();
            batch.resize(40, column);
            self.next += 1;
            Ok(true)
        }
    }

    fn text(numbers: Numbers, threads: usize) -> (Vec<u8>, Option<String>) {
        let mut text = Vec::new();
        let mut stream = TableText::of_parts(Vec::new(), Box::new(numbers), threads);
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
        let mut stream = TableText::of_parts(Vec::new(), Box::new(numbers), 3);
        assert_eq!(begun.load(Ordering::Relaxed), 0);
        stream.read_exact(&mut [0; 100]).unwrap();
        drop(stream);
        assert!((1..=3).contains(&begun.load(Ordering::Relaxed)));
        // No thread holds the parts any more.
        assert_eq!(Arc::strong_count(&begun), 1);
    }
}
