//! Clocks compared by the edges of one signal that both sides have recorded.
//!
//! ```text
//! t_reference,j = t_board,i + offset + skew · (t_board,i − pivot) + e
//! e: uniform over a sample of the reference's, for its edge lies anywhere between two samples
//! ```
//!
//! Errors may be common to all edges, where the reference's samples keep step with the signal; the standard
//! error of the offset then does not fall with their number.
//!
//! Which edge is which follows from the gaps between them (`matching`), and where these leave it open from
//! the loads. Offset and skew are least squares over the pairs, with what oscillators differ by as the prior of
//! the skew, so that one edge gives the offset and two that are far apart the skew.

mod matching;

use super::error::MOST_EDGES;
use super::{AlignError, ClockMap, RecordingSide};
use matching::Pairing;
use shell_data::statistics::extremes;

/// Standard deviation of the skew before anything is known: the board has a clock without a crystal, good
/// to 1 % (DS11451, table "HSI16 oscillator characteristics").
const PRIOR_SKEW: f64 = 5e-3;

/// The board's own error of an edge: its clock's step of 1 µs, and the interrupt's some µs.
const BOARD_SD_S: f64 = 5e-6;

/// As many pairs tell by how much they scatter.
const ENOUGH_TO_SCATTER: usize = 5;

/// Shares of the range below which a signal is low and above which it is high.
const LOW: f64 = 0.4;
const HIGH: f64 = 0.6;

/// The edges of both sides.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Edges {
    /// In the reference's recording, on its clock, s.
    pub reference_s: Vec<f64>,
    /// At the board's sync input, on its clock, s.
    pub board_s: Vec<f64>,
    /// Time between two samples of the reference, s: an edge may be anywhere within.
    pub resolution_s: f64,
}

/// Edges that were matched, and what follows from them.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct EdgeMatch {
    /// Pairs of the same edge.
    pub matched: usize,
    /// Edges of the reference.
    pub reference: usize,
    /// Edges of the board.
    pub board: usize,
    /// RMS of what offset and skew leave of the pairs, s.
    pub residual_s: f64,
    /// Whether the loads had to tell which edge is which.
    pub told_by_loads: bool,
    /// What the loads say by themselves, where they say anything.
    pub by_loads: Option<ClockMap>,
}

impl Edges {
    /// The clocks by the edges; `by_loads` are those by the loads, if these match.
    ///
    /// # Errors
    /// [`AlignError::TooManyEdges`], or [`AlignError::EdgesUnclear`] if neither the gaps nor the loads tell which
    /// edge is which.
    pub(super) fn clocks(
        mut self,
        by_loads: Option<ClockMap>,
    ) -> Result<(ClockMap, EdgeMatch), AlignError> {
        for (side, times) in [
            (RecordingSide::Reference, &mut self.reference_s),
            (RecordingSide::Board, &mut self.board_s),
        ] {
            times.retain(|time_s| time_s.is_finite());
            times.sort_unstable_by(f64::total_cmp);
            if times.len() > MOST_EDGES {
                let edges = times.len();
                return Err(AlignError::TooManyEdges { side, edges });
            }
        }
        let ways = matching::pairings(&self.reference_s, &self.board_s, self.resolution_s);
        let (pairing, told_by_loads) = choose(&ways, by_loads.as_ref())?;
        let (clock, residual_s) = self.solve(pairing);
        let found = EdgeMatch {
            matched: pairing.pairs.len(),
            reference: self.reference_s.len(),
            board: self.board_s.len(),
            residual_s,
            told_by_loads,
            by_loads,
        };
        Ok((clock, found))
    }

    /// Least squares over the pairs, and the RMS of what is left.
    fn solve(&self, pairing: &Pairing) -> (ClockMap, f64) {
        let pairs = pairing.pairs.iter().map(|&(j, i)| {
            let board_s = self.board_s[i];
            (board_s, self.reference_s[j] - board_s)
        });
        let pairs: Vec<(f64, f64)> = pairs.collect();
        let n = pairs.len() as f64;
        let mean = |of: fn(&(f64, f64)) -> f64| pairs.iter().map(of).sum::<f64>() / n;
        let (pivot_s, offset_s) = (mean(|pair| pair.0), mean(|pair| pair.1));
        let sum = |of: &dyn Fn(f64, f64) -> f64| -> f64 {
            pairs.iter().map(|&(t, d)| of(t - pivot_s, d - offset_s)).sum()
        };
        let variance = self.resolution_s * self.resolution_s / 12.0 + BOARD_SD_S * BOARD_SD_S;
        let precision = 1.0 / (PRIOR_SKEW * PRIOR_SKEW);
        let spread = sum(&|t, _| t * t);
        let skew = sum(&|t, d| t * d) / (spread + variance * precision);
        let left = sum(&|t, d| (d - skew * t).powi(2));
        // Clocks that wander scatter more than samples do. What the pairs do not scatter by is common to all:
        // a signal that the reference itself has made keeps step with its samples. Few pairs do not tell.
        let seen = if pairs.len() >= ENOUGH_TO_SCATTER { left / (n - 2.0) } else { 0.0 };
        let (scatter, common) = (variance.max(seen), (variance - seen).max(0.0));
        let clock = ClockMap {
            offset_s,
            skew,
            pivot_s,
            offset_se_s: (common * (n - 1.0) / n + scatter / n).sqrt(),
            skew_se: (spread / scatter + precision).sqrt().recip(),
            covariance_s: 0.0,
        };
        (clock, (left / n).sqrt())
    }
}

/// The one way to pair edges that is meant, and whether the loads had to tell.
fn choose<'a>(
    ways: &'a [Pairing],
    by_loads: Option<&ClockMap>,
) -> Result<(&'a Pairing, bool), AlignError> {
    let unclear = |matched| AlignError::EdgesUnclear { ways: ways.len(), matched };
    let best = ways.first().ok_or(unclear(0))?;
    // Another way that explains half as many may be the right one, where edges are missing on a side.
    let rivals: Vec<&Pairing> =
        ways.iter().filter(|way| 2 * way.pairs.len() > best.pairs.len()).collect();
    let [_, _, ..] = rivals[..] else { return Ok((best, false)) };
    let clock = by_loads.ok_or(unclear(best.pairs.len()))?;
    let distance = |way: &Pairing| (way.offset_at(clock.pivot_s) - clock.offset_s).abs();
    let mut near: Vec<(f64, &Pairing)> = rivals.iter().map(|way| (distance(way), *way)).collect();
    near.sort_by(|a, b| a.0.total_cmp(&b.0));
    // The loads know the offset to some ms.
    match near[..] {
        [(first, way), (second, _), ..] if first < second / 4.0 => Ok((way, true)),
        _ => Err(unclear(best.pairs.len())),
    }
}

/// The rising edges of a signal, s, and the time between the samples around one, s (RMS; 0 without an edge).
///
/// A signal is low below 40 % of its range and high above 60 %; an edge lies in the middle between the last
/// low sample and the first high one. Samples that are not finite say nothing.
pub fn rising_edges(time_s: &[f64], values: &[f64]) -> (Vec<f64>, f64) {
    let (least, most) = extremes(values.iter().copied().filter(|value| value.is_finite()));
    let range = most - least;
    let (mut edges, mut squares) = (Vec::new(), 0.0);
    if range.is_nan() || range <= 0.0 {
        return (edges, 0.0);
    }
    let (low, high) = (least + LOW * range, least + HIGH * range);
    let mut last_low = None;
    for (&time, &value) in time_s.iter().zip(values) {
        if value <= low {
            last_low = Some(time);
        } else if value >= high
            && let Some(before) = last_low.take()
        {
            edges.push(0.5 * (before + time));
            squares += (time - before) * (time - before);
        }
    }
    let resolution_s = (squares / edges.len().max(1) as f64).sqrt();
    (edges, resolution_s)
}

#[cfg(test)]
mod tests;
