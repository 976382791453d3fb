//! Householder QR of an R factor with rows below it. faer's QR (0.24) drops a column, and shifts the later rows, if the
//! part of the column that is independent of earlier ones is below 16·n·2⁻⁵² of its norm. With a thousand rows to a
//! block, that is a silent loss of rank at a condition number of 10¹¹.

use std::ops::Range;

use faer::linalg::matmul::matmul;
use faer::prelude::*;
use faer::{Accum, ColMut, ColRef, Mat, MatMut, Par};

use crate::vectors::{add_multiple, dot};

/// Bytes in a row block, which should fit in the L1 cache, because each reflector passes over it.
const BLOCK_BYTES: usize = 1 << 15;

/// Bytes in a row block with many columns. Each panel passes over it once.
const LARGE_BLOCK_BYTES: usize = 1 << 20;

const PANEL: usize = 16;

#[derive(Clone, Debug, PartialEq)]
pub struct RFactor {
    pub(super) features: usize,
    pub rows: u64,
    pub(super) r: Mat<f64>,
}

impl RFactor {
    /// R factor of zero rows, with `features` columns of `X` and `outputs` columns of `Y`.
    pub fn new(features: usize, outputs: usize) -> Self {
        let order = features + outputs;
        Self { features, rows: 0, r: Mat::zeros(order, order) }
    }

    /// R factor of `rows` rows from a matrix that [`RFactor::whole`] returned.
    ///
    /// # Panics
    /// If the matrix is not square, or its order is less than `features`.
    pub fn from_parts(features: usize, rows: u64, whole: Mat<f64>) -> Self {
        assert!(whole.nrows() == whole.ncols() && features <= whole.ncols());
        Self { features, rows, r: whole }
    }

    /// The whole matrix of order p + q: `R` and `Z`, and below them zeros and `E`.
    pub fn whole(&self) -> MatRef<'_, f64> {
        self.r.as_ref()
    }

    pub fn r(&self) -> MatRef<'_, f64> {
        self.r.as_ref().submatrix(0, 0, self.features, self.features)
    }
}

struct Workspace {
    rows: usize,
    /// Elements of the rows, column-major.
    block: Vec<f64>,
    compact: Mat<f64>,
    update: Mat<f64>,
}

impl RFactor {
    pub(crate) fn block_rows(&self) -> usize {
        let order = self.r.ncols();
        let rows_of = |bytes| bytes / (8 * order.max(1));
        let rows = rows_of(LARGE_BLOCK_BYTES).min(4 * order);
        rows_of(BLOCK_BYTES).max(rows).max(1)
    }

    /// Adds `rows` rows, in blocks that fit in the cache. `fill` receives a block's range of rows
    /// and the columns of `[X | Y]`, column `j` at `[j·stride ..][..rows.len()]`, and must write
    /// all elements.
    pub fn absorb(&mut self, rows: usize, mut fill: impl FnMut(Range<usize>, &mut [f64], usize)) {
        let mut workspace = Workspace::new(self.block_rows(), self.r.ncols());
        for start in (0..rows).step_by(workspace.rows) {
            let rows = start..rows.min(start + workspace.rows);
            let height = rows.len();
            fill(rows, &mut workspace.block, workspace.rows);
            self.factor_below(|_| height, &mut workspace);
        }
        self.rows += rows as u64;
    }

    /// Adds the rows of `later`.
    ///
    /// # Panics
    /// If the shapes differ.
    pub fn merge(&mut self, later: &RFactor) {
        assert_eq!((self.features, self.r.shape()), (later.features, later.r.shape()));
        if self.rows == 0 {
            self.clone_from(later);
        } else if later.rows > 0 {
            // In an R factor, the first `end` columns are zero below row `end`.
            self.add_columns(self.r.nrows(), later.r.col_iter(), |end| end);
            self.rows += later.rows;
        }
    }

    /// R factor of matrices that have at most as many rows as columns.
    pub(crate) fn from_rows(x: &Mat<f64>, y: &Mat<f64>) -> Self {
        let mut r_factor = Self::new(x.ncols(), y.ncols());
        let height = x.nrows();
        r_factor.add_columns(height, x.col_iter().chain(y.col_iter()), |_| height);
        r_factor.rows = height as u64;
        r_factor
    }

    fn add_columns<'a>(
        &mut self,
        height: usize,
        columns: impl Iterator<Item = ColRef<'a, f64>>,
        rows: impl Fn(usize) -> usize,
    ) {
        let mut workspace = Workspace::new(height, self.r.ncols());
        for (to, from) in workspace.block.chunks_exact_mut(height.max(1)).zip(columns) {
            to.copy_from_slice(contiguous(from));
        }
        self.factor_below(rows, &mut workspace);
    }

    /// Factors the R factor with the rows of the workspace below it. The first `end` columns are
    /// zero after the first `rows(end)` of those rows. The reflector of column `k` is one on row
    /// `k` of the R factor, zero on the other rows, and `v` on the block. The product of the
    /// reflectors of a panel is `I − V·T·Vᵀ`, with an identity on top of `V` (the compact form of
    /// Schreiber and Van Loan, SIAM J. Sci. Stat. Comput. 10, 1989).
    fn factor_below(&mut self, rows: impl Fn(usize) -> usize, workspace: &mut Workspace) {
        let order = self.r.nrows();
        let Workspace { rows: stride, block, compact, update, .. } = workspace;
        let mut block = MatMut::from_column_major_slice_mut(block, *stride, order);
        for start in (0..order).step_by(PANEL) {
            let end = order.min(start + PANEL);
            let (panel, mut later) = block.rb_mut().subrows_mut(0, rows(end)).split_at_col_mut(end);
            let mut panel = panel.subcols_mut(start, end - start);
            self.factor_panel(start, panel.rb_mut(), compact);
            if end == order {
                break;
            }
            // Later columns become R − Tᵀ·W and B − V·Tᵀ·W, where W = R + Vᵀ·B.
            let (width, count) = (end - start, order - end);
            let panel = panel.rb();
            let compact = compact.as_ref().submatrix(0, 0, width, width);
            let (mut sums, rest) = update.as_mut().split_at_row_mut(PANEL);
            let mut sums = sums.rb_mut().submatrix_mut(0, 0, width, count);
            let mut product = rest.submatrix_mut(0, 0, width, count);
            let mut top = self.r.as_mut().submatrix_mut(start, end, width, count);
            sums.copy_from(&top);
            matmul(sums.rb_mut(), Accum::Add, panel.transpose(), later.rb(), 1.0, Par::Seq);
            let transposed = compact.transpose();
            matmul(product.rb_mut(), Accum::Replace, transposed, sums.rb(), 1.0, Par::Seq);
            top -= &product;
            matmul(later.rb_mut(), Accum::Add, panel, product.rb(), -1.0, Par::Seq);
        }
    }

    /// Replaces the columns of a panel, from column `start` of the stack on, with reflectors;
    /// writes `T` to `compact`.
    fn factor_panel(&mut self, start: usize, mut panel: MatMut<'_, f64>, compact: &mut Mat<f64>) {
        let width = panel.ncols();
        for k in 0..width {
            let (before, rest) = panel.rb_mut().split_at_col_mut(k);
            let (column, mut later) = rest.split_at_col_mut(1);
            let mut column = column.col_mut(0);
            let below = column.norm_l2();
            let diagonal = self.r[(start + k, start + k)];
            let reflected = -below.hypot(diagonal).copysign(diagonal);
            let first = diagonal - reflected;
            let tau = if below > 0.0 { -first / reflected } else { 0.0 };
            compact[(k, k)] = tau;
            if tau == 0.0 {
                (0..k).for_each(|i| compact[(i, k)] = 0.0);
                column.fill(0.0);
                continue;
            }
            self.r[(start + k, start + k)] = reflected;
            let v = contiguous_mut(column);
            v.iter_mut().for_each(|v| *v /= first);
            let v = &*v;
            for j in 0..later.ncols() {
                let top = &mut self.r[(start + k, start + k + 1 + j)];
                let x = contiguous_mut(later.rb_mut().col_mut(j));
                let share = tau * (*top + dot(v, x));
                *top -= share;
                add_multiple(x, -share, v);
            }
            // Column k of T is −τ·T·(Vᵀv), with T and V of the earlier reflectors.
            for i in 0..k {
                compact[(k, i)] = dot(contiguous(before.rb().col(i)), v);
            }
            for i in 0..k {
                let sum: f64 = (i..k).map(|l| compact[(i, l)] * compact[(k, l)]).sum();
                compact[(i, k)] = -tau * sum;
            }
            (0..k).for_each(|i| compact[(k, i)] = 0.0);
        }
    }
}

impl Workspace {
    fn new(rows: usize, order: usize) -> Self {
        Self {
            rows,
            block: vec![0.0; rows * order],
            compact: Mat::zeros(PANEL, PANEL),
            update: Mat::zeros(2 * PANEL, order),
        }
    }
}

/// The elements of a column, which are contiguous in every matrix here.
#[inline(always)]
pub(super) fn contiguous(column: ColRef<'_, f64>) -> &[f64] {
    column.try_as_col_major().expect("a column of a column-major matrix").as_slice()
}

#[inline(always)]
fn contiguous_mut(column: ColMut<'_, f64>) -> &mut [f64] {
    column.try_as_col_major_mut().expect("a column of a column-major matrix").as_slice_mut()
}
