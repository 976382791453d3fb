//! Applying a calibration: from readings to wrenches.

use pulp::{Arch, NullaryFnOnce, Simd, WithSimd};

use super::features::{Features, LANES, RowLanes};
use super::model::Model;
use super::reading_ranges::{ReadingRange, ReadingRanges};
use super::scaling::Scaling;
use super::solver::Solution;
use super::uncertainty::Covariance;
use shell_data::wrench::PerAxis;

/// A fitted model and what is needed to apply and to trust it.
#[derive(Clone, Debug, PartialEq)]
pub struct Calibration {
    features: Features,
    coefficients: Vec<PerAxis<f64>>,
    /// The covariance of errors and coefficients, where it is known.
    pub covariance: Option<Covariance>,
    /// The range of each channel in the training data, where that is known.
    pub valid_range: Option<Vec<ReadingRange>>,
}

impl Calibration {
    /// A calibration from coefficients for standardised readings.
    ///
    /// `coefficients` has one entry per [term](Model::terms), in N and N·m per unit of the feature.
    ///
    /// # Panics
    /// If there are not as many coefficients as terms, or as many scalings as channels.
    pub fn new(model: Model, scaling: Scaling, coefficients: Vec<PerAxis<f64>>) -> Self {
        let features = Features::new(model, scaling);
        assert_eq!(coefficients.len(), features.len(), "one row of coefficients per term");
        Self { features, coefficients, covariance: None, valid_range: None }
    }

    /// The calibration that a solver has found, valid over the ranges of its training data, without
    /// a covariance.
    pub fn of_solution(solution: &Solution, ranges: &ReadingRanges) -> Self {
        let c = &solution.coefficients;
        let rows = (0..c.nrows()).map(|j| std::array::from_fn(|axis| c[(j, axis)])).collect();
        Self {
            valid_range: Some(ranges.channels.clone()),
            ..Self::new(solution.model, solution.scaling.clone(), rows)
        }
    }

    /// The model.
    pub fn model(&self) -> Model {
        self.features.model()
    }

    /// The scaling of the readings.
    pub fn scaling(&self) -> &Scaling {
        self.features.scaling()
    }

    /// The features that the coefficients are for.
    pub fn features(&self) -> &Features {
        &self.features
    }

    /// One row per [term](Model::terms), in N and N·m per unit of the feature of standardised
    /// readings.
    pub fn coefficients(&self) -> &[PerAxis<f64>] {
        &self.coefficients
    }

    /// The wrench of every row, untared: `W = X(s)·C`, N and N·m.
    ///
    /// `readings` has one column per channel, in counts; `wrench` is made as long as they are. The
    /// sum over features is one fused multiply-add each, so the bits are the same on any machine.
    ///
    /// # Panics
    /// If `readings` are not the model's channels, or of different lengths.
    pub fn wrench(&self, readings: &[Vec<f64>], wrench: &mut PerAxis<Vec<f64>>) {
        let rows = self.rows_of(readings);
        wrench.iter_mut().for_each(|axis| axis.resize(rows, 0.0));
        let features = vec![[0.0; LANES]; self.features.len()];
        Arch::new().dispatch(Convert { calibration: self, readings, rows, features, wrench });
    }

    /// For every row, the channels whose reading lies outside the range of the training data: bit
    /// `i` for channel `i` from 0, all channels from 63 up sharing the last bit. Zero where the
    /// range is not known.
    pub fn out_of_range(&self, readings: &[Vec<f64>]) -> Vec<u64> {
        let mut flags = vec![0; self.rows_of(readings)];
        for (channel, range) in self.valid_range.iter().flatten().enumerate() {
            let bit = 1 << channel.min(63);
            for (flags, &reading) in flags.iter_mut().zip(&readings[channel]) {
                *flags |= if range.contains(reading) { 0 } else { bit };
            }
        }
        flags
    }

    /// The number of rows with a reading outside the range of the training data.
    ///
    /// # Panics
    /// If `readings` are not the model's channels, or of different lengths.
    pub fn rows_out_of_range(&self, readings: &[Vec<f64>]) -> u64 {
        let rows = self.rows_of(readings);
        let columns = readings.iter().zip(self.valid_range.iter().flatten());
        // Where a calibration is used as it should be, there is no such column.
        let arch = Arch::new();
        let outside: Vec<_> = columns
            .filter(|&(column, &range)| arch.dispatch(LeavesRange { column, range }))
            .collect();
        if outside.is_empty() {
            return 0;
        }
        let is_outside = |row: &usize| outside.iter().any(|(c, range)| !range.contains(c[*row]));
        (0..rows).filter(is_outside).count() as u64
    }

    /// Number of rows, after a check of the shape that callers promise.
    pub(super) fn rows_of(&self, readings: &[Vec<f64>]) -> usize {
        assert_eq!(readings.len(), self.model().channels, "one column per channel");
        let rows = readings.first().map_or(0, Vec::len);
        assert!(readings.iter().all(|column| column.len() == rows), "columns of one length");
        rows
    }
}

/// The loop over rows, inlined whole into code for the widest vectors of the machine.
struct Convert<'a> {
    calibration: &'a Calibration,
    readings: &'a [Vec<f64>],
    rows: usize,
    features: Vec<RowLanes>,
    wrench: &'a mut PerAxis<Vec<f64>>,
}

impl WithSimd for Convert<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Convert { calibration, readings, rows, mut features, wrench } = self;
        for start in (0..rows).step_by(LANES) {
            calibration.features.lanes(readings, start, &mut features);
            let mut sums = [[0.0; LANES]; 6];
            // Two vectors of rows at a time: their twelve sums stay in registers, and are as many as
            // it takes for none to wait for its last addition.
            for vector in (0..LANES / S::F64_LANES).step_by(2) {
                let mut vectors = [[simd.splat_f64s(0.0); 2]; 6];
                for (feature, coefficients) in features.iter().zip(&calibration.coefficients) {
                    let feature = S::as_simd_f64s(feature).0;
                    let x = [feature[vector], feature[vector + 1]];
                    for (sums, &c) in vectors.iter_mut().zip(coefficients) {
                        let c = simd.splat_f64s(c);
                        *sums = [0, 1].map(|i| simd.mul_add_f64s(x[i], c, sums[i]));
                    }
                }
                for (lanes, sums) in sums.iter_mut().zip(vectors) {
                    S::as_mut_simd_f64s(lanes).0[vector..vector + 2].copy_from_slice(&sums);
                }
            }
            for (axis, sums) in wrench.iter_mut().zip(&sums) {
                match axis[start..].first_chunk_mut() {
                    Some(lanes) => *lanes = *sums,
                    None => axis[start..].copy_from_slice(&sums[..rows - start]),
                }
            }
        }
    }
}

/// Whether any reading of a channel lies outside a range, inlined whole into code for the widest
/// vectors of the machine.
struct LeavesRange<'a> {
    column: &'a [f64],
    range: ReadingRange,
}

impl NullaryFnOnce for LeavesRange<'_> {
    type Output = bool;

    #[inline(always)]
    fn call(self) -> bool {
        let Self { column, range } = self;
        column.iter().fold(false, |any, &s| any | !range.contains(s))
    }
}

#[cfg(test)]
mod tests {
    use super::super::model::Basis;
    use super::*;

    fn calibration(basis: Basis, channels: usize) -> Calibration {
        let model = Model { basis, intercept: true, channels };
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
            for rows in [0, 1, 7, 8, 9, 23] {
                let readings: Vec<Vec<f64>> = (0..3)
                    .map(|c| (0..rows).map(|row| ((row * 31 + c * 17) % 100) as f64).collect())
                    .collect();
                let mut wrench = PerAxis::default();
                calibration.wrench(&readings, &mut wrench);
                for row in 0..rows {
                    let z = |c: &u8| (readings[usize::from(*c)][row] - 50.0) / 64.0;
                    for axis in 0..6 {
                        // Dyadic numbers of few bits: every operation is exact.
                        let expected: f64 =
                            std::iter::zip(calibration.model().terms(), calibration.coefficients())
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
