//! Fits without some of the rows, and their errors on those rows, from sums alone.
//!
//! Let `A = XᵀX`, `B = XᵀW`, `D = WᵀW` over all rows, and `A_g`, `B_g`, `D_g` over a part g. The fit without the part
//! solves `(A − A_g)·C = B − B_g`, and its squared errors on the part are
//!
//! ```text
//! diag(D_g − 2·CᵀB_g + CᵀA_g·C)
//! ```
//!
//! `A − A_g` is computed in integers, relative to the mean of all rows, so it equals the sum over the other rows
//! exactly. The rest is in double-double. By Cauchy's inequality the terms of the last formula are at most
//! `t = (√D_g + Σ_j |C_j|·√A_g[j][j])²`, and its rounding error is below `p·2⁻⁹⁸·t` for p features: cancellation would
//! have to cost 20 digits before the tenth digit was wrong.
//!
//! The [scatter](crate::sandwich) of coefficients over groups needs `K_g` and `u_g`, which come from `A_g` and the
//! scores `s_g = B_g − A_g·C`. Scores cancel, so they are in double-double. The rest is in `f64`, with a relative error
//! of about κ(X)²·2⁻⁵³ in a variance. If `T·Tᵀ` is the covariance of the coefficients, they contribute `tr(TᵀA_gT)/n`
//! to the mean prediction variance over the n rows of a group.

use super::double_double_matrix::{
    AxisRow, DoubleDoubleMatrix, ElementLanes, LANES, axis_row, residual_of,
};
use super::integers::{power_of_two, round, round_scaled};
use super::layout::pair;
use super::product_sums::ExactSums;
use super::readings::ReadingUnit;
use crate::double_double::DoubleDouble;
use crate::error::FitError;
use crate::held_out_errors::HeldOutErrors;
use crate::model::{Model, Term};
use crate::quality::AxisQuality;
use crate::sandwich::{GroupScatter, ScatterSums, corrected};
use crate::satterthwaite;
use crate::solution::Solution;
use crate::symmetric::{UpperTriangle, congruence, trace_of_congruence};
use shell_data::vectorised;
use shell_data::wrench::PerAxis;

#[derive(Debug)]
pub struct PartitionedSums<'a> {
    pub(crate) total: &'a ExactSums,
    pub(crate) model: Model,
    pub(crate) scales: EquationScales,
    pub(crate) all: PartSums,
}

impl<'a> PartitionedSums<'a> {
    /// # Errors
    /// [`FitError::OtherFeatures`] if features of the model were not summed; [`FitError::TooFewRows`] for zero rows.
    pub fn new(total: &'a ExactSums, model: &Model) -> Result<Self, FitError> {
        let scales = EquationScales::new(total, model)?;
        Ok(Self { total, model: *model, all: scales.part(total), scales })
    }

    /// Converts the sums over a part of the rows to the form that the fits need.
    pub fn part(&self, moments: &ExactSums) -> PartSums {
        self.scales.part(moments)
    }

    /// Fits all rows except those of `moments`, and returns the errors on these. `part` must be [`Self::part`] of
    /// `moments`. `ridge` is as in [`ExactSums::solve`], for readings relative to the mean of all rows.
    ///
    /// # Errors
    /// [`FitError`] if the other rows do not determine the coefficients.
    pub fn held_out(
        &self,
        moments: &ExactSums,
        part: &PartSums,
        ridge: f64,
    ) -> Result<PerAxis<HeldOutErrors>, FitError> {
        if !(ridge >= 0.0 && ridge.is_finite()) {
            return Err(FitError::Ridge(ridge));
        }
        let size = self.scales.terms.len();
        let rows = self.all.rows - part.rows;
        if rows < size as u64 && ridge == 0.0 || rows == 0 {
            return Err(FitError::TooFewRows { rows, coefficients: size });
        }
        if let Some(coefficients) = self.scales.solve(&self.all, part, ridge) {
            return Ok(self.scales.errors(part, &coefficients));
        }
        // The slow path, with exact rank and iterative refinement.
        let fit = self.total.without(moments).solve(&self.model, ridge)?;
        Ok(fit.errors_on(moments))
    }
}

pub(super) fn penalty_of(square: DoubleDouble, ridge: f64) -> DoubleDouble {
    // For a column of zeros, any penalty keeps its coefficient at zero.
    let square = if square == DoubleDouble::ZERO { DoubleDouble::ONE } else { square };
    square * DoubleDouble::from(ridge)
}

vectorised! {
    fn error_sums(
        columns: &[i32],
        part: &PartSums,
        coefficients: &[AxisRow],
    ) -> (AxisRow, AxisRow) {
        let mut sums = ElementLanes::new(&part.wrench.map(|sum| -sum));
        let mut squares = part.squares;
        let lanes: Vec<ElementLanes> = coefficients.iter().map(ElementLanes::new).collect();
        let mut gram = &part.gram[..];
        for (a, c) in coefficients.iter().enumerate() {
            let (row, rest) = gram.split_at(columns.len() - a);
            gram = rest;
            // B_a − A_aa·C_a / 2 − Σ_{b>a} A_ab·C_b: half of the amount that the terms of `a` subtract.
            let mut half = ElementLanes::new(&part.right[a]);
            for (b, &element) in (a..).zip(row) {
                let up = if a == b { 1 } else { 0 };
                let element = round(element).scaled(power_of_two(-columns[a] - columns[b] - up));
                half.take_away(element, &lanes[b]);
            }
            let ones = round(part.features[a]).scaled(power_of_two(-columns[a]));
            sums.take_away(-ones, &lanes[a]);
            let half = half.row();
            for lane in 0..LANES {
                squares[lane] -= (half[lane] * c[lane]).scaled(2.0);
            }
        }
        let sums = sums.row();
        (sums, squares)
    }
}

/// Sums over a part of the rows, in the units of the total. They are as large as the normal equations.
#[derive(Debug)]
pub struct PartSums {
    pub(crate) rows: u64,
    /// Upper triangle, row by row.
    pub(crate) gram: Vec<i128>,
    pub(crate) features: Vec<i128>,
    pub(crate) right: Vec<AxisRow>,
    pub(crate) wrench: AxisRow,
    pub(crate) squares: AxisRow,
}

/// Origin of the readings, and exponents of two that scale columns and axes; zero for a column or axis of zeros.
#[derive(Clone, Debug)]
pub(crate) struct EquationScales {
    pub(crate) terms: Vec<Term>,
    /// Positions of the products of pairs of terms among the sums of readings, row by row.
    pub(crate) positions: Vec<usize>,
    pub(crate) units: Vec<ReadingUnit>,
    pub(crate) centre: Vec<i64>,
    pub(crate) columns: Vec<i32>,
    pub(crate) axes: [i32; 6],
}

impl EquationScales {
    /// Chooses origin and scales. The origin is the rounded mean of each channel, or zero without an intercept. The
    /// scales are the powers of two just above the norms.
    ///
    /// # Errors
    /// [`FitError`] if the features of `model` were not summed, or for zero rows.
    pub(crate) fn new(moments: &ExactSums, model: &Model) -> Result<Self, FitError> {
        let terms = moments.summed_terms(model)?;
        let size = terms.len();
        if moments.rows == 0 {
            return Err(FitError::TooFewRows { rows: 0, coefficients: size });
        }
        let mut positions = vec![0; size * size];
        for a in 0..size {
            for b in a..size {
                let position = moments.layout.position(terms[a], terms[b]);
                (positions[a * size + b], positions[b * size + a]) = (position, position);
            }
        }
        let origin = |i: usize| if model.intercept { moments.rounded_mean(i) } else { 0 };
        let centre: Vec<i64> = (0..model.channels).map(origin).collect();
        let readings = moments.readings_about(&centre);
        let half = |exponent: i32| exponent.div_euclid(2) + 1;
        let columns = (0..size).map(|j| match readings[positions[j * size + j]] {
            0 => 0,
            square => half(square.ilog2() as i32),
        });
        let axes = std::array::from_fn(|axis| {
            let square = &moments.squares[pair(axis, axis)];
            match square.values[0].bits() {
                0 => 0,
                bits => half(square.exponent + bits as i32 - 1),
            }
        });
        let (columns, units) = (columns.collect(), moments.units());
        Ok(Self { columns, axes, positions, units, centre, terms })
    }

    pub(crate) fn part(&self, moments: &ExactSums) -> PartSums {
        let moments = moments.in_units(&self.units);
        let (readings, wrench) = moments.about(&self.centre);
        let size = self.terms.len();
        let ones: Vec<usize> = (self.terms.iter())
            .map(|&term| moments.layout.position(term, Term::INTERCEPT))
            .collect();
        let upper = (0..size).flat_map(|a| &self.positions[a * size + a..(a + 1) * size]);
        let sum = |axis: usize, position: usize, column: i32| {
            let exponent = moments.wrench[axis].exponent - column - self.axes[axis];
            wrench[axis].rounded(position, exponent)
        };
        PartSums {
            rows: moments.rows(),
            gram: upper.map(|&position| readings[position]).collect(),
            features: ones.iter().map(|&position| readings[position]).collect(),
            right: (ones.iter().zip(&self.columns))
                .map(|(&position, &column)| axis_row(|axis| sum(axis, position, column)))
                .collect(),
            wrench: axis_row(|axis| sum(axis, 0, 0)),
            squares: axis_row(|axis| {
                let square = &moments.squares[pair(axis, axis)];
                round_scaled(&square.values[0], square.exponent - 2 * self.axes[axis])
            }),
        }
    }

    /// Solves for the scaled coefficients without the part; `None` if ten digits are not certain.
    fn solve(&self, all: &PartSums, part: &PartSums, ridge: f64) -> Option<Vec<AxisRow>> {
        let rest = all.gram.iter().zip(&part.gram).map(|(all, part)| all.wrapping_sub(*part));
        let mut gram = DoubleDoubleMatrix::new(rest, &self.columns);
        for (a, term) in self.terms.iter().enumerate() {
            if ridge > 0.0 && *term != Term::INTERCEPT {
                let square = gram.diagonal_mut(a);
                *square += penalty_of(*square, ridge);
            }
        }
        let right: Vec<AxisRow> = (all.right.iter().zip(&part.right))
            .map(|(all, part)| std::array::from_fn(|lane| all[lane] - part[lane]))
            .collect();
        gram.solve(&right)
    }

    pub(super) fn errors(
        &self,
        part: &PartSums,
        coefficients: &[AxisRow],
    ) -> PerAxis<HeldOutErrors> {
        let (sums, squares) = error_sums(&self.columns, part, coefficients);
        std::array::from_fn(|axis| {
            let unit = power_of_two(self.axes[axis]);
            HeldOutErrors {
                rows: part.rows,
                sum: sums[axis].to_f64() * unit,
                // Rounding may make a sum negative that should be zero.
                squares: (squares[axis].to_f64() * unit).max(0.0) * unit,
            }
        })
    }
}

#[derive(Clone, Debug)]
pub struct ExactFit {
    /// Scales are powers of two; centres are zero without an intercept.
    pub solution: Solution,
    /// One row per feature, in N and N·m.
    pub coefficients: Vec<PerAxis<DoubleDouble>>,
    /// Scales of the equations, for readings counted in the units of the sums; axes in N and N·m.
    pub(crate) scales: EquationScales,
    /// Ratio of each feature to the feature of counted readings: one if the units are powers of two.
    pub(crate) feature_ratios: Vec<DoubleDouble>,
}

impl ExactFit {
    /// The coefficients for features of counted readings, with axes as lanes.
    pub(crate) fn counted_coefficients(&self) -> Vec<AxisRow> {
        let row = |(row, &ratio): (&PerAxis<DoubleDouble>, &DoubleDouble)| -> AxisRow {
            axis_row(|axis| row[axis] * ratio)
        };
        self.coefficients.iter().zip(&self.feature_ratios).map(row).collect()
    }

    pub fn quality(&self, rows: &ExactSums) -> PerAxis<AxisQuality> {
        let errors = self.errors_on(rows);
        std::array::from_fn(|axis| errors[axis].quality(rows.total_square(axis)))
    }

    /// The errors on some rows, with the origin and units of this fit.
    pub(crate) fn errors_on(&self, rows: &ExactSums) -> PerAxis<HeldOutErrors> {
        self.scales.errors(&self.scales.part(rows), &self.counted_coefficients())
    }

    /// Scatter of the coefficients over `groups`, which together are all fitted rows; without the bias from the ridge.
    ///
    /// # Errors
    /// [`FitError`] if one group alone determines a coefficient, or all groups do not determine it.
    pub fn scatter<'a>(
        &self,
        groups: impl IntoIterator<Item = &'a (String, ExactSums)>,
        with_degrees: bool,
    ) -> Result<GroupScatter, FitError> {
        let ratios: Vec<f64> = self.feature_ratios.iter().map(|s| s.to_f64()).collect();
        let factor = UpperTriangle::new(&self.solution.factor);
        // Row i of the factor belongs to feature i. Convert it from the feature of the fit to that of counted readings.
        let mut counted = factor.clone();
        for (i, ratio) in ratios.iter().enumerate() {
            counted.row_mut(i).iter_mut().for_each(|x| *x *= ratio);
        }
        let coefficients = self.counted_coefficients();
        let combinations =
            if with_degrees { satterthwaite::coefficients(&self.solution) } else { Vec::new() };
        let mut sums = ScatterSums::new(&self.solution, combinations.len());
        for (label, group) in groups.into_iter().filter(|(_, group)| group.rows() > 0) {
            let scales = &self.scales;
            let part = scales.part(group);
            let gram = DoubleDoubleMatrix::new(part.gram.iter().copied(), &scales.columns);
            let errors = scales.errors(&part, &coefficients);
            let share = congruence(&counted, &gram.rounded());
            let score = residual_of(&gram, &part.right, &coefficients);
            let score = std::array::from_fn(|axis| {
                let score: Vec<f64> = score.iter().map(|row| row[axis].to_f64()).collect();
                counted.transposed_times(&score)
            });
            sums.take_off(&share);
            sums.add(label, corrected(&share, score, &combinations)?, &errors);
        }
        sums.finish(&factor)
    }

    /// Mean prediction variance over the rows of each group, from `scatter`, in N² and (N·m)².
    pub(crate) fn variances(
        &self,
        scatter: &GroupScatter,
        groups: &[(String, ExactSums)],
    ) -> Vec<PerAxis<f64>> {
        let ratios: Vec<f64> = self.feature_ratios.iter().map(|s| s.to_f64()).collect();
        let factors = scatter.factors.each_ref().map(|factor| {
            UpperTriangle::from_fn(factor.nrows(), |i, j| ratios[i] * factor[(i, j)])
        });
        let of_group = |(_, group): &(String, ExactSums)| {
            let (part, columns) = (self.scales.part(group), &self.scales.columns);
            let gram = DoubleDoubleMatrix::new(part.gram.iter().copied(), columns).rounded();
            let rows = part.rows.max(1) as f64;
            factors.each_ref().map(|factor| trace_of_congruence(factor, &gram).max(0.0) / rows)
        };
        groups.iter().map(of_group).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::exact::Accumulator;
    use crate::model::{Basis, Model};
    use faer::{Mat, Side};

    /// Seven groups of unequal size, two channels, and six axes with errors shared within groups.
    fn rows() -> (Vec<Vec<f64>>, Vec<Vec<f64>>, Vec<usize>) {
        let noise = |i: usize| {
            let z = (i as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
            let z = (z ^ (z >> 31)).wrapping_mul(0x94d0_49bb_1331_11eb);
            (z >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
        };
        let sizes = [5, 9, 4, 12, 7, 3, 10];
        let groups: Vec<usize> =
            sizes.iter().enumerate().flat_map(|(g, &n)| std::iter::repeat_n(g, n)).collect();
        let reading = |c: usize, row: usize| {
            (1000.0 + 300.0 * noise(groups[row] * 5 + c) + 40.0 * noise(row * 3 + c)).round()
        };
        let readings: Vec<Vec<f64>> =
            (0..2).map(|c| (0..groups.len()).map(|row| reading(c, row)).collect()).collect();
        let wrench = (0..6)
            .map(|axis| {
                let of = |row: usize| {
                    0.01 * readings[axis % 2][row]
                        + noise(groups[row] * 11 + axis)
                        + 0.3 * noise(row * 17 + axis)
                };
                (0..groups.len()).map(of).collect()
            })
            .collect();
        (readings, wrench, groups)
    }

    fn moments(
        readings: &[Vec<f64>],
        wrench: &[Vec<f64>],
        keep: impl Fn(usize) -> bool,
    ) -> ExactSums {
        let thin = |columns: &[Vec<f64>]| -> Vec<Vec<f64>> {
            let thin = |column: &Vec<f64>| {
                column.iter().enumerate().filter(|(i, _)| keep(*i)).map(|(_, x)| *x).collect()
            };
            columns.iter().map(thin).collect()
        };
        let mut sums = Accumulator::new(Basis::Quadratic, readings.len());
        sums.absorb(&thin(readings), &thin(wrench)).unwrap();
        sums.finish().unwrap()
    }

    #[test]
    fn sums_give_the_same_results_as_rows_by_definition() {
        let (readings, wrench, groups) = rows();
        let total = moments(&readings, &wrench, |_| true);
        let part = |g| (format!("pose {g}"), moments(&readings, &wrench, |row| groups[row] == g));
        let parts: Vec<_> = (0..7).map(part).collect();
        let model = Model { basis: Basis::Quadratic, intercept: true, channels: 2, memory: 0 };
        let fit = total.solve(&model, 0.0).unwrap();
        let found = fit.scatter(&parts, true).unwrap();

        // The direct computation, row by row: hat matrix, its blocks, their inverse roots.
        let z = |c: usize, row: usize| {
            (readings[c][row] - fit.solution.scaling.centre[c]) / fit.solution.scaling.scale[c]
        };
        let (n, p) = (groups.len(), 6);
        let x = Mat::from_fn(n, p, |row, j| {
            model.terms()[j].factors().iter().map(|&c| z(usize::from(c), row)).product::<f64>()
        });
        let y = Mat::from_fn(n, 6, |row, axis| wrench[axis][row]);
        let bread = faer::linalg::solvers::DenseSolveCore::inverse(
            &(x.transpose() * &x).llt(Side::Lower).unwrap(),
        );
        let e = &y - &x * (&bread * (x.transpose() * &y));
        let mut expected: Vec<Mat<f64>> = vec![Mat::zeros(p, p); 6];
        let mut products = Mat::<f64>::zeros(6, 6);
        for g in 0..7 {
            let members: Vec<usize> = (0..n).filter(|&row| groups[row] == g).collect();
            let m = members.len();
            let xg = Mat::from_fn(m, p, |i, j| x[(members[i], j)]);
            let eg = Mat::from_fn(m, 6, |i, a| e[(members[i], a)]);
            let rest = Mat::<f64>::identity(m, m) - &xg * &bread * xg.transpose();
            let eigen = rest.self_adjoint_eigen(Side::Lower).unwrap();
            let power = |exponent: f64| {
                let values = eigen.S().column_vector();
                let scaled =
                    Mat::from_fn(m, m, |i, j| eigen.U()[(i, j)] * values[j].powf(exponent));
                scaled * eigen.U().transpose()
            };
            let v = &bread * xg.transpose() * (power(-0.5) * &eg);
            for (axis, expected) in expected.iter_mut().enumerate() {
                *expected += v.col(axis) * v.col(axis).transpose();
            }
            products += eg.transpose() * (power(-1.0) * &eg);
        }
        assert_eq!(found.groups, 7);
        for axis in 0..6 {
            let (mut common, mut all) = (0.0, 0.0);
            for g in 0..7 {
                let own: Vec<f64> =
                    (0..n).filter(|&row| groups[row] == g).map(|row| e[(row, axis)]).collect();
                common += own.iter().sum::<f64>().powi(2) / own.len() as f64;
                all += own.iter().map(|e| e * e).sum::<f64>();
            }
            assert!((found.shared[axis] - common / all).abs() < 1e-10, "{axis}");
        }
        for axis in 0..6 {
            let t = &found.factors[axis];
            assert!((0..p).all(|j| (j + 1..p).all(|i| t[(i, j)] == 0.0)), "upper triangular");
            let covariance = t * t.transpose();
            // The condition number is below 100; both sides square it in double precision.
            let error = (&covariance - &expected[axis]).norm_max();
            assert!(error < 1e-10 * expected[axis].norm_max(), "{axis}: {error:e}");
            for b in 0..6 {
                let (found, expected) = (found.residual_products[axis][b], products[(axis, b)]);
                assert!((found - expected).abs() < 1e-10 * products.norm_max(), "{axis} {b}");
            }
        }
    }

    #[test]
    fn a_group_that_alone_moves_a_channel_is_named() {
        let (mut readings, wrench, groups) = rows();
        for (reading, &group) in readings[1].iter_mut().zip(&groups) {
            *reading = if group == 3 { *reading } else { 1000.0 };
        }
        let total = moments(&readings, &wrench, |_| true);
        let part = |g| (format!("pose {g}"), moments(&readings, &wrench, |row| groups[row] == g));
        let parts: Vec<_> = (0..7).map(part).collect();
        let model = Model { basis: Basis::Linear, intercept: true, channels: 2, memory: 0 };
        let fit = total.solve(&model, 0.0).unwrap();
        let found = fit.scatter(&parts, true);
        let alone = FitError::Alone { groups: vec!["pose 3".to_owned()] };
        assert_eq!(found.unwrap_err(), alone);
    }
}
