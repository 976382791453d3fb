//! Works on the pieces of a file on several threads and hands the results over in file order.
//!
//! The caller's thread works too. Which thread gets which piece is left to chance; the pieces and
//! the order of the results are not.

use std::collections::BTreeMap;
use std::io::Read;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

use super::chunk::{Chunk, ChunkError, Chunker};

/// How many finished pieces per thread may wait for an earlier one: bounds the memory.
const WAITING_PER_THREAD: usize = 4;

/// Passes every piece of `chunker` to `work` and the results to `fold`, in order.
pub(super) fn run<R: Read + Send, T: Send, E>(
    chunker: &mut Chunker<R>,
    threads: usize,
    work: impl Fn(&Chunk) -> T + Sync,
    failed: impl Fn(ChunkError) -> E,
    mut fold: impl FnMut(T) -> Result<(), E>,
) -> Result<(), E> {
    let mut chunk = Chunk::default();
    if !chunker.next(&mut chunk).map_err(&failed)? {
        return Ok(());
    }
    fold(work(&chunk))?;
    if threads <= 1 || chunker.ended() {
        while chunker.next(&mut chunk).map_err(&failed)? {
            fold(work(&chunk))?;
        }
        return Ok(());
    }
    let first = chunk.index + 1;
    let queue = Queue::new(chunker, WAITING_PER_THREAD * threads, first);
    std::thread::scope(|scope| {
        for _ in 1..threads {
            scope.spawn(|| {
                let _stop = StopOnPanic(&queue);
                let mut chunk = Chunk::default();
                while queue.wait_for_room() && queue.work_on_next(&mut chunk, &work) {}
            });
        }
        let _stop = StopOnPanic(&queue);
        let outcome = loop {
            match queue.take_finished() {
                Finished::Result(Ok(value)) => {
                    if let Err(error) = fold(value) {
                        break Err(error);
                    }
                }
                Finished::Result(Err(error)) => break Err(failed(error)),
                Finished::NotYet { all_taken: false } => {
                    queue.work_on_next(&mut chunk, &work);
                }
                Finished::NotYet { all_taken: true } => {
                    if !queue.wait_for_finished() {
                        break Ok(());
                    }
                }
                Finished::All => break Ok(()),
            }
        };
        queue.stop();
        outcome
    })
}

struct Queue<'a, R, T> {
    chunker: Mutex<&'a mut Chunker<R>>,
    state: Mutex<State<T>>,
    changed: Condvar,
    room: usize,
}

struct State<T> {
    finished: BTreeMap<usize, Result<T, ChunkError>>,
    /// The next piece to hand over.
    next: usize,
    /// How many pieces there are, once that is known.
    pieces: Option<usize>,
    stopped: bool,
}

enum Finished<T> {
    Result(Result<T, ChunkError>),
    NotYet { all_taken: bool },
    All,
}

impl<'a, R: Read, T> Queue<'a, R, T> {
    fn new(chunker: &'a mut Chunker<R>, room: usize, next: usize) -> Self {
        let state = State { finished: BTreeMap::new(), next, pieces: None, stopped: false };
        Self {
            chunker: Mutex::new(chunker),
            state: Mutex::new(state),
            changed: Condvar::new(),
            room,
        }
    }

    fn state(&self) -> MutexGuard<'_, State<T>> {
        // A poisoned lock means that a thread has panicked; the scope passes the panic on.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes a piece, works on it, files the result; `false` if there is none.
    fn work_on_next(&self, chunk: &mut Chunk, work: impl Fn(&Chunk) -> T) -> bool {
        let mut chunker = self.chunker.lock().unwrap_or_else(PoisonError::into_inner);
        let index = chunker.next_index();
        let next = chunker.next(chunk);
        if chunker.ended() || !matches!(next, Ok(true)) {
            let pieces = if matches!(next, Ok(false)) { index } else { index + 1 };
            self.state().pieces.get_or_insert(pieces);
            self.changed.notify_all();
        }
        drop(chunker);
        let result = match next {
            Ok(false) => return false,
            Ok(true) => Ok(work(chunk)),
            Err(error) => Err(error),
        };
        let more = result.is_ok();
        self.state().finished.insert(index, result);
        self.changed.notify_all();
        more
    }

    /// Waits until not too many results wait; `false` when there is nothing left to do.
    fn wait_for_room(&self) -> bool {
        let mut state = self.state();
        while !state.stopped && state.pieces.is_none() && state.finished.len() >= self.room {
            state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
        !state.stopped && state.pieces.is_none()
    }

    fn take_finished(&self) -> Finished<T> {
        let mut state = self.state();
        let next = state.next;
        match state.finished.remove(&next) {
            Some(result) => {
                state.next += 1;
                self.changed.notify_all();
                Finished::Result(result)
            }
            None if state.pieces.is_some_and(|pieces| next >= pieces) => Finished::All,
            None => Finished::NotYet { all_taken: state.pieces.is_some() },
        }
    }

    /// Waits for the next result in order; `false` if it will never come.
    fn wait_for_finished(&self) -> bool {
        let mut state = self.state();
        while !state.stopped && !state.finished.contains_key(&state.next) {
            state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
        !state.stopped
    }

    fn stop(&self) {
        self.state().stopped = true;
        self.changed.notify_all();
    }
}

/// Lets the other threads go when this one panics, or they would wait for its result for ever.
struct StopOnPanic<'a, 'b, R: Read, T>(&'a Queue<'b, R, T>);

impl<R: Read, T> Drop for StopOnPanic<'_, '_, R, T> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.0.stop();
        }
    }
}
