//! Inner products and multiples of columns, compiled for the widest vectors of the machine, and
//! products of a matrix with itself.

use faer::linalg::matmul::triangular::{BlockStructure, matmul};
use faer::{Accum, MatMut, MatRef, Par};

use shell_data::vectorised;

/// Number of parallel sums: enough to hide the latency of one addition.
const LANES: usize = 16;

vectorised! {
    pub(super) fn dot(x: &[f64], y: &[f64]) -> f64 {
        let mut sums = [0.0; LANES];
        let ((x, x_rest), (y, y_rest)) = (x.as_chunks(), y.as_chunks());
        for (x, y) in x.iter().zip(y) {
            let (x, y): (&[f64; LANES], &[f64; LANES]) = (x, y);
            for lane in 0..LANES {
                sums[lane] = x[lane].mul_add(y[lane], sums[lane]);
            }
        }
        let rest: f64 = x_rest.iter().zip(y_rest).map(|(x, y)| x * y).sum();
        sums.iter().sum::<f64>() + rest
    }

    pub(super) fn add_multiple(y: &mut [f64], c: f64, x: &[f64]) {
        for (y, &x) in y.iter_mut().zip(x) {
            *y = c.mul_add(x, *y);
        }
    }
}

/// Computes the lower triangle of `M·Mᵀ`, which replaces the content of `to` or is added to it.
pub(crate) fn lower_product(to: MatMut<'_, f64>, add: Accum, m: MatRef<'_, f64>) {
    use BlockStructure::{Rectangular, TriangularLower};
    matmul(to, TriangularLower, add, m, Rectangular, m.transpose(), Rectangular, 1.0, Par::Seq);
}
