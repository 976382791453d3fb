//! Matrices in memory as a source of rows.

use faer::{Mat, MatRef};

use super::{
    LeastSquares, LeastSquaresError, Method, Reduction, Ridge, RowChunk, RowSource, Shape, solve,
};

/// `X` and `Y`, columns multiplied by powers of two that bring their largest element near one:
/// squares neither overflow nor underflow in any units, even with subnormal numbers.
#[derive(Clone, Debug)]
pub(crate) struct Dense<'a> {
    x: MatRef<'a, f64>,
    tails: Option<MatRef<'a, f64>>,
    y: MatRef<'a, f64>,
    /// Exponents of the powers of two that scale the columns of `[X | Y]`.
    units: Vec<i32>,
}

impl<'a> Dense<'a> {
    /// Rows of `x` (n × p) and `y` (n × q). With tails, the elements of `X` are `x + tails`.
    ///
    /// # Panics
    /// If the shapes do not match.
    pub(crate) fn new(
        x: MatRef<'a, f64>,
        tails: Option<MatRef<'a, f64>>,
        y: MatRef<'a, f64>,
    ) -> Self {
        assert_eq!(x.nrows(), y.nrows(), "as many rows in X as in Y");
        assert!(tails.is_none_or(|tails| tails.shape() == x.shape()), "as many tails as heads");
        let units = x.col_iter().chain(y.col_iter()).map(|column| {
            let largest = column.iter().fold(0.0, |a: f64, b| a.max(b.abs()));
            if largest > 0.0 && largest.is_finite() { -libm::ilogb(largest) } else { 0 }
        });
        Self { x, tails, y, units: units.collect() }
    }

    fn unscaled(&self, mut solved: LeastSquares) -> Result<LeastSquares, LeastSquaresError> {
        let (p, q) = (self.x.ncols(), self.y.ncols());
        let (x, y) = self.units.split_at(p);
        let scale = |m: &mut Mat<f64>, exponent: &dyn Fn(usize, usize) -> i32| {
            for j in 0..m.ncols() {
                for i in 0..m.nrows() {
                    m[(i, j)] = libm::ldexp(m[(i, j)], exponent(i, j));
                }
            }
        };
        scale(&mut solved.coefficients, &|i, j| x[i] - y[j]);
        scale(&mut solved.factor, &|i, _| x[i]);
        scale(&mut solved.residual_products, &|i, j| -y[i] - y[j]);
        debug_assert_eq!(solved.residual_products.nrows(), q);
        let all_finite = solved.coefficients.is_all_finite() && solved.factor.is_all_finite();
        if all_finite { Ok(solved) } else { Err(LeastSquaresError::NotFinite) }
    }
}

impl RowSource for Dense<'_> {
    type Error = LeastSquaresError;

    fn shape(&self) -> Shape {
        Shape { features: self.x.ncols(), outputs: self.y.ncols() }
    }

    fn pass<R: Reduction>(&mut self, empty: &R) -> Result<R, LeastSquaresError> {
        let (p, columns) = (self.x.ncols(), self.shape().columns());
        let stride = RowChunk::rows_in_cache(columns);
        let mut heads = vec![0.0; stride * columns];
        let mut tails = vec![0.0; if R::WIDE && self.tails.is_some() { stride * p } else { 0 }];
        let mut partial = empty.clone();
        for start in (0..self.x.nrows()).step_by(stride) {
            let rows = stride.min(self.x.nrows() - start);
            let scaled = |to: &mut [f64], from: faer::ColRef<'_, f64>, unit: i32| {
                for (to, &from) in to.iter_mut().zip(from.subrows(start, rows).iter()) {
                    *to = libm::ldexp(from, unit);
                }
            };
            for (j, column) in heads.chunks_mut(stride).enumerate() {
                let from = if j < p { self.x.col(j) } else { self.y.col(j - p) };
                scaled(column, from, self.units[j]);
            }
            if let Some(from) = self.tails.filter(|_| R::WIDE) {
                for (j, column) in tails.chunks_mut(stride).enumerate() {
                    scaled(column, from.col(j), self.units[j]);
                }
            }
            let chunk = RowChunk { rows, stride, heads: &heads, tails: &tails };
            partial.absorb(&chunk);
        }
        Ok(partial)
    }
}

/// # Errors
/// As [`solve`]; also if a coefficient is too large for an `f64`.
pub(crate) fn solve_dense(
    mut rows: Dense<'_>,
    method: impl Into<Method>,
    ridge: Ridge,
) -> Result<LeastSquares, LeastSquaresError> {
    if !(rows.x.is_all_finite() && rows.y.is_all_finite()) {
        return Err(LeastSquaresError::NotFinite);
    }
    let (solved, _) = solve(&mut rows, method.into(), ridge)?;
    rows.unscaled(solved)
}
