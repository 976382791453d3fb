use std::borrow::Cow;
use std::sync::Arc;

use num_bigint::BigInt;

use super::integers::{DigitPlanes, ScaledIntegers};
use super::layout::SumLayout;
use super::readings::{ChannelRange, ReadingUnit};
use crate::error::{ExactError, MAX_ROWS};
use crate::model::Basis;
use crate::reading_ranges::{ReadingRange, ReadingRanges};
use shell_data::wrench::PerAxis;

/// Exact sums, over rows, of products of readings and wrench. They suffice to fit a basis or a smaller one within it.
/// Equal rows give equal sums, however the rows were ordered, split and merged.
///
/// Readings are relative to zero. Arithmetic is modulo 2¹²⁸, which loses nothing: with at most [`MAX_ROWS`] rows and
/// readings below 2¹⁶, a sum is below 2³⁰·2⁹⁶ = 2¹²⁶.
#[derive(Clone, Debug, PartialEq)]
pub struct ExactSums {
    pub(crate) basis: Basis,
    pub(crate) layout: Arc<SumLayout>,
    pub(crate) rows: u64,
    pub(crate) channels: Vec<ChannelRange>,
    /// Sums of the monomials of counted readings, in the order of the layout.
    pub(crate) readings: Vec<i128>,
    /// Sums of the wrench times one and times each feature, for each axis.
    pub(crate) wrench: [ScaledIntegers; 6],
    /// Sums of products of two axes: Fx·Fx, Fx·Fy, …, Mz·Mz.
    pub(crate) squares: Vec<ScaledIntegers>,
}

impl ExactSums {
    pub fn new(basis: Basis, channels: usize) -> Self {
        Self::with_layout(basis, Arc::new(SumLayout::new(basis, channels)))
    }

    pub(crate) fn with_layout(basis: Basis, layout: Arc<SumLayout>) -> Self {
        Self {
            basis,
            rows: 0,
            channels: vec![ChannelRange::EMPTY; layout.channels()],
            readings: vec![0; layout.sums()],
            wrench: std::array::from_fn(|_| ScaledIntegers::zero(layout.features.len() + 1)),
            squares: vec![ScaledIntegers::zero(1); 21],
            layout,
        }
    }

    pub fn rows(&self) -> u64 {
        self.rows
    }

    /// Largest basis that can be fitted.
    pub fn basis(&self) -> Basis {
        self.basis
    }

    pub fn channels(&self) -> usize {
        self.channels.len()
    }

    /// Number of rows and range of each channel, as far as the sums contain them.
    pub fn reading_ranges(&self) -> ReadingRanges {
        let mut ranges = ReadingRanges::new(self.channels.len());
        ranges.rows = self.rows;
        for (of, range) in ranges.channels.iter_mut().zip(&self.channels) {
            let per_count = f64::from(range.unit.per_count());
            if range.lowest <= range.highest {
                let (min, max) =
                    (range.lowest as f64 / per_count, range.highest as f64 / per_count);
                *of = ReadingRange { min, max };
            }
        }
        ranges
    }

    /// Adds the rows of `other`, which must be different rows of the same channels and basis.
    ///
    /// # Errors
    /// [`ExactError`] if the total has too many rows or too wide a range; `self` is then unchanged.
    ///
    /// # Panics
    /// If basis or number of channels differ.
    pub fn merge(&mut self, other: &ExactSums) -> Result<(), ExactError> {
        assert_eq!((self.basis, self.channels.len()), (other.basis, other.channels.len()));
        if self.rows + other.rows > MAX_ROWS {
            return Err(ExactError::TooManyRows);
        }
        let mut merged = self.channels.clone();
        for (channel, other) in merged.iter_mut().zip(&other.channels) {
            channel.merge(other);
        }
        if let Some(channel) = merged.iter().position(|c| !c.fits()) {
            return Err(ExactError::TooWide { channel });
        }
        let units: Vec<ReadingUnit> = merged.iter().map(|channel| channel.unit).collect();
        self.rescale(&units);
        let other = other.in_units(&units);
        self.channels = merged;
        self.rows += other.rows;
        for (sum, other) in self.readings.iter_mut().zip(&other.readings) {
            *sum = sum.wrapping_add(*other);
        }
        let sums = self.wrench.iter_mut().chain(&mut self.squares);
        sums.zip(other.wrench.iter().chain(&other.squares)).for_each(|(sum, other)| sum.add(other));
        Ok(())
    }

    /// Adds these rows to `sums`, or stores them there if it is `None`.
    ///
    /// # Errors
    /// As [`ExactSums::merge`].
    pub fn add_to(self, sums: &mut Option<ExactSums>) -> Result<(), ExactError> {
        match sums {
            None if self.rows > MAX_ROWS => Err(ExactError::TooManyRows),
            None => {
                *sums = Some(self);
                Ok(())
            }
            Some(sums) => sums.merge(&self),
        }
    }

    /// Subtracts `part`, sums over some of these rows. The ranges remain those of all rows.
    pub fn without(&self, part: &ExactSums) -> ExactSums {
        let mut rest = self.clone();
        let part = part.in_units(&self.units());
        rest.rows -= part.rows;
        for (sum, part) in rest.readings.iter_mut().zip(&part.readings) {
            *sum = sum.wrapping_sub(*part);
        }
        let sums = rest.wrench.iter_mut().chain(&mut rest.squares);
        for (sum, part) in sums.zip(part.wrench.iter().chain(&part.squares)) {
            let values = part.values.iter().map(|value| -value).collect();
            sum.add(&ScaledIntegers { exponent: part.exponent, values });
        }
        rest
    }

    pub(crate) fn units(&self) -> Vec<ReadingUnit> {
        self.channels.iter().map(|channel| channel.unit).collect()
    }

    /// Sums in the given units, which must be the same or finer.
    pub(crate) fn in_units(&self, units: &[ReadingUnit]) -> Cow<'_, ExactSums> {
        if self.units() == units {
            return Cow::Borrowed(self);
        }
        let mut rescaled = self.clone();
        rescaled.rescale(units);
        Cow::Owned(rescaled)
    }

    pub(crate) fn rescale(&mut self, units: &[ReadingUnit]) {
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

    /// Sums of readings, and of each axis of the wrench times features, with the origin moved to `origin`.
    pub(crate) fn about(&self, origin: &[i64]) -> (Vec<i128>, PerAxis<DigitPlanes>) {
        let moved = |axis: &ScaledIntegers| self.layout.moved_features(&axis.values, origin);
        (self.readings_about(origin), self.wrench.each_ref().map(moved))
    }

    /// Sums of readings with the origin of each channel moved to `origin`.
    pub(crate) fn readings_about(&self, origin: &[i64]) -> Vec<i128> {
        let mut readings = self.readings.clone();
        self.layout.move_origin(&mut readings, origin);
        readings
    }
}
