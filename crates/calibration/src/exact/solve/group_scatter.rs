//! How coefficients scatter where errors are alike within groups of rows, from sums alone.
//!
//! With `F·Fᵀ = A⁻¹`, `A = XᵀX` over all rows, and for each group of rows its Gram matrix `A_g` and
//! its score `s_g = X_gᵀ(W_g − X_g·C) = B_g − A_g·C`,
//!
//! ```text
//! K_g = FᵀA_gF    u_g = Fᵀs_g    v_g = (I − K_g)^(−½)·u_g
//! cov(C) = F·(Σ v_g·v_gᵀ)·Fᵀ
//! ```
//!
//! for each axis: the sandwich over clusters with the correction CR2 of Bell and McCaffrey (Survey
//! Methodology 28, 2002, p. 169), who take the residuals `(I − H_g)^(−½)·e_g`, `H_g = X_gA⁻¹X_gᵀ`.
//! That the sums are sufficient follows from `Xᵀ·f(X·A⁻¹·Xᵀ) = f(XᵀX·A⁻¹)·Xᵀ`. Likewise
//!
//! ```text
//! Σ e_gᵀ(I − H_g)⁻¹e_g = Σ eᵀe + Σ u_gᵀ(I − K_g)⁻¹u_g
//! ```
//!
//! whose mean over all rows is the variance of one row: without bias where errors are independent,
//! and where the errors of a group are one and the same and so are its readings.
//!
//! In `f64` but for the scores, which cancel: errors of about κ(X)²·2⁻⁵³ in a variance.

use faer::{Mat, Side};

use super::fit::SolveError;
use super::partition::{PartitionedMoments, counted_coefficients};
use super::symmetric::Symmetric;
use crate::exact::moments::product_sums::Moments;
use crate::factor::InverseFactor;
use shell_data::wrench::PerAxis;

/// A group whose `K_g` has an eigenvalue this near to one determines a direction alone.
const ALONE: f64 = 1e-8;

/// By how much the `K_g` may fail to add up to the identity.
const LARGEST_DEFECT: f64 = 1e-4;

/// What groups of rows say about the scatter of the coefficients.
#[derive(Clone, Debug)]
pub struct GroupScatter {
    /// Groups that have rows.
    pub groups: usize,
    /// For each axis an upper triangular `T`, `T·Tᵀ = cov(C)`: rows are features of centred and
    /// scaled readings, N and N·m.
    pub factors: PerAxis<Mat<f64>>,
    /// `Σ e_gᵀ(I − H_g)⁻¹e_g`, in products of N and N·m.
    pub residual_products: PerAxis<PerAxis<f64>>,
    /// The share of the squared errors that the rows of a group have in common: their mean, squared.
    pub shared: PerAxis<f64>,
}

impl GroupScatter {
    /// The covariance of the errors of one of so many rows, in products of N and N·m.
    pub fn residual_covariance(&self, rows: u64) -> PerAxis<PerAxis<f64>> {
        self.residual_products.map(|row| row.map(|product| product / rows as f64))
    }
}

/// Why groups say nothing about the scatter of the coefficients.
#[derive(Clone, Debug, PartialEq)]
pub enum GroupScatterError {
    /// There are no coefficients.
    Solve(SolveError),
    /// The groups, by their places, without which the rows do not determine the coefficients.
    Alone(Vec<usize>),
    /// The features are too nearly dependent for this.
    NearlyDependent,
}

impl PartitionedMoments<'_> {
    /// The scatter of the coefficients that fit all rows best, over `groups`, which are all rows.
    /// `ridge` is as in [`Moments::solve`]; the bias that it brings is left out.
    ///
    /// # Errors
    /// [`GroupScatterError`] if some group alone determines a coefficient, or all together do not.
    pub fn by_group(
        &self,
        groups: &[&Moments],
        ridge: f64,
    ) -> Result<GroupScatter, GroupScatterError> {
        let fit = self.total.solve(&self.model, ridge).map_err(GroupScatterError::Solve)?;
        let scales = self.scales_of(&fit);
        let stretch: Vec<f64> = fit.counted.stretch.iter().map(|s| s.to_f64()).collect();
        // Rows are features: from those of the fit to those that are counted.
        let factor = InverseFactor::Inverse(fit.triangle()).matrix().into_owned();
        let factor = Mat::from_fn(stretch.len(), stretch.len(), |i, j| stretch[i] * factor[(i, j)]);
        let (size, coefficients) = (factor.nrows(), counted_coefficients(&fit));
        let groups: Vec<&Moments> = groups.iter().copied().filter(|g| g.rows() > 0).collect();
        let mut scores: PerAxis<Mat<f64>> = std::array::from_fn(|_| Mat::zeros(groups.len(), size));
        let mut products = fit.residual_products;
        let mut defect = Mat::<f64>::identity(size, size);
        let mut alone = Vec::new();
        let (mut common, mut squares) = (PerAxis::<f64>::default(), PerAxis::<f64>::default());
        for (place, group) in groups.iter().enumerate() {
            let part = scales.part(&group.in_units_of(self.total));
            let gram = Symmetric::new(part.gram.iter().copied(), &scales.columns);
            let errors = scales.errors(&part, &coefficients);
            for (axis, errors) in errors.iter().enumerate() {
                common[axis] += errors.sum * errors.sum / errors.rows as f64;
                squares[axis] += errors.squares;
            }
            let share = factor.transpose() * (gram.rounded() * &factor);
            defect -= &share;
            let score = gram.residual(&part.right, &coefficients);
            let score = Mat::from_fn(size, 6, |j, axis| score[j][axis].to_f64());
            let score = factor.transpose() * score;
            let eigen = share.self_adjoint_eigen(Side::Upper);
            let eigen = eigen.map_err(|_| GroupScatterError::NearlyDependent)?;
            let (basis, values) = (eigen.U(), eigen.S().column_vector());
            let rest: Vec<f64> = values.iter().map(|value| 1.0 - value.max(0.0)).collect();
            if rest.iter().any(|&rest| rest < ALONE) {
                alone.push(place);
                continue;
            }
            let mut turned = basis.transpose() * score;
            for (i, rest) in rest.iter().enumerate() {
                turned.row_mut(i).iter_mut().for_each(|x| *x /= rest.sqrt());
            }
            for (products, a) in products.iter_mut().zip(turned.col_iter()) {
                for (product, b) in products.iter_mut().zip(turned.col_iter()) {
                    *product += a.transpose() * b;
                }
            }
            let score = basis * turned;
            for (scores, score) in scores.iter_mut().zip(score.col_iter()) {
                scores.row_mut(place).iter_mut().zip(score.iter()).for_each(|(x, s)| *x = *s);
            }
        }
        if ridge == 0.0 && defect.norm_max() > LARGEST_DEFECT {
            return Err(GroupScatterError::NearlyDependent);
        }
        if !alone.is_empty() {
            return Err(GroupScatterError::Alone(alone));
        }
        let back = Mat::from_fn(size, size, |i, j| factor[(j, i)] / stretch[j]);
        let factors = scores.each_ref().map(|scores| upper_root(&(scores * &back)));
        let shared = std::array::from_fn(|axis| match squares[axis] > 0.0 {
            true => (common[axis] / squares[axis]).min(1.0),
            false => 0.0,
        });
        Ok(GroupScatter { groups: groups.len(), factors, residual_products: products, shared })
    }
}

/// An upper triangular `T` with `T·Tᵀ = MᵀM`, by QR of `M` with its columns backwards.
fn upper_root(m: &Mat<f64>) -> Mat<f64> {
    let size = m.ncols();
    let last = size - 1;
    let backwards = Mat::from_fn(m.nrows(), size, |i, j| m[(i, last - j)]);
    let qr = backwards.qr();
    let r = qr.thin_R();
    Mat::from_fn(size, size, |i, j| {
        if i <= j && last - j < r.nrows() { r[(last - j, last - i)] } else { 0.0 }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::exact::Accumulator;
    use crate::model::{Basis, Model};

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
        let parts: Vec<Moments> =
            (0..7).map(|g| moments(&readings, &wrench, |row| groups[row] == g)).collect();
        let model = Model { basis: Basis::Quadratic, intercept: true, channels: 2 };
        let found = PartitionedMoments::new(&total, &model).unwrap();
        let found = found.by_group(&parts.iter().collect::<Vec<_>>(), 0.0).unwrap();

        // Directly, row by row: hat matrix, its blocks, their inverse roots.
        let fit = total.solve(&model, 0.0).unwrap();
        let z = |c: usize, row: usize| (readings[c][row] - fit.centre[c]) / fit.scale[c];
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
        let parts: Vec<Moments> =
            (0..7).map(|g| moments(&readings, &wrench, |row| groups[row] == g)).collect();
        let model = Model { basis: Basis::Linear, intercept: true, channels: 2 };
        let found = PartitionedMoments::new(&total, &model).unwrap();
        let found = found.by_group(&parts.iter().collect::<Vec<_>>(), 0.0);
        assert_eq!(found.unwrap_err(), GroupScatterError::Alone(vec![3]));
    }
}
