//! R factors beside exact sums on a fixed grid, for readings of full length: the figures of ADR 12.
//! The grid has a step of 2^-66 of the range of a column. A value has three limbs of 22 bits, so
//! the sums of 512 products of limbs are exact in doubles: five matrix products for each chunk of
//! rows, added as integers. Only sums are timed, not their solution.
#![allow(missing_docs, reason = "no one reads the documentation of a benchmark")]

use divan::{Bencher, black_box};
use faer::linalg::matmul::matmul;
use faer::linalg::matmul::triangular::{self, BlockStructure};
use faer::{Accum, Mat, Par};
use least_squares::r_factor::RFactor;

fn main() {
    divan::main();
}

/// Rows of the longest recording in the tests that has readings of full length.
const ROWS: usize = 19_069;
const LOADS: usize = 6;

/// The largest degree of a polynomial in twelve readings, and its number of features.
const DEGREES: [(usize, usize); 2] = [(2, 91), (3, 455)];

/// Features and loads, each within ±1: products of readings that are drawn at random.
fn rows((degree, features): (usize, usize)) -> Mat<f64> {
    let mut state = 1_u64;
    let mut draw = || {
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    };
    let readings: Vec<[f64; 12]> = (0..ROWS).map(|_| std::array::from_fn(|_| draw())).collect();
    let mut factors = vec![(Vec::new(), 0)];
    let mut next = 0;
    while let Some((product, first)) = factors.get(next).cloned() {
        next += 1;
        if product.len() < degree {
            factors
                .extend((first..12).map(|channel| ([&product[..], &[channel]].concat(), channel)));
        }
    }
    assert_eq!(factors.len(), features);
    Mat::from_fn(ROWS, features + LOADS, |row, column| match factors.get(column) {
        Some((product, _)) => product.iter().map(|&channel| readings[row][channel]).product(),
        None => readings[row][column - features],
    })
}

#[divan::bench(args = DEGREES, sample_count = 7, sample_size = 1)]
fn r_factor(bencher: Bencher<'_, '_>, problem: (usize, usize)) {
    let rows = rows(problem);
    bencher.bench_local(|| {
        let mut factor = RFactor::new(problem.1, LOADS);
        factor.absorb(ROWS, |range, out, stride| {
            for (column, out) in rows.col_iter().zip(out.chunks_mut(stride)) {
                let column = column.try_as_col_major().expect("a whole column");
                out[..range.len()].copy_from_slice(&column.as_slice()[range.clone()]);
            }
        });
        black_box(factor)
    });
}

#[divan::bench(args = DEGREES, sample_count = 7, sample_size = 1)]
fn sums_on_a_fixed_grid(bencher: Bencher<'_, '_>, problem: (usize, usize)) {
    const CHUNK: usize = 512;
    const PAIRS: [(usize, usize); 5] = [(0, 0), (0, 1), (1, 1), (0, 2), (1, 2)];
    /// Rounds to an integer when it is added and subtracted.
    const ROUND: f64 = 6_755_399_441_055_744.0;
    const LIMB: f64 = 4_194_304.0;

    let rows = rows(problem);
    let columns = rows.ncols();
    bencher.bench_local(|| {
        let mut limbs: [Mat<f64>; 3] = std::array::from_fn(|_| Mat::zeros(CHUNK, columns));
        let mut products = Mat::zeros(columns, columns);
        let mut sums = vec![vec![0_i64; columns * columns]; PAIRS.len()];
        for first in (0..ROWS).step_by(CHUNK) {
            let count = CHUNK.min(ROWS - first);
            for column in 0..columns {
                let values = &rows.col_as_slice(column)[first..first + count];
                let [high, middle, low] =
                    limbs.each_mut().map(|limb| &mut limb.col_as_slice_mut(column)[..count]);
                for (i, value) in values.iter().enumerate() {
                    high[i] = value * LIMB + ROUND - ROUND;
                    let rest = (value * LIMB - high[i]) * LIMB;
                    middle[i] = rest + ROUND - ROUND;
                    low[i] = (rest - middle[i]) * LIMB + ROUND - ROUND;
                }
            }
            for ((i, j), sums) in PAIRS.into_iter().zip(&mut sums) {
                let left = limbs[i].subrows(0, count).transpose();
                let right = limbs[j].subrows(0, count);
                let whole = BlockStructure::Rectangular;
                if i == j {
                    let upper = BlockStructure::TriangularUpper;
                    let products = products.as_mut();
                    triangular::matmul(
                        products,
                        upper,
                        Accum::Replace,
                        left,
                        whole,
                        right,
                        whole,
                        1.0,
                        Par::Seq,
                    );
                } else {
                    matmul(products.as_mut(), Accum::Replace, left, right, 1.0, Par::Seq);
                }
                for column in 0..columns {
                    let end = if i == j { column + 1 } else { columns };
                    let sums = &mut sums[column * columns..][..end];
                    for (sum, product) in sums.iter_mut().zip(products.col_as_slice(column)) {
                        *sum += *product as i64;
                    }
                }
            }
        }
        black_box(sums)
    });
}
