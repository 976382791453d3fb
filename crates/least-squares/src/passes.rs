//! Passes over rows in memory, with the same bits for any number of threads. Threads take one block after another. The
//! thread that completes the next block in order folds all results that are ready, in block order. If the order does
//! not matter ([`Pass::ANY_ORDER`]), each thread sums its own blocks, and these sums are merged at the end.

use std::collections::VecDeque;
use std::panic::resume_unwind;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{LazyLock, Mutex, PoisonError};

use crate::error::FitError;
use shell_data::block::Block;
use shell_data::dataset::Dataset;
use shell_data::lock::lock;

#[derive(Clone, Copy, Default)]
pub struct Workers<'a> {
    /// Number of threads; 0 for one per core. Results do not depend on it.
    pub threads: usize,
    /// Called with the number of rows that a pass has just handled; returns false to cancel.
    pub watch: Option<&'a (dyn Fn(usize) -> bool + Sync)>,
    /// Called with the number of completed folds and of all folds, for physics models or splits of a replay.
    pub folds: Option<&'a (dyn Fn(usize, usize) + Sync)>,
    /// Called at the start of each stage of a fit, with its name.
    pub stages: Option<&'a (dyn Fn(&'static str) + Sync)>,
}

impl Workers<'_> {
    /// Workers on `threads` threads; 0 for one per core.
    pub fn new(threads: usize) -> Self {
        Self { threads, ..Self::default() }
    }

    pub fn start(&self, stage: &'static str) {
        if let Some(told) = self.stages {
            told(stage);
        }
    }

    fn worth<'b>(self, blocks: impl Iterator<Item = &'b Block>) -> Self {
        let numbers = blocks.map(|block| block.rows * (block.readings.len() + 6)).sum::<usize>();
        let threads = if self.threads == 0 && numbers < WORTH_A_THREAD { 1 } else { self.threads };
        Self { threads, ..self }
    }

    pub const ONE: Self = Self { threads: 1, watch: None, folds: None, stages: None };
}

impl std::fmt::Debug for Workers<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Workers").field("threads", &self.threads).finish_non_exhaustive()
    }
}

/// Number of available cores, determined once, because the system reads several files for it.
static AVAILABLE_THREADS: LazyLock<usize> =
    LazyLock::new(|| std::thread::available_parallelism().map_or(1, usize::from));

/// Number of values that a thread handles in the time that it takes to start another thread.
const WORTH_A_THREAD: usize = 1 << 16;

/// Blocks that can be passed over repeatedly, always in the same order.
#[derive(Clone, Debug)]
pub struct Rows<'a> {
    blocks: Vec<&'a Block>,
    workers: Workers<'a>,
}

impl<'a> Rows<'a> {
    pub fn new(data: &'a Dataset, workers: Workers<'a>) -> Self {
        Self { blocks: data.blocks().map(|(_, block)| &*block.rows).collect(), workers }
    }

    pub fn from_blocks(blocks: impl IntoIterator<Item = &'a Block>, workers: Workers<'a>) -> Self {
        Self { blocks: blocks.into_iter().collect(), workers }
    }

    /// Reduces every block from `empty`, the result for zero rows, and merges the results, in block
    /// order if it matters.
    ///
    /// # Errors
    /// [`FitError`] if the pass rejects a block, or [`Workers::watch`] cancels it.
    pub fn reduce<P: Pass>(&self, empty: &P) -> Result<P, FitError> {
        let mut all = empty.clone();
        let work = |own: &mut Option<P>, run: &&[&Block]| {
            let mut of_run = (!P::ANY_ORDER).then(|| empty.clone());
            let partial = match &mut of_run {
                Some(partial) => partial,
                None => own.get_or_insert_with(|| empty.clone()),
            };
            run.iter().try_for_each(|block| partial.absorb(block))?;
            Ok(of_run)
        };
        let merge = |of_run: Option<P>| of_run.map_or(Ok(()), |partial| all.merge(partial));
        let runs = runs(&self.blocks, if P::ANY_ORDER { 1 } else { empty.rows_together() });
        let rows_of = |run: &&[&Block]| run.iter().map(|block| block.rows).sum();
        let workers = self.workers.worth(self.blocks.iter().copied());
        let own = on_threads(&runs, rows_of, workers, || None, work, merge)?;
        own.into_iter().flatten().try_for_each(|partial| all.merge(partial))?;
        Ok(all)
    }
}

/// Runs of consecutive blocks, each except the last with at least `rows` rows.
fn runs<'b>(blocks: &'b [&'b Block], rows: usize) -> Vec<&'b [&'b Block]> {
    let (mut runs, mut start, mut found) = (Vec::new(), 0, 0);
    for (at, block) in blocks.iter().enumerate() {
        found += block.rows;
        if found >= rows || at + 1 == blocks.len() {
            runs.push(&blocks[start..=at]);
            (start, found) = (at + 1, 0);
        }
    }
    runs
}

impl<'a> From<&'a [Block]> for Rows<'a> {
    fn from(blocks: &'a [Block]) -> Self {
        Self::from_blocks(blocks, Workers::ONE)
    }
}

impl<'a> From<&'a Block> for Rows<'a> {
    fn from(block: &'a Block) -> Self {
        Self::from(std::slice::from_ref(block))
    }
}

/// The result of a pass over rows.
pub trait Pass: Clone + Send + Sync {
    /// True if `merge` is commutative and associative, bit for bit: row order does not matter.
    const ANY_ORDER: bool = false;

    /// Number of rows to reduce together if the order matters: a merge may cost as much as adding that many.
    fn rows_together(&self) -> usize {
        1
    }

    /// Adds the rows of a block, on any thread.
    ///
    /// # Errors
    /// [`FitError`] if the solver cannot use these readings or wrenches; discard `self` then.
    fn absorb(&mut self, block: &Block) -> Result<(), FitError>;

    /// Adds the rows of `later`.
    ///
    /// # Errors
    /// [`FitError`] if the solver can use either, but not both together.
    fn merge(&mut self, later: Self) -> Result<(), FitError>;
}

/// Passes every item to `work` as [`on_threads`] does, but on one thread if there are few values. `rows_of` returns the
/// block of an item.
///
/// # Errors
/// The first error of `work` or `fold` in order; [`FitError::Interrupted`] by [`Workers::watch`].
pub fn each<I: Sync, S: Send, T: Send>(
    items: &[I],
    rows_of: impl Fn(&I) -> &Block + Sync,
    workers: Workers<'_>,
    init: impl Fn() -> S + Sync,
    work: impl Fn(&mut S, &I) -> Result<T, FitError> + Sync,
    fold: impl FnMut(T) -> Result<(), FitError> + Send,
) -> Result<Vec<S>, FitError> {
    let workers = workers.worth(items.iter().map(&rows_of));
    on_threads(items, |item| rows_of(item).rows, workers, init, work, fold)
}

/// Applies `work` to every item, on any thread. Returns the results in the order of the items.
///
/// # Errors
/// As [`each`].
pub fn map<I: Sync, T: Send>(
    items: &[I],
    workers: Workers<'_>,
    work: impl Fn(&I) -> Result<T, FitError> + Sync,
) -> Result<Vec<T>, FitError> {
    map_folds(items, Workers { folds: None, ..workers }, work)
}

/// [`map`] for folds that take seconds each: reports progress to [`Workers::folds`].
///
/// # Errors
/// As [`each`].
pub fn map_folds<I: Sync, T: Send>(
    folds: &[I],
    workers: Workers<'_>,
    work: impl Fn(&I) -> Result<T, FitError> + Sync,
) -> Result<Vec<T>, FitError> {
    let mut results = Vec::with_capacity(folds.len());
    let fold = |result| {
        results.push(result);
        if let Some(told) = workers.folds {
            told(results.len(), folds.len());
        }
        Ok(())
    };
    on_threads(folds, |_| 0, workers, || (), |(), fold| work(fold), fold)?;
    Ok(results)
}

/// Passes every item to `work`, on any thread, and the results to `fold`, in the order of the
/// items. Reports the rows of each to [`Workers::watch`]. Returns the states of the threads,
/// created by `init`.
pub fn on_threads<I: Sync, S: Send, T: Send>(
    items: &[I],
    rows_of: impl Fn(&I) -> usize + Sync,
    workers: Workers<'_>,
    init: impl Fn() -> S + Sync,
    work: impl Fn(&mut S, &I) -> Result<T, FitError> + Sync,
    fold: impl FnMut(T) -> Result<(), FitError> + Send,
) -> Result<Vec<S>, FitError> {
    let threads = match workers.threads {
        // A browser has no other threads. The constant condition removes the code that starts them.
        _ if cfg!(target_family = "wasm") => 1,
        0 => *AVAILABLE_THREADS,
        threads => threads,
    };
    let next = AtomicUsize::new(0);
    let folded =
        Mutex::new(OrderedFold { next: 0, waiting: VecDeque::new(), fold, outcome: Ok(()) });
    let worker = || {
        let mut state = init();
        loop {
            let position = next.fetch_add(1, Ordering::Relaxed);
            let Some(item) = items.get(position) else { return state };
            let result = work(&mut state, item).and_then(|value| {
                let goes_on = workers.watch.is_none_or(|watch| watch(rows_of(item)));
                if goes_on { Ok(value) } else { Err(FitError::Interrupted) }
            });
            // A thread that panics poisons the lock; its panic is propagated.
            if !lock(&folded).add(position, result) {
                return state;
            }
        }
    };
    let states = match threads.min(items.len()) {
        0 | 1 => vec![worker()],
        threads => std::thread::scope(|scope| {
            let others: Vec<_> = (1..threads).map(|_| scope.spawn(worker)).collect();
            let own = worker();
            let join = |other: std::thread::ScopedJoinHandle<'_, S>| {
                other.join().unwrap_or_else(|panic| resume_unwind(panic))
            };
            std::iter::once(own).chain(others.into_iter().map(join)).collect()
        }),
    };
    folded.into_inner().unwrap_or_else(PoisonError::into_inner).outcome?;
    Ok(states)
}

struct OrderedFold<T, F> {
    next: usize,
    /// `None` for results still missing.
    waiting: VecDeque<Option<Result<T, FitError>>>,
    fold: F,
    outcome: Result<(), FitError>,
}

impl<T, F: FnMut(T) -> Result<(), FitError>> OrderedFold<T, F> {
    /// Adds the result of the item at a position; `false` if no further results are needed.
    fn add(&mut self, position: usize, result: Result<T, FitError>) -> bool {
        let ahead = position - self.next;
        while self.waiting.len() <= ahead {
            self.waiting.push_back(None);
        }
        self.waiting[ahead] = Some(result);
        while self.outcome.is_ok()
            && let Some(result) = self.waiting.front_mut().and_then(Option::take)
        {
            self.waiting.pop_front();
            self.next += 1;
            self.outcome = result.and_then(&mut self.fold);
        }
        self.outcome.is_ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn blocks(count: usize) -> Vec<Block> {
        let block = |i: usize| {
            let rows = 900 + i % 7;
            let column = |c: usize| (0..rows).map(|row| (i * 31 + row * c) as f64).collect();
            let readings = (1..9).map(column).collect();
            Block { rows, readings, wrench: vec![vec![0.0; rows]; 6], ..Block::default() }
        };
        (0..count).map(block).collect()
    }

    #[test]
    fn results_are_folded_in_order_and_the_first_error_in_order_is_returned() {
        let blocks = blocks(200);
        for threads in [1, 2, 5] {
            let workers = Workers::new(threads);
            let mut rows = Vec::new();
            let fold = |of_block: usize| {
                rows.push(of_block);
                Ok(())
            };
            let count = |sum: &mut usize, block: &Block| {
                *sum += block.rows;
                Ok(block.rows)
            };
            let sums = each(&blocks, |block| block, workers, || 0, count, fold).unwrap();
            assert_eq!(rows, blocks.iter().map(|block| block.rows).collect::<Vec<_>>());
            assert_eq!(sums.iter().sum::<usize>(), rows.iter().sum::<usize>());
            let fail = |(): &mut (), block: &Block| match block.readings[0][0] as usize / 31 {
                i @ (57 | 58 | 120) => Err(FitError::Ridge(i as f64)),
                _ => Ok(()),
            };
            let failed = each(&blocks, |block| block, workers, || (), fail, Ok).unwrap_err();
            assert_eq!(failed, FitError::Ridge(57.0));
        }
    }

    #[test]
    fn progress_reports_every_row_and_can_cancel() {
        let blocks = blocks(50);
        let (seen, most) = (AtomicUsize::new(0), AtomicUsize::new(usize::MAX));
        let watch =
            |rows: usize| seen.fetch_add(rows, Ordering::Relaxed) < most.load(Ordering::Relaxed);
        let workers = Workers { watch: Some(&watch), ..Workers::new(2) };
        let pass = || each(&blocks, |block| block, workers, || (), |(), _| Ok(()), Ok);
        pass().unwrap();
        assert_eq!(seen.load(Ordering::Relaxed), blocks.iter().map(|b| b.rows).sum::<usize>());
        most.store(0, Ordering::Relaxed);
        assert_eq!(pass().unwrap_err(), FitError::Interrupted);
    }
}
