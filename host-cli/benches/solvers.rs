//! Times every solver from readings to coefficients, at four sizes, on one thread, on rows of the sensor
//! model. Writes the tables of `docs/accuracy.md`.

use std::fs;
use std::path::Path;

use calibration::Basis;
use calibration::solver::SolverKind;
use shellcal::workflow::bench::{self, ModelBench};
use simulation::synthetic_log::training_blocks;

/// Includes the paper's size.
const SIZES: [(usize, &str); 4] =
    [(1_000, "1,000"), (10_000, "10,000"), (77_522, "77,522"), (1_000_000, "1,000,000")];

const MARKS: [&str; 2] = ["<!-- tables of the bench -->\n", "<!-- end of the tables -->"];

fn main() {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/accuracy.md");
    let text = fs::read_to_string(&page).expect("the page of the tables");
    let [start, end] = MARKS.map(|mark| text.find(mark).expect("the page has its marks"));
    let mut tables = String::new();
    for (rows, shown) in SIZES {
        let blocks = training_blocks(rows);
        let bases = [Basis::Cubic, Basis::Quadratic, Basis::Poly3];
        let benches: Vec<ModelBench> = bench::walk(&blocks, &bases, true, &SolverKind::ALL)
            .map(|(_, b)| b.expect("full rank"))
            .collect();
        tables += &format!("\n{shown} rows:\n\n{}", bench::markdown(&benches));
    }
    let (before, after) = (&text[..start + MARKS[0].len()], &text[end..]);
    fs::write(&page, format!("{before}{tables}\n{after}")).expect("the page can be written");
}
