//! Dense linear least squares, `min ‖X·C − Y‖`, by a family of methods over one stream of rows.
//!
//! Nothing here knows of readings and wrenches. Rows come in chunks `[X | Y]`, elements of `X` in
//! double-double where a plain `f64` would round them ([`Chunk`]). A [`Reduction`] says what a pass
//! over the rows leaves behind: a triangle, a Gram matrix, a gradient; memory does not grow with
//! the rows. [`Rows`] is whatever can be passed over, as often as the method needs:
//!
//! | method | passes | what is kept | relative error of the coefficients, about |
//! | --- | --- | --- | --- |
//! | [`Method::Gram`] | 1 | `XᵀX` | ε·κ² |
//! | [`Method::Tsqr`], [`Method::PivotedQr`], [`Method::Svd`] | 1 | R | ε·(κ + κ²·tan θ) |
//! | [`Method::RefinedTsqr`] | 2 or more | R, then `XᵀR` in double-double | ε, while ε·κ ≪ 1 |
//! | [`Method::WideGram`] | 1 | `XᵀX` in double-double | ε + ε²·κ² |
//! | [`Method::WideTsqr`] | 1 | R in double-double | ε + ε²·(κ + κ²·tan θ) |
//! | [`Method::RidgeGcv`] | 1 | R | that of the ridge |
//! | [`Method::Huber`] | about 10 | R, then clipped gradients | not a least-squares answer |
//!
//! with ε = 2⁻⁵³, κ the condition number of `X` with columns of norm one, θ the angle between `Y`
//! and its prediction (Björck, Numerical Methods for Least Squares Problems, 1996, §1.4, §2.4). A
//! method that cannot tell full rank from a loss of rank, or whose error would leave no digit,
//! answers with [`LeastSquaresError::IllConditioned`] and not with numbers.

mod dense;
mod gcv;
mod gram;
mod huber;
mod kernels;
mod qr;
mod rank_revealing;
mod refinement;
mod wide_gram;
mod wide_matrix;
mod wide_qr;

pub use self::dense::{Dense, solve_dense};
use self::gram::FormGram;
use self::qr::Factor;
use self::wide_gram::FormWideGram;
use self::wide_qr::FactorWide;
pub use super::triangle::{LeastSquares, LeastSquaresError, Ridge};

/// How to solve.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Method {
    /// Householder QR over row blocks.
    Tsqr,
    /// The same, corrected by residuals in double-double.
    RefinedTsqr,
    /// QR with column pivoting. Pivots are chosen in the triangle that [`Method::Tsqr`] leaves,
    /// whose columns have the lengths and angles of those of `X`: the same factorisation.
    PivotedQr,
    /// Singular values, again of the triangle, which has those of `X`.
    Svd {
        /// Leaves out directions whose singular value, of columns of norm one, is below this share
        /// of the largest. `None` leaves out nothing.
        truncate: Option<f64>,
    },
    /// Normal equations and Cholesky in `f64`.
    Gram,
    /// Normal equations and Cholesky in double-double.
    WideGram,
    /// Householder QR over row blocks in double-double.
    WideTsqr,
    /// A ridge whose parameter generalised cross-validation chooses.
    RidgeGcv,
    /// Huber's M-estimator: rows far off count less.
    Huber,
}

/// Some rows of `[X | Y]`, column by column.
#[derive(Clone, Copy, Debug)]
pub struct Chunk<'a> {
    /// Number of rows.
    pub rows: usize,
    /// Distance between the beginnings of columns.
    pub stride: usize,
    /// The elements, rounded to `f64`.
    pub heads: &'a [f64],
    /// What rounding left out of the elements of `X`, laid out like them; empty if nothing.
    pub tails: &'a [f64],
}

impl<'a> Chunk<'a> {
    /// Rows of a chunk of `columns` columns that stays in a core's own cache, and is long enough
    /// for the work per chunk not to count.
    pub fn rows_in_cache(columns: usize) -> usize {
        /// Bytes of a chunk.
        const BYTES: usize = 1 << 18;
        (BYTES / (8 * columns.max(1))).max(4 * columns)
    }

    /// Column `j` of `[X | Y]`.
    #[inline(always)]
    pub fn column(&self, j: usize) -> &'a [f64] {
        &self.heads[j * self.stride..][..self.rows]
    }

    /// What rounding left out of column `j`; empty if nothing.
    #[inline(always)]
    fn tail(&self, j: usize) -> &'a [f64] {
        self.tails.get(j * self.stride..).and_then(|tails| tails.get(..self.rows)).unwrap_or(&[])
    }

    #[inline(always)]
    fn wide(&self, j: usize) -> kernels::Wide<'a> {
        kernels::Wide { heads: self.column(j), tails: self.tail(j) }
    }
}

/// What a pass over the rows leaves behind.
pub trait Reduction: Sync {
    /// That of some of the rows.
    type Partial: Send;
    /// Memory to be used again from chunk to chunk.
    type Scratch;
    /// Whether [`Chunk::tails`] are looked at.
    const WIDE: bool;

    /// Of no rows.
    fn empty(&self) -> Self::Partial;

    /// Memory for [`Reduction::absorb`].
    fn scratch(&self) -> Self::Scratch;

    /// Adds a chunk of at most [`Chunk::rows_in_cache`] rows.
    fn absorb(&self, partial: &mut Self::Partial, chunk: &Chunk<'_>, scratch: &mut Self::Scratch);

    /// Adds the rows of `later` to those of `earlier`.
    fn merge(&self, earlier: &mut Self::Partial, later: Self::Partial);
}

/// Rows that can be passed over any number of times.
pub trait Rows {
    /// What can go wrong on the way.
    type Error: From<LeastSquaresError>;

    /// Columns of `X` and of `Y`.
    fn shape(&self) -> Shape;

    /// Reduces all rows.
    ///
    /// # Errors
    /// Where rows cannot be had.
    fn pass<R: Reduction>(&mut self, reduction: &R) -> Result<R::Partial, Self::Error>;
}

/// Columns of `X` and of `Y`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shape {
    /// p, columns of `X`.
    pub features: usize,
    /// q, columns of `Y`.
    pub outputs: usize,
}

impl Shape {
    /// Columns of `[X | Y]`.
    pub fn columns(self) -> usize {
        self.features + self.outputs
    }
}

/// Solves `min ‖X·C − Y‖² + λ·‖D·C‖²`.
///
/// With [`Method::RidgeGcv`], `ridge` says only which column is free of it.
///
/// # Errors
/// [`LeastSquaresError`] if the rows do not determine the coefficients, or not for this method;
/// whatever `rows` can fail with.
pub fn solve<R: Rows>(
    rows: &mut R,
    method: Method,
    ridge: Ridge,
) -> Result<LeastSquares, R::Error> {
    let shape = rows.shape();
    Ok(match method {
        Method::Tsqr => rows.pass(&Factor { shape })?.solve(ridge)?,
        Method::PivotedQr => rank_revealing::pivoted(&rows.pass(&Factor { shape })?, ridge)?,
        Method::Svd { truncate } => {
            rank_revealing::svd(&rows.pass(&Factor { shape })?, ridge, truncate)?
        }
        Method::RidgeGcv => {
            let triangle = rows.pass(&Factor { shape })?;
            triangle.solve(Ridge { lambda: gcv::lambda(&triangle, ridge.free_column)?, ..ridge })?
        }
        Method::Gram => rows.pass(&FormGram { shape })?.solve(ridge)?,
        Method::WideGram => rows.pass(&FormWideGram { shape })?.solve(ridge)?,
        Method::WideTsqr => rows.pass(&FactorWide { shape })?.solve(ridge)?,
        Method::RefinedTsqr => refinement::solve(rows, ridge)?,
        Method::Huber => huber::solve(rows, ridge)?,
    })
}
