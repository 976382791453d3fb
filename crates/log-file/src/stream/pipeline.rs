//! Processes a sequence of pieces on several threads and passes on the results in order.
//!
//! ```text
//! pieces ─▶ workers ─▶ results with their numbers ─▶ caller: fold, in order
//!              ▲                                              │
//!              └────────── room for another result ───────────┘
//! ```
//!
//! `init` makes a state for every thread, which is returned at the end. Workers can sum order-independent results in
//! their state without locks. The assignment of pieces to threads is random; the pieces and the order of results are
//! not.

use shell_data::lock::lock;
use std::collections::VecDeque;
use std::convert::Infallible;
use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::Mutex;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::ScopedJoinHandle;

pub trait Pieces: Send {
    /// A piece, or memory that is reused for one.
    type Piece: Default + Send;
    type Error: Send;

    /// Returns true if `next` will return no more pieces.
    fn ended(&self) -> bool;

    /// Reads the next piece into `piece`; `false` if there are no more.
    ///
    /// # Errors
    /// An error if the next piece cannot be read; there are no more pieces after it.
    fn next(&mut self, piece: &mut Self::Piece) -> Result<bool, Self::Error>;
}

impl Pieces for Range<usize> {
    type Piece = usize;
    type Error = Infallible;

    fn ended(&self) -> bool {
        self.is_empty()
    }

    fn next(&mut self, piece: &mut usize) -> Result<bool, Infallible> {
        Ok(Iterator::next(self).map(|number| *piece = number).is_some())
    }
}

/// Pieces per thread in progress or waiting for an earlier one; limits the memory.
const WAITING_PER_THREAD: usize = 4;

/// Passes every piece to `work` and the results to `fold`, in the order of the pieces.
///
/// `work` may change the piece, whose memory is reused, and its thread's state. Returns the states of all threads,
/// beginning with that of the first piece.
///
/// ```
/// use std::convert::Infallible;
///
/// use log_file::pipeline::run;
///
/// let mut squares = Vec::new();
/// let work = |sum: &mut usize, number: &mut usize| {
///     *sum += *number;
///     *number * *number
/// };
/// let fold = |square| {
///     squares.push(square);
///     Ok::<_, Infallible>(())
/// };
/// let Ok(sums) = run(&mut (0..5), 2, || 0, work, fold);
/// assert_eq!(squares, [0, 1, 4, 9, 16]);
/// assert_eq!(sums.iter().sum::<usize>(), 10);
/// ```
///
/// # Errors
/// The first error in the order of the pieces: of `pieces` or of `fold`.
pub fn run<P: Pieces, S: Send, T: Send, E: From<P::Error>>(
    pieces: &mut P,
    threads: usize,
    init: impl Fn() -> S + Sync,
    work: impl Fn(&mut S, &mut P::Piece) -> T + Sync,
    mut fold: impl FnMut(T) -> Result<(), E>,
) -> Result<Vec<S>, E> {
    let (mut state, mut piece) = (init(), P::Piece::default());
    loop {
        if !pieces.next(&mut piece)? {
            return Ok(vec![state]);
        }
        fold(work(&mut state, &mut piece))?;
        if threads > 1 && !pieces.ended() {
            break;
        }
    }
    let (room, wait_for_room) = channel();
    let source = &Mutex::new(PieceSource { pieces, next: 0, room: wait_for_room });
    for _ in 0..WAITING_PER_THREAD * threads {
        // The receiver still exists, so this cannot fail.
        let _ = room.send(());
    }
    let (results, finished) = channel();
    let states = std::iter::once(state).chain(std::iter::repeat_with(init)).take(threads);
    let work = &work;
    std::thread::scope(move |scope| {
        let worker = |state| {
            let results = results.clone();
            scope.spawn(move || work_on_pieces(source, state, work, &results))
        };
        let workers: Vec<_> = states.map(worker).collect();
        drop(results);
        let outcome = fold_in_order(finished, room, fold);
        let join = |worker: ScopedJoinHandle<'_, S>| {
            worker.join().unwrap_or_else(|panic| resume_unwind(panic))
        };
        let states = workers.into_iter().map(join).collect();
        outcome.map(|()| states)
    })
}

/// The pieces, the index of the next one, and a permit for each piece that may be started.
struct PieceSource<'a, P> {
    pieces: &'a mut P,
    next: usize,
    room: Receiver<()>,
}

/// The index of a piece, and its result, the error in its place, or a panic.
type Numbered<T, E> = (usize, std::thread::Result<Result<T, E>>);

/// Processes pieces until there are no more, or the receiver of the results is gone.
fn work_on_pieces<P: Pieces, S, T>(
    source: &Mutex<PieceSource<'_, P>>,
    mut state: S,
    work: impl Fn(&mut S, &mut P::Piece) -> T,
    results: &Sender<Numbered<T, P::Error>>,
) -> S {
    let mut piece = P::Piece::default();
    loop {
        let mut source = lock(source);
        if source.room.recv().is_err() {
            return state;
        }
        let next = match source.pieces.next(&mut piece) {
            Ok(false) => return state,
            Ok(true) => Ok(()),
            Err(error) => Err(error),
        };
        let number = source.next;
        source.next += 1;
        drop(source);
        let result = catch_unwind(AssertUnwindSafe(|| next.map(|()| work(&mut state, &mut piece))));
        let is_result = matches!(result, Ok(Ok(_)));
        if results.send((number, result)).is_err() || !is_result {
            return state;
        }
    }
}

/// Passes results to `fold` in order until the workers have ended; each result makes room for another piece. Both
/// channel ends are dropped on return or panic, so that no worker waits forever.
fn fold_in_order<T, E, F: From<E>>(
    finished: Receiver<Numbered<T, E>>,
    room: Sender<()>,
    mut fold: impl FnMut(T) -> Result<(), F>,
) -> Result<(), F> {
    // Results from index `next` on; missing ones are in progress.
    let (mut waiting, mut next) = (VecDeque::new(), 0);
    for (number, result) in finished {
        let position = number - next;
        if waiting.len() <= position {
            waiting.resize_with(position + 1, || None);
        }
        waiting[position] = Some(result);
        while let Some(result) = waiting.front_mut().and_then(Option::take) {
            waiting.pop_front();
            next += 1;
            let result = result.unwrap_or_else(|panic| resume_unwind(panic));
            fold(result?)?;
            // Sending fails only if all workers have ended, which need no room.
            let _ = room.send(());
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    /// Yields numbers from 0 to `end`, then optionally an error.
    struct Numbers {
        next: usize,
        end: usize,
        fails: bool,
    }

    impl Pieces for Numbers {
        type Piece = usize;
        type Error = String;

        fn ended(&self) -> bool {
            !self.fails && self.next >= self.end
        }

        fn next(&mut self, piece: &mut usize) -> Result<bool, String> {
            *piece = self.next;
            self.next += 1;
            match self.next > self.end && self.fails {
                true => Err("no more".to_owned()),
                false => Ok(*piece < self.end),
            }
        }
    }

    fn numbers(end: usize) -> Numbers {
        Numbers { next: 0, end, fails: false }
    }

    #[test]
    fn results_are_in_order_and_every_thread_has_a_state() {
        for (threads, end) in [(1, 0), (1, 50), (2, 1), (2, 50), (7, 500)] {
            let mut found = Vec::new();
            let work = |sum: &mut usize, number: &mut usize| {
                *sum += *number;
                // Some numbers take longer than others.
                let pause = if number.is_multiple_of(9) { 300 } else { 0 };
                std::thread::sleep(Duration::from_micros(pause));
                *number
            };
            let fold = |number| {
                found.push(number);
                Ok::<_, String>(())
            };
            let sums = run(&mut numbers(end), threads, || 0, work, fold).unwrap();
            assert!(found.iter().copied().eq(0..end), "{threads}, {end}");
            assert_eq!(sums.iter().sum::<usize>(), end * end.saturating_sub(1) / 2);
            assert_eq!(sums.len(), if end > 1 { threads } else { 1 });
        }
    }

    #[test]
    fn the_first_error_in_order_ends_it() {
        for threads in [1, 2, 5] {
            for (end, refused, expected) in [(40, 99, "no more"), (40, 20, "20"), (2000, 3, "3")] {
                let mut pieces = Numbers { fails: true, ..numbers(end) };
                let fold = |number: usize| match number == refused {
                    true => Err(number.to_string()),
                    false => Ok(()),
                };
                let work = |(): &mut (), number: &mut usize| *number;
                let error = run(&mut pieces, threads, || (), work, fold);
                assert_eq!(error.unwrap_err(), expected);
            }
        }
    }

    #[test]
    fn a_panic_of_any_thread_is_passed_on() {
        for in_fold in [false, true] {
            let work = |(): &mut (), number: &mut usize| {
                assert!(in_fold || *number != 30, "in work");
                *number
            };
            let fold = |number| {
                assert!(!in_fold || number != 30, "in fold");
                Ok::<_, String>(())
            };
            let whole = || run(&mut numbers(3000), 3, || (), work, fold);
            assert!(catch_unwind(AssertUnwindSafe(whole)).is_err());
        }
    }
}
