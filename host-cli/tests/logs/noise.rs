//! The noise of logs whose scatter is known.

use std::path::{Path, PathBuf};

use calibration::scaling::Scaling;
use calibration::{Basis, Calibration, Model};
use log_file::{Log, Mapping, ReadOptions};
use shellcal::workflow::WorkflowError;
use shellcal::workflow::noise::{NoiseSummary, noise};
use shellcal::workflow::selection::{RowFilter, TimeWindow};

fn calibration(channels: usize) -> Calibration {
    let model = Model { basis: Basis::Linear, intercept: false, channels, memory: 0 };
    let rows = (0..channels).map(|c| std::array::from_fn(|axis| (axis + c) as f64 / 4.0));
    Calibration::new(model, Scaling::identity(channels), rows.collect())
}

/// Writes a log of two channels that alternate by one count, then a push; each frame is written twice.
fn log(directory: &Path) -> PathBuf {
    let mut text = String::from("t_s,s1,s2\n");
    for row in 0..400 {
        let up = f64::from(row / 2 % 2);
        let push = if row >= 300 { 100.0 } else { 0.0 };
        let time = f64::from(row) / 100.0;
        text += &format!("{time},{},{}\n", 10.0 + up + push, 20.0 + up + push);
    }
    let path = directory.join("log.csv");
    std::fs::write(&path, text).unwrap();
    path
}

fn run(
    path: &Path,
    rows: RowFilter,
    window: Option<TimeWindow>,
) -> Result<NoiseSummary, WorkflowError> {
    let log = Log::open(path, &Mapping::default()).unwrap().with_chunk_bytes(700);
    noise(&log, &calibration(2), rows, window, &ReadOptions::default())
}

#[test]
fn scatter_about_the_mean_of_fresh_frames_in_a_window() {
    let directory = tempfile::tempdir().unwrap();
    let window = Some(TimeWindow { start_s: 0.0, end_s: 2.99 });
    let summary = run(&log(directory.path()), RowFilter::Fresh, window).unwrap();
    assert_eq!((summary.rows, summary.repeated_rows, summary.frames), (400, 200, 150));
    // Half of the frames are one count higher, so mean and RMS are half a count, up to the rounding of 150 sums.
    for (channel, mean) in summary.channels.iter().zip([10.5, 20.5]) {
        assert!((channel.mean - mean).abs() < 1e-13 && (channel.rms - 0.5).abs() < 1e-13);
        assert_eq!(channel.peak_to_peak, 1.0);
    }
    for (axis, (_, found)) in summary.axes.iter().enumerate() {
        let slope = (2 * axis + 1) as f64 / 4.0;
        assert!((found.rms - 0.5 * slope).abs() < 1e-14);
        assert_eq!(found.peak_to_peak, slope);
    }
}

#[test]
fn a_window_without_frames_and_another_sensor_are_refused() {
    let directory = tempfile::tempdir().unwrap();
    let path = log(directory.path());
    let window = Some(TimeWindow { start_s: 10.0, end_s: 11.0 });
    let error = run(&path, RowFilter::All, window).unwrap_err();
    let expected = format!(
        "`{}` has `0` frames to tell the noise from, at least 2 are needed",
        path.display()
    );
    assert_eq!(error.to_string(), expected);
    let log = Log::open(&path, &Mapping::default()).unwrap();
    let read = ReadOptions::default();
    let error = noise(&log, &calibration(8), RowFilter::All, None, &read).unwrap_err();
    let expected = "has `2` sensor channels, expected `8`";
    assert!(error.to_string().ends_with(expected), "{error}");
}
