//! Estimates offset and skew to a small part of a sample, by variable projection.
//!
//! Model, for board rows at times t_i with readings y_i:
//!
//! ```text
//! y_i = Bᵀ x(τ_i) + e_i      τ_i = t_i + o + s (t_i − t̄)      e ~ (0, Σ)
//! ```
//!
//! y are the [straightened](super::optics) readings, x the [features](super::response) of the
//! reference, a constant and a drift. For given o and s the map B is a linear least-squares
//! problem. The steps in (o, s) are Gauss–Newton steps with B eliminated (Golub & Pereyra, SIAM J.
//! Numer. Anal. 10, 413, 1973, in Kaufman's form): with d_i = Bᵀ ẋ(τ_i), J = (d, (t − t̄) d)
//! projected off the features, and W = Σ̂⁻¹,
//!
//! ```text
//! H = Jᵀ W J      g = Jᵀ W y      (o, s) ← (o, s) + H⁻¹ g
//! ```
//!
//! Each step needs one Gram matrix over the rows. H⁻¹ would be the covariance of (o, s) for white
//! residuals, which an inexact model of the springs prevents. The covariance is therefore H⁻¹ S H⁻¹
//! with the long-run covariance S of the scores (Newey & West, Econometrica 55, 703, 1987),
//! increased by the model errors in [`choice`](super::choice) and
//! [`uncertainty`](super::uncertainty).
//!
//! Three rounds follow. The first has memories on the axes, and finds the directions that channels sense. The second
//! has all kinds of memory, and the third has those that the readings need.

use faer::{Mat, MatRef};

use super::choice::Candidates;
use super::error::{AlignError, LEAST_OVERLAP_S};
use super::inner_products::dots;
use super::normal::{GramSums, Projected, explained_elsewhere, inverse};
use super::optics::{Bend, POWERS, Straight};
use super::recording::BoardFrames;
use super::response::{Family, MemoryModel};
use super::trajectory::Trajectory;
use super::uncertainty::{MatchedRow, ResidualSums, Solution};
use super::{Excerpt, Quality};

const BLOCK: usize = 256;
const STEPS: usize = 40;
/// Number of features that do not depend on the load: a constant and a drift.
const CONSTANTS: usize = 2;
/// Number of first steps that also estimate the share of the memory in the products. Later steps keep it.
const MEMORY_STEPS: usize = 4;
/// Steps are small below this share of the standard error for white residuals.
const SMALL: f64 = 0.01;
/// Models are compared once steps are this small.
const ROUGH: f64 = 0.1;
/// Number of full steps. Later ones are halved, because bends and outlier weights may oscillate with them.
const FULL_STEPS: usize = 8;
/// The minimum number of rows per feature for a trial of all kinds of memory.
const ROWS_PER_FEATURE: usize = 4;
/// Lower limit of the slope that converts residuals of straightened readings to raw ones for the figure.
const LEAST_GAIN: f64 = 0.1;
/// A row with a larger residual (squared, per channel) is downweighted (Huber).
const OUTLIER: f64 = 4.0;
/// Oscillating steps below this, s, are accepted: jumps of the load give the objective corners.
const NEARLY_S: f64 = 5e-4;
/// A step of this length has lost the match, s.
const LOST_S: f64 = 10.0;
/// Number of parts of the overlap, each explained by the others.
const PARTS: usize = 5;
const EXCERPT_S: f64 = 0.6;
/// The largest step of the offset, s: features hardly change over a shorter one.
const LARGEST_STEP_S: f64 = 0.01;

/// The map from board time to reference time, each since the start of its recording.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Warp {
    pub(super) offset_s: f64,
    pub(super) skew: f64,
    pub(super) pivot_s: f64,
}

impl Warp {
    pub(super) fn apply(&self, time_s: f64) -> f64 {
        time_s + self.offset_s + self.skew * (time_s - self.pivot_s)
    }

    pub(super) fn about(&self, pivot_s: f64) -> Self {
        let offset_s = self.offset_s + self.skew * (pivot_s - self.pivot_s);
        Self { offset_s, pivot_s, ..*self }
    }
}

#[derive(Clone, Debug)]
pub(super) struct WarpEstimate {
    pub(super) warp: Warp,
    pub(super) covariance: [[f64; 2]; 2],
    /// Quality without the results of the search. Times are since the start of the board's recording.
    pub(super) quality: Quality,
}

struct KnownSensor {
    map: Mat<f64>,
    weights: Option<Mat<f64>>,
    bends: Vec<Bend>,
    model: MemoryModel,
    keep: Vec<bool>,
}

impl KnownSensor {
    fn new(axes: usize, channels: usize) -> Self {
        let model = MemoryModel::on_axes(axes);
        let features = CONSTANTS + model.features();
        let of_load = model.families();
        // Quick lags take part only in the comparison of models.
        let is_kept = |family: &Option<Family>| *family != Some(Family::QuickLags);
        let keep = [true; CONSTANTS].into_iter().chain(of_load.iter().map(is_kept));
        Self {
            keep: keep.collect(),
            map: Mat::zeros(features, channels),
            weights: None,
            bends: vec![[0.0; POWERS]; channels],
            model,
        }
    }

    /// Adds plays beyond those on the axes. Their share is not yet known.
    fn with_channels(mut self, trajectory: &Trajectory) -> Self {
        let linear = linear(&self.map);
        self.model = self.model.with_channels(linear, |direction| trajectory.reach(direction));
        let features = CONSTANTS + self.model.features();
        self.map.resize_with(features, self.map.ncols(), |_, _| 0.0);
        self.keep.resize(features, true);
        self
    }

    fn families(&self) -> Vec<Option<Family>> {
        let mut families = vec![None; CONSTANTS];
        families.extend(self.model.families());
        families
    }

    fn learn(&mut self, projected: &Projected) {
        self.weights = projected.weights();
        self.map.copy_from(&projected.map);
        self.bends.clone_from(&projected.bends);
    }
}

fn linear(map: &Mat<f64>) -> MatRef<'_, f64> {
    map.subrows(CONSTANTS, map.nrows() - CONSTANTS)
}

struct SettledWarp {
    gram: GramSums,
    projected: Projected,
    /// H⁻¹.
    white: [[f64; 2]; 2],
    /// The last step of the offset (s) and the skew, if the steps oscillate.
    left: [f64; 2],
}

/// Fits the warp to the rows with board times in `window`, starting nearby. `prior_skew` is for
/// windows too short for the skew, with memories on the axes only.
pub(super) fn refine(
    trajectory: &Trajectory,
    frames: &BoardFrames,
    start: Warp,
    window: (f64, f64),
    prior_skew: Option<f64>,
) -> Result<WarpEstimate, AlignError> {
    let problem = WarpProblem::new(trajectory, frames, window, start);
    let overlap_s = 2.0 * problem.half_span_s;
    if overlap_s < LEAST_OVERLAP_S {
        return Err(AlignError::ShortOverlap(overlap_s));
    }
    let mut current = KnownSensor::new(trajectory.axes, frames.channels);
    let mut warp = start.about(problem.pivot_s);
    let mut settled = problem.settle(&mut warp, &mut current, prior_skew, (MEMORY_STEPS, SMALL))?;
    let mut spread = [0.0; 2];
    if prior_skew.is_none() {
        let all = MemoryModel::most_features(trajectory.axes, frames.channels);
        if problem.rows.len() >= ROWS_PER_FEATURE * all {
            current = current.with_channels(trajectory);
            settled = problem.settle(&mut warp, &mut current, None, (0, ROUGH))?;
        }
        let families = current.families();
        if let Some(chosen) = Candidates::new(&settled.gram, &families, frames.channels).best() {
            current.keep.clone_from(chosen);
            settled = problem.settle(&mut warp, &mut current, None, (0, SMALL))?;
            // Compare once more, with the slopes of the chosen model.
            let candidates = Candidates::new(&settled.gram, &families, frames.channels);
            spread = candidates.spread_about(&current.keep);
        }
    }
    let spread = std::array::from_fn(|i| spread[i] + settled.left[i] * settled.left[i]);
    Ok(problem.finish(warp, &settled, &current, spread))
}

struct WarpProblem<'a> {
    trajectory: &'a Trajectory,
    frames: &'a BoardFrames,
    rows: std::ops::Range<usize>,
    pivot_s: f64,
    half_span_s: f64,
}

impl<'a> WarpProblem<'a> {
    fn new(
        trajectory: &'a Trajectory,
        frames: &'a BoardFrames,
        (from_s, to_s): (f64, f64),
        near: Warp,
    ) -> Self {
        let first = frames.time_s.partition_point(|&t| t < from_s);
        let last = frames.time_s.partition_point(|&t| t <= to_s);
        // The middle of the overlap, at which the offset is nearly independent of the skew.
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
            pivot_s: 0.5 * (begin_s + end_s),
            half_span_s: (0.5 * (end_s - begin_s)).max(1e-9),
        }
    }

    /// Takes Gauss–Newton steps until they are `small`, updating map, weights, bends and, in the
    /// first `memory_steps`, shares of the memory.
    fn settle(
        &self,
        warp: &mut Warp,
        current: &mut KnownSensor,
        prior_skew: Option<f64>,
        (memory_steps, small): (usize, f64),
    ) -> Result<SettledWarp, AlignError> {
        let mut step_s = f64::INFINITY;
        let mut nearly = None;
        for iteration in 0..STEPS {
            let gram = self.gram(warp, current);
            let Some(projected) = Projected::new(&gram, |i| current.keep[i]) else {
                return Err(AlignError::NotConverged(step_s));
            };
            let (mut hessian, mut gradient) = projected.normal_equations();
            // Before the first map there are no slopes.
            let has_slopes = current.weights.is_some();
            current.learn(&projected);
            if has_slopes {
                if let Some(sd) = prior_skew {
                    hessian[1][1] += 1.0 / (sd * sd);
                    gradient[1] -= warp.skew / (sd * sd);
                }
                let Some(white) = inverse(hessian) else {
                    return Err(AlignError::NotConverged(step_s));
                };
                let full = white.map(|row| row[0] * gradient[0] + row[1] * gradient[1]);
                let most = if iteration < FULL_STEPS { 1.0 } else { 0.5 };
                let damping = (LARGEST_STEP_S / full[0].abs().max(1e-300)).min(most);
                warp.offset_s += damping * full[0];
                warp.skew = (warp.skew + damping * full[1]).clamp(-2e-3, 2e-3);
                step_s = full[0].abs();
                let is_small = |i: usize| full[i] * full[i] < small * small * white[i][i];
                if step_s.is_nan() || step_s > LOST_S {
                    return Err(AlignError::NotConverged(step_s));
                }
                let is_settled = iteration > memory_steps && is_small(0) && is_small(1);
                let left = if is_settled { [0.0; 2] } else { full };
                let settled = SettledWarp { gram, projected, white, left };
                if is_settled {
                    return Ok(settled);
                }
                nearly = (step_s < NEARLY_S).then_some(settled);
            }
            if iteration < memory_steps {
                current.model.learn_shares(linear(&current.map));
            }
        }
        nearly.ok_or(AlignError::NotConverged(step_s))
    }

    fn for_each(&self, warp: &Warp, current: &KnownSensor, mut each: impl FnMut(&MatchedRow<'_>)) {
        let channels = self.frames.channels;
        let mut window = self.trajectory.features(current.model.clone());
        let mut features = vec![0.0; current.map.nrows()];
        let mut slopes = vec![0.0; current.map.nrows()];
        let (mut slope, mut residual) = (vec![0.0; channels], vec![0.0; channels]);
        let mut straight: Vec<Straight> = Vec::with_capacity(channels);
        features[0] = 1.0;
        for i in self.rows.clone() {
            let (time_s, readings) = self.frames.row(i);
            let (of_load, slopes_of_load) = (&mut features[CONSTANTS..], &mut slopes[CONSTANTS..]);
            if !window.at(warp.apply(time_s), of_load, slopes_of_load) {
                continue;
            }
            let from_pivot_s = time_s - self.pivot_s;
            features[1] = from_pivot_s / self.half_span_s;
            let map = || (0..channels).map(|c| current.map.col_as_slice(c));
            dots(&slopes, &mut map(), &mut slope);
            dots(&features, &mut map(), &mut residual);
            straight.clear();
            let channel = readings.iter().zip(&self.frames.ranges).zip(&current.bends);
            straight.extend(channel.map(|((y, range), bend)| range.straighten(*y, bend)));
            residual
                .iter_mut()
                .zip(&straight)
                .for_each(|(fitted, z)| *fitted = z.reading - *fitted);
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
                straight: &straight,
                weight,
                residual: &residual,
            });
        }
    }

    fn gram(&self, warp: &Warp, current: &KnownSensor) -> GramSums {
        let mut gram = GramSums::new(current.map.nrows(), self.frames.channels);
        let width = gram.width();
        let mut block = Vec::with_capacity(BLOCK * width);
        let mut weights = 0.0;
        self.for_each(warp, current, |row| {
            let root = row.weight.sqrt();
            block.extend(row.features.iter().map(|x| root * x));
            block.extend(row.slope.iter().map(|d| root * d));
            block.extend(row.slope.iter().map(|d| root * row.from_pivot_s * d));
            block.extend(row.readings.iter().map(|y| root * y));
            block.extend(row.straight.iter().flat_map(|z| z.powers).map(|p| root * p));
            weights += row.weight;
            if block.len() == BLOCK * width {
                gram.add(&block, std::mem::take(&mut weights));
                block.clear();
            }
        });
        gram.add(&block, weights);
        gram
    }

    /// Share of the readings in each part of the overlap that the load explains with maps from the other parts. The
    /// maps have no memory: the few features can be told from little data.
    fn explained_elsewhere(&self, warp: &Warp, current: &KnownSensor) -> f64 {
        let of = |number: usize| self.rows.start + number * self.rows.len() / PARTS;
        let parts: Vec<GramSums> = (0..PARTS)
            .map(|number| Self { rows: of(number)..of(number + 1), ..*self }.gram(warp, current))
            .collect();
        let linear = CONSTANTS + self.trajectory.axes;
        explained_elsewhere(&parts, |feature| feature < linear).unwrap_or(0.0)
    }

    fn finish(
        &self,
        warp: Warp,
        settled: &SettledWarp,
        current: &KnownSensor,
        spread: [f64; 2],
    ) -> WarpEstimate {
        let SettledWarp { projected, white, .. } = settled;
        let channels = self.frames.channels;
        let weights = projected.weights().unwrap_or_else(|| Mat::identity(channels, channels));
        let (map, model) = (linear(&current.map), &current.model);
        let solution = Solution { along: &projected.along, weights: &weights, map, model };
        let mut sums = ResidualSums::new(channels, -self.half_span_s);
        self.for_each(&warp, current, |row| sums.add(row, &row.features[CONSTANTS..], &solution));
        let covariance = sums.covariance(*white, spread);
        // The excerpt shows the channel with the fastest change of a reading, around that time.
        let (_, channel, centre_s) = sums.steepest;
        let mut points = Vec::new();
        self.for_each(&warp, current, |row| {
            if (row.from_pivot_s - centre_s).abs() <= EXCERPT_S {
                let reading = row.readings[channel];
                let time_s = row.from_pivot_s + self.pivot_s;
                let gain = row.straight[channel].gain.max(LEAST_GAIN);
                points.push([time_s, reading, reading - row.residual[channel] / gain]);
            }
        });
        let quality = Quality {
            explained_elsewhere: self.explained_elsewhere(&warp, current),
            white_se: [white[0][0].sqrt(), white[1][1].sqrt()],
            spring_delay_s: sums.delay_s(),
            residual_counts: sums.residual(),
            explained: sums.explained(),
            rows: sums.rows,
            excerpt: Excerpt { channel, points },
            ..Quality::default()
        };
        WarpEstimate { warp, covariance, quality }
    }
}
