//! Every solver from readings to coefficients: what `shellcal bench` does, at four sizes, on one
//! thread, on rows of the sensor model. Prints tables in Markdown.

#![expect(clippy::print_stdout, reason = "a benchmark prints what it has measured")]

use calibration::Basis;
use calibration::solver::SolverKind;
use shellcal::workflow::bench::{self, ModelBench};
use simulation::synthetic_log::training_blocks;

/// The paper's size among them.
const SIZES: [usize; 4] = [1_000, 10_000, 77_522, 1_000_000];

fn main() {
    for rows in SIZES {
        let blocks = training_blocks(rows);
        println!("\n{rows} rows; time in ms, error of the worst coefficient; `*` on the front\n");
        let bases = [Basis::Cubic, Basis::Quadratic, Basis::Poly3];
        let benches: Vec<ModelBench> = bench::walk(&blocks, &bases, true, &SolverKind::ALL)
            .map(|(_, b)| b.expect("full rank"))
            .collect();
        print!("{}", bench::markdown(&benches));
    }
}
