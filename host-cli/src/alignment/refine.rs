//! Offset and skew to a small part of a sample, by variable projection.
//!
//! Model, for board rows at times t_i with readings y_i:
//!
//! ```text
//! y_i = Bᵀ x(τ_i) + e_i      τ_i = t_i + o + s (t_i − t̄)      e ~ (0, Σ)
//! ```
//!
//! x are the [features](super::response) of the reference, a constant and a drift. For given o and
//! s the map B is a linear least-squares problem; the steps in (o, s) are Gauss–Newton steps with B
//! eliminated (Golub & Pereyra, SIAM J. Numer. Anal. 10, 413, 1973, in Kaufman's form): with d_i =
//! Bᵀ ẋ(τ_i), J = (d, (t − t̄) d) projected off the features, and W = Σ̂⁻¹,
//!
//! ```text
//! H = Jᵀ W J      g = Jᵀ W y      (o, s) ← (o, s) + H⁻¹ g
//! ```
//!
//! All that is needed from the rows is one Gram matrix per step, so that memory does not grow. H⁻¹
//! would be the covariance of (o, s) if the residuals were white. They are not, where the model of
//! the springs is not theirs; so the covariance is H⁻¹ S H⁻¹ with S the long-run covariance of the
//! scores (Newey & West, Econometrica 55, 703, 1987).

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatRef, Par};

use super::error::{AlignError, LEAST_OVERLAP_S};
use super::excerpt::Excerpt;
use super::frames::Frames;
use super::matched_row::MatchedRow;
use super::normal::{Projected, inverse};
use super::response::Memory;
use super::trajectory::Trajectory;
use super::uncertainty::ResidualSums;
use super::wide::dots;

/// Rows per Gram update.
const BLOCK: usize = 256;
const STEPS: usize = 40;
/// In the first steps the memory of the springs is found as well; then it stays, so that the steps
/// can settle.
const MEMORY_STEPS: usize = 4;
/// A row whose residual is farther out than this (squared, per channel) counts less (Huber).
const OUTLIER: f64 = 4.0;
/// A step as long as this has lost the match, s.
const LOST_S: f64 = 10.0;
/// The excerpt reaches this far to both sides, s.
const EXCERPT_S: f64 = 0.6;
/// The largest step of the offset, s: features hardly change in less.
const LARGEST_STEP_S: f64 = 0.01;

/// From board time to reference time, both since the start of their recording.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Warp {
    pub(super) offset_s: f64,
    pub(super) skew: f64,
    /// Where the offset is that, s of board time.
    pub(super) pivot_s: f64,
}

impl Warp {
    pub(super) fn apply(&self, time_s: f64) -> f64 {
        time_s + self.offset_s + self.skew * (time_s - self.pivot_s)
    }

    /// The same warp, written about another time.
    pub(super) fn about(&self, pivot_s: f64) -> Self {
        let offset_s = self.offset_s + self.skew * (pivot_s - self.pivot_s);
        Self { offset_s, pivot_s, ..*self }
    }
}

/// What the rows say about the warp.
#[derive(Clone, Debug)]
pub(super) struct Estimate {
    pub(super) warp: Warp,
    /// Covariance of offset (s) and skew.
    pub(super) covariance: [[f64; 2]; 2],
    /// How late the springs make the readings, which the model takes off, s.
    pub(super) delay_s: f64,
    /// The covariance if the residuals were white.
    pub(super) white: [[f64; 2]; 2],
    /// RMS residual of each channel, counts.
    pub(super) residual: Vec<f64>,
    /// Share of the readings' variance explained.
    pub(super) explained: f64,
    pub(super) rows: usize,
    /// Times since the start of the board's recording.
    pub(super) excerpt: Excerpt,
}

/// The map from features to readings and the weights of the channels, so far.
struct Current {
    map: Mat<f64>,
    weights: Option<Mat<f64>>,
    memory: Memory,
}

/// Fits the warp, from near it, to the rows with board times in `window`.
///
/// `prior_skew` holds the skew near zero with that standard deviation, where the window is too
/// short to tell it.
pub(super) fn refine(
    trajectory: &Trajectory,
    frames: &Frames,
    start: Warp,
    window: (f64, f64),
    prior_skew: Option<f64>,
) -> Result<Estimate, AlignError> {
    let problem = WarpProblem::new(trajectory, frames, window, start);
    let overlap_s = 2.0 * problem.half_span_s;
    if overlap_s < LEAST_OVERLAP_S {
        return Err(AlignError::ShortOverlap { overlap_s, needed_s: LEAST_OVERLAP_S });
    }
    let mut warp = start.about(problem.pivot_s);
    let mut current = Current {
        map: Mat::zeros(problem.features, frames.channels),
        weights: None,
        memory: Memory::none(trajectory.axes()),
    };
    let mut step_s = f64::INFINITY;
    for iteration in 0..STEPS {
        let Some(projected) = problem.project(&warp, &current) else {
            return Err(AlignError::NotConverged { step_s });
        };
        let (mut hessian, mut gradient) = projected.normal_equations();
        // Before the first map there are no slopes.
        if iteration > 0 {
            if let Some(sd) = prior_skew {
                hessian[1][1] += 1.0 / (sd * sd);
                gradient[1] -= warp.skew / (sd * sd);
            }
            let Some(white) = inverse(hessian) else {
                return Err(AlignError::NotConverged { step_s });
            };
            let full = [0, 1].map(|i| white[i][0] * gradient[0] + white[i][1] * gradient[1]);
            let damping = (LARGEST_STEP_S / full[0].abs().max(1e-300)).min(1.0);
            warp.offset_s += damping * full[0];
            warp.skew = (warp.skew + damping * full[1]).clamp(-2e-3, 2e-3);
            step_s = full[0].abs();
            let small = |i: usize| full[i] * full[i] < 1e-4 * white[i][i];
            if step_s.is_nan() || step_s > LOST_S {
                return Err(AlignError::NotConverged { step_s });
            }
            if iteration > MEMORY_STEPS && small(0) && small(1) {
                current.weights = projected.weights();
                current.map.copy_from(&projected.map);
                return Ok(problem.finish(warp, white, &projected, &current));
            }
        }
        current.weights = projected.weights();
        current.map = projected.map;
        if iteration < MEMORY_STEPS {
            let linear = current.map.subrows(2, problem.features - 2);
            current.memory = Memory::of(linear, trajectory.axes());
        }
    }
    Err(AlignError::NotConverged { step_s })
}

struct WarpProblem<'a> {
    trajectory: &'a Trajectory,
    frames: &'a Frames,
    rows: std::ops::Range<usize>,
    features: usize,
    pivot_s: f64,
    half_span_s: f64,
}

impl<'a> WarpProblem<'a> {
    fn new(
        trajectory: &'a Trajectory,
        frames: &'a Frames,
        (from_s, to_s): (f64, f64),
        near: Warp,
    ) -> Self {
        let first = frames.time_s.partition_point(|&t| t < from_s);
        let last = frames.time_s.partition_point(|&t| t <= to_s);
        // The middle of what overlaps, which the offset is nearly independent of the skew about.
        let inside = |i: &usize| {
            let tau = near.apply(frames.time_s[*i]);
            tau >= 0.0 && tau <= trajectory.span_s()
        };
        let begin = (first..last).find(inside).unwrap_or(first);
        let end = (first..last).rev().find(inside).map_or(last, |i| i + 1);
        let (begin_s, end_s) = match begin < end {
            true => (frames.time_s[begin], frames.time_s[end - 1]),
            false => (from_s, from_s),
        };
        Self {
            trajectory,
            frames,
            rows: begin..end,
            features: trajectory.feature_count() + 2,
            pivot_s: 0.5 * (begin_s + end_s),
            half_span_s: (0.5 * (end_s - begin_s)).max(1e-9),
        }
    }

    /// Calls `each` with every row that the reference has a value for.
    fn for_each(&self, warp: &Warp, current: &Current, mut each: impl FnMut(&MatchedRow<'_>)) {
        let channels = self.frames.channels;
        let mut window = self.trajectory.features(current.memory.clone());
        let mut features = vec![0.0; self.features];
        let mut slopes = vec![0.0; self.features];
        let (mut slope, mut residual) = (vec![0.0; channels], vec![0.0; channels]);
        features[0] = 1.0;
        for i in self.rows.clone() {
            let (time_s, readings) = self.frames.row(i);
            if !window.at(warp.apply(time_s), &mut features[2..], &mut slopes[2..]) {
                continue;
            }
            let from_pivot_s = time_s - self.pivot_s;
            features[1] = from_pivot_s / self.half_span_s;
            let map = || (0..channels).map(|c| current.map.col_as_slice(c));
            dots(&slopes, map(), &mut slope);
            dots(&features, map(), &mut residual);
            residual.iter_mut().zip(readings).for_each(|(fitted, y)| *fitted = y - *fitted);
            let distance = current.weights.as_ref().map_or(0.0, |weights| {
                let weighted = |a: usize| -> f64 {
                    (0..channels).map(|b| weights[(a, b)] * residual[b]).sum::<f64>() * residual[a]
                };
                (0..channels).map(weighted).sum::<f64>() / channels as f64
            });
            let weight = if distance > OUTLIER { (OUTLIER / distance).sqrt() } else { 1.0 };
            each(&MatchedRow {
                from_pivot_s,
                features: &features,
                slope: &slope,
                readings,
                weight,
                residual: &residual,
            });
        }
    }

    /// The Gram matrix of features, slopes, slopes times time, and readings, projected off the
    /// features.
    fn project(&self, warp: &Warp, current: &Current) -> Option<Projected> {
        let channels = self.frames.channels;
        let width = self.features + 3 * channels;
        let mut gram = Mat::<f64>::zeros(width, width);
        let mut block = Vec::with_capacity(BLOCK * width);
        let mut total = 0.0;
        let mut add = |block: &mut Vec<f64>| {
            let rows = MatRef::from_row_major_slice(block, block.len() / width, width);
            matmul(gram.as_mut(), Accum::Add, rows.transpose(), rows, 1.0, Par::Seq);
            block.clear();
        };
        self.for_each(warp, current, |row| {
            let root = row.weight.sqrt();
            block.extend(row.features.iter().map(|x| root * x));
            block.extend(row.slope.iter().map(|d| root * d));
            block.extend(row.slope.iter().map(|d| root * row.from_pivot_s * d));
            block.extend(row.readings.iter().map(|y| root * y));
            total += row.weight;
            if block.len() == BLOCK * width {
                add(&mut block);
            }
        });
        add(&mut block);
        Projected::new(&gram, self.features, channels, total)
    }

    /// Uncertainty and figures of merit at the solution.
    fn finish(
        &self,
        warp: Warp,
        white: [[f64; 2]; 2],
        projected: &Projected,
        current: &Current,
    ) -> Estimate {
        let channels = self.frames.channels;
        let weights = projected.weights().unwrap_or_else(|| Mat::identity(channels, channels));
        let linear = current.map.subrows(2, self.features - 2);
        let mut sums = ResidualSums::new(&projected.along, &weights, linear, -self.half_span_s);
        self.for_each(&warp, current, |row| sums.add(row, self.trajectory.axes()));
        let (covariance, delay_s) = sums.covariance(white);
        let (channel, centre_s) = sums.steepest();
        Estimate {
            warp,
            covariance,
            white,
            delay_s,
            residual: sums.residual(),
            explained: sums.explained(),
            rows: sums.rows,
            excerpt: self.excerpt(&warp, current, channel, centre_s),
        }
    }

    /// A channel around a time from the pivot.
    fn excerpt(&self, warp: &Warp, current: &Current, channel: usize, centre_s: f64) -> Excerpt {
        let mut points = Vec::new();
        self.for_each(warp, current, |row| {
            if (row.from_pivot_s - centre_s).abs() <= EXCERPT_S {
                let reading = row.readings[channel];
                let time_s = row.from_pivot_s + self.pivot_s;
                points.push([time_s, reading, reading - row.residual[channel]]);
            }
        });
        Excerpt { channel, points }
    }
}
