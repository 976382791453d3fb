//! The extreme singular values of an upper triangular matrix, by Lanczos's recursion.
//!
//! That of `RᵀR` finds the largest, that of its inverse the smallest, as each finds the largest eigenvalue first
//! (Golub & Van Loan, 4th ed., §10.1). Every vector is kept orthogonal to all before it: of a polynomial's features
//! some twenty are enough, where all singular values take as long as a refinement.

use faer::Mat;

use super::householder::contiguous;
use crate::symmetric::SymmetricMatrix;
use crate::vectors::{add_multiple, dot};

/// Vectors made before giving up.
const MOST_VECTORS: usize = 100;

/// Vectors between two looks at what they say.
const VECTORS_AT_ONCE: usize = 4;

/// By how much so many vectors may still raise an eigenvalue, as a share of it.
const SETTLED: f64 = 1e-13;

/// Columns of which all singular values are soon found.
const FEW_COLUMNS: usize = 100;

/// The smallest singular value and the largest of an upper triangular matrix; `None` if it is not finite.
pub(crate) fn extreme_singular_values(r: &Mat<f64>) -> Option<[f64; 2]> {
    let few = r.ncols() <= FEW_COLUMNS;
    (!few).then(|| by_recursion(r)).flatten().or_else(|| {
        let all = r.singular_values().ok()?;
        Some([*all.last()?, *all.first()?])
    })
}

/// The same; `None` if the recursion has not settled, or the matrix is singular.
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

/// The largest eigenvalue of a positive definite matrix, of which `apply` makes `A·x` of `x`.
fn largest_eigenvalue(size: usize, apply: impl Fn(&mut [f64])) -> Option<f64> {
    // Multiples of the golden ratio: in no direction that features have.
    let mut next: Vec<f64> =
        (1..=size).map(|i| (i as f64 * 0.618_033_988_749_895).fract() - 0.5).collect();
    let mut norm = dot(&next, &next).sqrt();
    let (mut vectors, mut elements, mut found) = (Vec::<Vec<f64>>::new(), Vec::new(), 0.0);
    for count in 1..=MOST_VECTORS {
        next.iter_mut().for_each(|x| *x /= norm);
        vectors.push(next.clone());
        apply(&mut next);
        let diagonal = dot(&next, &vectors[count - 1]);
        // Twice is enough (Parlett, The Symmetric Eigenvalue Problem, §6.9).
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
    use proptest::prelude::*;
    use system_tests::random::Random;

    use super::*;

    /// Columns of norm one whose angles are those of random columns that differ by `apart` from one they share.
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
        fn they_are_those_of_all_singular_values(
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
                // Either way rounding leaves the smallest an error of some ε of the largest.
                prop_assert!((low / smallest - 1.0).abs() < 1e-12 + 1e-14 * condition, "{low} {smallest}");
            } else {
                prop_assert!(size > MOST_VECTORS / 2, "not settled: {size} {condition}");
            }
        }
    }

    #[test]
    fn equal_singular_values_settle_and_a_zero_is_left_to_others() {
        let equal = by_recursion(&Mat::identity(200, 200)).unwrap();
        assert!(equal.iter().all(|value| (value - 1.0).abs() < 1e-13), "{equal:?}");
        let mut singular = upper(200, 0.1, 7);
        singular[(120, 120)] = 0.0;
        assert_eq!(by_recursion(&singular), None);
    }
}
