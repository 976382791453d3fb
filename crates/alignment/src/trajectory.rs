//! The reference on a fine, even grid, and its features between the grid points.

use super::inner_products::combine;
use super::recording::Clean;
use super::resample::Resampler;
use super::response::{MemoryModel, MemoryResponse};

/// Grid points per output sample: cubics err by < 0.4 % at the cut-off, 1e-5 at a quarter of it.
const PER_OUTPUT: f64 = 4.0;

/// Attenuation of faster loads: small against the noise; a longer kernel would only take longer.
const STOPBAND_DB: f64 = 50.0;

#[derive(Debug)]
pub(super) struct Trajectory {
    pub(super) step_s: f64,
    pub(super) axes: usize,
    values: Vec<f64>,
    valid: Vec<bool>,
    largest: Vec<f64>,
}

impl Trajectory {
    pub(super) fn new(reference: &Clean, rate_hz: f64) -> Self {
        let mut resampler = Resampler::new(reference, rate_hz, 0.0, STOPBAND_DB);
        let step_s = 1.0 / (PER_OUTPUT * rate_hz);
        let points = (reference.span_s() / step_s) as usize + 1;
        let columns = reference.columns.len();
        let mut all = vec![0.0; points * columns];
        let mut valid = vec![false; points];
        for (k, row) in all.chunks_exact_mut(columns).enumerate() {
            valid[k] = resampler.at(k as f64 * step_s, row);
        }
        let count = valid.iter().filter(|&&v| v).count().max(1) as f64;
        let rows =
            || all.chunks_exact(columns).zip(&valid).filter(|(_, v)| **v).map(|(row, _)| row);
        let mean: Vec<f64> =
            (0..columns).map(|axis| rows().map(|row| row[axis]).sum::<f64>() / count).collect();
        let largest: Vec<f64> = (0..columns)
            .map(|axis| rows().map(|row| (row[axis] - mean[axis]).abs()).fold(0.0, f64::max))
            .collect();
        let axes: Vec<usize> = (0..columns).filter(|&axis| largest[axis] > 0.0).collect();
        let mut values = Vec::with_capacity(points * axes.len());
        let mut last = vec![0.0; axes.len()];
        for (row, &valid) in all.chunks_exact(columns).zip(&valid) {
            if valid {
                last = axes.iter().map(|&axis| row[axis] - mean[axis]).collect();
            }
            // Hold the load over a gap; no row of the board is compared with it there.
            values.extend_from_slice(&last);
        }
        let largest = axes.iter().map(|&axis| largest[axis]).collect();
        Self { step_s, axes: axes.len(), values, valid, largest }
    }

    /// The largest load in a direction of the wrench, with each axis scaled to 1.
    pub(super) fn reach(&self, direction: &[f64]) -> f64 {
        let scaled: Vec<f64> = direction.iter().zip(&self.largest).map(|(d, w)| d / w).collect();
        let along = |row: &[f64]| row.iter().zip(&scaled).map(|(w, d)| w * d).sum::<f64>().abs();
        self.values.chunks_exact(self.axes).map(along).fold(0.0, f64::max)
    }

    pub(super) fn span_s(&self) -> f64 {
        self.valid.len() as f64 * self.step_s
    }

    pub(super) fn features(&self, model: MemoryModel) -> FeatureWindow<'_> {
        FeatureWindow {
            trajectory: self,
            width: model.features(),
            response: MemoryResponse::new(&self.largest, self.step_s, model),
            first: 0,
            end: 0,
            rows: Vec::new(),
        }
    }
}

#[derive(Debug)]
pub(super) struct FeatureWindow<'a> {
    trajectory: &'a Trajectory,
    response: MemoryResponse,
    width: usize,
    /// The grid point of the first row held, and the one after the last.
    first: usize,
    end: usize,
    rows: Vec<f64>,
}

impl FeatureWindow<'_> {
    /// Computes features and slopes (1/s) at ascending `time_s`, by cubic interpolation; returns false if there is no
    /// value.
    pub(super) fn at(&mut self, time_s: f64, values: &mut [f64], slopes: &mut [f64]) -> bool {
        let position = time_s / self.trajectory.step_s;
        if !(position >= 1.0 && position < self.trajectory.valid.len() as f64 - 2.0) {
            return false;
        }
        let k = position as usize - 1;
        if !self.trajectory.valid[k..k + 4].iter().all(|&v| v) {
            return false;
        }
        self.advance(k);
        let x = position - (k + 1) as f64;
        // Lagrange's polynomials through −1, 0, 1, 2, and their derivatives.
        let weights = [
            -x * (x - 1.0) * (x - 2.0) / 6.0,
            (x + 1.0) * (x - 1.0) * (x - 2.0) / 2.0,
            -x * (x + 1.0) * (x - 2.0) / 2.0,
            x * (x + 1.0) * (x - 1.0) / 6.0,
        ];
        let per_s = 1.0 / self.trajectory.step_s;
        let slope_weights = [
            -(3.0 * x * x - 6.0 * x + 2.0) / 6.0 * per_s,
            (3.0 * x * x - 4.0 * x - 1.0) / 2.0 * per_s,
            -(3.0 * x * x - 2.0 * x - 2.0) / 2.0 * per_s,
            (3.0 * x * x - 1.0) / 6.0 * per_s,
        ];
        let start = (k - self.first) * self.width;
        let stencil = &self.rows[start..start + 4 * self.width];
        combine(stencil, [weights, slope_weights], values, slopes);
        true
    }

    fn advance(&mut self, k: usize) {
        const KEPT: usize = 256;
        if k > self.first + KEPT {
            let drop = (k.min(self.end) - self.first) * self.width;
            self.rows.drain(..drop);
            self.first = k.min(self.end);
        }
        let axes = self.trajectory.axes;
        while self.end < k + 4 {
            let wrench = &self.trajectory.values[self.end * axes..(self.end + 1) * axes];
            let start = self.rows.len();
            self.rows.resize(start + self.width, 0.0);
            self.response.next(wrench, &mut self.rows[start..]);
            self.end += 1;
            // On the way to a distant k no row needs to be kept.
            if self.end <= k {
                self.rows.clear();
                self.first = self.end;
            }
        }
    }
}
