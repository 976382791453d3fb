//! Conversion of readings to wrenches with a calibration.

use std::borrow::Cow;

use crate::dynamics::{ReferenceLag, prepared};
use crate::memory::{MemoryState, MemoryTerms, TimeBase};
use least_squares::error::FitError;
use least_squares::model::Model;
use least_squares::polynomial::Polynomial;
use least_squares::reading_ranges::{ReadingRange, ReadingRanges};
use least_squares::scaling::Scaling;
use least_squares::solver::Solution;
use least_squares::uncertainty::Covariance;
use sensor_physics::PhysicsCalibration;
use shell_data::Converter;
use shell_data::dataset::Dataset;
use shell_data::wrench::{Axes, PerAxis};

#[derive(Clone, Debug, PartialEq)]
pub struct Calibration {
    pub kind: Kind,
    /// Axes measured in the training data. Output on other axes is meaningless.
    pub axes: Axes,
    /// Covariance of the errors and coefficients of a polynomial, if known.
    pub covariance: Option<Covariance>,
    pub valid_range: Option<Vec<ReadingRange>>,
    /// Memory terms whose columns must follow those of the readings.
    pub memory: Option<MemoryTerms>,
    /// Lag of the training reference behind the readings. The fit removed it: forces refer to the reading's time.
    pub lag: Option<ReferenceLag>,
}

#[derive(Clone, Debug, PartialEq)]
pub enum Kind {
    Polynomial(Polynomial),
    /// The inverse of a model of the sensors' response to a wrench.
    Physics(Box<PhysicsCalibration>),
}

impl Calibration {
    /// Creates a calibration from coefficients for standardised readings, one entry per
    /// [term](Model::terms), in N and N·m per unit of the feature.
    ///
    /// # Panics
    /// If the numbers of coefficients and terms, or of scalings and channels, differ.
    pub fn new(model: Model, scaling: Scaling, coefficients: Vec<PerAxis<f64>>) -> Self {
        Self::from_kind(Kind::Polynomial(Polynomial::new(model, scaling, coefficients)))
    }

    pub fn from_kind(kind: Kind) -> Self {
        Self { kind, axes: Axes::ALL, covariance: None, valid_range: None, memory: None, lag: None }
    }

    /// Creates a calibration of all six axes, valid over its training ranges, without a covariance.
    pub fn from_solution(solution: &Solution, ranges: &ReadingRanges) -> Self {
        let c = &solution.coefficients;
        let rows = (0..c.nrows()).map(|j| std::array::from_fn(|axis| c[(j, axis)])).collect();
        Self {
            valid_range: Some(ranges.channels[..solution.model.channels].to_vec()),
            ..Self::new(solution.model, solution.scaling.clone(), rows)
        }
    }

    pub fn polynomial(&self) -> Option<&Polynomial> {
        match &self.kind {
            Kind::Polynomial(polynomial) => Some(polynomial),
            Kind::Physics(_) => None,
        }
    }

    /// Name of the model for reports: `cubic + offset`, `physics`.
    pub fn name(&self) -> String {
        match &self.kind {
            Kind::Polynomial(polynomial) => polynomial.model().name(),
            Kind::Physics(_) => "physics".to_owned(),
        }
    }

    /// State of the memory terms before the first row of a log; `None` without memory terms.
    pub fn start_memory(&self) -> Option<MemoryState> {
        self.memory.as_ref().map(MemoryTerms::start)
    }

    pub fn needs_time(&self) -> bool {
        self.memory.as_ref().is_some_and(|memory| memory.time_base == TimeBase::Seconds)
    }

    /// Appends memory terms to the readings, and moves the wrench to the time of the readings for comparisons.
    ///
    /// # Errors
    /// [`FitError::NoTime`] if the time constants are in seconds and a log has no time.
    pub fn prepared(&self, data: &Dataset) -> Result<Dataset, FitError> {
        prepared(data.clone(), self.memory.as_ref(), self.lag)
    }

    /// Appends memory terms of zero if `readings` has columns for the channels only.
    pub(super) fn with_terms<'a>(&self, readings: &'a [Vec<f64>]) -> Cow<'a, [Vec<f64>]> {
        let columns = self.columns();
        if readings.len() != self.channels() || readings.len() == columns {
            return Cow::Borrowed(readings);
        }
        let rows = readings.first().map_or(0, Vec::len);
        let mut all = readings.to_vec();
        all.resize(columns, vec![0.0; rows]);
        Cow::Owned(all)
    }

    /// Number of columns: one per channel, then one per memory term.
    pub fn columns(&self) -> usize {
        match &self.kind {
            Kind::Polynomial(polynomial) => polynomial.model().columns(),
            Kind::Physics(physics) => physics.model().channels,
        }
    }

    pub fn channels(&self) -> usize {
        match &self.kind {
            Kind::Polynomial(polynomial) => polynomial.model().channels,
            Kind::Physics(physics) => physics.model().channels,
        }
    }

    /// Converts every row to an untared wrench, N and N·m, with the same bits on any machine, whatever the other rows.
    ///
    /// `readings`: one column per channel, in counts, then the [memory terms](Self::memory); without these the sensor
    /// is assumed to have been still. `wrench` is resized to the rows, with zeros on axes not in [`Self::axes`].
    ///
    /// # Panics
    /// If `readings` does not have these columns, or they differ in length.
    pub fn wrench(&self, readings: &[Vec<f64>], wrench: &mut PerAxis<Vec<f64>>) {
        let readings = &self.with_terms(readings);
        let rows = self.rows_of(readings);
        match &self.kind {
            Kind::Polynomial(polynomial) => polynomial.wrench(readings, rows, wrench),
            Kind::Physics(physics) => *wrench = physics.estimates(readings).wrench,
        }
        for axis in Axes::ALL.without(self.axes).iter() {
            wrench[axis.index()].fill(0.0);
        }
    }

    /// Flags, for every row, the channels whose reading is outside the training range; none if the range is unknown.
    /// Bit `i` stands for channel `i`, counted from 0; all channels from 63 up share the last bit.
    pub fn out_of_range(&self, readings: &[Vec<f64>]) -> Vec<u64> {
        let mut flags = vec![0; readings.first().map_or(0, Vec::len)];
        for (channel, range) in self.valid_range.iter().flatten().enumerate() {
            let bit = 1 << channel.min(63);
            for (flags, &reading) in flags.iter_mut().zip(&readings[channel]) {
                *flags |= if range.contains(reading) { 0 } else { bit };
            }
        }
        flags
    }

    /// Analogue-to-digital converter, inferred from the training range; 12 bits if this is unknown. `full_scale`
    /// replaces its highest reading. `None` if the readings are not counts and `full_scale` is not given.
    pub fn converter(&self, full_scale: Option<f64>) -> Option<Converter> {
        let found = match &self.valid_range {
            None => Some(Converter::new(4095.0)),
            Some(ranges) => {
                let min = ranges.iter().map(|range| range.min).fold(f64::INFINITY, f64::min);
                let max = ranges.iter().map(|range| range.max).fold(f64::NEG_INFINITY, f64::max);
                Converter::of_extremes(min, max)
            }
        };
        match full_scale {
            None => found,
            Some(high) => Some(Converter { high, ..found.unwrap_or(Converter::new(high)) }),
        }
    }

    /// Number of rows with a reading outside the range of the training data.
    pub fn rows_out_of_range(&self, readings: &[Vec<f64>]) -> u64 {
        match self.valid_range {
            Some(_) => self.out_of_range(readings).iter().filter(|&&of| of != 0).count() as u64,
            None => 0,
        }
    }

    /// Checks the shape that [`Self::wrench`] requires, and returns the number of rows.
    pub(super) fn rows_of(&self, readings: &[Vec<f64>]) -> usize {
        assert_eq!(readings.len(), self.columns(), "one column per channel, and its memory terms");
        let rows = readings.first().map_or(0, Vec::len);
        assert!(readings.iter().all(|column| column.len() == rows), "columns of one length");
        rows
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use least_squares::model::Basis;

    fn calibration(basis: Basis, channels: usize) -> Calibration {
        let model = Model { basis, intercept: true, channels, memory: 0 };
        let scaling = Scaling { centre: vec![50.0; channels], scale: vec![64.0; channels] };
        let coefficients = (0..model.terms().len())
            .map(|j| std::array::from_fn(|axis| (1 + j * 7 + axis * 3) as f64 / 8.0))
            .collect();
        Calibration::new(model, scaling, coefficients)
    }

    #[test]
    fn every_row_gets_the_sum_of_its_terms_whatever_the_number_of_rows() {
        for basis in Basis::ALL {
            let calibration = calibration(basis, 3);
            let polynomial = calibration.polynomial().unwrap();
            for rows in [0, 1, 7, 8, 9, 23] {
                let readings: Vec<Vec<f64>> = (0..3)
                    .map(|c| (0..rows).map(|row| ((row * 31 + c * 17) % 100) as f64).collect())
                    .collect();
                let mut wrench = PerAxis::default();
                calibration.wrench(&readings, &mut wrench);
                for row in 0..rows {
                    let z = |c: &u8| (readings[usize::from(*c)][row] - 50.0) / 64.0;
                    for axis in 0..6 {
                        // All numbers are dyadic with few bits, so every operation is exact.
                        let expected: f64 =
                            std::iter::zip(polynomial.model().terms(), &polynomial.coefficients)
                                .map(|(term, c)| {
                                    c[axis] * term.factors().iter().map(z).product::<f64>()
                                })
                                .sum();
                        assert_eq!(wrench[axis][row], expected);
                    }
                }
            }
        }
    }

    #[test]
    fn readings_outside_the_training_data_are_flagged_channel_by_channel() {
        let mut calibration = calibration(Basis::Linear, 2);
        let readings = [vec![0.0, 5.0, 11.0], vec![1.0, 0.5, 3.5]];
        assert_eq!(calibration.out_of_range(&readings), [0, 0, 0]);
        assert_eq!(calibration.rows_out_of_range(&readings), 0);
        calibration.valid_range =
            Some(vec![ReadingRange { min: 0.0, max: 10.0 }, ReadingRange { min: 1.0, max: 3.0 }]);
        assert_eq!(calibration.out_of_range(&readings), [0, 0b10, 0b11]);
        assert_eq!(calibration.rows_out_of_range(&readings), 2);
    }
}
