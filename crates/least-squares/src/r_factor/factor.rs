//! The R factor, and coefficients from it.
//!
//! Lanczos iteration finds the extreme singular values (Golub & Van Loan, 4th ed., §10.1) from the largest eigenvalues
//! of `RᵀR` and of its inverse. Each vector is kept orthogonal to all previous ones. Some twenty vectors are enough for
//! a polynomial. Computing all singular values would take as long as a refinement.

use faer::linalg::{triangular_inverse, triangular_solve};
use faer::{Mat, MatRef, Par};

use super::householder::{RFactor, contiguous};
use super::{LeastSquares, LeastSquaresError, Ridge};
use crate::symmetric::SymmetricMatrix;
use crate::vectors::{add_multiple, dot};

impl RFactor {
    /// `R` and `Z` without the rows in which `R` has only rounding errors; at most as many rows as were added.
    pub fn significant_rows(&self) -> (Mat<f64>, Mat<f64>) {
        let (p, q) = (self.features, self.r.ncols() - self.features);
        // There are p reflections, each with a rounding error relative to the column.
        let rounding = |j: usize| self.r.col(j).norm_l2() * p as f64 * f64::EPSILON;
        let rounding: Vec<f64> = (0..p).map(rounding).collect();
        let is_significant = |&i: &usize| (i..p).any(|j| self.r[(i, j)].abs() > rounding[j]);
        let rows: Vec<usize> = (0..p).filter(is_significant).collect();
        let r = Mat::from_fn(rows.len(), p, |i, j| self.r[(rows[i], j)]);
        (r, Mat::from_fn(rows.len(), q, |i, j| self.r[(rows[i], p + j)]))
    }

    /// R factor of the same rows with `X·T` in place of `X`. `T` is `change`, p × any number of columns.
    pub(crate) fn in_terms_of(&self, change: MatRef<'_, f64>) -> Self {
        let (p, order) = (self.features, self.r.nrows());
        let mut x = Mat::zeros(order, change.ncols());
        x.as_mut().subrows_mut(0, p).copy_from(self.r() * change);
        let y = self.r.as_ref().submatrix(0, p, order, order - p).to_owned();
        Self { rows: self.rows, ..Self::from_rows(&x, &y) }
    }

    /// Solves for the coefficients. Singular values of the equilibrated `R` count as zero if rounding may have produced
    /// them. With a ridge, which determines these directions, the rank is only reported.
    ///
    /// # Errors
    /// [`LeastSquaresError`] for too few rows, dependent columns without a ridge, nearly dependent
    /// columns whose rounding leaves no correct digit, or values that are not finite.
    pub fn solve(&self, ridge: Ridge) -> Result<LeastSquares, LeastSquaresError> {
        let solved = self.solve_roughly(ridge)?;
        // The relative error is about ε·κ·(1 + κ·‖r‖/‖D·C‖), with the norms D of columns (Björck
        // 1996, theorem 1.4.6), times sixteen for the constants.
        let steepest = (0..solved.coefficients.ncols()).map(|a| {
            let sizes = self.r().col_iter().zip(solved.coefficients.col(a).iter());
            let fitted = sizes.fold(0.0, |f: f64, (x, c)| f.hypot(x.norm_l2() * c));
            solved.residual_products[(a, a)].sqrt() / fitted.max(f64::MIN_POSITIVE)
        });
        let digits_lost =
            solved.condition * (1.0 + solved.condition * steepest.fold(0.0, f64::max));
        let limit = 1.0 / (16.0 * f64::EPSILON);
        if ridge.lambda == 0.0 && digits_lost > limit {
            return Err(LeastSquaresError::IllConditioned {
                limit: solved.condition * (limit / digits_lost).sqrt(),
            });
        }
        Ok(solved)
    }

    /// Solves like [`RFactor::solve`], but accepts any loss of accuracy: a starting point for refinement.
    pub(crate) fn solve_roughly(&self, ridge: Ridge) -> Result<LeastSquares, LeastSquaresError> {
        let (p, q) = (self.features, self.r.nrows() - self.features);
        ridge.check(self.rows, p, self.r.is_all_finite())?;
        let (equilibrated, norms) = equilibrated(self.r());
        let (condition, rank) = condition_and_rank(&equilibrated, self.rounding())?;
        if rank < p && ridge.lambda == 0.0 {
            return Err(rank_deficient(self.r(), rank));
        }

        let damped = self.damped(&norms, ridge);
        let r = damped.as_ref().submatrix(0, 0, p, p);
        let mut coefficients = damped.as_ref().submatrix(0, p, p, q).to_owned();
        triangular_solve::solve_upper_triangular_in_place(r, coefficients.as_mut(), Par::Seq);
        let mut factor = Mat::zeros(p, p);
        triangular_inverse::invert_upper_triangular(factor.as_mut(), r, Par::Seq);
        let residual_products = self.residual_products(coefficients.as_ref());
        if !coefficients.is_all_finite() || !factor.is_all_finite() {
            return Err(LeastSquaresError::NotFinite);
        }
        Ok(LeastSquares {
            coefficients,
            factor,
            residual_products,
            rows: self.rows,
            condition,
            rank,
        })
    }

    /// Relative size that rounding can give a zero singular value: a random walk over the p columns
    /// and the row blocks.
    fn rounding(&self) -> f64 {
        const ROWS: f64 = 256.0;
        4.0 * f64::EPSILON * (self.features as f64 * (1.0 + self.rows as f64 / ROWS)).sqrt()
    }

    /// Computes `(Y − X·C)ᵀ(Y − X·C)` for any `C`, q × q.
    pub(crate) fn residual_products(&self, coefficients: MatRef<'_, f64>) -> Mat<f64> {
        let misfit = self.misfit(coefficients);
        misfit.transpose() * &misfit + self.rest_products()
    }

    /// Computes `Z − R·C` for any `C`, p × q.
    pub(crate) fn misfit(&self, coefficients: MatRef<'_, f64>) -> Mat<f64> {
        let (p, q) = (self.features, self.r.nrows() - self.features);
        self.r.as_ref().submatrix(0, p, p, q) - self.r() * coefficients
    }

    /// Sums of the residuals `X·C − Y` for any `C`; column `ones` of `X` must contain ones.
    pub(crate) fn sums_of_residuals(&self, coefficients: MatRef<'_, f64>, ones: usize) -> Vec<f64> {
        let misfit = self.misfit(coefficients);
        let column = self.r().col(ones).to_owned();
        (0..misfit.ncols()).map(|a| -(column.transpose() * misfit.col(a))).collect()
    }

    /// `EᵀE`, q × q: the residual products that no `C` can reduce.
    pub(crate) fn rest_products(&self) -> Mat<f64> {
        let (p, q) = (self.features, self.r.nrows() - self.features);
        let rest = self.r.as_ref().submatrix(p, p, q, q);
        rest.transpose() * rest
    }

    pub(crate) fn damped_parts(&self, ridge: Ridge) -> (Mat<f64>, Mat<f64>) {
        let (p, q) = (self.features, self.r.nrows() - self.features);
        let (_, norms) = equilibrated(self.r());
        let damped = self.damped(&norms, ridge);
        let part = |from, columns| damped.as_ref().submatrix(0, from, p, columns).to_owned();
        (part(0, p), part(p, q))
    }

    fn damped(&self, norms: &[f64], ridge: Ridge) -> Mat<f64> {
        let mut damped = self.clone();
        if ridge.lambda > 0.0 {
            let mut penalty = RFactor::new(self.features, self.r.nrows() - self.features);
            for (j, &norm) in norms.iter().enumerate() {
                if ridge.free_column != Some(j) {
                    penalty.r[(j, j)] = ridge.lambda.sqrt() * norm;
                }
            }
            penalty.rows = 1;
            damped.merge(&penalty);
        }
        damped.r
    }
}

/// The error for an upper triangular `R` of this rank, with the directions in which columns cancel.
pub(crate) fn rank_deficient(r: MatRef<'_, f64>, rank: usize) -> LeastSquaresError {
    let columns = r.ncols();
    let Ok(svd) = equilibrated(r).0.svd() else { return LeastSquaresError::NotFinite };
    let null_space = svd.V().subcols(rank, columns - rank).to_owned();
    let r_factor = Box::new(r.to_owned());
    LeastSquaresError::RankDeficient { rank, columns, null_space, r_factor }
}

/// Scales columns to norm one, except columns of zeros. Returns the divisors too.
pub(crate) fn equilibrated(matrix: MatRef<'_, f64>) -> (Mat<f64>, Vec<f64>) {
    let unit = |norm: f64| if norm > 0.0 { norm } else { 1.0 };
    let norms: Vec<f64> = matrix.col_iter().map(|column| unit(column.norm_l2())).collect();
    (Mat::from_fn(matrix.nrows(), matrix.ncols(), |i, j| matrix[(i, j)] / norms[j]), norms)
}

const MOST_VECTORS: usize = 100;

const VECTORS_AT_ONCE: usize = 4;

const SETTLED: f64 = 1e-13;

/// Maximum number of columns for which computing all singular values is fast.
const FEW_COLUMNS: usize = 100;

/// Condition number of an upper triangle, and number of singular values above the fraction
/// `tolerance` of the largest.
pub(crate) fn condition_and_rank(
    matrix: &Mat<f64>,
    tolerance: f64,
) -> Result<(f64, usize), LeastSquaresError> {
    let columns = matrix.ncols();
    if columns > FEW_COLUMNS
        && let Some([smallest, largest]) = by_recursion(matrix)
        && smallest > 100.0 * tolerance * largest
    {
        return Ok((largest / smallest, columns));
    }
    let values = matrix.singular_values().map_err(|_| LeastSquaresError::NotFinite)?;
    let (Some(largest), Some(smallest)) = (values.first(), values.last()) else {
        return Ok((1.0, 0));
    };
    Ok((largest / smallest, values.iter().filter(|&&value| value > tolerance * largest).count()))
}

/// Smallest and largest singular value; `None` without convergence, or for a singular matrix.
fn by_recursion(r: &Mat<f64>) -> Option<[f64; 2]> {
    let column = |j: usize| contiguous(r.col(j));
    let multiply = |x: &mut [f64]| {
        for j in 0..x.len() {
            let (above, own) = x.split_at_mut(j);
            let (r_above, r_own) = column(j).split_at(j);
            add_multiple(above, own[0], r_above);
            own[0] *= r_own[0];
        }
        for j in (0..x.len()).rev() {
            x[j] = dot(&column(j)[..=j], &x[..=j]);
        }
    };
    let divide = |x: &mut [f64]| {
        for j in 0..x.len() {
            x[j] = (x[j] - dot(&column(j)[..j], &x[..j])) / column(j)[j];
        }
        for j in (0..x.len()).rev() {
            let (above, own) = x.split_at_mut(j);
            own[0] /= column(j)[j];
            add_multiple(above, -own[0], &column(j)[..j]);
        }
    };
    let largest = largest_eigenvalue(r.ncols(), multiply)?;
    let smallest = 1.0 / largest_eigenvalue(r.ncols(), divide)?;
    Some([smallest.sqrt(), largest.sqrt()])
}

/// Largest eigenvalue of a positive definite matrix. `apply` replaces `x` with `A·x`.
fn largest_eigenvalue(size: usize, apply: impl Fn(&mut [f64])) -> Option<f64> {
    // Fractional parts of multiples of the golden ratio: a direction unrelated to any feature.
    let mut next: Vec<f64> =
        (1..=size).map(|i| (i as f64 * 0.618_033_988_749_895).fract() - 0.5).collect();
    let mut norm = dot(&next, &next).sqrt();
    let (mut vectors, mut elements, mut found) = (Vec::<Vec<f64>>::new(), Vec::new(), 0.0);
    for count in 1..=MOST_VECTORS {
        next.iter_mut().for_each(|x| *x /= norm);
        vectors.push(next.clone());
        apply(&mut next);
        let diagonal = dot(&next, &vectors[count - 1]);
        // Orthogonalising twice is enough (Parlett, The Symmetric Eigenvalue Problem, §6.9).
        for v in vectors.iter().chain(&vectors) {
            let share = dot(&next, v);
            add_multiple(&mut next, -share, v);
        }
        norm = dot(&next, &next).sqrt();
        elements.push([diagonal, norm]);
        let is_all = count == size || norm <= f64::EPSILON * diagonal;
        if is_all || count.is_multiple_of(VECTORS_AT_ONCE) {
            let tridiagonal = SymmetricMatrix::from_fn(count, |i, j| match j - i {
                apart @ (0 | 1) => elements[i][apart],
                _ => 0.0,
            });
            let value = tridiagonal.eigen()?.values.into_iter().fold(0.0, f64::max);
            if is_all || value - found <= SETTLED * value {
                return Some(value).filter(|value| value.is_finite());
            }
            found = value;
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use faer::Col;
    use proptest::prelude::*;
    use system_tests::random::Random;

    /// Pseudorandom values in [−1, 1], the same on every machine.
    fn noise(rows: usize, columns: usize, seed: u64) -> Mat<f64> {
        let mut random = Random(seed);
        Mat::from_fn(rows, columns, |_, _| 2.0 * random.unit() - 1.0)
    }

    fn least_squares(
        x: MatRef<'_, f64>,
        y: MatRef<'_, f64>,
        ridge: Ridge,
    ) -> Result<LeastSquares, LeastSquaresError> {
        assert_eq!(x.nrows(), y.nrows(), "as many rows in X as in Y");
        let mut r_factor = RFactor::new(x.ncols(), y.ncols());
        r_factor.absorb(x.nrows(), |rows, columns, stride| {
            for (j, column) in columns.chunks_mut(stride).enumerate() {
                let source = if j < x.ncols() { x.col(j) } else { y.col(j - x.ncols()) };
                let rows = source.subrows(rows.start, rows.len());
                column.iter_mut().zip(rows.iter()).for_each(|(to, from)| *to = *from);
            }
        });
        r_factor.solve(ridge)
    }

    fn difference(a: &Mat<f64>, b: &Mat<f64>) -> f64 {
        (a - b).norm_max() / b.norm_max()
    }

    #[test]
    fn known_coefficients_are_recovered_from_data_without_noise() {
        let (x, c) = (noise(500, 12, 1), noise(12, 6, 2));
        let solved = least_squares(x.as_ref(), (&x * &c).as_ref(), Ridge::NONE).unwrap();
        assert_eq!((solved.rank, solved.rows), (12, 500));
        assert!(difference(&solved.coefficients, &c) < 1e-14);
        assert!(solved.residual_products.norm_max() < 1e-27);
    }

    #[test]
    fn residuals_are_orthogonal_to_the_columns_and_their_products_are_returned() {
        let (x, y) = (noise(3000, 9, 3), noise(3000, 6, 4));
        let solved = least_squares(x.as_ref(), y.as_ref(), Ridge::NONE).unwrap();
        let residual = &y - &x * &solved.coefficients;
        // ‖xⱼ‖·‖y‖ ≈ 1000, times 2⁻⁵³ and a small constant.
        assert!((x.transpose() * &residual).norm_max() < 1e-12);
        let products = residual.transpose() * &residual;
        assert!(difference(&solved.residual_products, &products) < 1e-13);
        let gram = x.transpose() * &x;
        let inverse = &solved.factor * solved.factor.transpose();
        assert!((gram * inverse - Mat::<f64>::identity(9, 9)).norm_max() < 1e-13);
    }

    #[test]
    fn condition_equals_that_of_columns_of_norm_one() {
        // Columns (1, 0) and (cos t, sin t) have singular values √(1 ± cos t).
        let t = 1e-3_f64;
        let x = Mat::from_fn(2, 2, |i, j| [[1.0, t.cos() * 1e9], [0.0, t.sin() * 1e9]][i][j]);
        let solved =
            least_squares(x.as_ref(), Mat::<f64>::zeros(2, 1).as_ref(), Ridge::NONE).unwrap();
        let expected = (t / 2.0).tan().recip();
        // The relative error of a condition number is about that number times 2⁻⁵³: 2000 · 2⁻⁵³.
        assert!((solved.condition / expected - 1.0).abs() < 1e-11);
    }

    #[test]
    fn dependent_columns_are_an_error_with_the_direction_that_cancels() {
        let mut x = noise(100, 4, 5);
        for i in 0..100 {
            x[(i, 3)] = 2.0 * x[(i, 0)] - x[(i, 1)];
        }
        let error = least_squares(x.as_ref(), noise(100, 1, 6).as_ref(), Ridge::NONE).unwrap_err();
        let LeastSquaresError::RankDeficient { rank: 3, columns: 4, null_space, .. } = error else {
            panic!("{error:?}")
        };
        assert!(null_space[(2, 0)].abs() < 1e-12);
        let norms: Vec<f64> = (0..4).map(|j| x.col(j).norm_l2()).collect();
        let direction = Col::from_fn(4, |j| null_space[(j, 0)] / norms[j]);
        assert!((&x * direction).norm_l2() < 1e-13);
    }

    #[test]
    fn nearly_dependent_columns_are_distinguished_from_dependent_ones() {
        for gap in [1e-4, 1e-8, 1e-11] {
            let mut x = noise(1000, 5, 7);
            for i in 0..1000 {
                x[(i, 4)] = x[(i, 3)] + gap * x[(i, 4)];
            }
            let solved = least_squares(x.as_ref(), x.as_ref(), Ridge::NONE).unwrap();
            assert_eq!(solved.rank, 5, "gap {gap}");
        }
    }

    #[test]
    fn columns_of_zeros_are_dependent_and_have_zero_coefficients_with_a_ridge() {
        let mut x = noise(50, 3, 8);
        x.col_mut(1).fill(0.0);
        let y = noise(50, 2, 9);
        let error = least_squares(x.as_ref(), y.as_ref(), Ridge::NONE).unwrap_err();
        assert!(matches!(error, LeastSquaresError::RankDeficient { rank: 2, .. }));
        let ridge = Ridge { lambda: 1e-3, free_column: None };
        let solved = least_squares(x.as_ref(), y.as_ref(), ridge).unwrap();
        assert_eq!(solved.rank, 2);
        assert_eq!(solved.coefficients[(1, 0)], 0.0);
    }

    #[test]
    fn a_ridge_solves_the_penalised_normal_equations() {
        let (x, y) = (noise(400, 6, 10), noise(400, 2, 11));
        let lambda = 0.3;
        let ridge = Ridge { lambda, free_column: Some(5) };
        let solved = least_squares(x.as_ref(), y.as_ref(), ridge).unwrap();
        let mut gram = x.transpose() * &x;
        for j in 0..5 {
            gram[(j, j)] += lambda * x.col(j).squared_norm_l2();
        }
        let left = gram * &solved.coefficients;
        assert!(difference(&left, &(x.transpose() * &y)) < 1e-13);
        let residual = &y - &x * &solved.coefficients;
        let products = residual.transpose() * &residual;
        assert!(difference(&solved.residual_products, &products) < 1e-13);
    }

    #[test]
    fn too_few_rows_and_infinite_values_are_errors() {
        let y = noise(3, 1, 12);
        let error = least_squares(noise(3, 4, 13).as_ref(), y.as_ref(), Ridge::NONE).unwrap_err();
        assert_eq!(error, LeastSquaresError::TooFewRows { rows: 3, columns: 4 });
        for bad in [f64::NAN, f64::INFINITY] {
            let mut x = noise(3, 2, 14);
            x[(1, 1)] = bad;
            let error = least_squares(x.as_ref(), y.as_ref(), Ridge::NONE).unwrap_err();
            assert_eq!(error, LeastSquaresError::NotFinite);
        }
    }

    #[test]
    fn tiny_and_huge_columns_lose_no_digits() {
        let (x, c) = (noise(200, 4, 15), noise(4, 2, 16));
        let y = &x * &c;
        let units = [1e-100, 1e100, 1.0, 1e-30];
        let scaled = Mat::from_fn(200, 4, |i, j| x[(i, j)] * units[j]);
        let solved = least_squares(scaled.as_ref(), y.as_ref(), Ridge::NONE).unwrap();
        let back = Mat::from_fn(4, 2, |i, j| solved.coefficients[(i, j)] * units[i]);
        assert!(difference(&back, &c) < 1e-14);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]
        #[test]
        fn rows_may_be_cut_anywhere_and_merged(cut in 0_usize..400, seed in 0_u64..1000) {
            let (x, y) = (noise(400, 7, seed), noise(400, 3, seed + 1));
            let whole = least_squares(x.as_ref(), y.as_ref(), Ridge::NONE).unwrap();
            let part = |from: usize, rows: usize| {
                let mut r_factor = RFactor::new(7, 3);
                r_factor.absorb(rows, |rows, columns, stride| {
                    for (j, column) in columns.chunks_mut(stride).enumerate() {
                        let source = if j < 7 { x.col(j) } else { y.col(j - 7) };
                        rows.clone().for_each(|i| column[i - rows.start] = source[from + i]);
                    }
                });
                r_factor
            };
            let mut merged = part(0, cut);
            merged.merge(&part(cut, 400 - cut));
            let merged = merged.solve(Ridge::NONE).unwrap();
            prop_assert_eq!(merged.rows, 400);
            prop_assert!(difference(&merged.coefficients, &whole.coefficients) < 1e-13);
            prop_assert!(difference(&merged.residual_products, &whole.residual_products) < 1e-13);
        }
    }

    /// Columns of norm one that differ by `apart` from a common column.
    fn upper(size: usize, apart: f64, seed: u64) -> Mat<f64> {
        let mut random = Random(seed);
        let mut r = Mat::from_fn(size, size, |i, j| match (i, i <= j) {
            (0, _) => 1.0,
            (_, true) => apart * random.normal(),
            _ => 0.0,
        });
        for j in 0..size {
            let norm = r.col(j).norm_l2();
            (0..size).for_each(|i| r[(i, j)] /= norm);
        }
        r
    }

    proptest! {
        #[test]
        fn null_vectors_equal_those_of_a_full_svd(
            size in 1..60_usize,
            exponent in -6.0..1.0,
            seed in any::<u64>(),
        ) {
            let r = upper(size, 10_f64.powf(exponent), seed);
            let expected = r.singular_values().unwrap();
            let (largest, smallest) = (expected[0], expected[size - 1]);
            let condition = largest / smallest;
            prop_assume!(condition < 1e12);
            if let Some([low, high]) = by_recursion(&r) {
                prop_assert!((high / largest - 1.0).abs() < 1e-12, "{high} {largest}");
                // In both methods, rounding gives the smallest singular value an error of some ε of the largest.
                prop_assert!((low / smallest - 1.0).abs() < 1e-12 + 1e-14 * condition, "{low} {smallest}");
            } else {
                prop_assert!(size > MOST_VECTORS / 2, "not settled: {size} {condition}");
            }
        }
    }

    #[test]
    fn equal_singular_values_converge_and_a_zero_is_left_to_the_caller() {
        let equal = by_recursion(&Mat::identity(200, 200)).unwrap();
        assert!(equal.iter().all(|value| (value - 1.0).abs() < 1e-13), "{equal:?}");
        let mut singular = upper(200, 0.1, 7);
        singular[(120, 120)] = 0.0;
        assert_eq!(by_recursion(&singular), None);
    }
}
