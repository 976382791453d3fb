//! Logs converted to wrenches, against direct evaluation of the same formulas.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use calibration::scaling::Scaling;
use calibration::uncertainty::{CoefficientCovariance, Covariance};
use calibration::{Basis, Calibration, Model};
use figures::WrenchTrace;
use forces::filter::{Butterworth, Filter, FilterError};
use forces::{ForceError, ForceOptions, LowPass, TareRule};
use log_file::{Log, Mapping, ReadOptions};
use shell_data::Converter;
use shell_data::wrench::{Axes, Axis};
use shellcal::workflow::WorkflowError;
use shellcal::workflow::convert::{
    Conversion, ConvertOptions, ConvertSummary, OutputPlan, TableColumns, convert,
};
use shellcal::workflow::selection::RowFilter;
use system_tests::real_recording;

/// Irregular coefficients, in N and N·m per count.
fn linear(channels: usize) -> Calibration {
    let model = Model { basis: Basis::Linear, intercept: false, channels, memory: 0 };
    let row = |channel: usize| {
        std::array::from_fn(|axis| ((channel * 6 + axis) as f64 * 0.7).sin() / 100.0)
    };
    let rows = (0..channels).map(row).collect();
    Calibration::new(model, Scaling::identity(channels), rows)
}

fn reading(frame: usize, channel: usize) -> f64 {
    (2000.0 + 900.0 * (frame as f64 * (0.003 + 0.001 * channel as f64)).sin()).round()
}

fn wrench(calibration: &Calibration, frame: usize) -> [f64; 6] {
    let rows = calibration.polynomial().unwrap().coefficients.iter().enumerate();
    rows.fold([0.0; 6], |sum, (channel, row)| {
        std::array::from_fn(|axis| sum[axis] + row[axis] * reading(frame, channel))
    })
}

/// Writes a log at 1 kHz with three channels; every frame is written `repeats` times.
fn csv(directory: &Path, frames: usize, repeats: usize) -> PathBuf {
    let mut text = String::from("t_s,s1,s2,s3\n");
    for row in 0..frames * repeats {
        let [a, b, c] = [0, 1, 2].map(|channel| reading(row / repeats, channel));
        writeln!(text, "{},{a},{b},{c}", row as f64 / 1000.0).unwrap();
    }
    let path = directory.join("log.csv");
    std::fs::write(&path, text).unwrap();
    path
}

const ALL: TableColumns = TableColumns {
    time: true,
    axes: Axes::ALL,
    standard_errors: false,
    interval: None,
    flags: true,
};

fn options() -> ConvertOptions {
    ConvertOptions {
        rows: RowFilter::All,
        forces: ForceOptions::RAW,
        load: None,
        frame: Vec::new(),
        columns: ALL,
        converter: None,
    }
}

fn low_pass(cutoff_hz: f64, zero_phase: bool) -> Option<LowPass> {
    Some(LowPass { cutoff_hz, order: 4, zero_phase })
}

fn tared(tare: TareRule) -> ForceOptions {
    ForceOptions { tare, ..ForceOptions::RAW }
}

fn filtered(low_pass: Option<LowPass>) -> ForceOptions {
    ForceOptions { low_pass, ..ForceOptions::RAW }
}

fn open(path: &Path) -> Log {
    Log::open(path, &Mapping::default()).unwrap()
}

fn run_on(
    log: &Log,
    calibration: &Calibration,
    options: &ConvertOptions,
) -> Result<(String, ConvertSummary), WorkflowError> {
    let mut out = Vec::new();
    let conversion = Conversion { log, calibration, options, read: ReadOptions::default() };
    let summary = convert(&conversion, &OutputPlan::default(), &mut out, None)?;
    Ok((String::from_utf8(out).unwrap(), summary))
}

fn run(path: &Path, options: &ConvertOptions) -> Result<(String, ConvertSummary), WorkflowError> {
    run_on(&open(path), &linear(3), options)
}

/// Returns the numbers row by row; empty cells are NaN.
fn numbers(text: &str) -> Vec<Vec<f64>> {
    let number = |field: &str| if field.is_empty() { f64::NAN } else { field.parse().unwrap() };
    text.lines().skip(1).map(|line| line.split(',').map(number).collect()).collect()
}

/// The largest term is 29 N; the relative rounding error of a sum of three is 1e-14.
const TOLERANCE: f64 = 1e-12;

#[test]
fn every_frame_gets_its_time_and_its_wrench() {
    let directory = tempfile::tempdir().unwrap();
    let (text, summary) = run(&csv(directory.path(), 500, 1), &options()).unwrap();
    assert!(text.starts_with("t_s,fx_n,fy_n,fz_n,mx_nm,my_nm,mz_nm,flags\n"));
    let rows = numbers(&text);
    assert_eq!((rows.len(), summary.frames, summary.rows), (500, 500, 500));
    for (frame, row) in rows.iter().enumerate() {
        assert_eq!(row[0], frame as f64 / 1000.0);
        for (found, expected) in row[1..7].iter().zip(wrench(&linear(3), frame)) {
            assert!((found - expected).abs() < TOLERANCE);
        }
    }
    let fx: Vec<f64> = rows.iter().map(|row| row[1]).collect();
    assert_eq!(summary.axes[0].1.max, fx.iter().copied().fold(f64::MIN, f64::max));
    assert_eq!(summary.axes[0].1.min, fx.iter().copied().fold(f64::MAX, f64::min));
}

#[test]
fn the_result_is_the_same_for_any_threads_and_blocks() {
    let directory = tempfile::tempdir().unwrap();
    let path = csv(directory.path(), 400, 3);
    for low_pass in [None, low_pass(20.0, false), low_pass(20.0, true)] {
        let options = ConvertOptions {
            rows: RowFilter::Fresh,
            forces: ForceOptions { low_pass, ..tared(TareRule::First(50)) },
            ..options()
        };
        let (whole, summary) = run(&path, &options).unwrap();
        assert_eq!((summary.rows, summary.repeated_rows, summary.frames), (1200, 800, 400));
        for (threads, bytes) in [(1, 100), (2, 1000), (3, 333)] {
            let log = open(&path).with_chunk_bytes(bytes);
            let read = ReadOptions { threads, ..ReadOptions::default() };
            let mut out = Vec::new();
            let calibration = linear(3);
            let conversion =
                Conversion { log: &log, calibration: &calibration, options: &options, read };
            convert(&conversion, &OutputPlan::default(), &mut out, None).unwrap();
            assert!(String::from_utf8(out).unwrap() == whole, "{threads} {bytes}");
        }
    }
}

#[test]
fn a_tare_subtracts_the_mean_of_its_window() {
    let directory = tempfile::tempdir().unwrap();
    let path = csv(directory.path(), 500, 1);
    let mean = |frames: std::ops::Range<usize>| {
        let count = frames.len() as f64;
        let sum = frames.fold([0.0; 6], |sum: [f64; 6], frame| {
            std::array::from_fn(|axis| sum[axis] + wrench(&linear(3), frame)[axis])
        });
        sum.map(|sum| sum / count)
    };
    let by_time = TareRule::Between(0.1, 0.199);
    for (tare, frames) in [(TareRule::First(50), 0..50), (by_time, 100..200)] {
        let (text, summary) =
            run(&path, &ConvertOptions { forces: tared(tare), ..options() }).unwrap();
        let result = summary.tare.unwrap();
        assert_eq!(result.frames, frames.len());
        assert_eq!(result.start_s, Some(frames.start as f64 / 1000.0));
        assert_eq!(result.end_s, Some((frames.end - 1) as f64 / 1000.0));
        let mean = mean(frames);
        for (frame, row) in numbers(&text).iter().enumerate() {
            for axis in 0..6 {
                let expected = wrench(&linear(3), frame)[axis] - mean[axis];
                assert!((row[1 + axis] - expected).abs() < TOLERANCE);
            }
        }
    }
}

#[test]
fn low_passes_equal_those_of_the_filter_module_at_the_rate_of_the_log() {
    let directory = tempfile::tempdir().unwrap();
    let path = csv(directory.path(), 500, 1);
    let unfiltered = numbers(&run(&path, &options()).unwrap().0);
    for zero_phase in [false, true] {
        let options = ConvertOptions { forces: filtered(low_pass(25.0, zero_phase)), ..options() };
        let (text, summary) = run(&path, &options).unwrap();
        let rate = summary.low_pass.unwrap().rate_hz;
        assert!((rate - 1000.0).abs() < 1e-6, "{rate}");
        let design = Butterworth::low_pass(4, 25.0, rate).unwrap();
        let found = numbers(&text);
        for axis in 1..7 {
            let mut column: Vec<f64> = unfiltered.iter().map(|row| row[axis]).collect();
            if zero_phase {
                design.zero_phase(&mut column).unwrap();
            } else {
                Filter::settled(&design, column[0]).process(&mut column);
            }
            assert!(found.iter().map(|row| row[axis]).eq(column));
        }
    }
}

#[test]
fn a_tared_causal_filter_starts_from_zero() {
    let directory = tempfile::tempdir().unwrap();
    let path = csv(directory.path(), 500, 1);
    let forces = ForceOptions { low_pass: low_pass(25.0, false), ..tared(TareRule::First(1)) };
    let options = ConvertOptions { forces, ..options() };
    let (text, _) = run(&path, &options).unwrap();
    // The first frame is the tare, so its wrench is zero.
    assert_eq!(numbers(&text)[0][1..7], [0.0; 6]);
}

#[test]
fn readings_that_cannot_be_trusted_are_flagged_and_counted() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("log.csv");
    std::fs::write(&path, "s1,s2,s3\n100,100,100\n100,4095,100\n300,100,0\n").unwrap();
    let mut calibration = linear(3);
    let range = calibration::reading_ranges::ReadingRange { min: 50.0, max: 200.0 };
    calibration.valid_range = Some(vec![range; 3]);
    let columns = TableColumns {
        time: false,
        axes: Axes::NONE,
        standard_errors: false,
        interval: None,
        flags: true,
    };
    let options = ConvertOptions { columns, converter: Some(Converter::new(4095.0)), ..options() };
    let (text, summary) = run_on(&open(&path), &calibration, &options).unwrap();
    assert_eq!(text, "flags\n\ns2:range s2:saturated\ns1:range s3:range s3:saturated\n");
    assert_eq!((summary.out_of_range_frames, summary.saturated_frames), (2, 2));
}

#[test]
fn standard_errors_equal_those_of_the_calibration() {
    let directory = tempfile::tempdir().unwrap();
    let path = csv(directory.path(), 100, 1);
    let mut calibration = linear(3);
    let residual = std::array::from_fn(|a| std::array::from_fn(|b| f64::from(a == b) * 0.25));
    calibration.covariance = Some(Covariance {
        residual,
        degrees_of_freedom: 10,
        coefficients: CoefficientCovariance::Groups {
            groups: 11,
            factors: std::array::from_fn(|_| {
                vec![vec![0.5e-4], vec![0.0, 1e-4], vec![0.0, 0.0, 1.5e-4]]
            }),
            degrees_of_freedom: None,
        },
        shape: None,
        shared: None,
        intervals: None,
    });
    let columns = TableColumns { standard_errors: true, interval: Some(0.95), ..ALL };
    let options = ConvertOptions { columns, ..options() };
    let (text, _) = run_on(&open(&path), &calibration, &options).unwrap();
    for (frame, row) in numbers(&text).iter().enumerate() {
        let part = |channel: usize, scale: f64| (scale * reading(frame, channel)).powi(2);
        let expected = 0.5 * (1.0 + part(0, 1e-4) + part(1, 2e-4) + part(2, 3e-4)).sqrt();
        assert!(row[7..13].iter().all(|found| (found - expected).abs() < 1e-14));
        for axis in 0..6 {
            // Student's t for ten degrees of freedom; tables give it to five decimals.
            let (value, half) = (row[1 + axis], 2.22814 * expected);
            assert!((row[13 + axis] - (value - half)).abs() < 1e-5, "lower");
            assert!((row[19 + axis] - (value + half)).abs() < 1e-5, "upper");
        }
    }
}

#[test]
fn the_trace_sees_every_frame() {
    let directory = tempfile::tempdir().unwrap();
    let path = csv(directory.path(), 300, 1);
    let axes = [Axis::Fz].into_iter().collect();
    let columns =
        TableColumns { time: false, axes, standard_errors: false, interval: None, flags: false };
    let options = ConvertOptions { columns, ..options() };
    let mut trace = WrenchTrace::default();
    let (log, calibration, read) = (open(&path), linear(3), ReadOptions::default());
    let conversion = Conversion { log: &log, calibration: &calibration, options: &options, read };
    convert(&conversion, &OutputPlan::default(), &mut Vec::new(), Some(&mut trace)).unwrap();
    let figure = figures::trace_figure(figures::Size::Screen, "log", &trace);
    assert!(figure.svg().contains(">Fz (N)<"));
}

#[test]
fn an_impossible_order_of_the_default_low_pass_is_refused() {
    let directory = tempfile::tempdir().unwrap();
    let path = csv(directory.path(), 200, 1);
    for order in [0, 17] {
        let low_pass = LowPass { order, ..LowPass::default() };
        let forces = ForceOptions { low_pass: Some(low_pass), ..ForceOptions::default() };
        let Err(error) = run(&path, &ConvertOptions { forces, ..options() }) else {
            panic!("order {order} was left out")
        };
        assert!(error.to_string().contains(&format!("filter order `{order}`")), "{error}");
    }
}

#[test]
fn impossible_conversions_are_refused_by_name() {
    let directory = tempfile::tempdir().unwrap();
    let path = csv(directory.path(), 30, 2);
    let error = |options: ConvertOptions| run(&path, &options).unwrap_err();
    let tare = |tare| error(ConvertOptions { forces: tared(tare), ..options() });
    assert!(matches!(
        tare(TareRule::First(61)),
        WorkflowError::Forces { error: ForceError::TareFrames { wanted: 61, found: 60 }, .. }
    ));
    let message = tare(TareRule::Between(1.0, 2.0)).to_string();
    assert!(
        message.ends_with(
            "no frame between `1` and `2` s to tare on: frames run from `0` to `0.059` s"
        ),
        "{message}"
    );
    let filter = |low_pass| error(ConvertOptions { forces: filtered(low_pass), ..options() });
    assert!(matches!(
        filter(low_pass(500.1, false)),
        WorkflowError::Forces { error: ForceError::Filter(FilterError::Cutoff { .. }), .. }
    ));
    let errors = TableColumns { standard_errors: true, ..ALL };
    let no_covariance = error(ConvertOptions { columns: errors, ..options() });
    assert!(matches!(no_covariance, WorkflowError::NoCovariance));
    let other = run_on(&open(&path), &linear(8), &options()).unwrap_err();
    let expected = format!("`{}` has `3` sensor channels, expected `8`", path.display());
    assert_eq!(other.to_string(), expected);

    let short = csv(directory.path(), 15, 1);
    let forces = filtered(low_pass(20.0, true));
    let options = || ConvertOptions { forces, ..options() };
    let error = run(&short, &options()).unwrap_err();
    let too_few = FilterError::TooFewSamples { samples: 15, needed: 16 };
    let too_few = ForceError::Filter(too_few);
    assert!(matches!(error, WorkflowError::Forces { error, .. } if error == too_few));

    std::fs::write(&short, "s1,s2,s3\n1,2,3\n4,5,6\n").unwrap();
    let error =
        run(&short, &ConvertOptions { columns: TableColumns { time: false, ..ALL }, ..options() });
    let error = error.unwrap_err();
    assert!(matches!(error, WorkflowError::Forces { error: ForceError::NoRate { .. }, .. }));
    std::fs::write(&short, "t_s,s1,s2,s3\n0,4e9,4e9,4e9\n").unwrap();
    let error = run_on(&open(&short), &calibration_that_overflows(), &self::options());
    let expected = format!("`{}`: the wrench of frame `1` is not finite", short.display());
    assert_eq!(error.unwrap_err().to_string(), expected);
}

fn calibration_that_overflows() -> Calibration {
    let model = Model { basis: Basis::Linear, intercept: false, channels: 3, memory: 0 };
    Calibration::new(model, Scaling::identity(3), vec![[1e300; 6]; 3])
}

const TRIAL: &str =
    "skinproc/velociroach_s=10cm_w=5.5cm_h=27cm_layer=3_ply=6_f=13Hz_beetleshell_run3.txt";

/// Reads a matrix of 24 features (s1, s1², s1³, s2, …) by six axes, in N and mN·m.
fn lab_matrix(path: &Path) -> Vec<[f64; 6]> {
    let text = std::fs::read_to_string(path).unwrap();
    let row = |line: &str| -> [f64; 6] {
        let values: Vec<f64> = line.split(',').skip(1).map(|f| f.parse().unwrap()).collect();
        values.try_into().unwrap()
    };
    text.lines().skip(1).map(row).collect()
}

/// Reads the time in µs and eight readings from each row.
fn lab_trial(path: &Path) -> Vec<(f64, [f64; 8])> {
    let text = std::fs::read_to_string(path).unwrap();
    let row = |line: &str| {
        let values: Vec<f64> = line.split(',').map(|field| field.parse().unwrap()).collect();
        (values[0], values[16..24].try_into().unwrap())
    };
    text.lines().filter(|line| !line.starts_with('%')).map(row).collect()
}

#[test]
#[cfg_attr(not(real_data), ignore = "SHELLCAL_REAL_DATA does not name the recordings")]
fn the_labs_trial_is_converted_as_by_direct_evaluation() {
    let (matrix, trial) = (real_recording("skinproc/N_matrix_trial9.csv"), real_recording(TRIAL));
    let (matrix, log) = (lab_matrix(&matrix), lab_trial(&trial));
    // The reference sums feature by feature, in the lab's order and units, without the library.
    let direct = |readings: &[f64; 8], axis: usize| -> (f64, f64) {
        let unit = if axis < 3 { 1.0 } else { 1e-3 };
        let mut sum = 0.0;
        let mut largest = 0.0f64;
        for (feature, row) in matrix.iter().enumerate() {
            let term = readings[feature / 3].powi(feature as i32 % 3 + 1) * row[axis] * unit;
            sum += term;
            largest = largest.max(term.abs());
        }
        (sum, largest)
    };

    let model = Model { basis: Basis::Cubic, intercept: false, channels: 8, memory: 0 };
    let si = |row: &[f64; 6]| std::array::from_fn(|i| row[i] * if i < 3 { 1.0 } else { 1e-3 });
    let rows = matrix.iter().map(si).collect();
    let calibration = Calibration::new(model, Scaling::identity(8), rows);
    // The tare uses fresh frames only, even if all rows are written.
    let is_fresh = |&i: &usize| i == 0 || log[i].1 != log[i - 1].1;
    let fresh: Vec<&(f64, [f64; 8])> = (0..log.len()).filter(is_fresh).map(|i| &log[i]).collect();
    for rows in [RowFilter::All, RowFilter::Fresh] {
        let used: Vec<&(f64, [f64; 8])> = match rows {
            RowFilter::All => log.iter().collect(),
            RowFilter::Fresh => fresh.clone(),
        };
        let options = ConvertOptions { rows, forces: tared(TareRule::First(50)), ..options() };
        let (text, summary) = run_on(&open(&trial), &calibration, &options).unwrap();
        let found = numbers(&text);
        assert_eq!(found.len(), used.len());
        assert_eq!((summary.rows, summary.frames), (9689, used.len() as u64));
        for axis in 0..6 {
            let tare = fresh[..50].iter().map(|row| direct(&row.1, axis).0).sum::<f64>() / 50.0;
            for (found, (time_us, readings)) in found.iter().zip(&used) {
                assert_eq!(found[0], time_us / 1e6);
                let (sum, largest) = direct(readings, axis);
                let error = (found[1 + axis] - (sum - tare)).abs();
                assert!(error <= 1e-12 * largest, "{axis}: {error} of {largest}");
            }
        }
    }
}

/// A training log is loaded from its first frame on, so a tare would take a load as zero.
#[test]
fn a_tare_under_load_is_reported_or_refused() {
    let dir = tempfile::tempdir().unwrap();
    let data =
        |name: &str| Path::new(env!("CARGO_MANIFEST_DIR")).join("../calibration-data").join(name);
    let (train, zero) = (data("synthetic-train.csv"), data("synthetic-zero.csv"));
    let (train, zero) = (train.display(), zero.display());
    let run = |arguments: &str| system_tests::program::output(dir.path(), arguments);
    let warned = |arguments: &str| {
        let output = run(arguments);
        assert!(output.status.success(), "{output:?}");
        String::from_utf8_lossy(&output.stderr).contains("the frames of the tare are loaded")
    };
    assert!(run(&format!("fit {train} --model cubic -o cal.json")).status.success());
    assert!(warned(&format!("convert cal.json {train} -o loaded.csv")));
    assert!(!warned(&format!("convert cal.json {zero} -o zero.csv")));
    assert!(!warned(&format!("convert cal.json {train} --no-tare -o untared.csv")));
    let strict = run(&format!("convert cal.json {train} --strict -o strict.csv"));
    assert_eq!(strict.status.code(), Some(2));
    assert!(!dir.path().join("strict.csv").exists());
    assert!(run(&format!("convert cal.json {zero} --strict -o strict.csv")).status.success());
}
