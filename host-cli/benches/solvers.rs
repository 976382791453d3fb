//! Every solver from readings to coefficients, by the code of `shellcal bench`, on one thread.

use std::fmt;
use std::sync::OnceLock;

use divan::counter::ItemsCount;
use divan::{Bencher, black_box};
use shellcal::block::Block;
use shellcal::calibration::solver::SolverKind;
use shellcal::calibration::{Basis, Model};
use shellcal::sensor_model::{Kind, Recording, Settings};
use shellcal::synthetic_block;
use shellcal::workflow::bench;

fn main() {
    divan::main();
}

/// The paper's size among them.
const SIZES: [usize; 4] = [1_000, 10_000, 77_522, 1_000_000];

struct Case {
    basis: Basis,
    kind: SolverKind,
}

impl fmt::Display for Case {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", self.basis.name(), self.kind.name())
    }
}

fn cases() -> impl Iterator<Item = Case> {
    let of_basis = |basis| SolverKind::ALL.map(|kind| Case { basis, kind });
    [Basis::Cubic, Basis::Quadratic, Basis::Poly3].into_iter().flat_map(of_basis)
}

fn rows(count: usize) -> Vec<Block> {
    static ALL: OnceLock<Vec<Block>> = OnceLock::new();
    let all = ALL.get_or_init(|| {
        let recording = Recording::new(Settings {
            kind: Kind::Training,
            rate_hz: 100.0,
            start_time_s: 0.0,
            seed: 1,
            unit_seed: 1,
            noise_scale: 1.0,
            adc_bits: 12,
        });
        synthetic_block::blocks(recording.expect("valid settings"), SIZES[3])
    });
    let mut left = count;
    let take = |block: &Block| {
        let rows = left.min(block.rows);
        left -= rows;
        let mut block = block.clone();
        block.retain_rows(&(0..block.rows).map(|row| row < rows).collect::<Vec<_>>());
        block
    };
    all.iter().map(take).take_while(|block| block.rows > 0).collect()
}

#[divan::bench(args = cases(), consts = SIZES, sample_count = 5, max_time = 2)]
fn solve<const ROWS: usize>(bencher: Bencher, case: &Case) {
    let blocks = rows(ROWS);
    let model = Model { basis: case.basis, intercept: true, channels: 8 };
    let problem = bench::problem(&blocks, model).expect("full rank");
    bencher
        .counter(ItemsCount::new(ROWS))
        .bench(|| bench::solve(black_box(&blocks), case.kind, &problem).map(drop));
}
