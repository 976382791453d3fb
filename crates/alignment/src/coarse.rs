//! Coarse match of two recordings: all offsets at once, for any map from wrench to readings.
//!
//! Both sides are averaged into bins, differenced (which removes drift and poses) and whitened, so
//! that the columns x of the wrench and y of the readings have unit covariance. At an offset of l bins, a linear map of
//! the wrench explains this share of the readings' changes, with d_x columns x and the energies E in the overlap:
//!
//! ```text
//! R²(l) = Σ_ij c_ij(l)² / (E_x(l)/d_x · E_y(l))      c_ij(l) = Σ_k x_i[k + l] y_j[k]
//! ```
//!
//! R² is the mean square of the canonical correlations, but with whitening over the whole recordings. The *score*
//! weights R² with the share of the readings' energy in the overlap, so that a short overlap cannot win by chance. A
//! match is accepted if its R² is large. Other peaks with nearly the best score are *rivals*, which the refinement has
//! to rule out.

use faer::{Mat, Side as Triangle};
use rustfft::algorithm::Radix4;
use rustfft::num_complex::Complex;
use rustfft::{Fft as _, FftDirection, Length as _};

use super::error::{AlignError, HIGHEST_RATIO, LEAST_EXPLAINED, LEAST_OVERLAP_S};
use super::recording::Clean;

/// The smallest bin width, s: below the duration of a tap.
const BIN_S: f64 = 0.02;
/// Maximum number of rivals. With more, the load is periodic.
const MOST_RIVALS: usize = 4;
/// Changes are clipped to this many standard deviations, so that a damaged frame does not decide.
const CLIP: f64 = 6.0;
/// Directions weaker than this fraction of the strongest are not scaled up to unit variance.
const FLOOR: f64 = 0.02;

#[derive(Clone, Debug)]
pub(super) struct Match {
    /// Reference time minus board time, each since the start of its recording, s.
    pub(super) offset_s: f64,
    pub(super) explained: f64,
    /// Score of the second-best peak relative to the best.
    pub(super) ratio: f64,
    pub(super) rivals: Vec<f64>,
    /// Score against offset (s), relative to the best, for a figure.
    pub(super) scores: Vec<(f64, f64)>,
}

pub(super) fn find_match(
    reference: &Clean,
    board: &Clean,
    (from_s, to_s): (f64, f64),
) -> Result<Match, AlignError> {
    let bin_s = BIN_S.max(1.5 * reference.period_s).max(1.5 * board.period_s);
    let x = Changes::new(reference, bin_s, (0.0, reference.span_s()));
    let y = Changes::new(board, bin_s, (from_s, to_s));
    // Offsets run from −(y.bins − 1) to x.bins − 1.
    let (explained, energy) = explained(&x, &y, 0.5 * LEAST_OVERLAP_S / bin_s);
    let lags = energy.len();
    let most = energy.iter().copied().fold(0.0, f64::max);
    let scores: Vec<f64> = explained.iter().zip(&energy).map(|(r, e)| r * e / most).collect();
    let offset_of = |i: usize| (i as f64 - (y.bins as f64 - 1.0)) * bin_s - from_s;
    let best = argmax(&scores, 0..lags);
    let peak = best.map_or(0.0, |i| scores[i]);
    let Some(best) = best.filter(|&i| explained[i] >= LEAST_EXPLAINED && most > 0.0) else {
        let explained = best.map_or(0.0, |i| explained[i]);
        return Err(AlignError::NoMatch(explained));
    };
    let peaks = peaks(&scores, best, HIGHEST_RATIO * peak);
    let ratio = peaks.first().map_or(0.0, |&i| scores[i] / peak);
    let is_rival = |&&i: &&usize| scores[i] > HIGHEST_RATIO * peak;
    let rivals: Vec<f64> = peaks.iter().filter(is_rival).map(|&i| offset_of(i)).collect();
    if rivals.len() > MOST_RIVALS {
        let (best_s, second_s) = (offset_of(best), rivals[0]);
        return Err(AlignError::Ambiguous { best_s, second_s, ratio });
    }
    Ok(Match {
        offset_s: offset_of(best),
        explained: explained[best],
        ratio,
        rivals,
        scores: (0..lags).map(|i| (offset_of(i), scores[i] / peak)).collect(),
    })
}

fn argmax(values: &[f64], range: std::ops::Range<usize>) -> Option<usize> {
    range.max_by(|&a, &b| values[a].total_cmp(&values[b]))
}

/// Peaks other than `best`, highest first, down to `high`; at most one more than allowed rivals.
fn peaks(scores: &[f64], best: usize, high: f64) -> Vec<usize> {
    let mut left = scores.to_vec();
    let mut peaks = Vec::new();
    let mut last = best;
    while peaks.len() <= MOST_RIVALS {
        let (from, to) = lobe(scores, last);
        left[from..to].fill(0.0);
        let Some(next) = argmax(&left, 0..left.len()).filter(|&i| left[i] > 0.0) else { break };
        peaks.push(next);
        if scores[next] <= high {
            break;
        }
        last = next;
    }
    peaks
}

/// The extent of the peak at `best`: to the first minimum on each side that is below half of it.
fn lobe(scores: &[f64], best: usize) -> (usize, usize) {
    let half = 0.5 * scores[best];
    let is_foot = |i: usize| {
        let next = scores[(i + 1).min(scores.len() - 1)];
        scores[i] < half && scores[i] <= scores[i.saturating_sub(1)] && scores[i] <= next
    };
    let low = (0..best).rev().find(|&i| is_foot(i)).unwrap_or(0);
    let high = (best + 1..scores.len()).find(|&i| is_foot(i)).unwrap_or(scores.len());
    (low, high)
}

struct Changes {
    bins: usize,
    columns: Vec<Vec<f64>>,
    /// Squared length of each change, 0 for none.
    squared: Vec<f64>,
    present: Vec<f64>,
    energy: f64,
}

impl Changes {
    fn new(recording: &Clean, bin_s: f64, (from_s, to_s): (f64, f64)) -> Self {
        let rows = {
            let time = &recording.time_s;
            time.partition_point(|&t| t < from_s)..time.partition_point(|&t| t <= to_s)
        };
        let bin_of = |row: usize| ((recording.time_s[row] - from_s) / bin_s) as usize;
        let bins = rows.clone().next_back().map_or(0, bin_of) + 1;
        let mut count = vec![0.0; bins];
        let usable = || rows.clone().filter(|&row| recording.in_range[row]);
        usable().for_each(|row| count[bin_of(row)] += 1.0);
        let mut present: Vec<f64> = count
            .windows(2)
            .map(|pair| f64::from(u8::from(pair[0] > 0.0 && pair[1] > 0.0)))
            .collect();
        present.push(0.0);
        let mut columns = Vec::new();
        for column in &recording.columns {
            let mut mean = vec![0.0; bins];
            usable().for_each(|row| mean[bin_of(row)] += column[row] / count[bin_of(row)]);
            let mut change = vec![0.0; bins];
            for k in (0..bins - 1).filter(|&k| present[k] > 0.0) {
                change[k] = mean[k + 1] - mean[k];
            }
            columns.push(change);
        }
        whiten(&mut columns, &present);
        let mut squared = vec![0.0; bins];
        let limit = CLIP * CLIP * columns.len() as f64;
        for k in 0..bins {
            let length: f64 = columns.iter().map(|column| column[k] * column[k]).sum();
            let factor = (1.0 / (1.0 + length / limit)).sqrt();
            columns.iter_mut().for_each(|column| column[k] *= factor);
            squared[k] = length * factor * factor;
        }
        let energy = squared.iter().sum();
        Self { bins, columns, squared, present, energy }
    }
}

fn whiten(columns: &mut Vec<Vec<f64>>, present: &[f64]) {
    let rows: f64 = present.iter().sum::<f64>().max(1.0);
    columns.retain_mut(|column| {
        let rms = (column.iter().map(|x| x * x).sum::<f64>() / rows).sqrt();
        column.iter_mut().for_each(|x| *x /= rms);
        rms > 0.0 && rms.is_finite()
    });
    let dims = columns.len();
    if dims == 0 {
        return;
    }
    let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>() / rows;
    let covariance = Mat::from_fn(dims, dims, |i, j| product(&columns[i], &columns[j]));
    let Ok(eigen) = covariance.self_adjoint_eigen(Triangle::Lower) else {
        return;
    };
    let values: Vec<f64> = (0..dims).map(|i| eigen.S()[i].max(0.0)).collect();
    let floor = FLOOR * values.iter().copied().fold(0.0, f64::max);
    let directions = eigen.U();
    *columns = (0..dims)
        .map(|i| {
            let mut sum = vec![0.0; columns[0].len()];
            for (j, column) in columns.iter().enumerate() {
                let factor = directions[(j, i)] / values[i].max(floor).sqrt();
                sum.iter_mut().zip(column).for_each(|(sum, x)| *sum += factor * x);
            }
            sum
        })
        .collect();
}

/// Explained share at each offset, from −(y.bins − 1) on, and energy of the readings in the
/// overlap; zero for fewer than `fewest_bins` bins or hardly any energy.
fn explained(x: &Changes, y: &Changes, fewest_bins: f64) -> (Vec<f64>, Vec<f64>) {
    let fft = Fft::new(x.bins + y.bins - 1, y.bins);
    let xs: Vec<_> = x.columns.iter().map(|column| fft.forward(column)).collect();
    // Σ_ij c_ij².
    let mut squared = vec![0.0; fft.lags];
    for column in &y.columns {
        let column = fft.forward(column);
        for other in &xs {
            for (sum, c) in squared.iter_mut().zip(fft.correlate(other, &column)) {
                *sum += c * c;
            }
        }
    }
    let correlate = |x: &[f64], y: &[f64]| -> Vec<f64> {
        fft.correlate(&fft.forward(x), &fft.forward(y)).collect()
    };
    let overlap = correlate(&x.present, &y.present);
    let x_energy = correlate(&x.squared, &y.present);
    let y_energy = correlate(&x.present, &y.squared);
    let dims = x.columns.len() as f64;
    let at = |i: usize| {
        let (ex, ey) = (x_energy[i], y_energy[i]);
        let is_enough = ex > 1e-6 * x.energy && ey > 1e-6 * y.energy && overlap[i] >= fewest_bins;
        if is_enough { ((squared[i] / (ex / dims * ey)).min(1.0), ey) } else { (0.0, 0.0) }
    };
    (0..fft.lags).map(at).unzip()
}

struct Fft {
    forward: Radix4<f64>,
    inverse: Radix4<f64>,
    lags: usize,
    /// The smallest offset is `1 − behind`.
    behind: usize,
}

impl Fft {
    fn new(lags: usize, behind: usize) -> Self {
        let length = lags.next_power_of_two();
        let [forward, inverse] = [FftDirection::Forward, FftDirection::Inverse]
            .map(|direction| Radix4::new(length, direction));
        Self { forward, inverse, lags, behind }
    }

    fn forward(&self, values: &[f64]) -> Vec<Complex<f64>> {
        let mut spectrum: Vec<_> = values.iter().map(|&value| Complex::new(value, 0.0)).collect();
        spectrum.resize(self.forward.len(), Complex::ZERO);
        self.forward.process(&mut spectrum);
        spectrum
    }

    /// `Σ_k x[k + l] y[k]` for l from −(behind − 1) on.
    fn correlate(&self, x: &[Complex<f64>], y: &[Complex<f64>]) -> impl Iterator<Item = f64> {
        let mut product: Vec<_> = x.iter().zip(y).map(|(x, y)| x * y.conj()).collect();
        self.inverse.process(&mut product);
        let (length, behind) = (product.len(), self.behind);
        (0..self.lags).map(move |i| product[(i + length + 1 - behind) % length].re / length as f64)
    }
}
