//! Search for lag and time constants.
//!
//! **Lag.** Let `r` be the residual of the fit at a lag and `D⊥` the part of the loads' slope that the
//! features leave unexplained. The lag solves `Σ r·D⊥ = 0`, the condition for least squared errors. The slope
//! is taken over one row in each direction, so that the noise of a load is not in both factors. A direct
//! minimum of the squared errors would be biased towards half rows, where interpolation averages noise. The
//! standard error comes from the scatter of the sum between folds.
//!
//! **Time constants** are added one at a time. Each starts on a logarithmic grid, with its own lag, because a
//! short memory and a lag look alike while the longer memory is missing. It is then moved, together with the
//! earlier ones, to the least errors on held-out rows.

use std::sync::Arc;

use super::equations::{FoldEquations, MemoryColumns, ProductColumns};
use super::samples::SearchRows;
use super::{Dynamics, DynamicsRule, Gain, ReferenceLag};
use least_squares::passes::{Workers, map};

/// Most time constants.
const MOST_TIMES: usize = 4;

/// Ratio of neighbouring time constants on the grid.
const GRID: f64 = 2.0;

/// Least ratio of two different time constants; closer ones count as one.
const APART: f64 = 1.5;

/// Least gain of a memory term: one that lowers squared errors by a smaller share is not worth its state.
const LEAST_GAIN: f64 = 0.02;

/// Least gain of the first term if rows are labelled as groups: their order, and therefore the history,
/// differs in use. Also the least gain of a lag beside memory terms there: creep that a few time constants do
/// not describe fully looks like a lag.
const LEAST_GAIN_IN_GROUPS: f64 = 0.2;

/// Errors relative to the loads are rounding below this.
const NOTHING_LEFT: f64 = 1e-12;

/// Most steps towards a lag, which converge like the secant method.
const STEPS: usize = 12;

/// Steps towards the lag for each of many time constants.
const FIRST_STEPS: usize = 2;

/// Lags from which the search starts, rows.
const STARTS: [f64; 11] = [-32.0, -16.0, -8.0, -4.0, -2.0, 0.0, 2.0, 4.0, 8.0, 16.0, 32.0];

/// Factors that move time constants, one for each round.
const ROUNDS: [f64; 4] = [1.7, 1.4, 1.2, 1.08];

/// A lag and its standard error.
type LagEstimate = (f64, f64);

/// Runs the search that the rule requests; given values stay. If the caller cancels it, nothing is found, and
/// the next pass over the rows reports the cancellation.
pub(super) fn search(
    samples: &SearchRows<'_>,
    rule: &DynamicsRule<'_>,
    given: &Dynamics,
    workers: Workers<'_>,
) -> Dynamics {
    let search = DynamicsSearch { equations: FoldEquations::new(samples), rule, workers };
    search.run(given).unwrap_or_else(|| given.clone())
}

type Terms = [Arc<MemoryColumns>];

struct DynamicsSearch<'a> {
    equations: FoldEquations<'a>,
    rule: &'a DynamicsRule<'a>,
    workers: Workers<'a>,
}

impl DynamicsSearch<'_> {
    fn samples(&self) -> &SearchRows<'_> {
        self.equations.samples
    }

    fn terms(&self, time_constant: f64) -> Arc<MemoryColumns> {
        let columns = self.samples().memory_terms(time_constant);
        let terms = ProductColumns::new(self.samples(), columns);
        Arc::new(MemoryColumns { time_constant, terms })
    }

    /// Returns `None` if nothing can be found.
    fn run(&self, given: &Dynamics) -> Option<Dynamics> {
        let rule = self.rule;
        let plain = self.equations.errors(&[], 0.0)?;
        if plain.score() < NOTHING_LEFT {
            return None;
        }
        let mut lag = given.lag.map_or(0.0, |lag| lag.by);
        if rule.lag.is_none() {
            lag = self.significant_lag(&[], self.start()).map_or(0.0, |(lag, _)| lag);
        }
        let with_lag = self.equations.errors(&[], lag)?;
        let times = given.memory.iter().flat_map(|memory| &memory.time_constants);
        let mut terms: Vec<_> = times.map(|&tau| self.terms(tau)).collect();
        let mut best = self.equations.errors(&terms, lag)?;
        if rule.memory.is_none() {
            while terms.len() < MOST_TIMES {
                let Some(more) = self.one_more(&terms, &mut lag) else { break };
                let errors = self.equations.errors(&more, lag)?;
                let is_first_of_groups = terms.is_empty() && self.samples().are_labelled();
                let least = if is_first_of_groups { LEAST_GAIN_IN_GROUPS } else { LEAST_GAIN };
                if !best.are_explained_by(&errors, least) {
                    break;
                }
                (terms, best) = (more, errors);
            }
            terms.sort_by(|a, b| a.time_constant.total_cmp(&b.time_constant));
        }
        let mut standard_error = None;
        if rule.lag.is_none() {
            let found = self.significant_lag(&terms, lag);
            lag = found.map_or(0.0, |(lag, _)| lag);
            standard_error = found.map(|(_, error)| error);
        }
        let with_all = self.equations.errors(&terms, lag)?;
        let times: Vec<f64> = terms.iter().map(|of| of.time_constant).collect();
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

    /// Lag of least error among a few.
    fn start(&self) -> f64 {
        let period = self.samples().clock.period;
        let score = |rows: f64| (rows * period, self.score(&[], rows * period));
        let scored = STARTS.into_iter().map(score);
        scored.min_by(|a, b| a.1.total_cmp(&b.1)).map_or(0.0, |(lag, _)| lag)
    }

    /// Returns a lag if it is more than two standard errors from zero, and lowers the errors by more than one
    /// standard error and, beside memory terms in groups, by [`LEAST_GAIN_IN_GROUPS`].
    fn significant_lag(&self, terms: &Terms, start: f64) -> Option<LagEstimate> {
        let (lag, error) = self.lag(terms, start, STEPS)?;
        let without = self.equations.errors(terms, 0.0)?;
        let may_be_creep = !terms.is_empty() && self.samples().are_labelled();
        let least = if may_be_creep { LEAST_GAIN_IN_GROUPS } else { 0.0 };
        let pays = without.are_lowered_by(&self.equations.errors(terms, lag)?, least);
        (pays && lag.abs() > 2.0 * error).then_some((lag, error))
    }

    /// Finds the lag by the method of the module, from a first guess, in at most `steps` steps.
    fn lag(&self, terms: &Terms, start: f64, steps: usize) -> Option<LagEstimate> {
        let (samples, period) = (self.samples(), self.samples().clock.period);
        let mut weights = None;
        let unexplained =
            |columns| self.equations.unexplained(terms, &ProductColumns::new(samples, columns));
        // `Σ r·D⊥` of each fold, and `Σ D⊥²`; the weights of the axes are the inverse variances of their
        // residuals.
        let mut moments = |lag: f64| -> Option<(Vec<f64>, f64)> {
            let residual = unexplained(samples.loads(lag))?;
            let slope = unexplained(samples.slopes(lag))?;
            let weights = weights.get_or_insert_with(|| {
                std::array::from_fn::<f64, 6, _>(|axis| {
                    let square = residual.col(axis).squared_norm_l2();
                    let varies = self.equations.variances[axis] > 0.0 && square > 0.0;
                    if varies { samples.rows() as f64 / square } else { 0.0 }
                })
            });
            let of_fold = |rows: &std::ops::Range<usize>| {
                let part = |axis: usize| {
                    let r = residual.col(axis).subrows(rows.start, rows.len());
                    let d = slope.col(axis).subrows(rows.start, rows.len());
                    weights[axis] * (r.transpose() * d)
                };
                (0..6).map(part).sum::<f64>()
            };
            let folds: Vec<f64> = samples.folds.iter().map(of_fold).collect();
            let squares = (0..6).map(|axis| weights[axis] * slope.col(axis).squared_norm_l2());
            Some((folds, squares.sum()))
        };
        let (mut lag, mut at) = (start, moments(start)?);
        let mut steepness = at.1;
        for _ in 0..steps {
            if steepness.is_nan() || steepness <= 0.0 {
                return None;
            }
            let step = (-at.0.iter().sum::<f64>() / steepness).clamp(-2.0 * period, 2.0 * period);
            let next = moments(lag + step)?;
            let change = next.0.iter().sum::<f64>() - at.0.iter().sum::<f64>();
            if step.abs() > 1e-6 * period {
                steepness = change / step;
            }
            (lag, at) = (lag + step, next);
            if step.abs() < 1e-3 * period {
                break;
            }
        }
        let n = at.0.len() as f64;
        let spread: f64 = at.0.iter().map(|of| of * of).sum::<f64>() * n / (n - 1.0);
        let standard_error = spread.sqrt() / steepness;
        (steepness > 0.0 && standard_error.is_finite()).then_some((lag, standard_error))
    }

    /// Adds one time constant, and moves all of them and the lag to the least errors.
    fn one_more(&self, terms: &Terms, lag: &mut f64) -> Option<Vec<Arc<MemoryColumns>>> {
        let (least, most) = (self.samples().clock.period, self.samples().longest() / 4.0);
        let with = |tau: f64| [terms, &[self.terms(tau)]].concat();
        let score = |&tau: &f64| Ok(self.score_at_own_lag(&with(tau), *lag, FIRST_STEPS));
        let grid = std::iter::successors(Some(least), |tau| Some(tau * GRID));
        let grid: Vec<f64> = grid
            .take_while(|tau| *tau <= most)
            .filter(|tau| terms.iter().all(|of| is_apart(of.time_constant, *tau)))
            .collect();
        let scored = grid.iter().zip(map(&grid, self.workers, score).ok()?);
        let (&new, (_, own)) = scored.min_by(|a, b| a.1.0.total_cmp(&b.1.0))?;
        *lag = own;
        let mut all = with(new);
        for factor in ROUNDS {
            for position in 0..all.len() {
                (all, *lag) = self.move_one(&all, position, factor, (least, most), *lag)?;
            }
        }
        if self.rule.lag.is_none() {
            *lag = self.lag(&all, *lag, STEPS).map_or(*lag, |(lag, _)| lag);
        }
        Some(all)
    }

    /// Score with these terms at their best lag, found in `steps` steps from another lag; returns that lag,
    /// too.
    fn score_at_own_lag(&self, terms: &Terms, lag: f64, steps: usize) -> (f64, f64) {
        let own = match self.rule.lag {
            None => self.lag(terms, lag, steps).map_or(lag, |(lag, _)| lag),
            Some(_) => lag,
        };
        (self.score(terms, own), own)
    }

    /// Score that the search minimises; infinite if there is no fit.
    fn score(&self, terms: &Terms, lag: f64) -> f64 {
        self.equations.errors(terms, lag).map_or(f64::INFINITY, |errors| errors.systematic())
    }

    /// Moves a time constant, by up to about a factor, to the least errors on a parabola through three
    /// points. Returns the terms and their lag.
    fn move_one(
        &self,
        all: &Terms,
        position: usize,
        factor: f64,
        (least, most): (f64, f64),
        lag: f64,
    ) -> Option<(Vec<Arc<MemoryColumns>>, f64)> {
        let centre = all[position].time_constant;
        let is_allowed = |tau: f64| {
            let mut others = all.iter().enumerate().filter(|(at, _)| *at != position);
            (least..=most).contains(&tau) && others.all(|(_, of)| is_apart(of.time_constant, tau))
        };
        let attempt = |&tau: &f64| {
            let mut terms = all.to_vec();
            if tau != centre {
                if !is_allowed(tau) {
                    return Ok((f64::INFINITY, lag, terms));
                }
                terms[position] = self.terms(tau);
            }
            let (score, lag) = self.score_at_own_lag(&terms, lag, 1);
            Ok((score, lag, terms))
        };
        let mut tried =
            map(&[centre, centre / factor, centre * factor], self.workers, attempt).ok()?;
        let [at_centre, below, above] = [0, 1, 2].map(|at| tried[at].0);
        let (slope, curvature) = (below - above, below + above - 2.0 * at_centre);
        if curvature.is_finite() && curvature > 0.0 {
            let vertex = (0.5 * slope / curvature).clamp(-1.5, 1.5);
            tried.extend(attempt(&(centre * factor.powf(vertex))));
        }
        let (_, lag, terms) = tried.into_iter().min_by(|a, b| a.0.total_cmp(&b.0))?;
        Some((terms, lag))
    }
}

fn is_apart(a: f64, b: f64) -> bool {
    a.max(b) >= APART * a.min(b)
}
