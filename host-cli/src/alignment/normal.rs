//! Normal equations from a Gram matrix, with directions that the data do not excite left out.

use faer::Mat;

/// A pivot below this fraction of its diagonal is a feature that the ones before explain: features
/// of a load that never goes there, say.
const TOLERANCE: f64 = 1e-9;

/// Columns [X | D | tD | Y] after X is projected out.
#[derive(Debug)]
pub(super) struct Projected {
    /// Least-squares coefficients of Y on X.
    pub(super) map: Mat<f64>,
    /// Those of [D | tD] on X.
    pub(super) along: Mat<f64>,
    /// Gram matrix of what is left of [D | tD | Y].
    left: Mat<f64>,
    channels: usize,
    total: f64,
}

impl Projected {
    /// `gram` is that of the columns [X | D | tD | Y], X of `features` columns, the others of
    /// `channels` each; `total` is the sum of the row weights. `None` if there are no more rows
    /// than features.
    pub(super) fn new(
        gram: &Mat<f64>,
        features: usize,
        channels: usize,
        total: f64,
    ) -> Option<Self> {
        if total.is_nan() || total <= (features + channels) as f64 {
            return None;
        }
        let width = gram.ncols();
        let rest = width - features;
        // Cholesky, row-oriented, with the right-hand sides carried along: `work` ends as
        // [R | R⁻ᵀ XᵀZ] above the projected block.
        let mut work = gram.clone();
        let mut used = vec![false; features];
        for k in 0..features {
            let pivot = work[(k, k)];
            used[k] = pivot > TOLERANCE * gram[(k, k)];
            if !used[k] {
                continue;
            }
            let root = pivot.sqrt();
            for j in k..width {
                work[(k, j)] /= root;
            }
            for j in k + 1..width {
                let factor = work[(k, j)];
                for i in k + 1..=j {
                    work[(i, j)] -= work[(k, i)] * factor;
                }
            }
        }
        let mut solution = Mat::<f64>::zeros(features, rest);
        for column in 0..rest {
            for k in (0..features).rev().filter(|&k| used[k]) {
                let mut sum = work[(k, features + column)];
                for j in (k + 1..features).filter(|&j| used[j]) {
                    sum -= work[(k, j)] * solution[(j, column)];
                }
                solution[(k, column)] = sum / work[(k, k)];
            }
        }
        let left =
            Mat::from_fn(rest, rest, |i, j| work[(features + i.min(j), features + i.max(j))]);
        Some(Self {
            map: solution.subcols(2 * channels, channels).to_owned(),
            along: solution.subcols(0, 2 * channels).to_owned(),
            left,
            channels,
            total,
        })
    }

    /// The inverse of the residual covariance.
    pub(super) fn weights(&self) -> Option<Mat<f64>> {
        let n = self.channels;
        let features = self.map.nrows() as f64;
        let scale = 1.0 / (self.total - features);
        let covariance = Mat::from_fn(n, n, |i, j| scale * self.left[(2 * n + i, 2 * n + j)]);
        // A channel that is fitted to rounding would get all the weight.
        let largest = (0..n).map(|i| covariance[(i, i)]).fold(0.0, f64::max);
        let floored = Mat::from_fn(n, n, |i, j| {
            covariance[(i, j)] + if i == j { 1e-6 * largest + 1e-300 } else { 0.0 }
        });
        let factor = floored.llt(faer::Side::Lower).ok()?;
        Some(faer::linalg::solvers::DenseSolveCore::inverse(&factor))
    }

    /// H and g of the Gauss–Newton step.
    pub(super) fn normal_equations(&self) -> ([[f64; 2]; 2], [f64; 2]) {
        let n = self.channels;
        let Some(weights) = self.weights() else {
            return ([[0.0; 2]; 2], [0.0; 2]);
        };
        let trace = |a: usize, b: usize| -> f64 {
            let term = |i: usize, j: usize| weights[(i, j)] * self.left[(a * n + i, b * n + j)];
            (0..n).flat_map(|i| (0..n).map(move |j| (i, j))).map(|(i, j)| term(i, j)).sum()
        };
        ([0, 1].map(|a| [0, 1].map(|b| trace(a, b))), [0, 1].map(|a| trace(a, 2)))
    }
}

/// The inverse of a symmetric positive definite 2 × 2 matrix.
pub(super) fn inverse([[a, b], [_, c]]: [[f64; 2]; 2]) -> Option<[[f64; 2]; 2]> {
    let determinant = a * c - b * b;
    if !(a > 0.0 && c > 0.0 && determinant > 1e-12 * a * c) {
        return None;
    }
    Some([[c / determinant, -b / determinant], [-b / determinant, a / determinant]])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The Gram matrix of rows [X | D | tD | Y].
    fn gram(rows: &[Vec<f64>]) -> Mat<f64> {
        let width = rows[0].len();
        Mat::from_fn(width, width, |i, j| rows.iter().map(|row| row[i] * row[j]).sum())
    }

    /// Two features, one channel, and Y = 2 X₀ − X₁ + 0.5 D + 0.25 tD without error.
    fn rows(repeat_a_feature: bool) -> Vec<Vec<f64>> {
        let row = |i: i32| {
            let t = f64::from(i) / 20.0;
            let (a, b) = (1.0, t.sin());
            let (d, e) = ((3.0 * t).cos(), t * (3.0 * t).cos());
            let mut row = vec![a, b];
            row.extend(repeat_a_feature.then_some(2.0 * b - a));
            row.extend([d, e, 2.0 * a - b + 0.5 * d + 0.25 * e]);
            row
        };
        (0..100).map(row).collect()
    }

    #[test]
    fn a_step_recovers_what_the_features_do_not_explain() {
        for (features, repeated) in [(2, false), (3, true)] {
            let projected = Projected::new(&gram(&rows(repeated)), features, 1, 100.0).unwrap();
            let (hessian, gradient) = projected.normal_equations();
            let inverse = inverse(hessian).unwrap();
            let step = inverse.map(|row| row[0] * gradient[0] + row[1] * gradient[1]);
            // Exact but for rounding; the Gram matrix has a condition number of some 1e3.
            assert!((step[0] - 0.5).abs() < 1e-9 && (step[1] - 0.25).abs() < 1e-9, "{step:?}");
        }
    }

    #[test]
    fn a_feature_that_others_explain_is_left_out() {
        let projected = Projected::new(&gram(&rows(true)), 3, 1, 100.0).unwrap();
        assert_eq!(projected.map[(2, 0)], 0.0);
        assert!((0..3).all(|i| projected.map[(i, 0)].is_finite()));
    }

    #[test]
    fn too_few_rows_determine_nothing() {
        assert!(Projected::new(&gram(&rows(false)[..3]), 2, 1, 3.0).is_none());
        assert!(inverse([[1.0, 1.0], [1.0, 1.0]]).is_none());
        assert!(inverse([[0.0, 0.0], [0.0, 0.0]]).is_none());
    }
}
