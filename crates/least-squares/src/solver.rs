//! Rows to coefficients, for all solvers: blocks are reduced to partial fits, merged in row order, and solved.

pub use crate::methods::SolverKind;
pub use crate::passes::{Pass, Rows, Workers};
pub use crate::solution::Solution;

use crate::double_double::DoubleDouble;
use crate::error::FitError;
use crate::exact::{Accumulator, ExactError, ExactSums};
use crate::features::Features;
use crate::methods::{self, Method, Reduction, Ridge, RowChunk, Shape};
use crate::model::Model;
use crate::reading_ranges::ReadingRanges;
use crate::scaling::{ChannelSample, Scaling};
use shell_data::block::Block;
use shell_data::wrench::Axis;

/// Input of a solver, without the rows.
#[derive(Clone, Debug, PartialEq)]
pub struct FitProblem {
    pub model: Model,
    pub scaling: Scaling,
    /// λ ≥ 0 on columns of norm one; the intercept is not penalised. 0 for no ridge.
    pub ridge: f64,
}

/// Sums over all readings, for centre and scale of a ridge fit. A ridge penalises the coefficients of powers relative
/// to the centre. If the centre were the mean of a sample, the result would depend on the order of the rows.
#[derive(Clone, Debug)]
pub struct ReadingSums {
    ranges: ReadingRanges,
    /// Exact if readings span fewer than some fifty binary places.
    sums: Vec<DoubleDouble>,
    integers: Vec<bool>,
}

impl ReadingSums {
    pub fn new(channels: usize) -> Self {
        Self {
            ranges: ReadingRanges::new(channels),
            sums: vec![DoubleDouble::ZERO; channels],
            integers: vec![true; channels],
        }
    }

    /// Centre and scale; without `intercept`, readings are not shifted.
    pub fn scaling(&self, intercept: bool) -> Scaling {
        let Self { ranges, sums, integers } = self;
        let channel = |i: usize| ChannelSample {
            min: ranges.channels[i].min,
            max: ranges.channels[i].max,
            mean: sums[i].to_f64() / ranges.rows as f64,
            integers: integers[i],
        };
        Scaling::from_channels((0..sums.len()).map(channel), intercept)
    }
}

impl Pass for ReadingSums {
    const ANY_ORDER: bool = true;

    fn absorb(&mut self, block: &Block) -> Result<(), FitError> {
        self.ranges.merge(&ReadingRanges::from_block(block, self.sums.len())?);
        for (channel, column) in block.readings.iter().enumerate() {
            let sum = &mut self.sums[channel];
            *sum = column.iter().fold(*sum, |sum, &s| sum + DoubleDouble::from(s));
            self.integers[channel] &= column.iter().all(|s| s.fract() == 0.0);
        }
        Ok(())
    }

    fn merge(&mut self, later: Self) -> Result<(), FitError> {
        self.ranges.merge(&later.ranges);
        self.sums.iter_mut().zip(later.sums).for_each(|(sum, more)| *sum += more);
        self.integers.iter_mut().zip(later.integers).for_each(|(all, more)| *all &= more);
        Ok(())
    }
}

/// Fits `problem` with the given solver. Returns the ranges of the fitted readings, too.
///
/// # Errors
/// [`FitError`] if the rows do not determine the coefficients, or this solver cannot find them.
pub fn fit(
    kind: SolverKind,
    problem: FitProblem,
    rows: &Rows<'_>,
) -> Result<(Solution, ReadingRanges), FitError> {
    if kind == SolverKind::Exact {
        let moments = exact_sums(problem.model, rows)?;
        let ranges = moments.reading_ranges();
        return Ok((moments.solve(&problem.model, problem.ridge)?.solution, ranges));
    }
    fit_by(kind.into(), problem, rows)
}

/// Sums the rows exactly, as for [`ExactSums::solve`].
///
/// # Errors
/// [`FitError::NotExact`] if they cannot be exact.
pub fn exact_sums(model: Model, rows: &Rows<'_>) -> Result<ExactSums, FitError> {
    model.check_size()?;
    if model.memory > 0 {
        return Err(FitError::NotExact(ExactError::MemoryTerms));
    }
    Ok(rows.reduce(&Accumulator::new(model.basis, model.channels))?.finish()?)
}

impl Pass for Accumulator {
    const ANY_ORDER: bool = true;

    fn absorb(&mut self, block: &Block) -> Result<(), FitError> {
        Ok(self.absorb(&block.readings, &block.wrench)?)
    }

    fn merge(&mut self, later: Self) -> Result<(), FitError> {
        Ok(self.merge(later)?)
    }
}

/// Fits like [`fit`], by a method of [`methods`] on the features.
///
/// # Errors
/// As [`fit`].
pub fn fit_by(
    method: Method,
    problem: FitProblem,
    rows: &Rows<'_>,
) -> Result<(Solution, ReadingRanges), FitError> {
    let FitProblem { model, scaling, ridge: lambda } = problem;
    model.check_size()?;
    if !(lambda >= 0.0 && lambda.is_finite()) {
        return Err(FitError::Ridge(lambda));
    }
    let features = Features::new(model, scaling);
    let free_column = model.intercept.then(|| features.len() - 1);
    let mut rows = FeatureRows { rows, features: &features, ranges: None };
    let ridge = Ridge { lambda, free_column };
    let solved = methods::solve(&mut rows, method, ridge);
    let ranges = rows.ranges.unwrap_or_else(|| ReadingRanges::new(model.columns()));
    match solved {
        Ok((solved, lambda)) => Ok((Solution::new(&features, solved, lambda), ranges)),
        Err(FitError::Solver(error)) => {
            Err(FitError::from_least_squares(error, &features, &ranges))
        }
        Err(error) => Err(error),
    }
}

struct FeatureRows<'a> {
    rows: &'a Rows<'a>,
    features: &'a Features,
    ranges: Option<ReadingRanges>,
}

impl methods::RowSource for FeatureRows<'_> {
    type Error = FitError;

    fn shape(&self) -> Shape {
        Shape { features: self.features.len(), outputs: Axis::ALL.len() }
    }

    fn pass<R: Reduction>(&mut self, empty: &R) -> Result<R, Self::Error> {
        let (features, partial) = (self.features, empty.clone());
        let ranges = ReadingRanges::new(features.model.columns());
        let found = self.rows.reduce(&OverFeatures { features, ranges, partial });
        let OverFeatures { ranges, partial, .. } = found?;
        self.ranges.get_or_insert(ranges);
        Ok(partial)
    }
}

/// Multiplies rows by the square roots of their weights.
fn scale_rows(columns: &mut [f64], stride: usize, weights: &[f64]) {
    for column in columns.chunks_mut(stride) {
        column.iter_mut().zip(weights).for_each(|(x, weight)| *x *= weight.sqrt());
    }
}

/// Reduction of features, with the ranges of the readings, as a pass over blocks.
#[derive(Clone)]
struct OverFeatures<'a, R> {
    features: &'a Features,
    ranges: ReadingRanges,
    partial: R,
}

impl<R: Reduction> Pass for OverFeatures<'_, R> {
    fn rows_together(&self) -> usize {
        R::chunk_rows(self.features.len() + Axis::ALL.len())
    }

    fn absorb(&mut self, block: &Block) -> Result<(), FitError> {
        self.ranges.merge(&ReadingRanges::from_block(block, self.features.model.columns())?);
        let p = self.features.len();
        let columns = p + Axis::ALL.len();
        let stride = R::chunk_rows(columns).min(block.rows);
        let mut heads = vec![0.0; stride * columns];
        let mut tails = vec![0.0; if R::WIDE { stride * p } else { 0 }];
        for start in (0..block.rows).step_by(stride.max(1)) {
            let rows = start..block.rows.min(start + stride);
            let readings = &block.readings;
            let wide = if R::WIDE {
                self.features.fill_wide(readings, rows.clone(), &mut heads, &mut tails, stride)
            } else {
                self.features.fill(readings, rows.clone(), &mut heads, stride);
                false
            };
            for (column, axis) in heads.chunks_mut(stride).skip(p).zip(&block.wrench) {
                column[..rows.len()].copy_from_slice(&axis[rows.clone()]);
            }
            let tails = if wide { &mut tails[..] } else { &mut [] };
            if !block.weights.is_empty() {
                scale_rows(&mut heads, stride, &block.weights[rows.clone()]);
                scale_rows(tails, stride, &block.weights[rows.clone()]);
            }
            let chunk = RowChunk { rows: rows.len(), stride, heads: &heads, tails };
            self.partial.absorb(&chunk);
        }
        Ok(())
    }

    fn merge(&mut self, later: Self) -> Result<(), FitError> {
        self.ranges.merge(&later.ranges);
        self.partial.merge(later.partial);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::{Basis, Model};
    use crate::passes::Rows;
    use crate::scaling::Scaling;
    use system_tests::random::Random;

    #[test]
    fn whole_weights_equal_those_of_repeated_rows() {
        let mut random = Random(19);
        let mut column = |scale: f64| (0..200).map(|_| scale * random.unit()).collect::<Vec<f64>>();
        let readings = vec![column(4000.0), column(4000.0)];
        let wrench: Vec<Vec<f64>> = (0..6).map(|_| column(1.0)).collect();
        let weights: Vec<f64> = (0..200).map(|row| f64::from(row % 4)).collect();
        let repeat = |column: &Vec<f64>| -> Vec<f64> {
            let times = |(&x, &weight): (&f64, &f64)| std::iter::repeat_n(x, weight as usize);
            column.iter().zip(&weights).flat_map(times).collect()
        };
        let repeated = Block {
            rows: 300,
            readings: readings.iter().map(repeat).collect(),
            wrench: wrench.iter().map(repeat).collect(),
            ..Block::default()
        };
        let weighted =
            Block { rows: 200, readings, wrench, weights: weights.clone(), ..Block::default() };
        let model = Model { basis: Basis::Cubic, intercept: true, channels: 2, memory: 0 };
        let scaling = Scaling::from_sample(&repeated.readings, true);
        for kind in
            [SolverKind::Tsqr, SolverKind::RefinedTsqr, SolverKind::WideTsqr, SolverKind::Gram]
        {
            let solve = |block: &Block| {
                let problem = FitProblem { model, scaling: scaling.clone(), ridge: 0.0 };
                fit(kind, problem, &block.into()).unwrap().0
            };
            let (found, expected) = (solve(&weighted), solve(&repeated));
            // Roots of weights are rounded, and the features have a condition number of some hundred.
            let difference = (&found.coefficients - &expected.coefficients).norm_max();
            assert!(difference < 1e-11, "{}: {difference}", kind.name());
            let difference = (&found.residual_products - &expected.residual_products).norm_max();
            assert!(difference < 1e-11, "{}: {difference}", kind.name());
        }
    }

    #[test]
    fn a_solution_without_some_rows_equals_a_fit_to_the_others() {
        let mut random = Random(23);
        let mut column = |scale: f64| (0..200).map(|_| scale * random.unit()).collect::<Vec<f64>>();
        let readings = vec![column(4000.0), column(4000.0)];
        let wrench: Vec<Vec<f64>> = (0..6).map(|_| column(1.0)).collect();
        let all = Block { rows: 200, readings, wrench, ..Block::default() };
        let (mut some, mut others) = (Block::default(), Block::default());
        some.append(&all, 20..60);
        others.append(&all, 0..20);
        others.append(&all, 60..200);
        let model = Model { basis: Basis::Cubic, intercept: true, channels: 2, memory: 0 };
        let scaling = Scaling::from_sample(&all.readings, true);
        let solve = |block: &Block| {
            let problem = FitProblem { model, scaling: scaling.clone(), ridge: 0.0 };
            fit(SolverKind::WideTsqr, problem, &block.into()).unwrap().0
        };
        let (found, expected) = (solve(&all).without(&some).unwrap(), solve(&others));
        assert_eq!(found.rows, 160);
        // Double precision, and features with a condition number of some hundred.
        let products = |solution: &Solution| {
            let factor = &solution.factor;
            factor * factor.transpose()
        };
        let differences = [
            &found.coefficients - &expected.coefficients,
            &found.residual_products - &expected.residual_products,
            products(&found) - products(&expected),
        ];
        for difference in differences {
            assert!(difference.norm_max() < 1e-11, "{}", difference.norm_max());
        }
        // A row that alone determines a coefficient: without it, no digits remain.
        let mut lone = others.clone();
        lone.append(&some, 0..1);
        lone.readings[0][160] = 1e9;
        let mut row = Block::default();
        row.append(&lone, 160..161);
        assert_eq!(solve(&lone).without(&row), None);
    }

    #[test]
    fn the_centre_is_the_mean_of_all_rows_in_any_order() {
        let column: Vec<f64> = (0..1000).map(|i| f64::from(i * 7919 % 4001) / 10.0).collect();
        let scaling = |columns: &[&[f64]]| {
            let (empty, mut all) = (ReadingSums::new(1), ReadingSums::new(1));
            for column in columns {
                let readings = vec![column.to_vec()];
                let block = Block { rows: column.len(), readings, ..Block::default() };
                all.merge(Rows::from(&block).reduce(&empty).unwrap()).unwrap();
            }
            all.scaling(true)
        };
        let mut sorted = column.clone();
        sorted.sort_unstable_by(f64::total_cmp);
        let (head, tail) = column.split_at(311);
        assert_eq!(scaling(&[&column]), scaling(&[&sorted]));
        assert_eq!(scaling(&[&column]), scaling(&[tail, head]));
        assert_eq!(scaling(&[&column]), Scaling::from_sample(std::slice::from_ref(&column), true));
    }
}
