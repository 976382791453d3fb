//! Time from rows in memory to coefficients, at the paper's size, on one thread. `cargo bench
//! --bench solve`; the baseline for the exact sums is the plain `f64` Gram matrix.

use calibration::exact::{Accumulator, ExactSums};
use calibration::model::{Basis, Model, Term};
use divan::{Bencher, black_box};
use faer::linalg::matmul::triangular::{BlockStructure, matmul};
use faer::prelude::*;
use faer::{Accum, Mat, Par};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

const ROWS: usize = 77_522;
const BASES: [Basis; 3] = [Basis::Cubic, Basis::Quadratic, Basis::Poly3];

fn main() {
    divan::main();
}

struct DenseRows {
    readings: Vec<Vec<f64>>,
    wrench: Vec<Vec<f64>>,
}

/// 12-bit readings that fill `span` counts, and a wrench of full-length `f64`.
fn rows(span: f64) -> DenseRows {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let mut uniform = move || random.next_u64() as f64 / 2f64.powi(64) - 0.5;
    let mut readings = vec![Vec::new(); 8];
    let mut wrench = vec![Vec::new(); 6];
    for _ in 0..ROWS {
        let load: [f64; 6] = std::array::from_fn(|_| uniform());
        for (i, column) in readings.iter_mut().enumerate() {
            let own = 0.6 * load[i % 6] + 0.3 * load[(i + 1) % 6] + 0.1 * uniform();
            column.push((2048.0 + own * span).round());
        }
        for (axis, column) in wrench.iter_mut().enumerate() {
            column.push(load[axis] * 5.0 + 0.1 * uniform());
        }
    }
    DenseRows { readings, wrench }
}

fn sum(rows: &DenseRows, basis: Basis) -> ExactSums {
    let mut accumulator = Accumulator::new(basis, rows.readings.len());
    accumulator.absorb(&rows.readings, &rows.wrench).expect("integer readings");
    accumulator.finish().expect("integer readings")
}

fn with_intercept(basis: Basis) -> Model {
    Model { basis, intercept: true, channels: 8, memory: 0 }
}

#[divan::bench(args = BASES, consts = [1400, 3600])]
fn exact<const SPAN: usize>(bencher: Bencher, basis: Basis) {
    let rows = rows(SPAN as f64);
    let model = with_intercept(basis);
    bencher.bench_local(|| sum(black_box(&rows), basis).solve(&model, 0.0).expect("full rank"));
}

#[divan::bench(args = BASES)]
fn exact_sums(bencher: Bencher, basis: Basis) {
    let rows = rows(1400.0);
    bencher.bench_local(|| sum(black_box(&rows), basis));
}

#[divan::bench(args = BASES)]
fn exact_solve(bencher: Bencher, basis: Basis) {
    let moments = sum(&rows(1400.0), basis);
    let model = with_intercept(basis);
    bencher.bench_local(|| black_box(&moments).solve(&model, 0.0).expect("full rank"));
}

/// Features centred and scaled, one triangle of the Gram matrix with faer, Cholesky.
#[divan::bench(args = BASES)]
fn f64_gram(bencher: Bencher, basis: Basis) {
    const BLOCK: usize = 512;
    let rows = rows(1400.0);
    let terms = with_intercept(basis).terms();
    bencher.bench_local(|| {
        let rows = black_box(&rows);
        let size = terms.len() + 6;
        let mut gram = Mat::<f64>::zeros(size, size);
        let mut block = Mat::<f64>::zeros(BLOCK, size);
        for start in (0..ROWS).step_by(BLOCK) {
            let count = BLOCK.min(ROWS - start);
            fill(rows, &terms, start, count, &mut block);
            let x = block.as_ref().subrows(0, count);
            matmul(
                gram.as_mut(),
                BlockStructure::TriangularLower,
                Accum::Add,
                x.transpose(),
                BlockStructure::Rectangular,
                x,
                BlockStructure::Rectangular,
                1.0,
                Par::Seq,
            );
        }
        let p = terms.len();
        let factor = gram.submatrix(0, 0, p, p).llt(faer::Side::Lower).expect("positive definite");
        factor.solve(gram.submatrix(p, 0, 6, p).transpose())
    });
}

fn fill(rows: &DenseRows, terms: &[Term], start: usize, count: usize, block: &mut Mat<f64>) {
    for (j, term) in terms.iter().enumerate() {
        let (factors, before): (&[u8], Option<usize>) = match term.factors() {
            [] => (&[], None),
            [one] => (std::slice::from_ref(one), None),
            [rest @ .., last] => (
                std::slice::from_ref(last),
                terms[..j].iter().position(|t| *t == Term::product(rest)),
            ),
        };
        let earlier: Option<Vec<f64>> = before.map(|k| block.col_as_slice(k)[..count].to_vec());
        let column = &mut block.col_as_slice_mut(j)[..count];
        match (factors, earlier) {
            ([channel], earlier) => {
                let readings = &rows.readings[usize::from(*channel)][start..start + count];
                let earlier = earlier.unwrap_or_else(|| vec![1.0; count]);
                for ((x, s), e) in column.iter_mut().zip(readings).zip(earlier) {
                    *x = (s - 2048.0) * (1.0 / 1024.0) * e;
                }
            }
            _ => column.fill(1.0),
        }
    }
    for (axis, wrench) in rows.wrench.iter().enumerate() {
        block.col_as_slice_mut(terms.len() + axis)[..count]
            .copy_from_slice(&wrench[start..start + count]);
    }
}
