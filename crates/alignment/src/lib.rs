//! Alignment of a reference sensor's recording with a board log that has a separate clock.
//!
//! ```text
//! t_reference = t_board + offset + skew · (t_board − pivot)
//! ```
//!
//! Both recordings contain the same loads, but the map from wrench to readings is still unknown. `coarse` finds the
//! offset among all possible ones by correlation, and fails if it is ambiguous. `refine` then estimates offset, skew
//! and the map together, including the memory of the springs, close to the Cramér-Rao bound. [`Aligned::resample`]
//! evaluates the low-passed reference at the board's own times. Edges of one signal that both sides recorded
//! determine the clocks ([`Edges`]).
//!
//! The derivations are in `docs/alignment.md`. Not supported: a skew that changes during a recording by more than the
//! uncertainty, and loads faster than the board samples.

mod choice;
mod coarse;
mod edges;
mod error;
mod inner_products;
mod normal;
mod optics;
mod recording;
mod refine;
mod resample;
mod response;
mod trajectory;
mod uncertainty;

pub use edges::{EdgeMatch, Edges, rising_edges};
pub use error::{AlignError, RecordingSide};
use error::{LARGEST_SKEW_PPM, LEAST_EXPLAINED, OTHER_UNIT};
pub use recording::{LeftOut, Recording};

use coarse::Match;
use recording::{BoardFrames, Clean};
use refine::{Warp, WarpEstimate, refine};
use resample::{Resampler, STOPBAND_DB};
use shell_data::statistics::RunningVariance;
use trajectory::Trajectory;

/// Upper limit of the matched band: loads by hand and taps are slower, and a low rate saves rows.
const HIGHEST_MATCHED_RATE_HZ: f64 = 250.0;
/// Length of a block for the first search, s: enough contacts, and 200 ppm of skew blur it by less than a tap.
const PROBE_S: f64 = 120.0;
/// The maximum number of blocks of time tried.
const PROBES: usize = 8;
const PRIOR_SKEW: f64 = 2e-4;

/// The least share of held-out readings that a match with rivals must explain. In sessions of the sensor model, a true
/// match over 8 s with a rival explains 65 %, and a false one 32 %.
const WITH_RIVALS: f64 = 0.5;

/// The least overlap, as a share of the shorter recording, of a match that has rivals.
const WIDE_OVERLAP: f64 = 0.8;

/// The ratio of unexplained variances above which a rival is ruled out.
const CLEARLY: f64 = 4.0;

#[derive(Clone, Debug, Default, PartialEq)]
pub struct Options {
    pub exposure_s: f64,
    /// True if equal consecutive readings are always one frame logged repeatedly.
    pub repeats_are_stale: bool,
    /// Edges of a signal that both sides recorded, to align the clocks.
    pub edges: Option<Edges>,
}

#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct ClockMap {
    /// Reference time minus board time at the pivot, s.
    pub offset_s: f64,
    /// The relative rate of the reference's clock: (dt_reference/dt_board) − 1.
    pub skew: f64,
    /// Board time at which the offset is given, s: the middle of the overlap.
    pub pivot_s: f64,
    pub offset_se_s: f64,
    pub skew_se: f64,
    pub covariance_s: f64,
}

impl ClockMap {
    pub fn reference_time_s(&self, board_time_s: f64) -> f64 {
        board_time_s + self.offset_at_s(board_time_s)
    }

    pub fn offset_at_s(&self, board_time_s: f64) -> f64 {
        self.offset_s + self.skew * (board_time_s - self.pivot_s)
    }

    pub fn offset_se_at_s(&self, board_time_s: f64) -> f64 {
        let d = board_time_s - self.pivot_s;
        let variance = self.offset_se_s * self.offset_se_s
            + 2.0 * d * self.covariance_s
            + d * d * self.skew_se * self.skew_se;
        variance.max(0.0).sqrt()
    }
}

#[derive(Clone, Debug, Default, PartialEq)]
pub struct Quality {
    /// Share of the readings' variance that the aligned reference explains, with memory, averaged over the channels.
    pub explained: f64,
    /// Share of the readings of each fifth of the overlap that the reference explains with maps from the other fifths.
    pub explained_elsewhere: f64,
    /// RMS of the unexplained part in each changing channel, around its usual reading.
    pub residual_counts: Vec<f64>,
    /// Number of the board's rows (averaged down to 250 Hz) that were compared.
    pub rows: usize,
    pub search_explained: f64,
    pub search_ratio: f64,
    /// The score over all offsets (s), with a maximum of 1.
    pub search: Vec<(f64, f64)>,
    /// Delay of the readings by the memory of the springs: part of the model, not of the offset.
    pub spring_delay_s: f64,
    /// Standard errors of offset (s) and skew if residuals were white noise.
    pub white_se: [f64; 2],
    /// A block with much motion, for a figure.
    pub excerpt: Excerpt,
}

/// A channel around its steepest change: readings and predictions from the aligned reference.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Excerpt {
    pub channel: usize,
    pub points: Vec<[f64; 3]>,
}

#[derive(Debug)]
pub struct Aligned {
    pub clock: ClockMap,
    /// The match of the loads; `None` if they do not match and the clocks come from edges.
    pub quality: Option<Quality>,
    pub edges: Option<EdgeMatch>,
    pub reference_left_out: LeftOut,
    pub board_left_out: LeftOut,
    reference: Clean,
    board: Clean,
    exposure_s: f64,
}

/// Aligns `reference` (six axes, or fewer) with `board` (readings of any number of channels).
///
/// Neither sampling needs to be even; rows may be missing, repeated or out of range. Delays of the board become part
/// of the offset, which pairs each row with the load that caused it. With edges, the loads decide only if the gaps
/// between edges do not; otherwise the loads need not match.
///
/// # Errors
/// [`AlignError`] if a recording is too short or does not change, or the match or the edges are unclear.
pub fn align(
    reference: Recording,
    board: Recording,
    options: Options,
) -> Result<Aligned, AlignError> {
    let Options { exposure_s, repeats_are_stale, edges } = options;
    let reference = Clean::new(reference, RecordingSide::Reference, false)?;
    let board = Clean::new(board, RecordingSide::Board, repeats_are_stale)?;
    let ratio = reference.span_s() / board.span_s();
    let loads = by_loads(&reference, &board).map_err(|error| {
        match OTHER_UNIT.contains(&ratio) || OTHER_UNIT.contains(&ratio.recip()) {
            true => {
                AlignError::OtherUnit { reference_s: reference.span_s(), board_s: board.span_s() }
            }
            false => error,
        }
    });
    let (clock, quality, edges) = match edges {
        Some(edges) => {
            let (by_loads, quality) = loads.ok().unzip();
            let (clock, found) = edges.clocks(by_loads)?;
            (clock, quality, Some(found))
        }
        None => {
            let (clock, quality) = loads?;
            (clock, Some(quality), None)
        }
    };
    Ok(Aligned {
        clock,
        quality,
        edges,
        reference_left_out: reference.left_out,
        board_left_out: board.left_out,
        reference,
        board,
        exposure_s,
    })
}

fn by_loads(reference: &Clean, board: &Clean) -> Result<(ClockMap, Quality), AlignError> {
    let (found, probe) = search(reference, board)?;
    let rate_hz = HIGHEST_MATCHED_RATE_HZ.min(1.0 / board.period_s).min(1.0 / reference.period_s);
    let refinement = Refinement {
        trajectory: Trajectory::new(reference, rate_hz),
        frames: BoardFrames::new(board, rate_hz),
        span_s: board.span_s(),
    };
    let estimate = refinement.clearest(&found, probe)?;
    let skew_ppm = 1e6 * estimate.warp.skew;
    if skew_ppm.abs() > LARGEST_SKEW_PPM {
        return Err(AlignError::Skew(skew_ppm));
    }
    let WarpEstimate { warp, covariance, mut quality } = estimate;
    let clock = ClockMap {
        offset_s: warp.offset_s + reference.start_s - board.start_s,
        skew: warp.skew,
        pivot_s: warp.pivot_s + board.start_s,
        offset_se_s: covariance[0][0].sqrt(),
        skew_se: covariance[1][1].sqrt(),
        covariance_s: covariance[0][1],
    };
    quality.excerpt.points.iter_mut().for_each(|[time_s, ..]| *time_s += board.start_s);
    let Match { explained: search_explained, ratio: search_ratio, scores: search, .. } = found;
    Ok((clock, Quality { search_explained, search_ratio, search, ..quality }))
}

/// Searches with one block of the board log after another, most motion first, until a match is clear.
fn search(reference: &Clean, board: &Clean) -> Result<(Match, (f64, f64)), AlignError> {
    let count = (board.span_s() / PROBE_S).ceil().max(1.0);
    let length_s = board.span_s() / count;
    let time_blocks = (0..count as usize).map(|i| (i as f64 * length_s, (i + 1) as f64 * length_s));
    let mut liveliest: Vec<_> =
        time_blocks.map(|time_block| (activity(board, time_block), time_block)).collect();
    liveliest.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut refused = None;
    for (_, time_block) in liveliest.into_iter().take(PROBES) {
        match coarse::find_match(reference, board, time_block) {
            Ok(found) => return Ok((found, time_block)),
            Err(error) => refused = refused.or(Some(error)),
        }
    }
    Err(refused.unwrap_or(AlignError::Constant(RecordingSide::Board)))
}

fn activity(board: &Clean, (from_s, to_s): (f64, f64)) -> f64 {
    let first = board.time_s.partition_point(|&t| t < from_s);
    let last = board.time_s.partition_point(|&t| t <= to_s);
    let spread = |values: &[f64]| RunningVariance::new(values).rms_about_mean();
    // 0 / 0 if a channel is constant, or a block has no rows.
    let relative = |column: &Vec<f64>| (spread(&column[first..last]) / spread(column)).powi(2);
    board.columns.iter().map(relative).filter(|relative| relative.is_finite()).sum()
}

/// Refuses a match if its map does not explain held-out readings. Over a short overlap, many features fit anything.
fn not_by_chance(estimate: WarpEstimate, least: f64) -> Result<WarpEstimate, AlignError> {
    let Quality { explained, explained_elsewhere, .. } = estimate.quality;
    match explained_elsewhere >= least {
        true => Ok(estimate),
        false => Err(AlignError::ByChance { explained, explained_elsewhere }),
    }
}

struct Refinement {
    trajectory: Trajectory,
    frames: BoardFrames,
    span_s: f64,
}

impl Refinement {
    /// Refines the match and its rivals. One of them must explain far more than any other.
    fn clearest(&self, found: &Match, probe: (f64, f64)) -> Result<WarpEstimate, AlignError> {
        if found.rivals.is_empty() {
            let estimate = self.grow(found.offset_s, probe)?;
            return not_by_chance(estimate, LEAST_EXPLAINED);
        }
        let offsets = std::iter::once(found.offset_s).chain(found.rivals.iter().copied());
        let unexplained = |estimate: &WarpEstimate| 1.0 - estimate.quality.explained;
        let grown = offsets.map(|offset_s| not_by_chance(self.grow(offset_s, probe)?, WITH_RIVALS));
        let mut estimates: Vec<WarpEstimate> = grown.filter_map(Result::ok).collect();
        estimates.sort_by(|a, b| unexplained(a).total_cmp(&unexplained(b)));
        let (best_s, ratio) = (found.offset_s, found.ratio);
        let unclear = |second_s: f64| AlignError::Ambiguous { best_s, second_s, ratio };
        match &estimates[..] {
            [] => Err(unclear(found.rivals[0])),
            [best, second, ..] if unexplained(second) < CLEARLY * unexplained(best) => {
                Err(unclear(second.warp.offset_s))
            }
            // If only one of several candidates converges, it has to explain the readings by itself.
            [best] if CLEARLY * unexplained(best) > 1.0 => Err(unclear(found.rivals[0])),
            // Loads of one kind fit several offsets. Where recordings cover each other, only the true one fits all.
            [best, ..] if self.overlap(&best.warp) < WIDE_OVERLAP => Err(unclear(found.rivals[0])),
            _ => Ok(estimates.swap_remove(0)),
        }
    }

    /// Time that both recordings cover, as a share of the shorter one.
    fn overlap(&self, warp: &Warp) -> f64 {
        let reference_s = self.trajectory.span_s();
        let covered_s = warp.apply(self.span_s).min(reference_s) - warp.apply(0.0).max(0.0);
        covered_s / self.span_s.min(reference_s)
    }

    /// Refines the match of a block, then of ever longer ones around it, up to the whole recording.
    fn grow(
        &self,
        offset_s: f64,
        (mut from_s, mut to_s): (f64, f64),
    ) -> Result<WarpEstimate, AlignError> {
        let mut warp = Warp { offset_s, skew: 0.0, pivot_s: 0.5 * (from_s + to_s) };
        loop {
            let whole = from_s <= 0.0 && to_s >= self.span_s;
            let prior = (!whole).then_some(PRIOR_SKEW);
            let estimate = refine(&self.trajectory, &self.frames, warp, (from_s, to_s), prior)?;
            if whole {
                return Ok(estimate);
            }
            warp = estimate.warp;
            let length_s = to_s - from_s;
            (from_s, to_s) = ((from_s - length_s).max(0.0), (to_s + length_s).min(self.span_s));
        }
    }
}

impl Aligned {
    pub fn channels(&self) -> usize {
        self.board.columns.len()
    }

    /// Evaluates the reference at the times of the board's rows, low-passed below the board's Nyquist frequency and
    /// averaged over its exposure. Calls `row` with board time (s, on its own clock), readings and wrench for each
    /// row that is not a repeat and is covered by the reference. Returns the number of rows that the reference does
    /// not cover.
    ///
    /// # Errors
    /// Any error of `row`.
    pub fn resample<E>(
        &self,
        mut row: impl FnMut(f64, &[f64], &[f64]) -> Result<(), E>,
    ) -> Result<usize, E> {
        let rate_hz = (1.0 / self.board.period_s).min(1.0 / self.reference.period_s);
        let mut resampler = Resampler::new(&self.reference, rate_hz, self.exposure_s, STOPBAND_DB);
        let mut readings = vec![0.0; self.board.columns.len()];
        let mut wrench = vec![0.0; self.reference.columns.len()];
        let mut uncovered = 0;
        for (i, &since_start_s) in self.board.time_s.iter().enumerate() {
            let time_s = self.board.start_s + since_start_s;
            let at_s = self.clock.reference_time_s(time_s) - self.reference.start_s;
            if !resampler.at(at_s, &mut wrench) {
                uncovered += 1;
                continue;
            }
            for (reading, column) in readings.iter_mut().zip(&self.board.columns) {
                *reading = column[i];
            }
            row(time_s, &readings, &wrench)?;
        }
        Ok(uncovered)
    }
}
