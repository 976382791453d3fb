//! The [scatter](crate::sandwich) of coefficients over groups of rows, from sums alone.
//!
//! `K_g` and `u_g` of a group come from its sums `A_g` and `s_g = B_g − A_g·C`. In `f64` but for the scores,
//! which cancel: errors of about κ(X)²·2⁻⁵³ in a variance.
//!
//! What the fit says of other groups: with `T·Tᵀ` the covariance of the coefficients of an axis, the mean over the rows of a group of the variance
//! that they bring is `tr(TᵀA_gT)/n`; its errors are as in [`held_out`](super::held_out).

use super::double_double_matrix::{DoubleDoubleMatrix, residual_of};
use super::held_out::ExactFit;
use crate::exact::moments::product_sums::Moments;
use crate::sandwich::{GroupScatter, ScatterSums, corrected};
use crate::symmetric::{UpperTriangle, congruence, trace_of_congruence};
use crate::validation::ValidationError;
use shell_data::wrench::PerAxis;

impl ExactFit {
    /// The scatter of the coefficients over `groups`, which are all rows that were fitted. The bias that a ridge brings
    /// is left out.
    ///
    /// # Errors
    /// [`ValidationError`] if some group alone determines a coefficient, or all together do not.
    pub fn scatter<'a>(
        &self,
        groups: impl IntoIterator<Item = &'a (String, Moments)>,
    ) -> Result<GroupScatter, ValidationError> {
        let stretch: Vec<f64> = self.stretch.iter().map(|s| s.to_f64()).collect();
        let factor = UpperTriangle::new(&self.solution.factor);
        // Rows are features: from those of the fit to those that are counted.
        let mut counted = factor.clone();
        for (i, stretch) in stretch.iter().enumerate() {
            counted.row_mut(i).iter_mut().for_each(|x| *x *= stretch);
        }
        let coefficients = self.counted_coefficients();
        let mut sums = ScatterSums::new(&self.solution);
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
            sums.add(label, corrected(share, score)?, &errors);
        }
        sums.finish(&factor)
    }
}

impl ExactFit {
    /// The variance of the rows of each of `groups` that comes from the coefficients, which scatter by `scatter`, on
    /// average, squares of N and N·m.
    pub(crate) fn variances(
        &self,
        scatter: &GroupScatter,
        groups: &[(String, Moments)],
    ) -> Vec<PerAxis<f64>> {
        let stretch: Vec<f64> = self.stretch.iter().map(|s| s.to_f64()).collect();
        // Rows are features: from those of the fit to those that are counted.
        let factors = scatter.factors.each_ref().map(|factor| {
            UpperTriangle::from_fn(factor.nrows(), |i, j| stretch[i] * factor[(i, j)])
        });
        let of_group = |(_, group): &(String, Moments)| {
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

    /// Seven groups of unequal size, two channels, six axes with errors that groups share.
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
    ) -> Moments {
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
    fn sums_give_what_the_rows_themselves_give_by_the_definition() {
        let (readings, wrench, groups) = rows();
        let total = moments(&readings, &wrench, |_| true);
        let part = |g| (format!("pose {g}"), moments(&readings, &wrench, |row| groups[row] == g));
        let parts: Vec<_> = (0..7).map(part).collect();
        let model = Model { basis: Basis::Quadratic, intercept: true, channels: 2, memory: 0 };
        let fit = total.solve(&model, 0.0).unwrap();
        let found = fit.scatter(&parts).unwrap();

        // Directly, row by row: hat matrix, its blocks, their inverse roots.
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
            // A condition number below 100, squared, in double precision on either side.
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
        let found = fit.scatter(&parts);
        let alone = ValidationError::Alone { groups: vec!["pose 3".to_owned()] };
        assert_eq!(found.unwrap_err(), alone);
    }
}
