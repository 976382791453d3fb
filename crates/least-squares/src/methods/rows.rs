use std::ops::Range;

use super::wide_matrix::Wide;
use crate::r_factor::{LeastSquaresError, RFactor};

#[derive(Clone, Copy, Debug)]
pub struct RowChunk<'a> {
    pub rows: usize,
    pub stride: usize,
    pub heads: &'a [f64],
    /// Rounding errors of the elements of `X`, in the same layout; empty if all are zero.
    pub tails: &'a [f64],
}

impl<'a> RowChunk<'a> {
    /// Number of rows in a chunk that fits in a core's private cache and has a negligible overhead.
    pub fn rows_in_cache(columns: usize) -> usize {
        const BYTES: usize = 1 << 18;
        (BYTES / (8 * columns.max(1))).max(4 * columns)
    }

    #[inline(always)]
    pub fn column(&self, j: usize) -> &'a [f64] {
        &self.heads[j * self.stride..][..self.rows]
    }

    #[inline(always)]
    pub(super) fn tail(&self, j: usize) -> &'a [f64] {
        self.tails.get(j * self.stride..).and_then(|tails| tails.get(..self.rows)).unwrap_or(&[])
    }

    #[inline(always)]
    pub(super) fn wide(&self, j: usize) -> Wide<'a> {
        Wide { heads: self.column(j), tails: self.tail(j) }
    }
}

#[derive(Clone, Debug)]
pub(super) struct WideColumns {
    pub(super) height: usize,
    pub(super) heads: Vec<f64>,
    pub(super) tails: Vec<f64>,
}

impl WideColumns {
    pub(super) fn new(chunk: &RowChunk<'_>, columns: Range<usize>) -> Self {
        let elements = columns.len() * chunk.rows;
        let (mut heads, mut tails) = (Vec::with_capacity(elements), Vec::with_capacity(elements));
        for j in columns {
            let column = chunk.wide(j);
            heads.extend(column.heads);
            tails.extend(column.tails);
            tails.resize(heads.len(), 0.0);
        }
        Self { height: chunk.rows, heads, tails }
    }
}

/// The result of a pass over the rows.
pub trait Reduction: Clone + Send + Sync {
    /// True if the reduction uses [`RowChunk::tails`].
    const WIDE: bool;

    fn chunk_rows(columns: usize) -> usize {
        RowChunk::rows_in_cache(columns)
    }

    fn absorb(&mut self, chunk: &RowChunk<'_>);

    fn merge(&mut self, later: Self);
}

/// Rows for any number of passes.
pub trait RowSource {
    type Error: From<LeastSquaresError>;

    fn shape(&self) -> Shape;

    /// Reduces all rows, starting from `empty`, the result for zero rows.
    ///
    /// # Errors
    /// If rows cannot be read.
    fn pass<R: Reduction>(&mut self, empty: &R) -> Result<R, Self::Error>;
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shape {
    /// p, number of columns of `X`.
    pub features: usize,
    /// q, number of columns of `Y`.
    pub outputs: usize,
}

impl Shape {
    pub fn columns(self) -> usize {
        self.features + self.outputs
    }
}

impl Reduction for RFactor {
    const WIDE: bool = false;

    fn absorb(&mut self, chunk: &RowChunk<'_>) {
        self.absorb(chunk.rows, |rows, columns, stride| {
            for (j, column) in columns.chunks_mut(stride).enumerate() {
                column[..rows.len()].copy_from_slice(&chunk.column(j)[rows.clone()]);
            }
        });
    }

    fn merge(&mut self, later: Self) {
        self.merge(&later);
    }
}
