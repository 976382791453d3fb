//! Coefficients from exact sums, in four steps.
//!
//! 1. Rank, in integers (see [`rank`](super::rank)).
//! 2. With an intercept, the origin of each channel is moved to its mean, rounded to an integer: an
//!    exact change of basis that removes most of the collinearity of the powers.
//! 3. Columns and axes are scaled by powers of two to norms near one, the sums are rounded to
//!    double-double, and the normal equations are solved by Cholesky, with a relative error of
//!    about κ(X)²·2⁻¹⁰⁴ (κ after shift and scaling).
//! 4. Where that may be too large, iterative refinement follows, with residuals in exact integers
//!    (Higham, *Accuracy and Stability of Numerical Algorithms*, chapter 12). It converges as long
//!    as κ(X) < 10¹⁵.

use faer::Mat;
use num_bigint::BigInt;
use num_traits::Zero;

use super::double_double_matrix::{AxisRow, Bordered, LANES, factor, solve_lower, solve_upper};
use super::held_out::{EquationScales, ExactFit, penalty_of};
use super::integers::{
    DIGIT_BITS, digit_planes, integer, join, power_of_two, round, round_scaled, shifted,
};
use super::layout::pair;
use super::product_sums::ExactSums;
use super::rank::rank_loss;
use crate::double_double::DoubleDouble;
use crate::error::FitError;
use crate::model::{Model, Term};
use crate::r_factor::condition_and_rank;
use crate::scaling::Scaling;
use crate::solution::Solution;
use crate::symmetric::UpperTriangle;
use shell_data::wrench::{Axis, PerAxis};

impl ExactSums {
    /// Fits `model`: minimises the sum of squared residuals plus `ridge·(c·‖x‖)²` for each feature
    /// except the intercept, with its coefficient `c` and column `x`. Without ridge, each
    /// coefficient is within a unit in the last place, unless it is some 10¹⁰ times smaller than
    /// the coefficients of the other standardised features.
    ///
    /// # Errors
    /// [`FitError`] if the rows do not determine the coefficients.
    pub fn solve(&self, model: &Model, ridge: f64) -> Result<ExactFit, FitError> {
        if !(ridge >= 0.0 && ridge.is_finite()) {
            return Err(FitError::Ridge(ridge));
        }
        let scales = EquationScales::new(self, model)?;
        let size = scales.terms.len();
        if self.rows < size as u64 && ridge == 0.0 {
            return Err(FitError::TooFewRows { rows: self.rows, coefficients: size });
        }
        let loss = rank_loss(self, &scales);
        let rank = loss.as_ref().map_or(size, |loss| loss.rank);
        if let Some(loss) = loss.filter(|_| ridge == 0.0) {
            let is_all = self.reading_ranges().constant_channels().len() == self.channels();
            return Err(match is_all {
                true => FitError::IdenticalRows(self.rows),
                false => FitError::RankDeficient(loss),
            });
        }
        IntegerEquations::new(self, model, scales).solve(ridge, rank)
    }

    /// Returns the terms of a model, or an error if a product of them was not summed.
    pub(crate) fn summed_terms(&self, model: &Model) -> Result<Vec<Term>, FitError> {
        let terms = model.terms();
        let is_summed =
            |term: &Term| *term == Term::INTERCEPT || self.layout.features.contains(term);
        let (basis, channels) = (self.basis, self.channels());
        if model.channels != channels {
            return Err(FitError::Channels { expected: model.channels, found: channels });
        }
        if terms.iter().all(is_summed) {
            return Ok(terms);
        }
        let summed = Model { basis, intercept: true, channels, memory: 0 };
        Err(FitError::OtherFeatures { kept: summed.name(), asked: model.name() })
    }

    pub(crate) fn rounded_mean(&self, channel: usize) -> i64 {
        let rows = i128::from(self.rows);
        (self.sum_of(channel) + rows / 2).div_euclid(rows) as i64
    }

    pub(crate) fn sum_of(&self, channel: usize) -> i128 {
        let channel = u8::try_from(channel).expect("as many channels as terms name");
        self.readings[self.layout.position(Term::product(&[channel]), Term::INTERCEPT)]
    }

    /// Exponent of the smallest power of two that no reading exceeds in distance from `centre`.
    pub(crate) fn reach(&self, channel: usize, centre: i64) -> i32 {
        let range = &self.channels[channel];
        let reach = (range.highest - centre).max(centre - range.lowest).max(1);
        (reach as u64).next_power_of_two().ilog2() as i32
    }

    /// Variance of the loads, N² or (N·m)²; NaN over zero rows.
    pub fn variance(&self, axis: Axis) -> f64 {
        self.total_square(axis.index()) / self.rows as f64
    }

    /// Mean square of the loads, N² or (N·m)²; NaN over zero rows.
    pub fn mean_square(&self, axis: usize) -> f64 {
        let square = &self.squares[pair(axis, axis)];
        round_scaled(&square.values[0], square.exponent).to_f64() / self.rows as f64
    }

    /// Sum of squared deviations from the mean.
    pub fn total_square(&self, axis: usize) -> f64 {
        let square = &self.squares[pair(axis, axis)];
        let sums = &self.wrench[axis];
        let sum = &sums.values[0];
        // n·Σw² − (Σw)², in the finer unit of the two.
        let unit = square.exponent.min(2 * sums.exponent);
        let squares = (&square.values[0] << (square.exponent - unit)) * self.rows;
        let difference = squares - ((sum * sum) << (2 * sums.exponent - unit));
        let total = round_scaled(&difference, unit) / DoubleDouble::from(self.rows as f64);
        total.to_f64()
    }
}

/// Condition number above which the error of Cholesky, κ²·2⁻¹⁰⁴, may affect the last place of a
/// coefficient a thousand times smaller than others.
const REFINE_ABOVE: f64 = 1e5;

/// Relative size of a correction that does not change the coefficients rounded to `f64`.
const DONE: f64 = 1.0 / (1u64 << 60) as f64;

pub(crate) struct IntegerEquations<'a> {
    moments: &'a ExactSums,
    model: Model,
    scales: EquationScales,
    readings: Vec<i128>,
    wrench: PerAxis<Vec<BigInt>>,
}

impl<'a> IntegerEquations<'a> {
    pub(crate) fn new(moments: &'a ExactSums, model: &Model, scales: EquationScales) -> Self {
        let (readings, wrench) = moments.about(&scales.centre);
        let sums = 0..=moments.layout.features.len();
        let wrench = wrench.map(|axis| sums.clone().map(|position| axis.value(position)).collect());
        Self { moments, model: *model, scales, readings, wrench }
    }

    pub(crate) fn solve(self, ridge: f64, rank: usize) -> Result<ExactFit, FitError> {
        let size = self.scales.terms.len();
        let mut bordered = Bordered::zero(size, 6);
        let mut penalties = vec![DoubleDouble::ZERO; size];
        for (a, penalty) in penalties.iter_mut().enumerate() {
            for b in a..size {
                let scale = power_of_two(-self.scales.columns[a] - self.scales.columns[b]);
                bordered.set(a, b, round(self.gram(a, b)).scaled(scale));
            }
            if self.scales.terms[a] != Term::INTERCEPT && ridge > 0.0 {
                let square = bordered.get(a, a);
                *penalty = penalty_of(square, ridge);
                bordered.set(a, a, square + *penalty);
            }
            for axis in 0..6 {
                let (value, exponent) = self.right(a, axis);
                let exponent = exponent - self.scales.columns[a] - self.scales.axes[axis];
                bordered.set(a, size + axis, round_scaled(value, exponent));
            }
        }
        for a in 0..6 {
            for b in a..6 {
                let square = &self.moments.squares[pair(a, b)];
                let exponent = square.exponent - self.scales.axes[a] - self.scales.axes[b];
                bordered.set(size + a, size + b, round_scaled(&square.values[0], exponent));
            }
        }
        let products: Vec<AxisRow> = (0..size + 6).map(|a| bordered.border(a)).collect();
        factor(&mut bordered).map_err(|_| FitError::NearlyDependent)?;
        let mut coefficients: Vec<AxisRow> = (0..size).map(|a| bordered.border(a)).collect();
        solve_upper(&bordered, &mut coefficients);
        let condition = condition(&bordered);
        if !condition.is_finite() {
            return Err(FitError::NearlyDependent);
        }
        if condition > REFINE_ABOVE {
            self.refine(&bordered, &penalties, &mut coefficients)?;
        }
        let residuals = if ridge == 0.0 {
            (0..6).map(|a| bordered.border(size + a)).collect()
        } else {
            penalised_residuals(&products, &coefficients, &penalties)
        };
        self.fit(&bordered, &coefficients, &residuals, condition, (ridge, rank))
    }

    fn gram(&self, a: usize, b: usize) -> i128 {
        self.readings[self.scales.positions[a * self.scales.terms.len() + b]]
    }

    fn right(&self, a: usize, axis: usize) -> (&BigInt, i32) {
        let position = self.moments.layout.position(self.scales.terms[a], Term::INTERCEPT);
        (&self.wrench[axis][position], self.moments.wrench[axis].exponent)
    }

    /// Corrects the coefficients by solving for the exact residual of the normal equations.
    fn refine(
        &self,
        cholesky: &Bordered,
        penalties: &[DoubleDouble],
        coefficients: &mut [AxisRow],
    ) -> Result<(), FitError> {
        /// Maximum number of rounds. Each gains as many digits as the first solution had.
        const ROUNDS: usize = 8;
        let mut before = f64::INFINITY;
        for _ in 0..ROUNDS {
            let mut correction = self.residual(penalties, coefficients);
            solve_lower(cholesky, &mut correction);
            solve_upper(cholesky, &mut correction);
            let mut largest: f64 = 0.0;
            for (row, correction) in coefficients.iter_mut().zip(&correction) {
                for (c, &d) in row.iter_mut().zip(correction) {
                    *c += d;
                    if d != DoubleDouble::ZERO {
                        largest = largest.max((d.to_f64() / c.to_f64()).abs());
                    }
                }
            }
            if largest > DONE && largest >= before || largest.is_nan() {
                return Err(FitError::NearlyDependent);
            }
            // The next correction would be smaller by the same factor again.
            if largest < DONE {
                return Ok(());
            }
            before = largest;
        }
        Err(FitError::NearlyDependent)
    }

    /// `b − (A + penalties)·c`, rounded once.
    fn residual(&self, penalties: &[DoubleDouble], coefficients: &[AxisRow]) -> Vec<AxisRow> {
        let size = self.scales.terms.len();
        let (units, integers) = self.integers(coefficients);
        let planes = integers.each_ref().map(|column| digit_planes(column));
        let mut residual = vec![[DoubleDouble::ZERO; LANES]; size];
        for (a, residual) in residual.iter_mut().enumerate() {
            let gram: Vec<i128> = (0..size).map(|b| self.gram(a, b)).collect();
            for (axis, planes) in planes.iter().enumerate() {
                let sum = product(&gram, |sum| i128::from(sum as u64), planes)
                    + (product(&gram, |sum| sum >> 64, planes) << 64);
                let (right, exponent) = self.right(a, axis);
                let lowest = units[axis].min(exponent);
                let rest = (right << (exponent - lowest)) - (sum << (units[axis] - lowest));
                let exponent = lowest - self.scales.columns[a] - self.scales.axes[axis];
                let penalty = penalties[a] * coefficients[a][axis];
                residual[axis] = round_scaled(&rest, exponent) - penalty;
            }
        }
        residual
    }

    /// Exponents of units, and the coefficients of each axis for unscaled columns as integers in these units.
    fn integers(&self, coefficients: &[AxisRow]) -> ([i32; 6], PerAxis<Vec<BigInt>>) {
        let mut units = [0; 6];
        let integers = std::array::from_fn(|axis| {
            let parts: Vec<[(BigInt, i32); 2]> = (coefficients.iter().zip(&self.scales.columns))
                .map(|(row, &column)| {
                    let up = self.scales.axes[axis] - column;
                    [row[axis].to_f64(), row[axis].tail()].map(|x| {
                        let (integer, exponent) = integer(x);
                        (integer, exponent + up)
                    })
                })
                .collect();
            let unit = parts.iter().flatten().filter(|(n, _)| !n.is_zero()).map(|&(_, e)| e).min();
            units[axis] = unit.unwrap_or(0);
            let whole = |parts: &[(BigInt, i32); 2]| {
                let parts = parts.iter().filter(|(n, _)| !n.is_zero());
                parts.map(|(n, e)| n << (e - units[axis])).sum()
            };
            parts.iter().map(whole).collect()
        });
        (units, integers)
    }

    fn fit(
        self,
        cholesky: &Bordered,
        coefficients: &[AxisRow],
        residuals: &[AxisRow],
        condition: f64,
        (ridge, rank): (f64, usize),
    ) -> Result<ExactFit, FitError> {
        let EquationScales { ref centre, ref terms, ref columns, axes, .. } = self.scales;
        let unit = |i: usize| self.moments.channels[i].unit;
        let reach: Vec<i32> =
            centre.iter().enumerate().map(|(i, &c)| self.moments.reach(i, c)).collect();
        let reach_of = |term: &Term| term.factors().iter().map(|&c| reach[usize::from(c)]).sum();
        let counted: Vec<i32> = terms.iter().map(reach_of).collect();
        // A column of the factor times 2^exponent is the column of the centred and scaled feature.
        let exponents: Vec<i32> =
            counted.iter().zip(columns).map(|(counted, column)| counted - column).collect();
        let ratio = |&c: &u8| {
            let unit = unit(usize::from(c));
            DoubleDouble::from(power_of_two(unit.nearest_power()))
                / DoubleDouble::from(f64::from(unit.per_count()))
        };
        let feature_ratios: Vec<DoubleDouble> = (terms.iter())
            .map(|term| term.factors().iter().map(ratio).fold(DoubleDouble::ONE, |a, b| a * b))
            .collect();
        let scaled = |(row, (&exponent, &ratio)): (&AxisRow, (&i32, &DoubleDouble))| {
            std::array::from_fn(|axis| shifted(row[axis], exponent + axes[axis]) / ratio)
        };
        let coefficients: Vec<PerAxis<DoubleDouble>> =
            coefficients.iter().zip(exponents.iter().zip(&feature_ratios)).map(scaled).collect();
        if !coefficients.iter().flatten().all(|c| c.is_finite()) {
            return Err(FitError::Overflow);
        }
        let centre = (centre.iter().enumerate())
            .map(|(i, &centre)| centre as f64 / f64::from(unit(i).per_count()));
        let scale = (reach.iter().enumerate())
            .map(|(i, reach)| power_of_two(reach - unit(i).nearest_power()));
        let r_factor = UpperTriangle::from_fn(terms.len(), |i, j| {
            (shifted(cholesky.get(i, j), -exponents[j]) * feature_ratios[j]).to_f64()
        });
        let residual_product = |a: usize, b: usize| {
            let product = shifted(residuals[a.min(b)][a.max(b)], axes[a] + axes[b]).to_f64();
            // With no residual left, rounding may make the product negative.
            if a == b { product.max(0.0) } else { product }
        };
        let solution = Solution {
            model: self.model,
            scaling: Scaling { centre: centre.collect(), scale: scale.collect() },
            coefficients: Mat::from_fn(terms.len(), 6, |i, a| coefficients[i][a].to_f64()),
            factor: r_factor.inverse().matrix(),
            residual_products: Mat::from_fn(6, 6, residual_product),
            rows: self.moments.rows,
            condition,
            rank,
            ridge,
        };
        let scales = EquationScales { columns: counted, axes: [0; 6], ..self.scales };
        Ok(ExactFit { solution, coefficients, scales, feature_ratios })
    }
}

/// Sum of products of 64-bit halves with the digits of long integers. Partial sums stay below 2⁹⁶:
/// no carry is needed.
fn product(values: &[i128], half: impl Fn(i128) -> i128, planes: &[Vec<i128>]) -> BigInt {
    let of_plane = |plane: &Vec<i128>| values.iter().zip(plane).map(|(&v, d)| half(v) * d).sum();
    let sums: Vec<i128> = planes.iter().map(of_plane).collect();
    join(sums.into_iter(), DIGIT_BITS)
}

fn penalised_residuals(
    products: &[AxisRow],
    c: &[AxisRow],
    penalties: &[DoubleDouble],
) -> Vec<AxisRow> {
    let size = c.len();
    (0..6)
        .map(|a| {
            let mut row = products[size + a];
            for j in 0..size {
                for b in 0..6 {
                    row[b] -= c[j][a] * (products[j][b] + penalties[j] * c[j][b]);
                }
            }
            row
        })
        .collect()
}

/// Condition number with columns of norm one, to six digits: further digits depend on the vector width.
fn condition(cholesky: &Bordered) -> f64 {
    let size = cholesky.size;
    let mut r = Mat::<f64>::zeros(size, size);
    for j in 0..size {
        let column: Vec<f64> = (0..=j).map(|i| cholesky.get(i, j).to_f64()).collect();
        let norm = column.iter().map(|x| x * x).sum::<f64>().sqrt();
        for (i, x) in column.into_iter().enumerate() {
            r[(i, j)] = x / norm;
        }
    }
    condition_and_rank(&r, 0.0).map_or(f64::INFINITY, |(condition, _)| six_digits(condition))
}

fn six_digits(number: f64) -> f64 {
    format!("{number:.5e}").parse().unwrap_or(number)
}
