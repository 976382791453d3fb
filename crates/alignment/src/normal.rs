//! Normal equations from a Gram matrix, without the directions that the data do not excite.

use faer::linalg::matmul::matmul;
use faer::linalg::solvers::Solve;
use faer::{Accum, Mat, MatRef, Par};

use super::optics::{Bend, POWERS};

/// Least pivot, as a fraction of its diagonal, of a feature that earlier features do not explain.
const TOLERANCE: f64 = 1e-9;

/// Regularisation of the bends, as a share of the squares of the powers. It makes undetermined bends zero.
const HELD: f64 = 1e-9;

/// Gram matrix of the columns [X | D | tD | Y | P]: features X, slopes D by the offset, time t from
/// the pivot, readings Y, and their [`POWERS`] powers P, channel by channel.
#[derive(Debug)]
pub(super) struct GramSums {
    sums: Mat<f64>,
    features: usize,
    channels: usize,
    pub(super) total: f64,
}

impl GramSums {
    pub(super) fn new(features: usize, channels: usize) -> Self {
        let width = features + (3 + POWERS) * channels;
        Self { sums: Mat::zeros(width, width), features, channels, total: 0.0 }
    }

    pub(super) fn width(&self) -> usize {
        self.sums.ncols()
    }

    fn add_sums(&mut self, other: &Self) {
        self.sums += &other.sums;
        self.total += other.total;
    }

    /// The product of two columns, each a weighted sum of columns of the matrix.
    fn product(&self, a: &[(usize, f64)], b: &[(usize, f64)]) -> f64 {
        let term = |&(i, x): &(usize, f64)| -> f64 {
            b.iter().map(|&(j, y)| x * y * self.sums[(i.min(j), i.max(j))]).sum()
        };
        a.iter().map(term).sum()
    }

    /// Adds consecutive `rows`, each multiplied by the root of its weight; `weights` is the sum.
    pub(super) fn add(&mut self, rows: &[f64], weights: f64) {
        let width = self.width();
        let rows = MatRef::from_row_major_slice(rows, rows.len() / width, width);
        matmul(self.sums.as_mut(), Accum::Add, rows.transpose(), rows, 1.0, Par::Seq);
        self.total += weights;
    }
}

/// Columns [D | tD | Z] after projecting out X, where Z = Y + P β are the straightened readings.
#[derive(Debug)]
pub(super) struct Projected {
    /// Least-squares coefficients of Z on X.
    pub(super) map: Mat<f64>,
    pub(super) bends: Vec<Bend>,
    /// Coefficients of [D | tD] on X.
    pub(super) along: Mat<f64>,
    pub(super) used: usize,
    left: Mat<f64>,
    channels: usize,
    total: f64,
}

impl Projected {
    /// Uses the features of `keep`. `None` if there are no more rows than features.
    pub(super) fn new(gram: &GramSums, keep: impl Fn(usize) -> bool) -> Option<Self> {
        let GramSums { sums: ref gram, features, channels, total } = *gram;
        if total.is_nan() || total <= (features + channels) as f64 {
            return None;
        }
        let kept: Vec<usize> = (0..features).filter(|&k| keep(k)).collect();
        let columns: Vec<usize> = kept.iter().copied().chain(features..gram.ncols()).collect();
        // Cholesky by rows of the upper triangle: `work` ends as [R | R⁻ᵀ XᵀZ] above the remaining block.
        let row = |&i: &usize| columns.iter().map(|&j| gram[(i.min(j), i.max(j))]).collect();
        let mut work: Vec<Vec<f64>> = columns.iter().map(row).collect();
        let mut used = Vec::with_capacity(kept.len());
        for (k, &feature) in kept.iter().enumerate() {
            let (above, below) = work.split_at_mut(k + 1);
            let row = &mut above[k];
            let pivot = row[k];
            if pivot.is_nan() || pivot <= TOLERANCE * gram[(feature, feature)] {
                continue;
            }
            used.push(k);
            let root = pivot.sqrt();
            row[k..].iter_mut().for_each(|x| *x /= root);
            for (i, below) in (k + 1..).zip(below) {
                subtract_multiple(&mut below[i..], row[i], &row[i..]);
            }
        }
        let mut solution: Vec<Vec<f64>> = vec![vec![0.0; gram.ncols() - features]; features];
        for (position, &k) in used.iter().enumerate().rev() {
            let mut sum = work[k][kept.len()..].to_vec();
            for &j in &used[position + 1..] {
                subtract_multiple(&mut sum, work[k][j], &solution[kept[j]]);
            }
            sum.iter_mut().for_each(|x| *x /= work[k][k]);
            solution[kept[k]] = sum;
        }
        let left = |i: usize, j: usize| work[kept.len() + i.min(j)][kept.len() + i.max(j)];
        let square = |i: usize| gram[(features + i, features + i)];
        let powers = |c: usize| (3 * channels + c * POWERS)..(3 * channels + (c + 1) * POWERS);
        let bends: Vec<Bend> =
            (0..channels).map(|c| bend(powers(c), 2 * channels + c, left, square)).collect();
        // Each column of [D | tD | Z] as a sum of columns of [D | tD | Y | P].
        let parts = |column: usize| {
            let channel = column.checked_sub(2 * channels);
            let bent = channel.map(|c| powers(c).zip(bends[c]));
            std::iter::once((column, 1.0)).chain(bent.into_iter().flatten())
        };
        let product = |i: usize, j: usize| -> f64 {
            parts(i).flat_map(|(a, x)| parts(j).map(move |(b, y)| x * y * left(a, b))).sum()
        };
        let map = |i: usize, c: usize| -> f64 {
            parts(2 * channels + c).map(|(column, x)| x * solution[i][column]).sum()
        };
        Some(Self {
            map: Mat::from_fn(features, channels, map),
            along: Mat::from_fn(features, 2 * channels, |i, column| solution[i][column]),
            used: used.len(),
            left: Mat::from_fn(3 * channels, 3 * channels, product),
            bends,
            channels,
            total,
        })
    }

    pub(super) fn log_volume(&self) -> f64 {
        match self.residual_covariance(self.total).llt(faer::Side::Lower) {
            Ok(factor) => (0..self.channels).map(|i| 2.0 * factor.L()[(i, i)].ln()).sum(),
            Err(_) => f64::INFINITY,
        }
    }

    fn residual_covariance(&self, count: f64) -> Mat<f64> {
        let n = self.channels;
        let entry = |i: usize, j: usize| self.left[(2 * n + i, 2 * n + j)] / count;
        // A channel that is fitted down to rounding errors would get all the weight.
        let largest = (0..n).map(|i| entry(i, i)).fold(0.0, f64::max);
        let floor = 1e-6 * largest + 1e-300;
        Mat::from_fn(n, n, |i, j| entry(i, j) + if i == j { floor } else { 0.0 })
    }

    pub(super) fn weights(&self) -> Option<Mat<f64>> {
        let covariance = self.residual_covariance(self.total - self.used as f64);
        let factor = covariance.llt(faer::Side::Lower).ok()?;
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

/// Share of the variance of the readings in each part, about their mean there, that maps from the other parts explain:
/// the mean over the channels that vary. Feature 0 is a constant. `None` if the parts do not determine the maps.
///
/// The maps have the features of `keep`. Many features explain any readings of a short time, but not those of others.
pub(super) fn explained_elsewhere(
    parts: &[GramSums],
    keep: impl Fn(usize) -> bool + Copy,
) -> Option<f64> {
    let &GramSums { features, channels, .. } = parts.first()?;
    let mut sums = vec![[0.0; 2]; channels];
    for (number, part) in parts.iter().enumerate() {
        let mut others = GramSums::new(features, channels);
        let others_of = parts.iter().enumerate().filter(|(other, _)| *other != number);
        others_of.for_each(|(_, other)| others.add_sums(other));
        let Projected { map, bends, .. } = Projected::new(&others, keep)?;
        let about_mean = |column: &[(usize, f64)]| {
            part.product(column, column) - part.product(column, &[(0, 1.0)]).powi(2) / part.total
        };
        for (channel, sums) in sums.iter_mut().enumerate().filter(|_| part.total > 0.0) {
            let powers = features + 3 * channels + channel * POWERS;
            let mut column = vec![(features + 2 * channels + channel, 1.0)];
            column.extend(bends[channel].iter().enumerate().map(|(k, &share)| (powers + k, share)));
            sums[1] += about_mean(&column);
            column.extend((0..features).map(|feature| (feature, -map[(feature, channel)])));
            sums[0] += about_mean(&column);
        }
    }
    let explained: Vec<f64> =
        sums.iter().filter(|sums| sums[1] > 0.0).map(|sums| 1.0 - sums[0] / sums[1]).collect();
    Some(explained.iter().sum::<f64>() / explained.len().max(1) as f64)
}

fn subtract_multiple(values: &mut [f64], factor: f64, other: &[f64]) {
    values.iter_mut().zip(other).for_each(|(value, other)| *value -= other * factor);
}

/// β that minimises ‖y + P β‖² after projecting out X, for the columns `powers` and `reading`.
fn bend(
    powers: std::ops::Range<usize>,
    reading: usize,
    left: impl Fn(usize, usize) -> f64,
    square: impl Fn(usize) -> f64,
) -> Bend {
    let first = powers.start;
    let normal = Mat::from_fn(POWERS, POWERS, |i, j| {
        let held = if i == j { HELD * square(first + i) + 1e-300 } else { 0.0 };
        left(first + i, first + j) + held
    });
    let right = Mat::from_fn(POWERS, 1, |i, _| -left(first + i, reading));
    match normal.llt(faer::Side::Lower) {
        Ok(factor) => {
            let solution = factor.solve(&right);
            std::array::from_fn(|k| solution[(k, 0)])
        }
        Err(_) => [0.0; POWERS],
    }
}

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

    fn gram(rows: &[Vec<f64>], features: usize) -> GramSums {
        let mut gram = GramSums::new(features, 1);
        rows.iter().for_each(|row| gram.add(row, 1.0));
        gram
    }

    /// Two features, and one channel whose straight reading is 2 X₀ − X₁ + 0.5 D + 0.25 tD without
    /// error, but which is recorded bent: `z = y + bend · p₂`.
    fn rows(repeat_a_feature: bool, bend: f64) -> Vec<Vec<f64>> {
        let row = |i: i32| {
            let t = f64::from(i) / 20.0;
            let (a, b) = (1.0, t.sin());
            let (d, e) = ((3.0 * t).cos(), t * (3.0 * t).cos());
            let mut row = vec![a, b];
            row.extend(repeat_a_feature.then_some(2.0 * b - a));
            let straight = 2.0 * a - b + 0.5 * d + 0.25 * e;
            let powers = [(5.0 * t).sin(), (7.0 * t).sin(), (11.0 * t).cos()];
            row.extend([d, e, straight - bend * powers[0]]);
            row.extend(powers);
            row
        };
        (0..100).map(row).collect()
    }

    #[test]
    fn a_step_recovers_the_unexplained_part() {
        for (features, repeated) in [(2, false), (3, true)] {
            // Without powers that could explain the slopes.
            let mut rows = rows(repeated, 0.0);
            rows.iter_mut().for_each(|row| row[features + 3..].fill(0.0));
            let projected = Projected::new(&gram(&rows, features), |_| true).unwrap();
            let (hessian, gradient) = projected.normal_equations();
            let inverse = inverse(hessian).unwrap();
            let step = inverse.map(|row| row[0] * gradient[0] + row[1] * gradient[1]);
            // Exact except for rounding; the Gram matrix has a condition number of some 1e3.
            assert!((step[0] - 0.5).abs() < 1e-9 && (step[1] - 0.25).abs() < 1e-9, "{step:?}");
        }
    }

    #[test]
    fn a_bend_is_found_beside_the_map() {
        let mut rows = rows(false, 0.3);
        // Subtract the slopes, so that only the bend remains.
        rows.iter_mut().for_each(|row| row[4] -= 0.5 * row[2] + 0.25 * row[3]);
        let projected = Projected::new(&gram(&rows, 2), |_| true).unwrap();
        let expected = [0.3, 0.0, 0.0];
        // The regularisation holds the powers at zero by 1e-9 of their squares.
        let near = |(a, b): (f64, f64)| (a - b).abs() < 1e-8;
        assert!(projected.bends[0].into_iter().zip(expected).all(near), "{:?}", projected.bends);
        assert!(near((projected.map[(0, 0)], 2.0)) && near((projected.map[(1, 0)], -1.0)));
    }

    #[test]
    fn a_dependent_feature_is_left_out() {
        let projected = Projected::new(&gram(&rows(true, 0.0), 3), |_| true).unwrap();
        assert_eq!((projected.map[(2, 0)], projected.used), (0.0, 2));
        assert!((0..3).all(|i| projected.map[(i, 0)].is_finite()));
    }

    #[test]
    fn a_feature_that_is_not_kept_is_not_used() {
        let with = |features, rows: &[Vec<f64>], keep: fn(usize) -> bool| {
            Projected::new(&gram(rows, features), keep).unwrap()
        };
        let all = with(3, &rows(true, 0.1), |i| i != 1);
        // Without the second feature, the third one replaces it.
        assert_eq!((all.used, all.map[(1, 0)]), (2, 0.0));
        let two = with(2, &rows(false, 0.1), |_| true);
        assert!((all.log_volume() - two.log_volume()).abs() < 1e-9);
        assert!(with(2, &rows(false, 0.1), |i| i == 0).log_volume() > two.log_volume());
    }

    #[test]
    fn too_few_rows_give_no_solution() {
        assert!(Projected::new(&gram(&rows(false, 0.0)[..3], 2), |_| true).is_none());
        assert!(inverse([[1.0, 1.0], [1.0, 1.0]]).is_none());
        assert!(inverse([[0.0, 0.0], [0.0, 0.0]]).is_none());
    }
}
