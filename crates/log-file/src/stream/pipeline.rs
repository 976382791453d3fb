//! Works on the pieces of a sequence on several threads and hands the results over in order.
//!
//! The caller's thread works too. Every thread has a state of its own, made by `init` and returned
//! at the end: what does not depend on order is summed there, without locks. Which thread gets
//! which piece is left to chance; the pieces and the order of the results are not.

use shell_data::lock::lock;
use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

/// A sequence that is cut into pieces, one after another.
pub trait Pieces: Send {
    /// A piece, or memory for one that is used again.
    type Piece: Default + Send;
    /// Why there is no next piece.
    type Error: Send;

    /// Whether `next` will return no more pieces.
    fn ended(&self) -> bool;

    /// Puts the next piece into `piece`; `false` if there are no more.
    ///
    /// # Errors
    /// Where the next piece cannot be read; there are none after it.
    fn next(&mut self, piece: &mut Self::Piece) -> Result<bool, Self::Error>;
}

/// How many finished pieces per thread may wait for an earlier one: bounds the memory.
const WAITING_PER_THREAD: usize = 4;

/// Passes every piece of `pieces` to `work` and the results to `fold`, in the order of the pieces.
///
/// `work` may change the piece, which is memory to be used again, and the state of its thread.
/// Returns the states of all threads, that of the caller first.
///
/// ```
/// use std::convert::Infallible;
///
/// use log_file::pipeline::{Pieces, run};
///
/// struct Numbers(std::ops::Range<u64>);
///
/// impl Pieces for Numbers {
///     type Piece = u64;
///     type Error = Infallible;
///
///     fn ended(&self) -> bool {
///         self.0.is_empty()
///     }
///
///     fn next(&mut self, piece: &mut u64) -> Result<bool, Infallible> {
///         Ok(self.0.next().map(|number| *piece = number).is_some())
///     }
/// }
///
/// let mut squares = Vec::new();
/// let work = |sum: &mut u64, number: &mut u64| {
///     *sum += *number;
///     *number * *number
/// };
/// let fold = |square| {
///     squares.push(square);
///     Ok::<_, Infallible>(())
/// };
/// let Ok(sums) = run(&mut Numbers(0..5), 2, || 0, work, |never| never, fold);
/// assert_eq!(squares, [0, 1, 4, 9, 16]);
/// assert_eq!(sums.iter().sum::<u64>(), 10);
/// ```
///
/// # Errors
/// The first error in the order of the pieces: of `pieces`, made one of `fold` by `failed`, or of
/// `fold`.
pub fn run<P: Pieces, S: Send, T: Send, E>(
    pieces: &mut P,
    threads: usize,
    init: impl Fn() -> S + Sync,
    work: impl Fn(&mut S, &mut P::Piece) -> T + Sync,
    failed: impl Fn(P::Error) -> E,
    mut fold: impl FnMut(T) -> Result<(), E>,
) -> Result<Vec<S>, E> {
    let (mut state, mut piece) = (init(), P::Piece::default());
    // Where there is but one piece, no thread is started.
    loop {
        if !pieces.next(&mut piece).map_err(&failed)? {
            return Ok(vec![state]);
        }
        fold(work(&mut state, &mut piece))?;
        if threads > 1 && !pieces.ended() {
            break;
        }
    }
    let queue = Queue::new(pieces, WAITING_PER_THREAD * threads);
    let (states, mut outcome) = (Mutex::new(Vec::new()), Ok(()));
    let worker = || {
        let _stop = StopOnPanic(&queue);
        let (mut state, mut piece) = (init(), P::Piece::default());
        while queue.wait_for_room() && queue.work_on_next(&mut state, &mut piece, &work) {}
        lock(&states).push(state);
    };
    let mut caller = || {
        let _stop = StopOnPanic(&queue);
        outcome = queue.work_and_fold(&mut state, &mut piece, &work, &failed, &mut fold);
        queue.stop();
    };
    on_threads(threads - 1, &worker, &mut caller);
    outcome?;
    let others = states.into_inner().unwrap_or_else(PoisonError::into_inner);
    Ok(std::iter::once(state).chain(others).collect())
}

/// Runs `worker` on so many threads and `caller` on this one, until all have returned. A panic of one of them is
/// passed on.
fn on_threads(workers: usize, worker: &(dyn Fn() + Sync), caller: &mut dyn FnMut()) {
    std::thread::scope(|scope| {
        let workers: Vec<_> = (0..workers).map(|_| scope.spawn(worker)).collect();
        caller();
        for worker in workers {
            if let Err(panic) = worker.join() {
                std::panic::resume_unwind(panic);
            }
        }
    });
}

struct Queue<'a, P: Pieces, T> {
    source: Mutex<PieceSource<'a, P>>,
    progress: Mutex<PipelineProgress<T, P::Error>>,
    changed: Condvar,
    /// How many results may wait.
    room: usize,
}

/// The pieces, and the number of the next one.
struct PieceSource<'a, P> {
    pieces: &'a mut P,
    next: usize,
}

struct PipelineProgress<T, E> {
    finished: InOrder<Result<T, E>>,
    /// The number of pieces, once it is known.
    pieces: Option<usize>,
    stopped: bool,
    /// The number of threads that wait for a change.
    waiting: usize,
}

/// Results that are handed over in order and come in any: those that are missing among them are in work.
///
/// Not a map: pipelines are compiled for each of their uses, and the code of so many maps was a twentieth of
/// the program.
struct InOrder<R> {
    /// From the next on.
    waiting: VecDeque<Option<R>>,
    /// The number of the next.
    next: usize,
    /// How many there are.
    count: usize,
}

impl<R> InOrder<R> {
    fn new() -> Self {
        Self { waiting: VecDeque::new(), next: 0, count: 0 }
    }

    /// Files the result of such a number, which has not been handed over.
    fn insert(&mut self, number: usize, result: R) {
        let position = number - self.next;
        while self.waiting.len() <= position {
            self.waiting.push_back(None);
        }
        self.waiting[position] = Some(result);
        self.count += 1;
    }

    fn has_next(&self) -> bool {
        matches!(self.waiting.front(), Some(Some(_)))
    }

    fn take_next(&mut self) -> Option<R> {
        let result = self.waiting.front_mut()?.take()?;
        self.waiting.pop_front();
        (self.next, self.count) = (self.next + 1, self.count - 1);
        Some(result)
    }
}

enum Finished<T, E> {
    Result(Result<T, E>),
    NotYet { all_taken: bool },
    All,
}

impl<'a, P: Pieces, T> Queue<'a, P, T> {
    fn new(pieces: &'a mut P, room: usize) -> Self {
        let progress =
            PipelineProgress { finished: InOrder::new(), pieces: None, stopped: false, waiting: 0 };
        Self {
            source: Mutex::new(PieceSource { pieces, next: 0 }),
            progress: Mutex::new(progress),
            changed: Condvar::new(),
            room,
        }
    }

    fn progress(&self) -> MutexGuard<'_, PipelineProgress<T, P::Error>> {
        lock(&self.progress)
    }

    /// The caller's part: hands over results in order and works on pieces in between.
    fn work_and_fold<S, E>(
        &self,
        state: &mut S,
        piece: &mut P::Piece,
        work: impl Fn(&mut S, &mut P::Piece) -> T,
        failed: impl Fn(P::Error) -> E,
        mut fold: impl FnMut(T) -> Result<(), E>,
    ) -> Result<(), E> {
        loop {
            match self.take_finished() {
                Finished::Result(result) => fold(result.map_err(&failed)?)?,
                Finished::NotYet { all_taken: false } => {
                    self.work_on_next(state, piece, &work);
                }
                Finished::NotYet { all_taken: true } if self.wait_for_finished() => {}
                Finished::NotYet { .. } | Finished::All => return Ok(()),
            }
        }
    }

    /// Takes a piece, works on it, files the result; `false` at the end of the stream.
    fn work_on_next<S>(
        &self,
        state: &mut S,
        piece: &mut P::Piece,
        work: impl Fn(&mut S, &mut P::Piece) -> T,
    ) -> bool {
        let mut source = lock(&self.source);
        let index = source.next;
        source.next += 1;
        let next = source.pieces.next(piece);
        if source.pieces.ended() || !matches!(next, Ok(true)) {
            let pieces = if matches!(next, Ok(false)) { index } else { index + 1 };
            self.change(|progress| *progress.pieces.get_or_insert(pieces));
        }
        drop(source);
        let result = match next {
            Ok(false) => return false,
            Ok(true) => Ok(work(state, piece)),
            Err(error) => Err(error),
        };
        let more = result.is_ok();
        self.change(|progress| progress.finished.insert(index, result));
        more
    }

    /// Waits until fewer than `room` results wait; `false` when there is nothing left to do.
    fn wait_for_room(&self) -> bool {
        let mut progress = self.progress();
        while !progress.stopped && progress.pieces.is_none() && progress.finished.count >= self.room
        {
            progress = self.wait(progress);
        }
        !progress.stopped && progress.pieces.is_none()
    }

    fn take_finished(&self) -> Finished<T, P::Error> {
        self.change(|progress| {
            let next = progress.finished.next;
            match progress.finished.take_next() {
                Some(result) => Finished::Result(result),
                None if progress.pieces.is_some_and(|pieces| next >= pieces) => Finished::All,
                None => Finished::NotYet { all_taken: progress.pieces.is_some() },
            }
        })
    }

    /// Waits for the next result in order; `false` if it will never come.
    fn wait_for_finished(&self) -> bool {
        let mut progress = self.progress();
        while !progress.stopped && !progress.finished.has_next() {
            progress = self.wait(progress);
        }
        !progress.stopped
    }

    fn stop(&self) {
        self.change(|progress| progress.stopped = true);
    }

    /// Changes the progress and wakes the threads that wait for that, if there are any.
    fn change<R>(&self, change: impl FnOnce(&mut PipelineProgress<T, P::Error>) -> R) -> R {
        let mut progress = self.progress();
        let result = change(&mut progress);
        let waiting = progress.waiting;
        drop(progress);
        if waiting > 0 {
            self.changed.notify_all();
        }
        result
    }

    /// Waits for a change.
    fn wait<'s>(
        &self,
        mut progress: MutexGuard<'s, PipelineProgress<T, P::Error>>,
    ) -> MutexGuard<'s, PipelineProgress<T, P::Error>> {
        progress.waiting += 1;
        let mut progress = self.changed.wait(progress).unwrap_or_else(PoisonError::into_inner);
        progress.waiting -= 1;
        progress
    }
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
