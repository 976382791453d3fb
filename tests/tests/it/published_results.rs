//! The whole path from recordings to forces: the paper's 77,522 and 19,932 rows, cubic model.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use calibration::{Basis, FitOptions};
use log_file::{Log, Mapping, ReadOptions};
use shellcal::workflow::fit::fit;
use shellcal::workflow::noise::noise;
use shellcal::workflow::selection::RowFilter;
use simulation::sensor_model::{RecordingKind, RecordingSettings, SensorRecording};
use simulation::synthetic_log::SyntheticLayout;

fn log(directory: &Path, kind: RecordingKind, seed: u64, rows: usize) -> Log {
    let settings = RecordingSettings {
        kind,
        rate_hz: 100.0,
        start_time_s: 0.0,
        seed,
        unit_seed: 1,
        noise_scale: 1.0,
        adc_bits: 12,
        elastic: false,
    };
    let path = directory.join(format!("{seed}.csv"));
    let mut file = BufWriter::new(File::create(&path).unwrap());
    write!(file, "{}", SyntheticLayout::Shellcal.header(kind)).unwrap();
    for sample in SensorRecording::new(settings).unwrap().take(rows) {
        SyntheticLayout::Shellcal.write_row(&mut file, kind, &sample).unwrap();
    }
    file.flush().unwrap();
    Log::open(&path, &Mapping::default()).unwrap()
}

#[test]
fn at_the_papers_size_errors_and_noise_are_of_the_papers_order() {
    let directory = tempfile::tempdir().unwrap();
    let train = log(directory.path(), RecordingKind::Training, 1, 77_522);
    let test = log(directory.path(), RecordingKind::Test, 2, 19_932);
    let zero = log(directory.path(), RecordingKind::Zero, 3, 5_000);
    let options = FitOptions { model: Basis::Cubic.into(), ..FitOptions::default() };
    let fitted = fit(&[train], &[test], &options).unwrap();
    assert_eq!(fitted.rows, 77_522);

    // The paper's RMS errors are 0.118, 0.122 and 0.126 N. The simulated instrument resembles the
    // paper's, so a third in either direction is the same order.
    let quality = fitted.tests[0].quality().unwrap();
    for (error, paper) in quality.iter().zip([0.118, 0.122, 0.126]) {
        assert!((error.rms / paper - 1.0).abs() < 0.33, "{} N, in the paper {paper} N", error.rms);
    }

    // The paper's zero-load noise lies between 0.015 and 0.048 N.
    let scatter =
        noise(&zero, &fitted.calibration, RowFilter::Fresh, None, &ReadOptions::default()).unwrap();
    for (_, axis) in &scatter.axes[..3] {
        assert!((0.01..0.06).contains(&axis.rms), "{} N", axis.rms);
    }
}
