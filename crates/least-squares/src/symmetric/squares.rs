//! Subtraction of squares `x·xᵀ` from a symmetric matrix, four at a time, in the given order.

use std::ops::Range;

use pulp::Simd;

use super::SymmetricMatrix;
use shell_data::vectorised;

/// Number of columns and rows in a tile, which stays in registers while squares are subtracted.
const TILE_COLUMNS: usize = 8;
const TILE_ROWS: usize = 4;

/// Number of vectors packed together: as many as fit in the L1 cache.
const VECTORS_AT_ONCE: usize = 64;

vectorised! {
    /// Subtracts `x·xᵀ` for each of `vectors`, whose length is the order of the matrix.
    pub(super) fn subtract_squares<S: Simd>(simd: S, from: &mut SymmetricMatrix, vectors: &[Vec<f64>]) {
        let bands = from.size.div_ceil(TILE_COLUMNS);
        let at_once = VECTORS_AT_ONCE.min(vectors.len()).max(1);
        // Each band of columns holds these columns of every vector, with zeros beyond the last column.
        let mut packed = vec![[0.0; TILE_COLUMNS]; bands * at_once];
        for of in vectors.chunks(at_once) {
            for (position, x) in of.iter().enumerate() {
                let (whole, rest) = x.as_chunks::<TILE_COLUMNS>();
                for (band, columns) in whole.iter().enumerate() {
                    packed[band * at_once + position] = *columns;
                }
                if !rest.is_empty() {
                    packed[whole.len() * at_once + position][..rest.len()].copy_from_slice(rest);
                }
            }
            for band in 0..bands {
                let columns = &packed[band * at_once..][..of.len()];
                for first in (0..(band + 1) * TILE_COLUMNS).step_by(TILE_ROWS) {
                    let rows = &packed[first / TILE_COLUMNS * at_once..][..of.len()];
                    let tile = Tile { first_row: first, first_column: band * TILE_COLUMNS };
                    let mut values = tile.load(from);
                    let rows = (rows, first % TILE_COLUMNS);
                    subtract_from_tile(simd, &mut values, rows, columns);
                    tile.store(&values, from);
                }
            }
        }
    }
}

type TileValues = [[f64; TILE_COLUMNS]; TILE_ROWS];

/// Computes `tile -= Σ a·xᵀ` for rows `a`, from `first` on, and columns `x`.
#[inline(always)]
fn subtract_from_tile<S: Simd>(
    simd: S,
    tile: &mut TileValues,
    (rows, first): (&[[f64; TILE_COLUMNS]], usize),
    columns: &[[f64; TILE_COLUMNS]],
) {
    let ((row_fours, row_rest), (fours, rest)) = (rows.as_chunks::<4>(), columns.as_chunks::<4>());
    for lane in (0..TILE_COLUMNS).step_by(S::F64_LANES) {
        let vector = |x: &[f64; TILE_COLUMNS]| S::as_simd_f64s(&x[lane..][..S::F64_LANES]).0[0];
        let mut sums = [simd.splat_f64s(0.0); TILE_ROWS];
        for (sum, values) in sums.iter_mut().zip(&*tile) {
            *sum = vector(values);
        }
        for (a, x) in row_fours.iter().zip(fours) {
            let x = [vector(&x[0]), vector(&x[1]), vector(&x[2]), vector(&x[3])];
            for (row, sum) in sums.iter_mut().enumerate() {
                let mut products = x;
                for (product, a) in products.iter_mut().zip(a) {
                    *product = simd.mul_f64s(simd.splat_f64s(a[first + row]), *product);
                }
                let [p, q, r, s] = products;
                let product = simd.add_f64s(simd.add_f64s(p, q), simd.add_f64s(r, s));
                *sum = simd.sub_f64s(*sum, product);
            }
        }
        for (a, x) in row_rest.iter().zip(rest) {
            for (row, sum) in sums.iter_mut().enumerate() {
                let product = simd.mul_f64s(simd.splat_f64s(a[first + row]), vector(x));
                *sum = simd.sub_f64s(*sum, product);
            }
        }
        for (values, sum) in tile.iter_mut().zip(sums) {
            S::as_mut_simd_f64s(&mut values[lane..][..S::F64_LANES]).0[0] = sum;
        }
    }
}

/// The start of a tile. Elements below the diagonal or beyond the matrix are not used.
struct Tile {
    first_row: usize,
    first_column: usize,
}

impl Tile {
    #[inline(always)]
    fn rows(&self, size: usize) -> impl Iterator<Item = (usize, Range<usize>)> {
        let columns = self.first_column..(self.first_column + TILE_COLUMNS).min(size);
        let rows = self.first_row..(self.first_row + TILE_ROWS).min(columns.end);
        rows.map(move |row| (row, columns.start.max(row)..columns.end))
    }

    #[inline(always)]
    fn load(&self, matrix: &SymmetricMatrix) -> TileValues {
        let mut values = [[0.0; TILE_COLUMNS]; TILE_ROWS];
        for ((row, columns), values) in self.rows(matrix.size).zip(&mut values) {
            values[columns.start - self.first_column..][..columns.len()]
                .copy_from_slice(&matrix.row(row)[columns.start - row..columns.end - row]);
        }
        values
    }

    #[inline(always)]
    fn store(&self, values: &TileValues, matrix: &mut SymmetricMatrix) {
        for ((row, columns), values) in self.rows(matrix.size).zip(values) {
            matrix.row_mut(row)[columns.start - row..columns.end - row]
                .copy_from_slice(&values[columns.start - self.first_column..][..columns.len()]);
        }
    }
}
