//! Comparison of clocks by the edges of a signal that both sides have recorded.
//!
//! ```text
//! t_reference,j = t_board,i + offset + skew · (t_board,i − pivot) + e
//! e: uniform over one sampling interval of the reference, since its edge lies anywhere between two samples
//! ```
//!
//! If the reference's samples keep step with the signal, all edges may have the same error; more edges then do not
//! lower the standard error of the offset. The gaps between edges determine which edges correspond (`matching`); if the
//! gaps do not, the loads do. Offset and skew are a least-squares fit to the pairs, with the tolerance of oscillators
//! as the prior of the skew: one edge gives the offset, two distant edges give the skew.

mod matching;

use super::error::MOST_EDGES;
use super::{AlignError, ClockMap, RecordingSide};
use matching::Pairing;
use shell_data::statistics::extremes;

/// Prior standard deviation of the skew: the board has a clock without a crystal, accurate to 1 %
/// (DS11451, table "HSI16 oscillator characteristics").
const PRIOR_SKEW: f64 = 5e-3;

/// The board's own error of an edge: its clock step of 1 µs, and some µs of interrupt latency.
const BOARD_SD_S: f64 = 5e-6;

/// The minimum number of pairs for an estimate of their scatter.
const ENOUGH_TO_SCATTER: usize = 5;

const LOW: f64 = 0.4;
const HIGH: f64 = 0.6;

#[derive(Clone, Debug, Default, PartialEq)]
pub struct Edges {
    pub reference_s: Vec<f64>,
    pub board_s: Vec<f64>,
    /// Time between two samples of the reference, s; an edge may lie anywhere between them.
    pub resolution_s: f64,
}

#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct EdgeMatch {
    pub matched: usize,
    pub reference: usize,
    pub board: usize,
    pub residual_s: f64,
    /// True if the loads had to decide which edge is which.
    pub told_by_loads: bool,
    pub by_loads: Option<ClockMap>,
}

impl Edges {
    /// The clock relation from the edges. `by_loads` is the clock relation from the loads, if the loads match.
    ///
    /// # Errors
    /// [`AlignError::TooManyEdges`]; [`AlignError::EdgesUnclear`] if gaps and loads leave open which edge is which.
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
        // Wandering clocks make the pairs scatter more than sampling alone would. If the pairs scatter less than
        // sampling would make them, the sampling error is the same in all pairs: a signal that the reference
        // generates keeps step with its samples. With only a few pairs, the scatter cannot be estimated.
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

/// The correct pairing, and true if the loads had to decide.
fn choose<'a>(
    ways: &'a [Pairing],
    by_loads: Option<&ClockMap>,
) -> Result<(&'a Pairing, bool), AlignError> {
    let unclear = |matched| AlignError::EdgesUnclear { ways: ways.len(), matched };
    let best = ways.first().ok_or(unclear(0))?;
    // If edges are missing on one side, a pairing with half as many pairs may be the right one.
    let rivals: Vec<&Pairing> =
        ways.iter().filter(|way| 2 * way.pairs.len() > best.pairs.len()).collect();
    let [_, _, ..] = rivals[..] else { return Ok((best, false)) };
    let clock = by_loads.ok_or(unclear(best.pairs.len()))?;
    let distance = |way: &Pairing| (way.offset_at(clock.pivot_s) - clock.offset_s).abs();
    let mut near: Vec<(f64, &Pairing)> = rivals.iter().map(|way| (distance(way), *way)).collect();
    near.sort_by(|a, b| a.0.total_cmp(&b.0));
    // The loads determine the offset to some ms.
    match near[..] {
        [(first, way), (second, _), ..] if first < second / 4.0 => Ok((way, true)),
        _ => Err(unclear(best.pairs.len())),
    }
}

/// Rising edges of a signal, s, and the RMS time between the samples around them, s (0 without an edge). A signal is
/// low below 40 % of its range and high above 60 %; an edge is midway between the last low and the first high sample.
/// Ignores samples that are not finite.
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
