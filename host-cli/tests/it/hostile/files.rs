//! Files of every kind that the program reads, and what chance does to them.

use std::fs;
use std::path::Path;

use system_tests::program;
use system_tests::random::{Random, damage};

/// Good files: logs, telemetry, a calibration, a partial fit, a matrix, a manifest, a table.
pub(super) const SEEDS: [&str; 9] = [
    "train.csv",
    "test.csv",
    "zero.csv",
    "trials/3cm-1.txt",
    "trials/manifest.csv",
    "cal.json",
    "partial.json",
    "matrix.csv",
    "results/strides.csv",
];

/// Makes them in a folder.
pub(super) fn make(dir: &Path) {
    for arguments in [
        "synth train --rows 400 -o train.csv",
        "synth test --rows 200 -o test.csv",
        "synth zero --rows 200 -o zero.csv",
        "synth trials trials --per-condition 1",
        "fit train.csv --model cubic --covariance rows -o cal.json --export-matrix matrix.csv",
        "fit train.csv --model linear --partial partial.json",
        "batch trials/manifest.csv --calibration cal.json --csv results",
    ] {
        program::succeed(dir, arguments);
    }
}

/// Bytes of a good file, or what is left of them.
pub(super) fn damaged(seeds: &Path, name: &str, random: &mut Random) -> Vec<u8> {
    let mut bytes = fs::read(seeds.join(name)).unwrap();
    // Long files take long, and say no more.
    bytes.truncate(200_000);
    if random.percent(40) {
        return bytes;
    }
    for _ in 0..=random.below(4) {
        damage(&mut bytes, random);
    }
    bytes
}
