//! Exact sums over rows, in a form that does not depend on how they were computed.

use std::borrow::Cow;
use std::sync::Arc;

use num_bigint::BigInt;
use num_traits::Zero;
use serde::{Deserialize, Serialize};

use super::layout::Layout;
use super::planes::Planes;
use super::unit::Unit;
use super::{ExactError, MAX_ROWS};
use crate::extent::{Extent, Range};
use crate::model::Basis;

/// Exact sums over rows of products of readings and wrench: all that a least-squares fit of a
/// basis, or of a smaller one within it, needs to know about the rows.
///
/// Equal for equal rows whatever their order and however they were split and merged.
///
/// Sums are kept about the origin of the readings and modulo 2¹²⁸. They fit, by [`MAX_ROWS`]: a
/// reading is below 2¹⁶ in magnitude, so a sum is below 2³⁰·2⁹⁶ = 2¹²⁶; and arithmetic modulo 2¹²⁸
/// on the way there, such as moving the origin, is exact where its result fits.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Stored", into = "Stored")]
pub struct Moments {
    pub(super) basis: Basis,
    pub(super) layout: Arc<Layout>,
    pub(super) rows: u64,
    /// One per channel.
    pub(super) channels: Vec<Channel>,
    /// Sums of monomials of the scaled readings, in the order of the layout.
    pub(super) readings: Vec<i128>,
    /// For each axis, sums of the wrench times one and times each feature.
    pub(super) wrench: [Scaled; 6],
    /// Sums of products of two axes: Fx·Fx, Fx·Fy, …, Mz·Mz.
    pub(super) squares: Vec<Scaled>,
}

/// What is known of a channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Channel {
    /// Readings are integers times this.
    pub(super) unit: Unit,
    /// The smallest of these integers.
    pub(super) lowest: i64,
    /// The largest of them.
    pub(super) highest: i64,
}

impl Channel {
    pub(super) const EMPTY: Self = Self { unit: Unit::COUNT, lowest: i64::MAX, highest: i64::MIN };
}

/// Integers times a power of two, in lowest terms: not all of them even, exponent 0 if all zero.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Scaled {
    pub(super) exponent: i32,
    pub(super) values: Vec<BigInt>,
}

impl Scaled {
    fn zero(len: usize) -> Self {
        Self { exponent: 0, values: vec![BigInt::zero(); len] }
    }

    pub(super) fn new(exponent: i32, values: Vec<BigInt>) -> Self {
        let mut scaled = Self { exponent, values };
        scaled.reduce();
        scaled
    }

    fn reduce(&mut self) {
        match self.values.iter().filter_map(BigInt::trailing_zeros).min() {
            Some(0) => {}
            Some(zeros) => {
                self.values.iter_mut().for_each(|v| *v >>= zeros);
                self.exponent += i32::try_from(zeros).expect("exponents of f64 are small");
            }
            None => self.exponent = 0,
        }
    }

    fn is_zero(&self) -> bool {
        self.values.iter().all(BigInt::is_zero)
    }

    fn add(&mut self, other: &Self) {
        if other.is_zero() {
            return;
        }
        if self.is_zero() {
            self.clone_from(other);
            return;
        }
        let exponent = self.exponent.min(other.exponent);
        let (own, others) = (self.exponent - exponent, other.exponent - exponent);
        for (value, other) in self.values.iter_mut().zip(&other.values) {
            *value <<= own;
            *value += other << others;
        }
        self.exponent = exponent;
        self.reduce();
    }
}

impl Moments {
    /// The sums over no rows.
    pub fn new(basis: Basis, channels: usize) -> Self {
        Self::with_layout(basis, Arc::new(Layout::new(basis, channels)))
    }

    pub(super) fn with_layout(basis: Basis, layout: Arc<Layout>) -> Self {
        Self {
            basis,
            rows: 0,
            channels: vec![Channel::EMPTY; layout.channels()],
            readings: vec![0; layout.sums()],
            wrench: std::array::from_fn(|_| Scaled::zero(layout.features.len() + 1)),
            squares: vec![Scaled::zero(1); 21],
            layout,
        }
    }

    /// Number of rows.
    pub fn rows(&self) -> u64 {
        self.rows
    }

    /// The largest basis that can be solved for.
    pub fn basis(&self) -> Basis {
        self.basis
    }

    /// Number of channels.
    pub fn channels(&self) -> usize {
        self.channels.len()
    }

    /// Rows and the range of each channel, as far as the sums tell.
    pub fn extent(&self) -> Extent {
        let mut extent = Extent::new(self.channels.len());
        extent.rows = self.rows;
        for (i, range) in extent.ranges.iter_mut().enumerate() {
            if let Some((min, max)) = self.range(i) {
                *range = Range { min, max };
            }
        }
        extent
    }

    /// Smallest and largest reading of each channel; `None` of no rows.
    pub fn range(&self, channel: usize) -> Option<(f64, f64)> {
        let Channel { unit, lowest, highest } = *self.channels.get(channel)?;
        let per_count = f64::from(unit.per_count());
        (lowest <= highest).then(|| (lowest as f64 / per_count, highest as f64 / per_count))
    }

    /// Adds the rows of `other`, which are other rows of the same channels and basis.
    ///
    /// # Errors
    /// [`ExactError`] if both together are too many rows or span too wide a range; `self` is then
    /// as it was.
    ///
    /// # Panics
    /// If basis or number of channels differ.
    pub fn merge(&mut self, other: &Moments) -> Result<(), ExactError> {
        assert_eq!((self.basis, self.channels.len()), (other.basis, other.channels.len()));
        if self.rows + other.rows > MAX_ROWS {
            return Err(ExactError::TooManyRows);
        }
        let channels = self.channels.iter().zip(&other.channels);
        let units: Vec<Unit> = channels.map(|(a, b)| a.unit.and(b.unit)).collect();
        let mut merged = self.channels.clone();
        for (channel, other) in merged.iter_mut().zip(&other.channels) {
            channel.merge(other);
        }
        if let Some(channel) = merged.iter().position(|c| !c.fits()) {
            return Err(ExactError::TooWide { channel });
        }
        self.rescale(&units);
        let mut rescaled;
        let mut other = other;
        if other.channels.iter().zip(&units).any(|(c, &unit)| c.unit != unit) {
            rescaled = other.clone();
            rescaled.rescale(&units);
            other = &rescaled;
        }
        self.channels = merged;
        self.rows += other.rows;
        for (sum, other) in self.readings.iter_mut().zip(&other.readings) {
            *sum = sum.wrapping_add(*other);
        }
        for (sum, other) in self.wrench.iter_mut().zip(&other.wrench) {
            sum.add(other);
        }
        for (sum, other) in self.squares.iter_mut().zip(&other.squares) {
            sum.add(other);
        }
        Ok(())
    }

    /// Adds these rows to those of `sums`, if there are any.
    ///
    /// # Errors
    /// As [`Moments::merge`].
    pub fn add_to(self, sums: &mut Option<Moments>) -> Result<(), ExactError> {
        match sums {
            None if self.rows > MAX_ROWS => Err(ExactError::TooManyRows),
            None => {
                *sums = Some(self);
                Ok(())
            }
            Some(sums) => sums.merge(&self),
        }
    }

    /// The sums over the rows that are not among those of `part`, which are rows of these. The
    /// ranges of the channels stay those of all rows.
    pub(super) fn without(&self, part: &Moments) -> Moments {
        let mut rest = self.clone();
        let part = part.in_units_of(self);
        rest.rows -= part.rows;
        for (sum, part) in rest.readings.iter_mut().zip(&part.readings) {
            *sum = sum.wrapping_sub(*part);
        }
        let sums = rest.wrench.iter_mut().chain(&mut rest.squares);
        for (sum, part) in sums.zip(part.wrench.iter().chain(&part.squares)) {
            let values = part.values.iter().map(|value| -value).collect();
            sum.add(&Scaled { exponent: part.exponent, values });
        }
        rest
    }

    /// These sums, of some of the rows of `whole`, with readings counted in its units.
    pub(super) fn in_units_of(&self, whole: &Moments) -> Cow<'_, Moments> {
        let same = self.channels.iter().zip(&whole.channels).all(|(a, b)| a.unit == b.unit);
        if same {
            return Cow::Borrowed(self);
        }
        let units: Vec<Unit> = whole.channels.iter().map(|channel| channel.unit).collect();
        let mut rescaled = self.clone();
        rescaled.rescale(&units);
        Cow::Owned(rescaled)
    }

    /// Counts the readings in finer units.
    pub(super) fn rescale(&mut self, units: &[Unit]) {
        for (i, &unit) in units.iter().enumerate() {
            let by = self.channels[i].unit.ratio(unit);
            if by == 1 {
                continue;
            }
            self.channels[i].rescale(unit);
            let powers: Vec<i128> = (0..=6).map(|e| i128::from(by).wrapping_pow(e)).collect();
            for (sum, e) in self.readings.iter_mut().zip(self.layout.exponents(i)) {
                *sum = sum.wrapping_mul(powers[e]);
            }
            for axis in &mut self.wrench {
                for (sum, e) in axis.values.iter_mut().zip(self.layout.exponents(i)) {
                    if e > 0 {
                        *sum *= BigInt::from(by).pow(e as u32);
                    }
                }
                axis.reduce();
            }
        }
    }

    /// The sums of readings, and for each axis those with the wrench, with the origin of each channel
    /// moved to `origin`.
    pub(super) fn about(&self, origin: &[i64]) -> (Vec<i128>, [Planes; 6]) {
        let wrench = self.wrench.each_ref().map(|axis| {
            let mut planes = Planes::of(&axis.values);
            planes.move_origin(&self.layout, origin);
            planes
        });
        (self.readings_about(origin), wrench)
    }

    /// The sums of readings with the origin of each channel moved to `origin`.
    pub(super) fn readings_about(&self, origin: &[i64]) -> Vec<i128> {
        let mut readings = self.readings.clone();
        self.layout.move_origin(&mut readings, origin);
        readings
    }
}

impl Channel {
    pub(super) fn rescale(&mut self, unit: Unit) {
        if self.lowest <= self.highest {
            let factor = i64::from(self.unit.ratio(unit));
            self.lowest = self.lowest.saturating_mul(factor);
            self.highest = self.highest.saturating_mul(factor);
        }
        self.unit = unit;
    }

    pub(super) fn merge(&mut self, other: &Self) {
        let mut other = *other;
        let unit = self.unit.and(other.unit);
        self.rescale(unit);
        other.rescale(unit);
        self.lowest = self.lowest.min(other.lowest);
        self.highest = self.highest.max(other.highest);
    }

    /// Whether the integers are of 16 bits, with or without sign, or there are none.
    pub(super) fn fits(&self) -> bool {
        self.lowest > self.highest
            || (self.lowest > -(1 << 16)
                && self.highest < 1 << 16
                && self.highest - self.lowest < 1 << 16)
    }

    /// The middle of the range.
    pub(super) fn middle(&self) -> i64 {
        if self.lowest > self.highest { 0 } else { (self.lowest + self.highest + 1).div_euclid(2) }
    }
}

/// How moments are written down: integers as decimal strings, since they exceed what readers of
/// JSON take for numbers.
#[derive(Serialize, Deserialize)]
struct Stored {
    basis: Basis,
    rows: u64,
    channels: Vec<Channel>,
    readings: Vec<String>,
    wrench: Vec<StoredScaled>,
    squares: Vec<StoredScaled>,
}

#[derive(Serialize, Deserialize)]
struct StoredScaled {
    exponent: i32,
    values: Vec<String>,
}

impl From<Moments> for Stored {
    fn from(moments: Moments) -> Self {
        let stored = |scaled: &Scaled| StoredScaled {
            exponent: scaled.exponent,
            values: scaled.values.iter().map(BigInt::to_string).collect(),
        };
        Self {
            basis: moments.basis,
            rows: moments.rows,
            channels: moments.channels,
            readings: moments.readings.iter().map(i128::to_string).collect(),
            wrench: moments.wrench.iter().map(stored).collect(),
            squares: moments.squares.iter().map(stored).collect(),
        }
    }
}

impl TryFrom<Stored> for Moments {
    type Error = String;

    fn try_from(stored: Stored) -> Result<Self, String> {
        if stored.channels.is_empty() || stored.channels.len() > 255 {
            return Err(format!("`{}` channels, expected 1 to 255", stored.channels.len()));
        }
        let mut moments = Moments::new(stored.basis, stored.channels.len());
        let sane = |c: &Channel| c.fits() && c.unit.is_sane();
        if !stored.channels.iter().all(sane) || stored.rows > MAX_ROWS {
            return Err("ranges or rows beyond what can be summed exactly".to_owned());
        }
        let expect = |what: &str, found: usize, expected: usize| {
            (found == expected)
                .then_some(())
                .ok_or_else(|| format!("`{found}` {what}, expected `{expected}`"))
        };
        expect("sums of readings", stored.readings.len(), moments.readings.len())?;
        expect("axes", stored.wrench.len(), moments.wrench.len())?;
        expect("products of axes", stored.squares.len(), moments.squares.len())?;
        for (sum, text) in moments.readings.iter_mut().zip(&stored.readings) {
            *sum = text.parse().map_err(|_| format!("`{text}` is not an integer of 128 bits"))?;
        }
        if moments.readings[0] != i128::from(stored.rows) {
            return Err("the number of rows is not the sum of ones".to_owned());
        }
        let targets = moments.wrench.iter_mut().chain(&mut moments.squares);
        for (sums, stored) in targets.zip(stored.wrench.iter().chain(&stored.squares)) {
            expect("sums of an axis", stored.values.len(), sums.values.len())?;
            for (value, text) in sums.values.iter_mut().zip(&stored.values) {
                *value = text.parse().map_err(|_| format!("`{text}` is not an integer"))?;
            }
            if !(-4000..=4000).contains(&stored.exponent) {
                return Err(format!("exponent `{}` is out of range", stored.exponent));
            }
            *sums = Scaled::new(stored.exponent, std::mem::take(&mut sums.values));
        }
        moments.rows = stored.rows;
        moments.channels = stored.channels;
        Ok(moments)
    }
}

/// `Σ parts_i·2^(width·i)`.
pub(super) fn join(parts: impl DoubleEndedIterator<Item = i128> + Clone, width: u32) -> BigInt {
    let narrow = parts
        .clone()
        .rev()
        .try_fold(0i128, |sum, part| sum.checked_mul(1i128.checked_shl(width)?)?.checked_add(part));
    narrow.map_or_else(
        || parts.rev().fold(BigInt::zero(), |sum, part| (sum << width) + part),
        BigInt::from,
    )
}
