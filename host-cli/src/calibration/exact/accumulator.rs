//! Summing rows exactly.
//!
//! Rows are worked on [`ROWS`] at a time, in integers about a centre near the middle of each
//! channel's range, which makes them small. Each sum over such a block is exact (see
//! [`limbs`](super::limbs)) and is added to a pair of `f64`, one for multiples of 2²⁶ and one for
//! the rest, which stay exact for 2²⁶ blocks. When readings or wrenches turn up that the choice of
//! centre and limbs does not cover, the sums so far are put into [`Moments`] and a new choice is
//! made.

use std::sync::Arc;

use num_bigint::BigInt;
use pulp::{Arch, Simd, WithSimd};

use super::kernel::{ROWS, products};
use super::layout::{Group, Layout};
use super::limbs::{FeatureLimbs, Limbs, Places, SQUARE_WIDTH, power_of_two};
use super::moments::{Channel, Moments, Scaled, join, move_origin};
use super::unit::{Unit, count, survey};
use super::{ExactError, MAX_ROWS};
use crate::calibration::model::Basis;
use crate::wrench::Axis;

/// Blocks after which the pairs of sums could lose their exactness: `2^25·2^26 < 2^53`, and
/// multiples of 2²⁶ below `2^53·2^26`.
const MOST_BLOCKS: u64 = 1 << 26;

/// Sums rows of readings and wrenches exactly, in memory that does not grow with the rows.
#[derive(Clone, Debug)]
pub struct Accumulator {
    layout: Arc<Layout>,
    total: Moments,
    /// What is known of the channels from all rows, staged ones included.
    channels: Vec<Channel>,
    /// What the choice of centre and limbs is made for: rows so far, and what other accumulators
    /// have met. Has no influence on results.
    expected: Vec<Channel>,
    places: [Places; 6],
    open: Option<Open>,
    /// Rows not yet summed: columns of [`ROWS`] numbers.
    staged: usize,
    readings: Vec<f64>,
    wrench: Vec<f64>,
    scratch: Scratch,
}

/// How sums are computed.
#[derive(Debug, PartialEq)]
struct Choice {
    centre: Vec<i64>,
    features: FeatureLimbs,
    /// For every group of the layout, the left operands: feature and limb.
    lefts: Vec<Vec<(usize, usize)>>,
    /// Limbs of each axis that are multiplied with features.
    cross: [Limbs; 6],
    /// Limbs of each axis that are multiplied with those of other axes.
    squares: [Limbs; 6],
}

/// Sums under way.
#[derive(Clone, Debug)]
struct Open {
    choice: Arc<Choice>,
    rows: u64,
    blocks: u64,
    /// Sums of parts of the right operands, group by group, then of one and the limbs of the
    /// wrench with them, then of the products of axes; multiples of 2²⁶.
    high: Vec<f64>,
    /// What is not a multiple of 2²⁶ in each sum.
    low: Vec<f64>,
}

/// Working memory.
#[derive(Clone, Debug, Default)]
pub(super) struct Scratch {
    features: Vec<f64>,
    rights: Vec<f64>,
    left: Vec<f64>,
    cross: Vec<f64>,
    squares: Vec<f64>,
    sums: Vec<f64>,
}

impl Accumulator {
    /// No rows yet, of `channels` channels.
    pub fn new(basis: Basis, channels: usize) -> Self {
        let total = Moments::new(basis, channels);
        Self {
            layout: total.layout.clone(),
            channels: total.channels.clone(),
            expected: total.channels.clone(),
            total,
            places: [Places::NONE; 6],
            open: None,
            staged: 0,
            readings: vec![0.0; channels * ROWS],
            wrench: vec![0.0; 6 * ROWS],
            scratch: Scratch::default(),
        }
    }

    /// An accumulator of no rows that begins with this one's choice of centre and limbs, so that
    /// both can be merged cheaply.
    pub fn fork(&self) -> Self {
        let mut fork = Self {
            layout: self.layout.clone(),
            total: Moments::with_layout(self.total.basis, self.layout.clone()),
            channels: Vec::new(),
            expected: self.expected.clone(),
            places: self.places,
            open: None,
            staged: 0,
            readings: vec![0.0; self.readings.len()],
            wrench: vec![0.0; self.wrench.len()],
            scratch: Scratch::default(),
        };
        fork.channels.clone_from(&fork.total.channels);
        // Readings with fractions are too rare to be taken care of here.
        if self.expected.iter().any(|channel| channel.unit != Unit::COUNT) {
            fork.expected.clone_from(&fork.channels);
        } else if let Some(open) = &self.open {
            fork.open = Some(Open::new(&self.layout, open.choice.clone()));
        }
        fork
    }

    /// The choice of centre and limbs, by its address; `None` before the first rows.
    pub(super) fn choice(&self) -> Option<*const ()> {
        self.open.as_ref().map(|open| Arc::as_ptr(&open.choice).cast())
    }

    /// Makes later choices good for what `other` has met, too.
    pub(super) fn expect_as(&mut self, other: &Self) {
        for (own, other) in self.expected.iter_mut().zip(&other.expected) {
            own.merge(other);
        }
        for (own, other) in self.places.iter_mut().zip(other.places) {
            *own = own.and(other);
        }
    }

    /// Makes later choices good for rows such as these.
    pub(super) fn expect<C: AsRef<[f64]>>(&mut self, readings: &[C], wrench: &[C]) {
        for (expected, column) in self.expected.iter_mut().zip(readings) {
            if let Ok(found) = survey(column.as_ref(), Unit::COUNT) {
                expected.merge(&found);
            }
        }
        for (places, column) in self.places.iter_mut().zip(wrench) {
            *places = places.and(Places::of(column.as_ref()));
        }
    }

    /// Works in memory that another accumulator has given back.
    pub(super) fn take_scratch(&mut self, scratch: Scratch) {
        self.scratch = scratch;
    }

    /// Adds the rows of `other`, which are other rows of the same channels and basis.
    ///
    /// # Errors
    /// [`ExactError`] if the rows of both cannot be summed exactly; the accumulator is then of no
    /// further use.
    ///
    /// # Panics
    /// If basis or number of channels differ.
    pub fn merge(&mut self, mut other: Self) -> Result<(), ExactError> {
        self.sum_staged()?;
        other.sum_staged()?;
        if other.total.rows > 0 {
            self.total.merge(&other.total)?;
        }
        for i in 0..self.channels.len() {
            if self.channels[i].unit != other.channels[i].unit {
                self.close()?;
            }
            self.channels[i].merge(&other.channels[i]);
            self.expected[i].merge(&other.expected[i]);
            if !self.channels[i].fits() {
                return Err(ExactError::TooWide { channel: i });
            }
        }
        for (own, other) in self.places.iter_mut().zip(other.places) {
            *own = own.and(other);
        }
        let Some(open) = other.open.take_if(|open| open.rows > 0) else { return Ok(()) };
        let same_units = self.channels.iter().zip(&other.channels);
        if same_units.into_iter().any(|(a, b)| a.unit != b.unit) {
            return self.put_away(&open, &other.channels);
        }
        match &mut self.open {
            None => self.open = Some(open),
            Some(own) if own.choice == open.choice && own.blocks + open.blocks <= MOST_BLOCKS => {
                own.add(&open);
            }
            // The later choice has seen more, and is more likely to be that of the next rows.
            Some(own) => {
                let own = std::mem::replace(own, open);
                self.put_away(&own, &self.channels.clone())?;
            }
        }
        Ok(())
    }

    /// Takes up rows: `readings` in counts, one column per channel; `wrench` in N and N·m, six
    /// columns; all of the same length.
    ///
    /// # Errors
    /// [`ExactError`] if the rows cannot be summed exactly. Rows before them may have been taken
    /// up; the accumulator is of no further use.
    ///
    /// # Panics
    /// If the numbers or lengths of columns are not as said.
    pub fn absorb<C: AsRef<[f64]>>(
        &mut self,
        readings: &[C],
        wrench: &[C],
    ) -> Result<(), ExactError> {
        assert_eq!((readings.len(), wrench.len()), (self.channels.len(), 6), "columns");
        let rows = wrench[0].as_ref().len();
        assert!(readings.iter().chain(wrench).all(|c| c.as_ref().len() == rows), "lengths");
        self.survey(readings)?;
        if self.open.is_none() {
            for (places, column) in self.places.iter_mut().zip(wrench) {
                *places = places.and(Places::of(column.as_ref()));
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

    /// Sums the rows that still wait for a full block, and gives working memory back.
    ///
    /// # Errors
    /// [`ExactError`] if they cannot be summed exactly.
    pub(super) fn settle(&mut self) -> Result<Scratch, ExactError> {
        self.sum_staged()?;
        Ok(std::mem::take(&mut self.scratch))
    }

    /// The sums over all rows taken up.
    ///
    /// # Errors
    /// [`ExactError`] if they cannot be exact.
    pub fn finish(mut self) -> Result<Moments, ExactError> {
        self.sum_staged()?;
        self.close()?;
        Ok(self.total)
    }

    /// Sees to it that readings count as integers, and widens the known ranges by them.
    fn survey<C: AsRef<[f64]>>(&mut self, readings: &[C]) -> Result<(), ExactError> {
        for (i, column) in readings.iter().enumerate() {
            let column = column.as_ref();
            let known = self.channels[i];
            let found = survey(column, known.unit)
                .map_err(|value| ExactError::NotAnInteger { channel: i, value })?;
            if found.unit != known.unit {
                self.sum_staged()?;
                self.close()?;
            }
            self.channels[i].merge(&found);
            self.expected[i].merge(&found);
            if !self.channels[i].fits() {
                return Err(ExactError::TooWide { channel: i });
            }
        }
        Ok(())
    }

    fn sum_staged(&mut self) -> Result<(), ExactError> {
        if self.staged == 0 {
            return Ok(());
        }
        for axis in Axis::ALL {
            let column = &self.wrench[axis.index() * ROWS..][..self.staged];
            if !column.iter().all(|x| x.is_finite()) {
                return Err(ExactError::NotFinite { axis });
            }
        }
        for column in self.wrench.chunks_mut(ROWS) {
            column[self.staged..].fill(0.0);
        }
        let covered = self.open.as_ref().is_some_and(|open| {
            let choice = &open.choice;
            open.blocks < MOST_BLOCKS
                && distance(&self.channels, &choice.centre) <= choice.features.largest
        });
        if !covered {
            self.reopen()?;
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
        Arch::new().dispatch(Sum {
            layout: &self.layout,
            open,
            staged: self.staged,
            readings: &self.readings,
            wrench: &self.wrench,
            scratch: &mut self.scratch,
        })
    }

    /// Puts the open sums away and opens new ones that cover all rows so far and those staged.
    fn reopen(&mut self) -> Result<(), ExactError> {
        self.close()?;
        let degree = self.total.basis.degree();
        let centre: Vec<i64> = self.expected.iter().map(Channel::middle).collect();
        let features = FeatureLimbs::new(distance(&self.expected, &centre), degree as u32);
        let mut limbs = |width| -> Result<[Limbs; 6], ExactError> {
            let mut limbs = [Limbs::of_integers(width, 0); 6];
            for axis in Axis::ALL {
                let i = axis.index();
                let staged = Places::of(&self.wrench[i * ROWS..][..self.staged]);
                self.places[i] = self.places[i].and(staged);
                limbs[i] = self.places[i].limbs(width).ok_or(ExactError::TooManyPlaces { axis })?;
            }
            Ok(limbs)
        };
        let (cross, squares) = (limbs(features.width)?, limbs(SQUARE_WIDTH)?);
        let choice = Choice::new(&self.layout, centre, features, cross, squares);
        self.open = Some(Open::new(&self.layout, Arc::new(choice)));
        Ok(())
    }

    fn close(&mut self) -> Result<(), ExactError> {
        match self.open.take() {
            Some(open) if open.rows > 0 => self.put_away(&open, &self.channels.clone()),
            _ => Ok(()),
        }
    }

    fn put_away(&mut self, open: &Open, channels: &[Channel]) -> Result<(), ExactError> {
        if self.total.rows + open.rows > MAX_ROWS {
            return Err(ExactError::TooManyRows);
        }
        let mut part = open.moments(&self.layout, self.total.basis);
        part.channels = channels.to_vec();
        self.total.merge(&part)
    }
}

impl Choice {
    fn new(
        layout: &Layout,
        centre: Vec<i64>,
        features: FeatureLimbs,
        cross: [Limbs; 6],
        squares: [Limbs; 6],
    ) -> Self {
        let limbs = |&f: &usize| {
            let limbs = features.left[layout.features[f].factors().len()];
            (0..limbs).map(move |limb| (f, limb))
        };
        let left = |group: &Group| group.left.iter().flat_map(limbs).collect();
        let lefts = layout.groups.iter().map(left).collect();
        Self { centre, features, lefts, cross, squares }
    }

    /// Number of sums.
    fn sums(&self, layout: &Layout) -> usize {
        let groups = layout.groups.iter().zip(&self.lefts);
        let gram: usize = groups.map(|(group, left)| left.len() * group.right.len()).sum();
        let operands = 1 + self.cross.iter().map(|limbs| limbs.count).sum::<usize>();
        let per_part = gram + operands * layout.features.len();
        let squares =
            (0..6).map(|axis| self.squares[axis].count * squares_right(&self.squares, axis));
        per_part * self.features.rights() + squares.sum::<usize>()
    }
}

impl Open {
    fn new(layout: &Layout, choice: Arc<Choice>) -> Self {
        let sums = choice.sums(layout);
        Self { choice, rows: 0, blocks: 0, high: vec![0.0; sums], low: vec![0.0; sums] }
    }

    fn add(&mut self, other: &Self) {
        self.rows += other.rows;
        self.blocks += other.blocks;
        for (own, other) in [(&mut self.high, &other.high), (&mut self.low, &other.low)] {
            own.iter_mut().zip(other).for_each(|(own, other)| *own += other);
        }
    }

    /// The sums about the origin of the readings.
    fn moments(&self, layout: &Arc<Layout>, basis: Basis) -> Moments {
        let Choice { centre, features: limbs, lefts, cross, squares } = &*self.choice;
        let mut moments = Moments::with_layout(basis, layout.clone());
        let mut sums = self.high.iter().zip(&self.low).map(|(&h, &l)| h as i128 + l as i128);
        let mut next = || sums.next().expect("one sum for every product");
        let features = layout.features.len();
        let axis_sums = || vec![BigInt::ZERO; features + 1];
        let mut wrench: [Vec<BigInt>; 6] = std::array::from_fn(|_| axis_sums());
        moments.rows = self.rows;
        moments.readings[0] = i128::from(self.rows);
        for part in 0..limbs.rights() {
            let up = limbs.right.unwrap_or(0) * part as u32;
            let mut first = 1 + features;
            for (group, lefts) in layout.groups.iter().zip(lefts) {
                for left in lefts.chunk_by(|a, b| a.0 == b.0) {
                    for &(_, limb) in left {
                        let up = up + limbs.width * limb as u32;
                        for sum in &mut moments.readings[first..first + group.right.len()] {
                            *sum = sum.wrapping_add(next() << up);
                        }
                    }
                    first += group.right.len();
                }
            }
            for sum in &mut moments.readings[1..=features] {
                *sum += next() << up;
            }
            for (axis_limbs, axis) in cross.iter().zip(&mut wrench) {
                let parts: Vec<i128> = (0..axis_limbs.count * features).map(|_| next()).collect();
                for (f, sum) in axis[1..].iter_mut().enumerate() {
                    *sum += join(parts.iter().skip(f).step_by(features).copied(), axis_limbs.width)
                        << up;
                }
            }
        }
        for (left, axis) in wrench.iter_mut().enumerate() {
            // Sums by limb on the left, then by axis and limb on the right, then one.
            let rows: Vec<Vec<i128>> = (0..squares[left].count)
                .map(|_| (0..squares_right(squares, left)).map(|_| next()).collect())
                .collect();
            let mut column = 0;
            for right in left..6 {
                let count = squares[right].count;
                let sum: BigInt = (column..column + count)
                    .zip((0u32..).step_by(SQUARE_WIDTH as usize))
                    .map(|(column, up)| {
                        join(rows.iter().map(|row| row[column]), SQUARE_WIDTH) << up
                    })
                    .sum();
                let exponent = squares[left].unit + squares[right].unit;
                moments.squares[pair(left, right)] = Scaled::new(exponent, vec![sum]);
                column += count;
            }
            let ones = join(rows.iter().map(|row| row[column]), SQUARE_WIDTH);
            // The other sums of this axis count in units of other limbs.
            let up = squares[left].unit - cross[left].unit;
            axis[0] = if up >= 0 { ones << up } else { ones >> -up };
        }
        let back: Vec<i64> = centre.iter().map(|c| -c).collect();
        move_origin(layout, &mut moments.readings, &mut wrench, &back);
        for ((scaled, sums), limbs) in moments.wrench.iter_mut().zip(wrench).zip(cross) {
            *scaled = Scaled::new(limbs.unit, sums);
        }
        moments
    }
}

/// Where the sum of products of two axes stands, `left ≤ right`.
pub(super) const fn pair(left: usize, right: usize) -> usize {
    left * (13 - left) / 2 + right - left
}

/// Right operands of the products of an axis with itself, later axes and one.
fn squares_right(squares: &[Limbs; 6], axis: usize) -> usize {
    squares[axis..].iter().map(|limbs| limbs.count).sum::<usize>() + 1
}

/// The largest distance between a reading and its centre.
fn distance(channels: &[Channel], centre: &[i64]) -> u32 {
    let of = |(channel, &centre): (&Channel, &i64)| {
        (channel.highest.saturating_sub(centre)).max(centre.saturating_sub(channel.lowest))
    };
    let largest = channels.iter().zip(centre).map(of).max().unwrap_or(0);
    u32::try_from(largest.max(0)).unwrap_or(u32::MAX)
}

impl Scratch {
    fn resize(&mut self, layout: &Layout, choice: &Choice) {
        let features = layout.features.len();
        let lefts = choice.lefts.iter().map(Vec::len);
        let groups = layout.groups.iter().zip(&choice.lefts);
        let cross: usize = choice.cross.iter().map(|limbs| limbs.count).sum();
        let squares: usize = choice.squares.iter().map(|limbs| limbs.count).sum();
        let sums = groups
            .map(|(group, left)| group.right.len() * left.len())
            .chain([(1 + cross) * features, (1 + squares) * squares])
            .max();
        self.features.resize(features * ROWS, 0.0);
        self.rights.resize(choice.features.right.map_or(0, |_| 2 * features * ROWS), 0.0);
        self.left.resize(lefts.max().unwrap_or(0) * ROWS, 0.0);
        self.cross.resize((1 + cross) * ROWS, 0.0);
        self.squares.resize((1 + squares) * ROWS, 0.0);
        self.sums.resize(sums.unwrap_or(0), 0.0);
    }
}

/// Adds the staged rows to the open sums, unless the limbs do not cover the wrench: says whether.
struct Sum<'a> {
    layout: &'a Layout,
    open: &'a mut Open,
    staged: usize,
    readings: &'a [f64],
    wrench: &'a [f64],
    scratch: &'a mut Scratch,
}

impl WithSimd for Sum<'_> {
    type Output = bool;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> bool {
        let Self { layout, open, staged, readings, wrench, scratch } = self;
        let choice = &*open.choice;
        scratch.resize(layout, choice);
        let Scratch { features, rights, left, cross, squares, sums } = scratch;
        // One comes before the limbs of the cross products and after those of the squares.
        let (ones, mut cross_limbs) = cross.split_at_mut(ROWS);
        let mut square_limbs = &mut squares[..];
        for (axis, column) in wrench.chunks_exact(ROWS).enumerate() {
            let now;
            (now, cross_limbs) = cross_limbs.split_at_mut(choice.cross[axis].count * ROWS);
            if !choice.cross[axis].cut(column, now) {
                return false;
            }
            let now;
            (now, square_limbs) = square_limbs.split_at_mut(choice.squares[axis].count * ROWS);
            if !choice.squares[axis].cut(column, now) {
                return false;
            }
        }
        for column in [ones, square_limbs] {
            column[..staged].fill(1.0);
            column[staged..].fill(0.0);
        }
        fill(layout, &choice.centre, staged, readings, features);
        let count = layout.features.len();
        let parts: &[f64] = match choice.features.right {
            None => features,
            Some(width) => {
                let limbs = Limbs::of_integers(width, 2);
                for f in 0..count {
                    limbs.cut(&features[f * ROWS..][..ROWS], &mut left[..2 * ROWS]);
                    rights[f * ROWS..][..ROWS].copy_from_slice(&left[..ROWS]);
                    rights[(count + f) * ROWS..][..ROWS].copy_from_slice(&left[ROWS..2 * ROWS]);
                }
                rights
            }
        };
        let mut target = Target { simd, sums, high: &mut open.high, low: &mut open.low };
        for part in parts.chunks_exact(count * ROWS) {
            for (group, lefts) in layout.groups.iter().zip(&choice.lefts) {
                let mut cut = 0;
                for &f in &group.left {
                    let limbs = choice.features.left[layout.features[f].factors().len()];
                    let now = &mut left[cut * ROWS..][..limbs * ROWS];
                    let column = &features[f * ROWS..][..ROWS];
                    Limbs::of_integers(choice.features.width, limbs).cut(column, now);
                    cut += limbs;
                }
                let right = &part[group.right.start * ROWS..group.right.end * ROWS];
                target.add_products(&left[..lefts.len() * ROWS], right);
            }
            target.add_products(cross, part);
        }
        let mut right = &squares[..];
        for limbs in choice.squares {
            target.add_products(&right[..limbs.count * ROWS], right);
            right = &right[limbs.count * ROWS..];
        }
        open.rows += staged as u64;
        open.blocks += 1;
        true
    }
}

struct Target<'a, S> {
    simd: S,
    sums: &'a mut [f64],
    high: &'a mut [f64],
    low: &'a mut [f64],
}

impl<S: Simd> Target<'_, S> {
    /// Adds the next sums.
    #[inline(always)]
    fn add_products(&mut self, left: &[f64], right: &[f64]) {
        let count = left.len() / ROWS * (right.len() / ROWS);
        let sums = &mut self.sums[..count];
        products(self.simd, left, right, sums);
        let (high, rest) = std::mem::take(&mut self.high).split_at_mut(count);
        self.high = rest;
        let (low, rest) = std::mem::take(&mut self.low).split_at_mut(count);
        self.low = rest;
        let round = 1.5 * power_of_two(52 + 26);
        for ((&sum, high), low) in sums.iter().zip(high).zip(low) {
            let rounded = (sum + round) - round;
            *high += rounded;
            *low += sum - rounded;
        }
    }
}

/// The features of readings about their centres; zero for rows that are not there.
#[inline(always)]
fn fill(layout: &Layout, centre: &[i64], staged: usize, readings: &[f64], features: &mut [f64]) {
    for (f, &(factor, channel)) in layout.recipe.iter().enumerate() {
        let (before, now) = features.split_at_mut(f * ROWS);
        let now = &mut now[..ROWS];
        match factor {
            None => {
                let centre = centre[channel] as f64;
                for (x, s) in now.iter_mut().zip(&readings[channel * ROWS..][..ROWS]) {
                    *x = s - centre;
                }
                now[staged..].fill(0.0);
            }
            Some(factor) => {
                let single = layout.single(channel);
                let single = &before[single * ROWS..][..ROWS];
                let factor = &before[factor * ROWS..][..ROWS];
                for ((x, a), b) in now.iter_mut().zip(factor).zip(single) {
                    *x = a * b;
                }
            }
        }
    }
}
