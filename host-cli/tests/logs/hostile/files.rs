//! Files of every kind that the program reads, and random damage to them.

use std::fs;
use std::path::Path;

use shell_data::wrench::{Axes, Axis};
use system_tests::program;
use system_tests::random::{Random, damage};

/// Valid files: logs, telemetry, a calibration, a partial fit, a matrix, a manifest, a table.
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

/// Labels of the still rows in `weights.csv`, 50 each.
pub(super) const LABELS: [&str; 4] = ["zero", "a", "b", "c"];

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
    let zero = fs::read_to_string(dir.join("zero.csv")).unwrap();
    let label = |(at, line): (usize, &str)| match at.checked_sub(1) {
        None => format!("{line},group\n"),
        Some(row) => format!("{line},{}\n", LABELS[row / 50]),
    };
    let weights: String = zero.lines().enumerate().map(label).collect();
    fs::write(dir.join("weights.csv"), weights).unwrap();
    fs::write(dir.join("loads.csv"), loads(&LABELS)).unwrap();
}

/// Returns a table of loads with these labels: none for labels that begin with `zero`, else 0.1 g.
pub(super) fn loads(labels: &[&str]) -> String {
    let header = "group,mass_g,x_mm,y_mm,z_mm,azimuth_deg,elevation_deg\n".to_owned();
    let line = |label: &&str| match label.starts_with("zero") {
        true => format!("{label},0,,,,,\n"),
        false => format!("{label},0.1,0,0,40,0,-90\n"),
    };
    header + &labels.iter().map(line).collect::<String>()
}

/// Binary logs of other programs; the first has nulls, lists and decimals.
const BINARY: [&str; 28] = [
    "table-file/tests/nested.parquet",
    "log-file/fuzz/seeds/parquet/delta.parquet",
    "log-file/fuzz/seeds/parquet/groups.parquet",
    "log-file/fuzz/seeds/parquet/pages_v2.parquet",
    "log-file/fuzz/seeds/parquet/polars_gzip.parquet",
    "log-file/fuzz/seeds/parquet/polars_lz4.parquet",
    "log-file/fuzz/seeds/parquet/polars_zstd.parquet",
    "log-file/fuzz/seeds/hdf5/chunked.h5",
    "log-file/fuzz/seeds/hdf5/fixed_array.h5",
    "log-file/fuzz/seeds/hdf5/growing.h5",
    "log-file/fuzz/seeds/hdf5/gzip_shuffle.h5",
    "log-file/fuzz/seeds/hdf5/matlab73.mat",
    "log-file/fuzz/seeds/hdf5/texts.h5",
    "log-file/fuzz/seeds/numpy/records.npy",
    "log-file/fuzz/seeds/numpy/by_column.npy",
    "log-file/fuzz/seeds/matlab/matrix_compressed.mat",
    "log-file/fuzz/seeds/matlab/vectors.mat",
    "log-file/fuzz/seeds/mcap/lz4.mcap",
    "log-file/fuzz/seeds/packed/plain.csv.gz",
    "log-file/fuzz/seeds/rosbag/bz2.bag",
    "log-file/fuzz/seeds/rosbag/lz4.bag",
    "log-file/fuzz/seeds/rosbag/none.bag",
    "log-file/fuzz/seeds/sqlite/bag.db3",
    "log-file/fuzz/seeds/ods/libreoffice.ods",
    "log-file/fuzz/seeds/tdms/cards.tdms",
    "log-file/fuzz/seeds/tdms/times.tdms",
    "log-file/fuzz/seeds/tdms/waveform.tdms",
    "log-file/fuzz/seeds/xlsx/workbook.xlsx",
];

pub(super) fn binary(random: &mut Random) -> Vec<u8> {
    let name = BINARY[random.below(BINARY.len() as u64) as usize];
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../crates").join(name);
    let mut bytes = fs::read(path).unwrap();
    if random.percent(40) {
        damage(&mut bytes, random);
    }
    bytes
}

/// Returns a log with some axes of the wrench, and these axes; the names of other axes are missing or misspelt.
pub(super) fn of_some_axes(seeds: &Path, name: &str, random: &mut Random) -> (String, Axes) {
    let text = fs::read_to_string(seeds.join(name)).unwrap();
    let axes: Axes = Axis::ALL.into_iter().filter(|_| random.percent(70)).collect();
    let absent = Axes::ALL.without(axes);
    let is_misspelt = random.percent(30);
    let header: Vec<&str> = text.lines().next().unwrap_or_default().split(',').collect();
    let is_absent = |name: &str| absent.iter().any(|axis| axis.column() == name);
    let line = |(at, line): (usize, &str)| {
        let fields = line.split(',').zip(&header);
        let fields = fields.filter(|(_, name)| is_misspelt || !is_absent(name)).map(
            |(field, name)| match at == 0 && is_absent(name) {
                true => format!("q{field}"),
                false => field.to_owned(),
            },
        );
        fields.collect::<Vec<_>>().join(",") + "\n"
    };
    (text.lines().enumerate().map(line).collect(), axes)
}

pub(super) fn damaged(seeds: &Path, name: &str, random: &mut Random) -> Vec<u8> {
    let mut bytes = fs::read(seeds.join(name)).unwrap();
    // Longer files take more time, but test nothing else.
    bytes.truncate(200_000);
    if random.percent(40) {
        return bytes;
    }
    for _ in 0..=random.below(4) {
        damage(&mut bytes, random);
    }
    bytes
}
