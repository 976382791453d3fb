//! Works on the pieces of something on several threads and hands the results over in order.
//!
//! The caller's thread works too. Which thread gets which piece is left to chance; the pieces and
//! the order of the results are not.

use std::collections::BTreeMap;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError, TryLockError};

use crate::cores::Cores;

/// What is cut into pieces, one after another.
pub trait Pieces: Send {
    /// A piece, or room for one that is used again.
    type Piece: Default + Send;
    /// Why there is no next piece.
    type Error: Send;

    /// Whether all pieces have been handed out, or cannot be.
    fn ended(&self) -> bool;

    /// Puts the next piece into `piece`; `false` if there are no more.
    fn next(&mut self, piece: &mut Self::Piece) -> Result<bool, Self::Error>;
}

/// How many finished pieces per thread may wait for an earlier one: bounds the memory.
const WAITING_PER_THREAD: usize = 4;

/// Passes every piece of `pieces` to `work`, which may take it apart, and the results to `fold`, in order.
///
/// The first piece is worked on before the other threads begin, so that `work` can learn from it.
pub fn run<P: Pieces, T: Send, E>(
    pieces: &mut P,
    threads: usize,
    work: impl Fn(&mut P::Piece) -> T + Sync,
    failed: impl Fn(P::Error) -> E,
    mut fold: impl FnMut(T) -> Result<(), E>,
) -> Result<(), E> {
    let mut piece = P::Piece::default();
    if !pieces.next(&mut piece).map_err(&failed)? {
        return Ok(());
    }
    fold(work(&mut piece))?;
    if threads <= 1 || pieces.ended() {
        while pieces.next(&mut piece).map_err(&failed)? {
            fold(work(&mut piece))?;
        }
        return Ok(());
    }
    let cores = Cores::for_each_of(threads);
    let _stay = cores.as_ref().and_then(|cores| cores.stay(0));
    let queue = Queue::new(pieces, WAITING_PER_THREAD * threads);
    std::thread::scope(|scope| {
        let _stop = StopOnPanic(&queue);
        for thread in 1..threads {
            let (queue, work, cores) = (&queue, &work, cores.as_ref());
            scope.spawn(move || {
                let _stay = cores.and_then(|cores| cores.stay(thread));
                let _stop = StopOnPanic(queue);
                let mut piece = P::Piece::default();
                while queue.wait_for_room() && queue.work_on_next(&mut piece, work) {}
            });
        }
        // New threads may have been put on this core: let them move to their own.
        std::thread::yield_now();
        let outcome = loop {
            match queue.take_finished() {
                Finished::Result(Ok(value)) => {
                    if let Err(error) = fold(value) {
                        break Err(error);
                    }
                }
                Finished::Result(Err(error)) => break Err(failed(error)),
                Finished::NotYet { all_taken: false } => {
                    queue.work_on_next(&mut piece, &work);
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

struct Queue<'a, P: Pieces, T> {
    source: Mutex<Source<'a, P>>,
    state: Mutex<State<T, P::Error>>,
    changed: Condvar,
    room: usize,
}

/// What pieces are taken from, counted.
struct Source<'a, P> {
    pieces: &'a mut P,
    next: usize,
}

struct State<T, E> {
    finished: BTreeMap<usize, Result<T, E>>,
    /// The next piece to hand over.
    next: usize,
    /// How many pieces there are, once that is known.
    pieces: Option<usize>,
    stopped: bool,
    /// How many threads wait for a change.
    waiting: usize,
}

enum Finished<T, E> {
    Result(Result<T, E>),
    NotYet { all_taken: bool },
    All,
}

impl<'a, P: Pieces, T> Queue<'a, P, T> {
    fn new(pieces: &'a mut P, room: usize) -> Self {
        let state =
            State { finished: BTreeMap::new(), next: 0, pieces: None, stopped: false, waiting: 0 };
        Self {
            source: Mutex::new(Source { pieces, next: 0 }),
            state: Mutex::new(state),
            changed: Condvar::new(),
            room,
        }
    }

    fn state(&self) -> MutexGuard<'_, State<T, P::Error>> {
        // A poisoned lock means that a thread has panicked; the scope passes the panic on.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes a piece, works on it, files the result; `false` if there is none.
    fn work_on_next(&self, piece: &mut P::Piece, work: impl Fn(&mut P::Piece) -> T) -> bool {
        let mut source = lock_soon(&self.source);
        let index = source.next;
        source.next += 1;
        let next = source.pieces.next(piece);
        if source.pieces.ended() || !matches!(next, Ok(true)) {
            let pieces = if matches!(next, Ok(false)) { index } else { index + 1 };
            self.change(|state| *state.pieces.get_or_insert(pieces));
        }
        drop(source);
        let result = match next {
            Ok(false) => return false,
            Ok(true) => Ok(work(piece)),
            Err(error) => Err(error),
        };
        let more = result.is_ok();
        self.change(|state| state.finished.insert(index, result));
        more
    }

    /// Waits until not too many results wait; `false` when there is nothing left to do.
    fn wait_for_room(&self) -> bool {
        let mut state = self.state();
        while !state.stopped && state.pieces.is_none() && state.finished.len() >= self.room {
            state = self.wait(state);
        }
        !state.stopped && state.pieces.is_none()
    }

    fn take_finished(&self) -> Finished<T, P::Error> {
        self.change(|state| {
            let next = state.next;
            match state.finished.remove(&next) {
                Some(result) => {
                    state.next += 1;
                    Finished::Result(result)
                }
                None if state.pieces.is_some_and(|pieces| next >= pieces) => Finished::All,
                None => Finished::NotYet { all_taken: state.pieces.is_some() },
            }
        })
    }

    /// Waits for the next result in order; `false` if it will never come.
    fn wait_for_finished(&self) -> bool {
        let mut state = self.state();
        while !state.stopped && !state.finished.contains_key(&state.next) {
            state = self.wait(state);
        }
        !state.stopped
    }

    fn stop(&self) {
        self.change(|state| state.stopped = true);
    }

    /// Changes the state and tells those who wait for that, if there are any.
    fn change<R>(&self, change: impl FnOnce(&mut State<T, P::Error>) -> R) -> R {
        let mut state = self.state();
        let result = change(&mut state);
        let waiting = state.waiting;
        drop(state);
        if waiting > 0 {
            self.changed.notify_all();
        }
        result
    }

    /// Waits for a change.
    fn wait<'s>(
        &self,
        mut state: MutexGuard<'s, State<T, P::Error>>,
    ) -> MutexGuard<'s, State<T, P::Error>> {
        state.waiting += 1;
        let mut state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        state.waiting -= 1;
        state
    }
}

/// Locks without going to sleep, if that is possible soon: to be woken takes longer than to read a
/// piece.
fn lock_soon<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    /// Some tens of microseconds.
    const ATTEMPTS: usize = 1000;
    for _ in 0..ATTEMPTS {
        match mutex.try_lock() {
            Ok(guard) => return guard,
            Err(TryLockError::Poisoned(error)) => return error.into_inner(),
            Err(TryLockError::WouldBlock) => std::hint::spin_loop(),
        }
    }
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Lets the other threads go when this one panics, or they would wait for its result for ever.
struct StopOnPanic<'a, 'b, P: Pieces, T>(&'a Queue<'b, P, T>);

impl<P: Pieces, T> Drop for StopOnPanic<'_, '_, P, T> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.0.stop();
        }
    }
}
