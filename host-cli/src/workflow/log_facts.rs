//! What is gathered of the rows of logs when they are read for the first time, so that a fit need not see
//! them again: all that can be said without a calibration.

use super::WorkflowError;
use super::batch::{Stamp, stamp};
use super::spread_rows::SpreadRows;
use calibration::validation::excitation::WrenchSums;
use calibration::validation::shared_loads::{RowSample, SharedRows};
use log_file::{Log, ReadSummary};
use shell_data::block::Block;
use shell_data::fingerprint::Fingerprint;

/// About as many bytes has a row of a log.
const BYTES_OF_ROW: u64 = 100;

/// What is wanted of the rows.
#[derive(Clone, Copy, Debug)]
pub struct Gathering {
    /// The training logs are the first so many.
    train: usize,
    /// Nothing but how many rows there are.
    counts_only: bool,
    /// Whether one log may be a copy of another.
    tells_copies: bool,
    /// Which training rows, and which test rows, tell whether tests are on plateaus of the training: one of
    /// so many, if any.
    plateaus: Option<[usize; 2]>,
    /// Which training rows are kept to find the distribution of errors on: one of so many, if any.
    spread: Option<usize>,
}

impl Gathering {
    /// Nothing is wanted but counts.
    pub(super) const NOTHING: Self =
        Self { train: 0, counts_only: true, tells_copies: false, plateaus: None, spread: None };

    /// Of training logs, and of tests if there are any. Training rows that are spread over the logs are kept
    /// if `spreads`.
    pub(super) fn new(train: &[Log], test: &[Log], spreads: bool) -> Self {
        let rows = |logs: &[Log]| logs.iter().map(Log::bytes).sum::<u64>() / BYTES_OF_ROW;
        let strides = [train, test].map(|logs| RowSample::stride(rows(logs)));
        Self {
            train: train.len(),
            counts_only: false,
            // A log by itself is a copy of none.
            tells_copies: train.len() + test.len() > 1,
            plateaus: (!test.is_empty()).then_some(strides),
            spread: spreads.then(|| SpreadRows::stride(rows(train))),
        }
    }

    /// Of training logs whose tests are not known yet.
    pub(super) fn of_training(train: &[Log], spreads: bool) -> Self {
        let strides = Self::new(train, train, spreads);
        Self { tells_copies: true, ..strides }
    }

    /// Of the rows of a block of a log that are used.
    pub(super) fn of(&self, log: usize, block: &Block) -> BlockFacts {
        let is_train = log < self.train;
        let spread = self.spread.filter(|_| is_train);
        let stride = self.plateaus.map(|strides| strides[usize::from(!is_train)]);
        BlockFacts {
            rows: block.rows as u64,
            loads: (is_train && !self.counts_only).then(|| WrenchSums::of(&block.wrench)),
            fingerprint: self.tells_copies.then(|| Fingerprint::of(block)),
            sample: stride.map(|stride| RowSample::of(block, stride)),
            spread: spread.map(|stride| SpreadRows::of(block, stride)),
        }
    }
}

/// What is known of a block.
pub(super) struct BlockFacts {
    rows: u64,
    loads: Option<WrenchSums>,
    fingerprint: Option<Fingerprint>,
    sample: Option<RowSample>,
    spread: Option<SpreadRows>,
}

/// What is known of logs.
#[derive(Clone, Debug, Default)]
pub struct LogFacts {
    /// What their files were before they were read.
    stamps: Vec<Stamp>,
    /// What the logs were that have been read.
    summaries: Vec<ReadSummary>,
    /// The rows of each that are used.
    rows: Vec<u64>,
    loads: WrenchSums,
    fingerprints: Vec<Fingerprint>,
    train_rows: RowSample,
    shared: Option<Option<SharedRows>>,
    spread: Option<SpreadRows>,
}

impl LogFacts {
    /// Looks at the files of `logs` before they are read, after those that have been.
    pub(super) fn expect<'a>(&mut self, logs: impl IntoIterator<Item = &'a Log>) {
        self.stamps.extend(logs.into_iter().map(|log| stamp(log.path())));
        self.rows.resize(self.stamps.len(), 0);
        self.fingerprints.resize(self.stamps.len(), Fingerprint::default());
    }

    /// Adds a block of a log, after those before it.
    pub(super) fn add(&mut self, gathering: &Gathering, log: usize, block: BlockFacts) {
        self.rows[log] += block.rows;
        if let Some(loads) = block.loads {
            self.loads.merge(&loads);
        }
        if let Some(fingerprint) = block.fingerprint {
            self.fingerprints[log].merge(fingerprint);
        }
        match block.sample {
            Some(sample) if log < gathering.train => self.train_rows.add(&sample),
            // All training rows have come before.
            Some(sample) => {
                let found = || self.train_rows.plateaus().map(SharedRows::new);
                if let Some(shared) = self.shared.get_or_insert_with(found) {
                    shared.add(&sample);
                }
            }
            None => {}
        }
        if let Some(spread) = block.spread {
            self.spread.get_or_insert_default().add(&spread);
        }
    }

    /// Adds what the next logs were, which have been read to their ends.
    pub(super) fn finish(&mut self, summaries: impl IntoIterator<Item = ReadSummary>) {
        self.summaries.extend(summaries);
    }

    /// How many logs have been read.
    pub(super) fn known(&self) -> usize {
        self.summaries.len()
    }

    /// What the logs were that have been read.
    pub(super) fn summaries(&self) -> &[ReadSummary] {
        &self.summaries
    }

    /// The rows of each log that are used.
    pub(super) fn rows(&self) -> &[u64] {
        &self.rows
    }

    /// The wrench that the training logs have measured.
    pub(super) fn loads(&self) -> &WrenchSums {
        &self.loads
    }

    /// Training rows, spread over the logs.
    pub(super) fn spread(&self) -> Option<&SpreadRows> {
        self.spread.as_ref()
    }

    /// The share of test rows on plateaus of the training logs, where those are made of plateaus.
    pub(super) fn share_on_plateaus(&self) -> Option<f64> {
        self.shared.as_ref()?.as_ref()?.share()
    }

    /// Whether the file of a log is still what it was.
    pub(super) fn is_unchanged(&self, place: usize, log: &Log) -> bool {
        self.stamps[place] == stamp(log.path())
    }

    /// Checks that no log is a copy of one before it.
    pub(super) fn check_copies(&self, logs: &[&Log]) -> Result<(), WorkflowError> {
        match Fingerprint::first_copy(&self.fingerprints) {
            Some((earlier, later)) => {
                let path = |log: usize| logs[log].path().to_path_buf();
                Err(WorkflowError::Copy { earlier: path(earlier), later: path(later) })
            }
            None => Ok(()),
        }
    }
}
