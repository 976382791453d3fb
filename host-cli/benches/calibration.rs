//! Fitting and converting at the paper's size: 77,522 rows of eight 12-bit readings.

use calibration::model::{Basis, Model};
use calibration::scaling::Scaling;
use calibration::solver::{self, FitProblem, SolverKind};
use calibration::{Calibration, quality};
use divan::counter::ItemsCount;
use divan::{Bencher, black_box};
use shell_data::block::Block;
use shell_data::wrench::PerAxis;
use system_tests::random::Random;

fn main() {
    divan::main();
}

const ROWS: usize = 77_522;
/// Approximate block size of the log reader.
const BLOCK_ROWS: usize = 6_000;

fn blocks() -> Vec<Block> {
    let mut random = Random(1);
    let mut random = || random.bits(12) as f64;
    (0..ROWS)
        .step_by(BLOCK_ROWS)
        .map(|start| {
            let rows = BLOCK_ROWS.min(ROWS - start);
            let mut columns = |n: usize| -> Vec<Vec<f64>> {
                (0..n).map(|_| (0..rows).map(|_| random()).collect()).collect()
            };
            Block { rows, readings: columns(8), wrench: columns(6), ..Block::default() }
        })
        .collect()
}

fn problem(basis: Basis, blocks: &[Block]) -> FitProblem {
    let model = Model { basis, intercept: true, channels: 8, memory: 0 };
    let scaling = Scaling::from_sample(&blocks[0].readings, true);
    FitProblem { model, scaling, ridge: 0.0 }
}

fn calibration(basis: Basis, blocks: &[Block]) -> Calibration {
    let problem = problem(basis, blocks);
    let (solution, ranges) =
        solver::fit(SolverKind::Tsqr, problem, &blocks[..1].into()).expect("full rank");
    Calibration::from_solution(&solution, &ranges)
}

/// One thread; the log reader uses all threads.
#[divan::bench(args = Basis::ALL, sample_count = 15)]
fn tsqr(bencher: Bencher, basis: &Basis) {
    let blocks = blocks();
    let problem = problem(*basis, &blocks);
    bencher.counter(ItemsCount::new(ROWS)).bench(|| {
        let blocks = black_box(&blocks[..]);
        solver::fit(SolverKind::Tsqr, problem.clone(), &blocks.into()).expect("full rank")
    });
}

#[divan::bench(args = Basis::ALL, sample_count = 15)]
fn convert(bencher: Bencher, basis: &Basis) {
    let blocks = blocks();
    let calibration = calibration(*basis, &blocks);
    let mut wrench = PerAxis::default();
    bencher.counter(ItemsCount::new(ROWS)).bench_local(|| {
        for block in &blocks {
            calibration.wrench(black_box(&block.readings), &mut wrench);
        }
    });
}

#[divan::bench(args = Basis::ALL, sample_count = 15)]
fn standard_errors(bencher: Bencher, basis: &Basis) {
    let blocks = blocks();
    let calibration = calibration(*basis, &blocks);
    bencher.counter(ItemsCount::new(ROWS)).bench_local(|| {
        for block in &blocks {
            black_box(calibration.standard_errors(black_box(&block.readings), None));
        }
    });
}

#[divan::bench(sample_count = 15)]
fn errors(bencher: Bencher) {
    let blocks = blocks();
    let calibration = calibration(Basis::Cubic, &blocks);
    let mut wrench = PerAxis::default();
    bencher.counter(ItemsCount::new(ROWS)).bench_local(|| {
        let mut all = PerAxis::default();
        for block in &blocks {
            calibration.wrench(black_box(&block.readings), &mut wrench);
            quality::merge(&mut all, &quality::errors(&wrench, &block.wrench));
        }
        all
    });
}
