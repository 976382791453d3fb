//! Offset and skew to a small part of a sample, by variable projection.
//!
//! Model, for board rows at times t_i with readings y_i:
//!
//! ```text
//! y_i = Bᵀ x(τ_i) + e_i      τ_i = t_i + o + s (t_i − t̄)      e ~ (0, Σ)
//! ```
//!
//! x are the [features](super::response) of the reference, a constant and a drift. For given o and
//! s the map B is a linear least-squares problem; the steps in (o, s) are Gauss–Newton steps
//! with B eliminated (Golub & Pereyra, SIAM J. Numer. Anal. 10, 413, 1973, in Kaufman's form): with d_i = Bᵀ ẋ(τ_i),
//! J = (d, (t − t̄) d) projected off the features, and W = Σ̂⁻¹,
//!
//! ```text
//! H = Jᵀ W J      g = Jᵀ W y      (o, s) ← (o, s) + H⁻¹ g
//! ```
//!
//! All that is needed from the rows is one Gram matrix per step, so that memory does not grow.
//! H⁻¹ would be the covariance of (o, s) if the residuals were white. They are not, where the model of the
//! springs is not theirs; so the covariance is H⁻¹ S H⁻¹ with S the long-run covariance of the scores
//! (Newey & West, Econometrica 55, 703, 1987).

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatRef, Par};

use super::normal::{Projected, inverse};
use super::recording::Clean;
use super::response::Memory;
use super::trajectory::Trajectory;
use super::{AlignError, Excerpt};

/// Rows per Gram update.
const BLOCK: usize = 256;
const STEPS: usize = 40;
/// Residuals correlated over longer than this are drift, which the model has, s.
const CORRELATED_S: f64 = 0.5;
/// Bins that scores are summed in before their correlations are, s.
const SCORE_BIN_S: f64 = 0.01;
/// A row whose residual is farther out than this (squared, per channel) counts less (Huber).
const OUTLIER: f64 = 4.0;
/// The excerpt reaches this far to both sides, s.
const EXCERPT_S: f64 = 0.6;
/// The largest step of the offset, s: features hardly change in less.
const LARGEST_STEP_S: f64 = 0.01;

/// The board's rows that are matched, at the rate of the band that is.
#[derive(Debug)]
pub(super) struct Frames {
    time_s: Vec<f64>,
    /// Row by row.
    readings: Vec<f64>,
    pub(super) channels: usize,
}

impl Frames {
    /// Averages rows that come faster than `rate_hz`.
    pub(super) fn new(board: &Clean, rate_hz: f64) -> Self {
        let moving: Vec<&Vec<f64>> =
            board.columns.iter().filter(|c| c.iter().any(|&x| x != c[0])).collect();
        let mut frames = Self { time_s: vec![], readings: vec![], channels: moving.len() };
        // With a little margin, so that rows at the rate itself are not paired by rounding.
        let cell_s = if rate_hz * board.period_s > 0.75 { 0.0 } else { 1.0 / rate_hz };
        let rows: Vec<usize> = (0..board.time_s.len()).filter(|&row| board.in_range[row]).collect();
        let cell = |row: usize| match cell_s > 0.0 {
            true => (board.time_s[row] / cell_s) as usize,
            false => row,
        };
        for group in rows.chunk_by(|&a, &b| cell(a) == cell(b)) {
            let mean = |column: &[f64]| {
                group.iter().map(|&row| column[row]).sum::<f64>() / group.len() as f64
            };
            frames.time_s.push(mean(&board.time_s));
            frames.readings.extend(moving.iter().map(|column| mean(column)));
        }
        frames
    }

    pub(super) fn row(&self, i: usize) -> (f64, &[f64]) {
        (self.time_s[i], &self.readings[i * self.channels..(i + 1) * self.channels])
    }
}

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
    /// The same if the residuals were white.
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
/// `prior_skew` holds the skew near zero with that standard deviation, where the window is too short
/// to tell it.
pub(super) fn refine(
    trajectory: &Trajectory,
    frames: &Frames,
    start: Warp,
    window: (f64, f64),
    prior_skew: Option<f64>,
) -> Result<Estimate, AlignError> {
    let problem = Problem::new(trajectory, frames, window, start);
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
        if iteration > 1 {
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
            if !(step_s < 10.0) {
                return Err(AlignError::NotConverged { step_s });
            }
            if iteration > 6 && small(0) && small(1) {
                current.weights = projected.weights();
                current.map = projected.map;
                return Ok(problem.finish(warp, white, &current));
            }
        }
        current.weights = projected.weights();
        current.map = projected.map;
        if (2..6).contains(&iteration) {
            let linear = current.map.subrows(2, problem.features - 2);
            current.memory = Memory::of(linear, trajectory.axes());
        }
    }
    Err(AlignError::NotConverged { step_s })
}

struct Problem<'a> {
    trajectory: &'a Trajectory,
    frames: &'a Frames,
    rows: std::ops::Range<usize>,
    features: usize,
    pivot_s: f64,
    half_span_s: f64,
}

/// One row of the board beside what the reference says.
struct Row<'a> {
    /// Time from the pivot, s.
    from_pivot_s: f64,
    features: &'a [f64],
    /// The change of the predicted readings with the offset, counts/s.
    slope: &'a [f64],
    readings: &'a [f64],
    /// What the row counts: 1, or less for an outlier.
    weight: f64,
    residual: &'a [f64],
}

impl<'a> Problem<'a> {
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
            false => (from_s, to_s),
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
    fn for_each(&self, warp: &Warp, current: &Current, mut each: impl FnMut(&Row<'_>)) {
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
            for c in 0..channels {
                let map = current.map.col_as_slice(c);
                let dot = |x: &[f64]| map.iter().zip(x).map(|(m, x)| m * x).sum::<f64>();
                slope[c] = dot(&slopes);
                residual[c] = readings[c] - dot(&features);
            }
            let distance = current.weights.as_ref().map_or(0.0, |weights| {
                let weighted = |a: usize| -> f64 {
                    (0..channels).map(|b| weights[(a, b)] * residual[b]).sum::<f64>() * residual[a]
                };
                (0..channels).map(weighted).sum::<f64>() / channels as f64
            });
            let weight = if distance > OUTLIER { (OUTLIER / distance).sqrt() } else { 1.0 };
            each(&Row {
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
    fn finish(&self, warp: Warp, white: [[f64; 2]; 2], current: &Current) -> Estimate {
        let channels = self.frames.channels;
        let projected = self.project(&warp, current);
        let (along, weights) = match &projected {
            Some(p) => (p.along.clone(), p.weights()),
            None => (Mat::zeros(self.features, 2 * channels), None),
        };
        let weights = weights.unwrap_or_else(|| Mat::identity(channels, channels));
        let mut scores: Vec<[f64; 2]> = Vec::new();
        let mut rows = 0;
        let mut squares = vec![0.0; channels];
        let (mut sum, mut sum_of_squares) = (vec![0.0; channels], vec![0.0; channels]);
        let start_s = -self.half_span_s;
        self.for_each(&warp, current, |row| {
            rows += 1;
            let bin = ((row.from_pivot_s - start_s).max(0.0) / SCORE_BIN_S) as usize;
            if scores.len() <= bin {
                scores.resize(bin + 1, [0.0; 2]);
            }
            for a in 0..channels {
                squares[a] += row.residual[a] * row.residual[a];
                sum[a] += row.readings[a];
                sum_of_squares[a] += row.readings[a] * row.readings[a];
            }
            for parameter in 0..2 {
                let time = if parameter == 0 { 1.0 } else { row.from_pivot_s };
                for a in 0..channels {
                    let column = along.col_as_slice(parameter * channels + a);
                    let fitted: f64 = column.iter().zip(row.features).map(|(c, x)| c * x).sum();
                    let j = row.slope[a] * time - fitted;
                    let wr: f64 = (0..channels).map(|b| weights[(a, b)] * row.residual[b]).sum();
                    scores[bin][parameter] += row.weight * j * wr;
                }
            }
        });
        let long_run = long_run_covariance(&scores, (CORRELATED_S / SCORE_BIN_S) as usize);
        let count = rows as f64;
        let spread = |a: usize| sum_of_squares[a] - sum[a] * sum[a] / count;
        let left: f64 = (0..channels).map(|a| squares[a] / spread(a)).sum();
        Estimate {
            warp,
            covariance: sandwich(white, long_run),
            white,
            residual: squares.iter().map(|s| (s / count).sqrt()).collect(),
            explained: 1.0 - left / channels as f64,
            rows,
            excerpt: self.excerpt(&warp, current),
        }
    }

    /// The channel that changes most between frames, around its steepest change.
    fn excerpt(&self, warp: &Warp, current: &Current) -> Excerpt {
        let mut steepest = (0.0, 0, 0.0);
        self.for_each(warp, current, |row| {
            for (channel, slope) in row.slope.iter().enumerate() {
                if slope.abs() > steepest.0 {
                    steepest = (slope.abs(), channel, row.from_pivot_s);
                }
            }
        });
        let (_, channel, centre_s) = steepest;
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

/// Σ over lags of the scores' covariances, with Bartlett's weights, which keep it positive.
fn long_run_covariance(scores: &[[f64; 2]], longest: usize) -> [[f64; 2]; 2] {
    let mut sum = [[0.0; 2]; 2];
    for lag in 0..=longest.min(scores.len().saturating_sub(1)) {
        let taper = 1.0 - lag as f64 / (longest + 1) as f64;
        for (a, b) in scores.iter().zip(&scores[lag..]) {
            for i in 0..2 {
                for j in 0..2 {
                    let product = a[i] * b[j] + if lag > 0 { a[j] * b[i] } else { 0.0 };
                    sum[i][j] += taper * product;
                }
            }
        }
    }
    sum
}

fn sandwich(bread: [[f64; 2]; 2], filling: [[f64; 2]; 2]) -> [[f64; 2]; 2] {
    let product = |a: [[f64; 2]; 2], b: [[f64; 2]; 2]| {
        [0, 1].map(|i| [0, 1].map(|j| a[i][0] * b[0][j] + a[i][1] * b[1][j]))
    };
    product(product(bread, filling), bread)
}
