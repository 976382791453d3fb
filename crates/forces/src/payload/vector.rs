//! Vectors and matrices in three dimensions.

pub(super) use shell_data::wrench::cross;

pub type Vector = [f64; 3];

pub type Matrix = [Vector; 3];

pub(super) fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub fn norm(a: Vector) -> f64 {
    dot(a, a).sqrt()
}

pub(super) fn add(a: Vector, b: Vector) -> Vector {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

pub(super) fn subtract(a: Vector, b: Vector) -> Vector {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

pub(super) fn scaled(a: Vector, factor: f64) -> Vector {
    a.map(|value| value * factor)
}

pub fn times(matrix: &Matrix, a: Vector) -> Vector {
    matrix.map(|row| dot(row, a))
}

pub(super) fn product(a: &Matrix, b: &Matrix) -> Matrix {
    a.map(|row| std::array::from_fn(|j| (0..3).map(|k| row[k] * b[k][j]).sum()))
}

/// `Σ a·bᵀ` over pairs.
pub(super) fn sum_of_products(pairs: impl Iterator<Item = (Vector, Vector)>) -> Matrix {
    let mut sum = Matrix::default();
    for (a, b) in pairs {
        for (row, a) in sum.iter_mut().zip(a) {
            row.iter_mut().zip(b).for_each(|(sum, b)| *sum += a * b);
        }
    }
    sum
}

/// The inverse by cofactors; not finite for a singular matrix.
pub(super) fn inverse(m: &Matrix) -> Matrix {
    let columns = [cross(m[1], m[2]), cross(m[2], m[0]), cross(m[0], m[1])];
    let determinant = dot(m[0], columns[0]);
    std::array::from_fn(|i| std::array::from_fn(|j| columns[j][i] / determinant))
}

/// The mean; zero without vectors.
pub(super) fn mean(vectors: impl ExactSizeIterator<Item = Vector>) -> Vector {
    let count = vectors.len().max(1) as f64;
    scaled(vectors.fold([0.0; 3], add), 1.0 / count)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_inverse_undoes_its_matrix() {
        let m = [[2.0, -1.0, 0.5], [0.25, 3.0, 1.0], [-1.0, 0.0, 4.0]];
        let identity = product(&inverse(&m), &m);
        for (i, row) in identity.iter().enumerate() {
            for (j, value) in row.iter().enumerate() {
                assert!((value - f64::from(u8::from(i == j))).abs() < 1e-15, "{identity:?}");
            }
        }
        assert_eq!(cross([1.0, 0.0, 0.0], [0.0, 1.0, 0.0]), [0.0, 0.0, 1.0]);
    }
}
