//! Exact summation of rows.
//!
//! Rows are processed in blocks of [`ROWS`]. Readings become integers relative to a centre near the middle of each
//! channel's range, which keeps them small. Each sum over a block is exact (see [`limbs`](super::limbs)). It is added
//! to a pair of `f64`, one for multiples of 2²⁶ and one for the rest, which is exact for 2²⁶ blocks. If a value does
//! not fit the plan of centres and limbs, the sums so far move into [`ExactSums`] and a new plan is made.

use std::sync::Arc;

use super::block_sums::{Scratch, sum_block};
use super::layout::SumLayout;
use super::limbs::ROWS;
use super::limbs::{BinaryPlaces, FeatureLimbs, Limbs, SQUARE_WIDTH};
use super::plan::{MOST_BLOCKS, OpenSums, SummationPlan};
use super::product_sums::ExactSums;
use super::readings::{ChannelRange, ReadingUnit, count, scan_column};
use crate::error::ExactError;
use crate::model::Basis;
use shell_data::wrench::Axis;

/// Sums rows of readings and wrenches exactly, in memory that does not grow with the rows.
#[derive(Clone, Debug)]
pub struct Accumulator {
    basis: Basis,
    layout: Arc<SumLayout>,
    closed: Option<ExactSums>,
    /// Units and ranges of the channels, including staged rows.
    channels: Vec<ChannelRange>,
    pub(super) expected: ExpectedRows,
    open: Option<OpenSums>,
    /// Number of rows not yet summed. `readings` and `wrench` hold them, in columns of [`ROWS`] numbers.
    staged: usize,
    readings: Vec<f64>,
    wrench: Vec<f64>,
    pub(super) scratch: Scratch,
}

/// Ranges that the next rows are expected to have. The plan covers them. They affect the speed, not the sums.
#[derive(Clone, Debug)]
pub(super) struct ExpectedRows {
    channels: Vec<ChannelRange>,
    places: [BinaryPlaces; 6],
    pub(super) plan: Option<Arc<SummationPlan>>,
}

impl ExpectedRows {
    /// Returns true if all readings are whole counts. Fractional readings are too rare to share their ranges.
    pub(super) fn in_counts(&self) -> bool {
        self.channels.iter().all(|channel| channel.unit == ReadingUnit::COUNT)
    }

    pub(super) fn learn(&mut self, other: &Self) {
        if self.in_counts() && other.in_counts() {
            self.channels.iter_mut().zip(&other.channels).for_each(|(own, other)| own.merge(other));
        }
        for (own, &other) in self.places.iter_mut().zip(&other.places) {
            *own = own.and(other);
        }
    }
}

impl Accumulator {
    pub fn new(basis: Basis, channels: usize) -> Self {
        let nothing = vec![ChannelRange::EMPTY; channels];
        Self {
            basis,
            layout: Arc::new(SumLayout::new(basis, channels)),
            closed: None,
            channels: nothing.clone(),
            expected: ExpectedRows {
                channels: nothing,
                places: [BinaryPlaces::NONE; 6],
                plan: None,
            },
            open: None,
            staged: 0,
            readings: vec![0.0; channels * ROWS],
            wrench: vec![0.0; 6 * ROWS],
            scratch: Scratch::default(),
        }
    }

    /// Adds the rows of `other`, which must be different rows of the same channels and basis.
    ///
    /// # Errors
    /// [`ExactError`] if the sums cannot be exact; do not use the accumulator after that.
    ///
    /// # Panics
    /// If basis or number of channels differ.
    pub fn merge(&mut self, other: Self) -> Result<(), ExactError> {
        self.sum_staged()?;
        self.discard_plan()?;
        let other = other.finish()?;
        for (i, range) in other.channels.iter().enumerate() {
            self.channels[i].merge(range);
            self.expected.channels[i].merge(range);
        }
        other.add_to(&mut self.closed)
    }

    /// Adds rows: `readings` in counts, one column per channel; `wrench` in N and N·m, six columns.
    ///
    /// # Errors
    /// [`ExactError`] if the sums cannot be exact. Some rows may have been added, so do not use the accumulator then.
    ///
    /// # Panics
    /// If the numbers or lengths of columns are not as described.
    pub fn absorb<C: AsRef<[f64]>>(
        &mut self,
        readings: &[C],
        wrench: &[C],
    ) -> Result<(), ExactError> {
        assert_eq!((readings.len(), wrench.len()), (self.channels.len(), 6), "columns");
        let rows = wrench[0].as_ref().len();
        assert!(readings.iter().chain(wrench).all(|c| c.as_ref().len() == rows), "lengths");
        self.widen_ranges(readings)?;
        if self.expected.plan.is_none() {
            for (places, column) in self.expected.places.iter_mut().zip(wrench) {
                *places = places.and(BinaryPlaces::new(column.as_ref()));
            }
        }
        let mut start = 0;
        while start < rows {
            let end = rows.min(start + ROWS - self.staged);
            let staged = self.staged..self.staged + end - start;
            for (i, column) in readings.iter().enumerate() {
                let target = &mut self.readings[i * ROWS..][staged.clone()];
                count(&column.as_ref()[start..end], self.channels[i].unit, target);
            }
            for (i, column) in wrench.iter().enumerate() {
                self.wrench[i * ROWS..][staged.clone()]
                    .copy_from_slice(&column.as_ref()[start..end]);
            }
            self.staged = staged.end;
            if self.staged == ROWS {
                self.sum_staged()?;
            }
            start = end;
        }
        Ok(())
    }

    /// Returns true if some sums are in working form, which takes more memory.
    pub fn is_open(&self) -> bool {
        self.open.is_some()
    }

    /// Takes the sums so far, without the rows that still wait for a full block; `None` if there are no sums.
    ///
    /// # Errors
    /// [`ExactError`] if they cannot be exact.
    pub fn settle(&mut self) -> Result<Option<ExactSums>, ExactError> {
        self.close()?;
        Ok(self.closed.take())
    }

    /// # Errors
    /// [`ExactError`] if they cannot be exact.
    pub fn finish(mut self) -> Result<ExactSums, ExactError> {
        self.sum_staged()?;
        self.close()?;
        Ok(self.closed.unwrap_or_else(|| ExactSums::with_layout(self.basis, self.layout)))
    }

    /// Checks that readings are integers in some unit, and widens the known ranges.
    fn widen_ranges<C: AsRef<[f64]>>(&mut self, readings: &[C]) -> Result<(), ExactError> {
        for (i, column) in readings.iter().enumerate() {
            let column = column.as_ref();
            let known = self.channels[i];
            let found = scan_column(column, known.unit)
                .map_err(|value| ExactError::NotAnInteger { channel: i, value })?;
            if found.unit != known.unit {
                self.sum_staged()?;
                self.discard_plan()?;
            }
            self.channels[i].merge(&found);
            self.expected.channels[i].merge(&found);
            if !self.channels[i].fits() {
                return Err(ExactError::TooWide { channel: i });
            }
        }
        Ok(())
    }

    pub(crate) fn sum_staged(&mut self) -> Result<(), ExactError> {
        if self.staged == 0 {
            return Ok(());
        }
        for column in self.wrench.chunks_mut(ROWS) {
            column[self.staged..].fill(0.0);
        }
        let is_full = self.open.as_ref().is_some_and(|open| open.blocks >= MOST_BLOCKS);
        let covers = |plan: &&Arc<SummationPlan>| {
            distance(&self.channels, &plan.centre) <= plan.features.largest
        };
        match self.expected.plan.as_ref().filter(covers) {
            Some(plan) if !is_full => {
                self.open.get_or_insert_with(|| OpenSums::new(plan.clone()));
            }
            _ => self.reopen()?,
        }
        if !self.sum() {
            self.reopen()?;
            let exact = self.sum();
            assert!(exact, "limbs chosen for these rows");
        }
        self.staged = 0;
        Ok(())
    }

    fn sum(&mut self) -> bool {
        let open = self.open.as_mut().expect("opened before");
        for (column, &centre) in self.readings.chunks_mut(ROWS).zip(&open.plan.centre) {
            column[self.staged..].fill(centre as f64);
        }
        let (readings, wrench) = (&self.readings, &self.wrench);
        sum_block(&self.layout, open, self.staged, readings, wrench, &mut self.scratch)
    }

    /// Closes the open sums and opens new ones whose plan covers all rows so far.
    fn reopen(&mut self) -> Result<(), ExactError> {
        self.close()?;
        for axis in Axis::ALL {
            let staged = &self.wrench[axis.index() * ROWS..][..self.staged];
            if !staged.iter().all(|x| x.is_finite()) {
                return Err(ExactError::NotFinite { axis });
            }
            let places = &mut self.expected.places[axis.index()];
            *places = places.and(BinaryPlaces::new(staged));
        }
        let expected = &self.expected.channels;
        let centre: Vec<i64> = expected.iter().map(ChannelRange::middle).collect();
        let places = &self.expected.places;
        let features = FeatureLimbs::new(distance(expected, &centre), &self.layout, places);
        let limbs = |width: u32| -> Result<Vec<Limbs>, ExactError> {
            let of_axis = |axis: Axis| {
                let limbs = self.expected.places[axis.index()].limbs(width);
                limbs.ok_or(ExactError::TooManyPlaces { axis })
            };
            Axis::ALL.into_iter().map(of_axis).collect()
        };
        let (squares, cross) = (limbs(SQUARE_WIDTH)?, limbs(features.cross_width())?);
        let plan = Arc::new(SummationPlan::new(&self.layout, centre, features, squares, cross));
        self.open = Some(OpenSums::new(plan.clone()));
        self.expected.plan = Some(plan);
        Ok(())
    }

    /// Closes the open sums and drops their plan, which depends on the units of the channels.
    fn discard_plan(&mut self) -> Result<(), ExactError> {
        self.expected.plan = None;
        self.close()
    }

    fn close(&mut self) -> Result<(), ExactError> {
        let Some(open) = self.open.take().filter(|open| open.rows > 0) else { return Ok(()) };
        let mut part = open.moments(&self.layout, self.basis);
        part.channels.clone_from(&self.channels);
        part.add_to(&mut self.closed)
    }
}

fn distance(channels: &[ChannelRange], centre: &[i64]) -> u32 {
    let of = |(channel, &centre): (&ChannelRange, &i64)| {
        (channel.highest.saturating_sub(centre)).max(centre.saturating_sub(channel.lowest))
    };
    let largest = channels.iter().zip(centre).map(of).max().unwrap_or(0);
    u32::try_from(largest.max(0)).unwrap_or(u32::MAX)
}

/// Adds rows to several [`Accumulator`]s of one basis, which share one working memory. Each starts with the latest plan
/// and the known ranges, because every new plan closes the open sums. The results do not depend on this.
#[derive(Clone, Debug)]
pub struct Adder {
    /// Template without rows. It has the ranges learned from all accumulators so far.
    empty: Accumulator,
    scratch: Scratch,
}

impl Adder {
    pub fn new(basis: Basis, channels: usize) -> Self {
        Self { empty: Accumulator::new(basis, channels), scratch: Scratch::default() }
    }

    pub fn begin(&self) -> Accumulator {
        self.empty.clone()
    }

    /// Adds rows to `sums` as [`Accumulator::absorb`] does, with the same panics.
    ///
    /// # Errors
    /// [`ExactError`] if the rows cannot be summed exactly.
    pub fn add<C: AsRef<[f64]>>(
        &mut self,
        sums: &mut Accumulator,
        readings: &[C],
        wrench: &[C],
    ) -> Result<(), ExactError> {
        let plan = |of: &Accumulator| of.expected.plan.as_ref().map(Arc::as_ptr);
        sums.expected.learn(&self.empty.expected);
        let before = plan(sums);
        std::mem::swap(&mut sums.scratch, &mut self.scratch);
        let added = sums.absorb(readings, wrench);
        std::mem::swap(&mut sums.scratch, &mut self.scratch);
        added?;
        if plan(sums) != before && sums.expected.in_counts() {
            self.empty.expected.clone_from(&sums.expected);
        }
        Ok(())
    }

    /// Finishes `sums` as [`Accumulator::finish`] does.
    ///
    /// # Errors
    /// [`ExactError`] if they cannot be exact.
    pub fn finish(&mut self, mut sums: Accumulator) -> Result<ExactSums, ExactError> {
        sums.scratch = std::mem::take(&mut self.scratch);
        sums.sum_staged()?;
        self.scratch = std::mem::take(&mut sums.scratch);
        sums.finish()
    }
}
