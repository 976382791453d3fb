//! Search for lag and time constants.
//!
//! **Lag.** Let `r` be the residual of the fit at a lag and `D⊥` the part of the loads' slope that
//! the features leave unexplained. The squared errors are least where `Σ r·D⊥ = 0`. The slope is taken
//! over one row in each direction, so that the noise of both factors does not correlate. Direct
//! minimisation would be biased towards half rows, where interpolation averages noise. The scatter of
//! the sum between folds gives the standard error.
//!
//! **Time constants** are added one at a time, from a logarithmic grid. Each is tried with its own lag,
//! because a lag looks like a short memory as long as the true, longer one is missing. All are then
//! adjusted to minimise the held-out errors.

use std::sync::Arc;

use super::equations::{FoldEquations, LagSums, MemoryColumns, TermSet};
use super::samples::SearchRows;
use super::{Dynamics, DynamicsRule, Gain, ReferenceLag};
use least_squares::passes::{Workers, map};
use shell_data::wrench::PerAxis;

const MOST_TIMES: usize = 4;

const GRID: f64 = 2.0;

/// Least ratio of two different time constants; closer ones count as one.
const APART: f64 = 1.5;

/// A memory term that lowers squared errors by a smaller share is not worth its state.
const LEAST_GAIN: f64 = 0.02;

/// Least gain of the first memory term if rows are labelled as groups: their order, and thereby their
/// history, differs in use. Also the least gain of a lag if such rows have memory terms: creep that the
/// terms do not describe fully looks like a lag.
const LEAST_GAIN_IN_GROUPS: f64 = 0.2;

/// Fewest rows per feature of a cubic without products that allow a search for time constants. With 20 poses of
/// 20 rows, memory terms tell poses apart: held-out errors are then up to 38 times smaller than those on other
/// poses. With 50 poses, they are within a factor of two.
const ROWS_PER_FEATURE: usize = 40;

/// Squared error relative to the loads' variance below which only rounding is left.
const NOTHING_LEFT: f64 = 1e-12;

/// Maximum number of steps towards a lag, by the secant method.
const STEPS: usize = 12;

/// Steps towards the lag for each of many time constants.
const FIRST_STEPS: usize = 2;

/// Lags from which the search starts, rows.
const STARTS: [f64; 11] = [-32.0, -16.0, -8.0, -4.0, -2.0, 0.0, 2.0, 4.0, 8.0, 16.0, 32.0];

/// Factors that move time constants, one for each round.
const ROUNDS: [f64; 4] = [1.7, 1.4, 1.2, 1.08];

type LagEstimate = (f64, f64);

/// Searches as the rule requests, and keeps given values. Returns only these if cancelled: the next pass
/// over the rows reports the cancellation.
pub(super) fn search(
    samples: &SearchRows<'_>,
    rule: &DynamicsRule<'_>,
    given: &Dynamics,
    workers: Workers<'_>,
) -> Dynamics {
    let origin = rule.lag.unwrap_or(0.0);
    let found = FoldEquations::new(samples, origin)
        .and_then(|equations| DynamicsSearch { equations, rule, workers }.run(given));
    found.unwrap_or_else(|| given.clone())
}

struct DynamicsSearch<'a> {
    equations: FoldEquations<'a>,
    rule: &'a DynamicsRule<'a>,
    workers: Workers<'a>,
}

impl DynamicsSearch<'_> {
    fn samples(&self) -> &SearchRows<'_> {
        self.equations.samples
    }

    fn run(&self, given: &Dynamics) -> Option<Dynamics> {
        let (rule, equations) = (self.rule, &self.equations);
        let none = equations.no_terms();
        let plain = match rule.lag {
            // `equations` serve only lags near the given one.
            Some(lag) if lag != 0.0 => {
                FoldEquations::new(self.samples(), 0.0)?.errors(&none, 0.0)?
            }
            _ => equations.errors(&none, 0.0)?,
        };
        if plain.score() < NOTHING_LEFT {
            return None;
        }
        let mut lag = given.lag.map_or(0.0, |lag| lag.by);
        if rule.lag.is_none() {
            lag = self.significant_lag(&none, self.start()).map_or(0.0, |(lag, _)| lag);
        }
        let with_lag = equations.errors(&none, lag)?;
        let mut set = none;
        for &tau in given.memory.iter().flat_map(|memory| &memory.time_constants) {
            set = equations.with(&set, set.terms.len(), &equations.memory(tau))?;
        }
        if rule.memory.is_none() {
            (set, lag) = self.time_constants(set, lag)?;
        }
        let mut standard_error = None;
        if rule.lag.is_none() {
            let found = self.significant_lag(&set, lag);
            lag = found.map_or(0.0, |(lag, _)| lag);
            standard_error = found.map(|(_, error)| error);
        }
        let with_all = equations.errors(&set, lag)?;
        let mut times = set.time_constants();
        times.sort_by(f64::total_cmp);
        let memory = match rule.memory {
            Some(_) => given.memory.clone(),
            None if times.is_empty() => None,
            None => Some(self.samples().clock.memory(&times).ok()?),
        };
        let time_base = self.samples().clock.time_base;
        Some(Dynamics {
            time_base,
            lag: (lag != 0.0).then_some(ReferenceLag { time_base, by: lag }),
            lag_standard_error: standard_error,
            memory,
            gain: Some(Gain {
                folds: self.samples().folds.len(),
                plain: plain.rms(),
                with_lag: with_lag.rms(),
                with_all: with_all.rms(),
            }),
        })
    }

    fn start(&self) -> f64 {
        let (period, none) = (self.samples().clock.period, self.equations.no_terms());
        let score = |rows: f64| (rows * period, self.score(&none, rows * period));
        let scored = STARTS.into_iter().map(score);
        scored.min_by(|a, b| a.1.total_cmp(&b.1)).map_or(0.0, |(lag, _)| lag)
    }

    /// A lag more than two standard errors from zero that lowers the errors by more than one
    /// standard error and, with memory terms in groups, by [`LEAST_GAIN_IN_GROUPS`].
    fn significant_lag(&self, set: &TermSet, start: f64) -> Option<LagEstimate> {
        let (lag, steepness) = self.lag(set, start, STEPS)?;
        let error = self.lag_error(set, lag, steepness)?;
        let without = self.equations.errors(set, 0.0)?;
        let may_be_creep = !set.terms.is_empty() && self.samples().are_labelled();
        let least = if may_be_creep { LEAST_GAIN_IN_GROUPS } else { 0.0 };
        let pays = without.are_lowered_by(&self.equations.errors(set, lag)?, least);
        (pays && lag.abs() > 2.0 * error).then_some((lag, error))
    }

    /// Finds the lag from a first guess in at most `steps` steps. Also returns the derivative of the weighted
    /// sum `Σ r·D⊥` with respect to the lag.
    fn lag(&self, set: &TermSet, start: f64, steps: usize) -> Option<(f64, f64)> {
        let period = self.samples().clock.period;
        let sums = |lag: f64| Some(self.equations.lag_sums(set, lag, false)?.0);
        let (mut lag, mut at) = (start, sums(start)?);
        let weights = self.weights(&at);
        let weighted = |of: &PerAxis<f64>| of.iter().zip(weights).map(|(of, w)| w * of).sum();
        let mut steepness: f64 = weighted(&at.slope);
        for _ in 0..steps {
            if steepness.is_nan() || steepness <= 0.0 {
                return None;
            }
            let sum: f64 = weighted(&at.both);
            let step = (-sum / steepness).clamp(-2.0 * period, 2.0 * period);
            let next = sums(lag + step)?;
            if step.abs() > 1e-6 * period {
                let after: f64 = weighted(&next.both);
                steepness = (after - sum) / step;
            }
            (lag, at) = (lag + step, next);
            if step.abs() < 1e-3 * period {
                break;
            }
        }
        (steepness > 0.0).then_some((lag, steepness))
    }

    fn weights(&self, sums: &LagSums) -> PerAxis<f64> {
        std::array::from_fn(|axis| {
            let square = sums.residual[axis];
            let varies = self.equations.variances[axis] > 0.0 && square > 0.0;
            if varies { self.samples().rows() as f64 / square } else { 0.0 }
        })
    }

    fn lag_error(&self, set: &TermSet, lag: f64, steepness: f64) -> Option<f64> {
        let (sums, folds) = self.equations.lag_sums(set, lag, true)?;
        let weights = self.weights(&sums);
        let of_fold = |of: &PerAxis<f64>| of.iter().zip(weights).map(|(of, w)| w * of).sum::<f64>();
        let n = folds.len() as f64;
        let spread = folds.iter().map(|of| of_fold(of).powi(2)).sum::<f64>() * n / (n - 1.0);
        Some(spread.sqrt() / steepness).filter(|error| error.is_finite())
    }

    /// Adds time constants as long as they lower the errors enough. Also returns the lag, which they change.
    fn time_constants(&self, mut set: TermSet, mut lag: f64) -> Option<(TermSet, f64)> {
        if self.samples().rows() < ROWS_PER_FEATURE * (3 * self.samples().channels + 1) {
            return Some((set, lag));
        }
        let (least, most) = self.bounds();
        let grid = std::iter::successors(Some(least), |tau| Some(tau * GRID));
        let grid: Vec<f64> = grid.take_while(|tau| *tau <= most).collect();
        let grid = map(&grid, self.workers, |&tau| Ok(self.equations.memory(tau))).ok()?;
        let mut best = self.equations.errors(&set, lag)?;
        while set.terms.len() < MOST_TIMES {
            let Some((more, moved)) = self.one_more(&set, lag, &grid) else { break };
            let errors = self.equations.errors(&more, moved)?;
            let is_first_of_groups = set.terms.is_empty() && self.samples().are_labelled();
            let least = if is_first_of_groups { LEAST_GAIN_IN_GROUPS } else { LEAST_GAIN };
            lag = moved;
            if !best.are_explained_by(&errors, least) {
                break;
            }
            (set, best) = (more, errors);
        }
        Some((set, lag))
    }

    fn bounds(&self) -> (f64, f64) {
        (self.samples().clock.period, self.samples().longest() / 4.0)
    }

    fn one_more(
        &self,
        set: &TermSet,
        lag: f64,
        grid: &[Arc<MemoryColumns>],
    ) -> Option<(TermSet, f64)> {
        let is_new = |new: &&Arc<MemoryColumns>| {
            set.terms.iter().all(|of| is_apart(of.time_constant, new.time_constant))
        };
        let new: Vec<_> = grid.iter().filter(is_new).collect();
        let attempt = |new: &&Arc<MemoryColumns>| {
            Ok(self.attempt(set, set.terms.len(), new, lag, FIRST_STEPS))
        };
        let tried = map(&new, self.workers, attempt).ok()?;
        let Attempt { mut set, mut lag, .. } =
            tried.into_iter().flatten().min_by(Attempt::order)?;
        for factor in ROUNDS {
            for position in 0..set.terms.len() {
                (set, lag) = self.move_one(set, position, factor, lag)?;
            }
        }
        if self.rule.lag.is_none() {
            lag = self.lag(&set, lag, STEPS).map_or(lag, |(lag, _)| lag);
        }
        Some((set, lag))
    }

    fn attempt(
        &self,
        set: &TermSet,
        position: usize,
        new: &Arc<MemoryColumns>,
        lag: f64,
        steps: usize,
    ) -> Option<Attempt> {
        let set = self.equations.with(set, position, new)?;
        let lag = match self.rule.lag {
            None => self.lag(&set, lag, steps).map_or(lag, |(lag, _)| lag),
            Some(_) => lag,
        };
        let score = self.score(&set, lag);
        Some(Attempt { score, set, lag })
    }

    /// Score that the search minimises; infinite if there is no fit.
    fn score(&self, set: &TermSet, lag: f64) -> f64 {
        self.equations.errors(set, lag).map_or(f64::INFINITY, |errors| errors.systematic())
    }

    /// Moves a time constant to the best of three scores and of the vertex of a parabola through them, by at
    /// most `factor` to the power of 1.5.
    fn move_one(
        &self,
        set: TermSet,
        position: usize,
        factor: f64,
        lag: f64,
    ) -> Option<(TermSet, f64)> {
        let (centre, (least, most)) = (set.terms[position].time_constant, self.bounds());
        let is_allowed = |tau: f64| {
            let mut others = set.terms.iter().enumerate().filter(|(at, _)| *at != position);
            (least..=most).contains(&tau) && others.all(|(_, of)| is_apart(of.time_constant, tau))
        };
        let attempt = |&tau: &f64| match tau == centre {
            true => Ok(self.attempt(&set, position, &set.terms[position], lag, 1)),
            false if !is_allowed(tau) => Ok(None),
            false => Ok(self.attempt(&set, position, &self.equations.memory(tau), lag, 1)),
        };
        let mut tried =
            map(&[centre, centre / factor, centre * factor], self.workers, attempt).ok()?;
        let [at_centre, below, above] =
            [0, 1, 2].map(|at| tried[at].as_ref().map_or(f64::INFINITY, |of| of.score));
        let (slope, curvature) = (below - above, below + above - 2.0 * at_centre);
        if curvature.is_finite() && curvature > 0.0 {
            let vertex = (0.5 * slope / curvature).clamp(-1.5, 1.5);
            tried.extend(attempt(&(centre * factor.powf(vertex))));
        }
        let best = tried.into_iter().flatten().min_by(Attempt::order);
        Some(best.map_or((set, lag), |best| (best.set, best.lag)))
    }
}

struct Attempt {
    score: f64,
    set: TermSet,
    lag: f64,
}

impl Attempt {
    fn order(a: &Self, b: &Self) -> std::cmp::Ordering {
        a.score.total_cmp(&b.score)
    }
}

fn is_apart(a: f64, b: f64) -> bool {
    a.max(b) >= APART * a.min(b)
}
