//! From exact sums to coefficients.
//!
//! 1. Rank, in integers (see [`rank`](super::rank)).
//! 2. With an intercept, the origin of each channel is moved to its mean, rounded to an integer: an
//!    exact change of basis that takes most of the collinearity out of the powers.
//! 3. Columns and axes are scaled by powers of two to norms near one, the sums rounded to
//!    double-double, and the normal equations solved by Cholesky. Relative error: about
//!    κ(X)²·2⁻¹⁰⁴, with κ after shift and scaling.
//! 4. Where that may not do, iterative refinement with residuals in exact integers, as in Higham,
//!    *Accuracy and Stability of Numerical Algorithms*, chapter 12: it converges as long as
//!    κ(X) < 10¹⁵.

use faer::Mat;
use num_bigint::BigInt;
use num_traits::{ToPrimitive, Zero};

use super::cholesky::{Bordered, LANES, Row};
use super::limbs::power_of_two;
use super::moments::Moments;
use super::open_sums::pair;
use super::rank::{RankLoss, rank_loss};
use crate::calibration::model::{Model, Term};
use crate::double_double::DoubleDouble;
use crate::wrench::{Axis, PerAxis};

/// Coefficients, and what the sums say about them. Features are in the order of [`Model::terms`],
/// axes in that of [`crate::wrench::Axis::ALL`].
#[derive(Clone, Debug)]
pub struct Fit {
    /// The features.
    pub model: Model,
    /// Rows fitted.
    pub rows: u64,
    /// What is subtracted from the readings of each channel before products are taken, in counts;
    /// zero without an intercept.
    pub centre: Vec<f64>,
    /// What they are divided by after that: a power of two.
    pub scale: Vec<f64>,
    /// One row per feature of centred and scaled readings, in N and N·m.
    pub coefficients: Vec<PerAxis<DoubleDouble>>,
    /// `(W − X·C)ᵀ(W − X·C)`, in products of N and N·m.
    pub residual_products: [PerAxis<f64>; 6],
    /// For each axis the sum of squared differences from the mean.
    pub total_squares: PerAxis<f64>,
    /// Condition number of the features, columns scaled to norm one.
    pub condition: f64,
    /// Independent features: all, unless a ridge stands in for the others.
    pub rank: usize,
    factor: Factor,
    pub(super) counted: Counted,
}

/// Why the sums give no coefficients.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SolveError {
    /// Fewer rows than coefficients.
    #[error("`{rows}` rows are too few for the `{coefficients}` coefficients of each axis")]
    TooFewRows {
        /// Rows summed.
        rows: u64,
        /// Coefficients of each axis.
        coefficients: usize,
    },
    /// Some features are combinations of others.
    #[error("{0}")]
    RankDeficient(RankLoss),
    /// The features are independent, but so nearly not that refinement does not converge.
    #[error("the features are so nearly dependent that their coefficients cannot be computed")]
    NearlyDependent,
    /// A coefficient is too large for `f64`.
    #[error("coefficients exceed the range of numbers")]
    Overflow,
    /// A ridge parameter that is not a finite number from zero up.
    #[error("the ridge parameter is `{0}`, expected a finite number that is not negative")]
    Ridge(f64),
    /// Features that were not summed.
    #[error("the sums are for `{summed}` features, not for `{asked}`")]
    OtherFeatures {
        /// What the sums are for.
        summed: String,
        /// What was asked for.
        asked: String,
    },
}

/// The Cholesky factor of scaled features.
#[derive(Clone, Debug)]
struct Factor {
    cholesky: Bordered,
    /// `2^exponent` times a column of it is that of the centred and scaled feature.
    exponents: Vec<i32>,
}

/// The features of readings that are counted in the units of the sums.
#[derive(Clone, Debug)]
pub(super) struct Counted {
    /// What is subtracted.
    pub(super) centre: Vec<i64>,
    /// The power of two that the rest is divided by.
    pub(super) reach: Vec<i32>,
    /// How much larger a feature of [`Fit`] is than one of these: one where units are powers of two.
    pub(super) stretch: Vec<DoubleDouble>,
}

impl Moments {
    /// The coefficients of `model` that fit the rows best: those that minimise the sum of squares
    /// of residuals and, for each feature but the intercept, of `√ridge` times its coefficient
    /// times the norm of its column.
    ///
    /// Without ridge, each coefficient is within a unit in the last place of the exact solution
    /// unless it is some 10¹⁰ times smaller than its standard fellow features suggest.
    ///
    /// # Errors
    /// [`SolveError`] if the rows do not determine the coefficients.
    pub fn solve(&self, model: &Model, ridge: f64) -> Result<Fit, SolveError> {
        let terms = model.terms();
        if !(ridge >= 0.0 && ridge.is_finite()) {
            return Err(SolveError::Ridge(ridge));
        }
        if model.channels != self.channels.len() || !contains(self, &terms) {
            let summed =
                Model { basis: self.basis, intercept: true, channels: self.channels.len() };
            return Err(SolveError::OtherFeatures { summed: summed.name(), asked: model.name() });
        }
        if self.rows < terms.len() as u64 && ridge == 0.0 || self.rows == 0 {
            return Err(SolveError::TooFewRows { rows: self.rows, coefficients: terms.len() });
        }
        let positions = self.positions(&terms);
        let loss = rank_loss(self, &terms, &positions);
        let rank = loss.as_ref().map_or(terms.len(), |loss| loss.rank);
        if let Some(loss) = loss.filter(|_| ridge == 0.0) {
            return Err(SolveError::RankDeficient(loss));
        }
        let centre: Vec<i64> = (0..model.channels)
            .map(|i| if model.intercept { self.rounded_mean(i) } else { 0 })
            .collect();
        Equations::new(self, model, terms, positions, &centre).solve(ridge, rank)
    }

    /// Where the products of each two terms stand among the sums, row by row.
    pub(super) fn positions(&self, terms: &[Term]) -> Vec<usize> {
        let size = terms.len();
        let mut positions = vec![0; size * size];
        for a in 0..size {
            for b in a..size {
                let position = self.layout.position(terms[a], terms[b]);
                positions[a * size + b] = position;
                positions[b * size + a] = position;
            }
        }
        positions
    }

    pub(super) fn rounded_mean(&self, channel: usize) -> i64 {
        let sum = self.readings[1 + self.layout.single(channel)];
        let rows = i128::from(self.rows);
        (sum + rows / 2).div_euclid(rows) as i64
    }

    /// The exponent of the power of two that no reading is farther from `centre` than.
    fn reach(&self, channel: usize, centre: i64) -> i32 {
        let range = &self.channels[channel];
        let reach = (range.highest - centre).max(centre - range.lowest).max(1);
        (reach as u64).next_power_of_two().ilog2() as i32
    }
}

pub(super) fn contains(moments: &Moments, terms: &[Term]) -> bool {
    terms.iter().all(|term| *term == Term::INTERCEPT || moments.layout.features.contains(term))
}

/// The normal equations in integers.
struct Equations<'a> {
    moments: &'a Moments,
    model: Model,
    terms: Vec<Term>,
    centre: Vec<i64>,
    reach: Vec<i32>,
    /// Sums about the centre, in the order of the layout.
    readings: Vec<i128>,
    wrench: [Vec<BigInt>; 6],
    /// Where the products of each two terms stand in `readings`, row by row.
    positions: Vec<usize>,
    /// Columns are divided by two to these.
    columns: Vec<i32>,
    /// Axes are divided by two to these.
    axes: [i32; 6],
}

impl<'a> Equations<'a> {
    fn new(
        moments: &'a Moments,
        model: &Model,
        terms: Vec<Term>,
        positions: Vec<usize>,
        centre: &[i64],
    ) -> Self {
        let (readings, wrench) = moments.about(centre);
        let sums = 0..=moments.layout.features.len();
        let wrench = wrench.map(|axis| sums.clone().map(|place| axis.value(place)).collect());
        let size = terms.len();
        let half = |exponent: i32| exponent.div_euclid(2) + 1;
        let columns = (0..size).map(|j| match readings[positions[j * size + j]] {
            0 => 0,
            square => half(square.ilog2() as i32),
        });
        let axes = std::array::from_fn(|a| {
            let square = &moments.squares[pair(a, a)];
            if square.values[0].is_zero() {
                return 0;
            }
            half(square.exponent + square.values[0].bits() as i32 - 1)
        });
        Self {
            columns: columns.collect(),
            axes,
            model: *model,
            reach: centre.iter().enumerate().map(|(i, &c)| moments.reach(i, c)).collect(),
            centre: centre.to_vec(),
            terms,
            readings,
            wrench,
            positions,
            moments,
        }
    }

    fn solve(self, ridge: f64, rank: usize) -> Result<Fit, SolveError> {
        let size = self.terms.len();
        let mut bordered = Bordered::zero(size, 6);
        let mut penalties = vec![DoubleDouble::ZERO; size];
        for (a, penalty) in penalties.iter_mut().enumerate() {
            for b in a..size {
                let scale = power_of_two(-self.columns[a] - self.columns[b]);
                bordered.set(a, b, round(self.gram(a, b)).scaled(scale));
            }
            if self.terms[a] != Term::INTERCEPT && ridge > 0.0 {
                let square = bordered.get(a, a);
                // A column of zeros: any penalty keeps its coefficient at zero.
                let square = if square == DoubleDouble::ZERO { DoubleDouble::ONE } else { square };
                *penalty = square * DoubleDouble::from(ridge);
                bordered.set(a, a, bordered.get(a, a) + *penalty);
            }
            for axis in 0..6 {
                let (value, exponent) = self.right(a, axis);
                let exponent = exponent - self.columns[a] - self.axes[axis];
                bordered.set(a, size + axis, round_scaled(value, exponent));
            }
        }
        for a in 0..6 {
            for b in a..6 {
                let square = &self.moments.squares[pair(a, b)];
                let exponent = square.exponent - self.axes[a] - self.axes[b];
                bordered.set(size + a, size + b, round_scaled(&square.values[0], exponent));
            }
        }
        let products: Vec<Row> = (0..size + 6).map(|a| border(&bordered, a)).collect();
        bordered.factor().map_err(|_| SolveError::NearlyDependent)?;
        let mut coefficients: Vec<Row> = (0..size).map(|a| border(&bordered, a)).collect();
        bordered.solve_upper(&mut coefficients);
        let condition = condition(&bordered);
        if !condition.is_finite() {
            return Err(SolveError::NearlyDependent);
        }
        if condition > REFINE_ABOVE {
            self.refine(&bordered, &penalties, &mut coefficients)?;
        }
        let residuals = if ridge == 0.0 {
            (0..6).map(|a| border(&bordered, size + a)).collect()
        } else {
            penalised_residuals(&products, &coefficients, &penalties)
        };
        self.fit(bordered, &coefficients, &residuals, condition, rank)
    }

    fn gram(&self, a: usize, b: usize) -> i128 {
        self.readings[self.positions[a * self.terms.len() + b]]
    }

    /// The sum of feature `a` times the wrench: integer and exponent.
    fn right(&self, a: usize, axis: usize) -> (&BigInt, i32) {
        let position = self.moments.layout.position(self.terms[a], Term::INTERCEPT);
        (&self.wrench[axis][position], self.moments.wrench[axis].exponent)
    }

    /// Corrects the coefficients by solving for the exact residual of the normal equations.
    fn refine(
        &self,
        cholesky: &Bordered,
        penalties: &[DoubleDouble],
        coefficients: &mut [Row],
    ) -> Result<(), SolveError> {
        /// Each round gains what the first solution had in digits.
        const ROUNDS: usize = 8;
        let mut before = f64::INFINITY;
        for _ in 0..ROUNDS {
            let mut correction = self.residual(penalties, coefficients);
            cholesky.solve_lower(&mut correction);
            cholesky.solve_upper(&mut correction);
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
                return Err(SolveError::NearlyDependent);
            }
            // The next correction would be smaller than this one by the same factor again.
            if largest < DONE {
                return Ok(());
            }
            before = largest;
        }
        Err(SolveError::NearlyDependent)
    }

    /// `b − (A + penalties)·c`, rounded once.
    fn residual(&self, penalties: &[DoubleDouble], coefficients: &[Row]) -> Vec<Row> {
        let size = self.terms.len();
        let mut residual = vec![[DoubleDouble::ZERO; LANES]; size];
        for axis in 0..6 {
            // Coefficients of unscaled columns, as integers times 2^unit.
            let parts: Vec<[(BigInt, i32); 2]> = (coefficients.iter().zip(&self.columns))
                .map(|(row, &column)| {
                    let up = self.axes[axis] - column;
                    [row[axis].to_f64(), row[axis].tail()].map(|x| {
                        let (integer, exponent) = integer(x);
                        (integer, exponent + up)
                    })
                })
                .collect();
            let unit = parts.iter().flatten().filter(|(n, _)| !n.is_zero()).map(|&(_, e)| e).min();
            let unit = unit.unwrap_or(0);
            let integers: Vec<BigInt> = parts
                .iter()
                .map(|parts| {
                    let whole = parts.iter().filter(|(n, _)| !n.is_zero());
                    whole.map(|(n, e)| n << (e - unit)).sum()
                })
                .collect();
            for (a, residual) in residual.iter_mut().enumerate() {
                let sum: BigInt = (integers.iter().enumerate())
                    .map(|(b, coefficient)| coefficient * self.gram(a, b))
                    .sum();
                let (right, exponent) = self.right(a, axis);
                let lowest = unit.min(exponent);
                let rest = (right << (exponent - lowest)) - (sum << (unit - lowest));
                let exponent = lowest - self.columns[a] - self.axes[axis];
                let penalty = penalties[a] * coefficients[a][axis];
                residual[axis] = round_scaled(&rest, exponent) - penalty;
            }
        }
        residual
    }

    fn fit(
        self,
        cholesky: Bordered,
        coefficients: &[Row],
        residuals: &[Row],
        condition: f64,
        rank: usize,
    ) -> Result<Fit, SolveError> {
        let unit = |i: usize| self.moments.channels[i].unit;
        let exponents: Vec<i32> = (self.terms.iter().zip(&self.columns))
            .map(|(term, &column)| {
                let reach: i32 = term.factors().iter().map(|&c| self.reach[usize::from(c)]).sum();
                reach - column
            })
            .collect();
        let stretch = |&c: &u8| {
            let unit = unit(usize::from(c));
            DoubleDouble::from(power_of_two(unit.nearest_power()))
                / DoubleDouble::from(f64::from(unit.per_count()))
        };
        let stretch: Vec<DoubleDouble> = (self.terms.iter())
            .map(|term| term.factors().iter().map(stretch).fold(DoubleDouble::ONE, |a, b| a * b))
            .collect();
        let scaled = |(row, (&exponent, &stretch)): (&Row, (&i32, &DoubleDouble))| {
            std::array::from_fn(|axis| shifted(row[axis], exponent + self.axes[axis]) / stretch)
        };
        let coefficients: Vec<PerAxis<DoubleDouble>> =
            coefficients.iter().zip(exponents.iter().zip(&stretch)).map(scaled).collect();
        if !coefficients.iter().flatten().all(|c| c.is_finite()) {
            return Err(SolveError::Overflow);
        }
        let residual_products = std::array::from_fn(|a| {
            std::array::from_fn(|b| {
                let (low, high) = (a.min(b), a.max(b));
                let product = residuals[low][high];
                let product = shifted(product, self.axes[a] + self.axes[b]).to_f64();
                // Where nothing is left, rounding may leave less than nothing.
                if a == b { product.max(0.0) } else { product }
            })
        });
        let channels = 0..self.model.channels;
        Ok(Fit {
            model: self.model,
            rows: self.moments.rows,
            centre: channels
                .clone()
                .map(|i| self.centre[i] as f64 / f64::from(unit(i).per_count()))
                .collect(),
            scale: channels
                .map(|i| power_of_two(self.reach[i] - unit(i).nearest_power()))
                .collect(),
            coefficients,
            residual_products,
            total_squares: std::array::from_fn(|axis| self.moments.total_square(axis)),
            condition,
            rank,
            factor: Factor { cholesky, exponents },
            counted: Counted { centre: self.centre, reach: self.reach, stretch },
        })
    }
}

/// Condition numbers from which the error of Cholesky, κ²·2⁻¹⁰⁴, may show in the last place of a
/// coefficient a thousand times smaller than others.
const REFINE_ABOVE: f64 = 1e5;

/// A correction that does not change what is rounded to `f64`.
const DONE: f64 = 1.0 / (1u64 << 60) as f64;

impl Moments {
    /// The variance of an axis over all rows, in N² or (N·m)²; NaN of no rows.
    pub fn variance(&self, axis: Axis) -> f64 {
        self.total_square(axis.index()) / self.rows as f64
    }

    /// The sum of squared differences from the mean of an axis.
    pub(super) fn total_square(&self, axis: usize) -> f64 {
        let square = &self.squares[pair(axis, axis)];
        let sums = &self.wrench[axis];
        let sum = &sums.values[0];
        // n·Σw² − (Σw)² in units of the finer of both.
        let unit = square.exponent.min(2 * sums.exponent);
        let squares = (&square.values[0] << (square.exponent - unit)) * self.rows;
        let difference = squares - ((sum * sum) << (2 * sums.exponent - unit));
        let total = round_scaled(&difference, unit) / DoubleDouble::from(self.rows as f64);
        total.to_f64()
    }
}

impl Fit {
    /// The fraction of the variance of each axis that the fit explains; `None` for an axis that
    /// does not vary.
    pub fn r_squared(&self) -> PerAxis<Option<f64>> {
        std::array::from_fn(|axis| {
            let total = self.total_squares[axis];
            (total > 0.0).then(|| 1.0 - self.residual_products[axis][axis] / total)
        })
    }

    /// Upper triangular `R` with `RᵀR = XᵀX`, ridge included: columns are features of centred and
    /// scaled readings. In `f64`, which is enough for standard errors.
    pub fn triangle(&self) -> Mat<f64> {
        let Factor { cholesky, exponents } = &self.factor;
        Mat::from_fn(cholesky.size, cholesky.size, |i, j| match i <= j {
            true => (shifted(cholesky.get(i, j), -exponents[j]) * self.counted.stretch[j]).to_f64(),
            false => 0.0,
        })
    }
}

fn border(bordered: &Bordered, row: usize) -> Row {
    let first = bordered.size;
    std::array::from_fn(
        |axis| {
            if axis < 6 { bordered.get(row, first + axis) } else { DoubleDouble::ZERO }
        },
    )
}

/// `WᵀW − CᵀB − CᵀPC`, which are the residuals of `(A + P)·C = B`.
fn penalised_residuals(products: &[Row], c: &[Row], penalties: &[DoubleDouble]) -> Vec<Row> {
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

/// The condition number of a factor with its columns scaled to norm one.
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
    match r.singular_values() {
        Ok(values) => match (values.first(), values.last()) {
            (Some(largest), Some(smallest)) => largest / smallest,
            _ => 1.0,
        },
        Err(_) => f64::INFINITY,
    }
}

/// A double-double of an integer below 2¹²⁶: the integer itself up to 2¹⁰⁶.
#[inline(always)]
pub(super) fn round(value: i128) -> DoubleDouble {
    /// Digits of so many bits, the highest of at most 47, are exact in `f64`, and so are sums of two
    /// neighbours in a head and a tail.
    const BITS: u32 = 40;
    const MASK: u64 = (1 << BITS) - 1;
    let low = (value as u64 & MASK) as i64;
    let middle = ((value >> BITS) as u64 & MASK) as i64;
    let high = (value >> (2 * BITS)) as i64;
    let (middle, high) =
        (middle as f64 * power_of_two(BITS as i32), high as f64 * power_of_two(2 * BITS as i32));
    DoubleDouble::from_sum(high, middle) + DoubleDouble::from(low as f64)
}

/// `value·2^exponent` as a double-double.
pub(super) fn round_scaled(value: &BigInt, exponent: i32) -> DoubleDouble {
    /// More bits than these do not matter.
    const BITS: u64 = 240;
    let cut = value.bits().saturating_sub(BITS);
    let (value, exponent) = match cut {
        0 => (value.clone(), exponent),
        _ => (value >> cut, exponent + cut as i32),
    };
    let to_f64 = |x: &BigInt| x.to_f64().unwrap_or(0.0);
    let head = to_f64(&value);
    let (significand, up) = integer(head);
    let rest = value - if up >= 0 { significand << up } else { significand >> -up };
    shifted(DoubleDouble::from_sum(head, to_f64(&rest)), exponent)
}

/// `value·2^exponent`, in steps that do not leave the range of `f64` unless the result does.
pub(super) fn shifted(value: DoubleDouble, exponent: i32) -> DoubleDouble {
    const STEP: i32 = 1000;
    let (mut value, mut exponent) = (value, exponent);
    while exponent.abs() > STEP {
        let step = STEP * exponent.signum();
        value = value.scaled(power_of_two(step));
        exponent -= step;
    }
    value.scaled(power_of_two(exponent))
}

/// A finite number as an integer times a power of two.
fn integer(value: f64) -> (BigInt, i32) {
    let bits = value.abs().to_bits();
    let (exponent, fraction) = ((bits >> 52) as i32, bits & ((1 << 52) - 1));
    let (significand, exponent) = match exponent {
        0 => (fraction, -1074),
        _ => (fraction | 1 << 52, exponent - 1075),
    };
    let integer = BigInt::from(significand);
    (if value.is_sign_negative() { -integer } else { integer }, exponent)
}
