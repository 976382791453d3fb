//! A trial of the real robot against the formulas written out plainly, and the published tables.

use std::f64::consts::{PI, TAU};
use std::fs;
use std::path::Path;

use calibration_file::CalibrationFile;
use calibration_file::matrix::ImportOptions;
use forces::{ForceOptions, LowPass, RowRule, TareRule};
use log_file::{Log, Mapping, ReadOptions};
use shellcal::workflow::trial::{TrialJob, evaluate_log};
use system_tests::real_recording;
use trial::{Instrument, Profile, TraceExtent, Trial, TrialOptions, TrialResult, ValueTable};

const TRIAL: &str =
    "skinproc/velociroach_s=10cm_w=5.5cm_h=27cm_layer=3_ply=6_f=13Hz_beetleshell_run3.txt";
const MATRIX: &str = "skinproc/N_matrix_trial9.csv";
/// Times of entering and leaving, s. Both are between rows.
const WINDOW: (f64, f64) = (3.0004, 7.5007);

/// Log and matrix, read by independent code.
struct Plain {
    rows: Vec<Vec<f64>>,
    matrix: Vec<Vec<f64>>,
}

impl Plain {
    fn read(log: &Path, matrix: &Path) -> Self {
        let numbers = |line: &str| line.split(',').map(|f| f.trim().parse().unwrap()).collect();
        let log = fs::read_to_string(log).unwrap();
        let rows = log.lines().filter(|l| !l.starts_with('%') && !l.trim().is_empty());
        let matrix = fs::read_to_string(matrix).unwrap();
        let matrix = matrix.lines().skip(1).map(|l| numbers(l.split_once(',').unwrap().1));
        Self { rows: rows.map(numbers).collect(), matrix: matrix.collect() }
    }

    fn time(&self) -> Vec<f64> {
        self.rows.iter().map(|row| row[0] / 1e6).collect()
    }

    /// One axis of the wrench of every row, untared: N.
    fn axis(&self, axis: usize) -> Vec<f64> {
        let of_row = |row: &Vec<f64>| {
            let powers = row[16..24].iter().flat_map(|s| [*s, s * s, s * s * s]);
            powers.zip(&self.matrix).map(|(x, c)| x * c[axis]).sum()
        };
        self.rows.iter().map(of_row).collect()
    }

    fn is_fresh(&self, row: usize) -> bool {
        row == 0 || self.rows[row][16..24] != self.rows[row - 1][16..24]
    }

    fn power(&self) -> Vec<f64> {
        let of_row = |row: &Vec<f64>| {
            let battery = row[15] * 3.3 / 1023.0 * 3.7 / 2.7;
            let side = |duty: f64, emf: f64| {
                let emf = emf * 3.3 / 1024.0 * 47.0 / 15.0;
                (duty / 4096.0 * battery * (battery - emf) / 3.3).abs()
            };
            side(row[5], row[13]) + side(row[6], row[14])
        };
        self.rows.iter().map(of_row).collect()
    }
}

/// The sections of a 4th-order Butterworth low-pass, `[b0, b1, b2, a1, a2]`: bilinear transform of
/// `1/(s² + s/Q + 1)`, Q = 1/(2·sin(π/8)) and 1/(2·sin(3π/8)).
fn sections(cutoff_hz: f64, rate_hz: f64) -> [[f64; 5]; 2] {
    let k = (PI * cutoff_hz / rate_hz).tan();
    [1.0, 3.0].map(|i| {
        let q = 1.0 / (2.0 * (i * PI / 8.0).sin());
        let norm = 1.0 / (1.0 + k / q + k * k);
        let b0 = k * k * norm;
        [b0, 2.0 * b0, b0, 2.0 * (k * k - 1.0) * norm, (1.0 - k / q + k * k) * norm]
    })
}

/// Direct form I; `start` is the constant input and output before the signal.
fn filter(signal: &[f64], sections: &[[f64; 5]], start: f64) -> Vec<f64> {
    let mut signal = signal.to_vec();
    for [b0, b1, b2, a1, a2] in sections {
        let (mut x1, mut x2, mut y1, mut y2) = (start, start, start, start);
        for value in &mut signal {
            let x = *value;
            let y = b0 * x + b1 * x1 + b2 * x2 - a1 * y1 - a2 * y2;
            (x2, x1, y2, y1) = (x1, x, y1, y);
            *value = y;
        }
    }
    signal
}

/// Forward and backward, the ends continued by reflection: `scipy.signal.sosfiltfilt`.
fn filter_both_ways(signal: &[f64], sections: &[[f64; 5]]) -> Vec<f64> {
    let (n, reach) = (signal.len(), 15);
    let before = (1..=reach).rev().map(|i| 2.0 * signal[0] - signal[i]);
    let after = (1..=reach).map(|i| 2.0 * signal[n - 1] - signal[n - 1 - i]);
    let long: Vec<f64> = before.chain(signal.iter().copied()).chain(after).collect();
    let mut once = filter(&long, sections, long[0]);
    once.reverse();
    let mut twice = filter(&once, sections, once[0]);
    twice.reverse();
    twice[reach..reach + n].to_vec()
}

fn evaluate(log: &Path, calibration: &Path, options: &TrialOptions) -> TrialResult {
    let calibration =
        CalibrationFile::import(calibration, &ImportOptions::default()).unwrap().0.calibration;
    let log = Log::open(log, &Mapping::default()).unwrap();
    let profile = Profile::velociroach();
    let instrument = Instrument { profile: &profile, calibration: Some(&calibration) };
    let trial = Trial {
        file: "run3".to_owned(),
        condition: "3 cm".to_owned(),
        t_enter_s: WINDOW.0,
        t_exit_s: WINDOW.1,
        velocity_m_s: None,
        mass_kg: None,
        channel_length_m: None,
        notes: None,
    };
    let job = TrialJob { log: &log, instrument, options: *options, read: ReadOptions::default() };
    evaluate_log(&job, &trial).unwrap().result
}

fn assert_near(found: Option<f64>, expected: f64, what: &str) {
    let found = found.unwrap();
    // Nine digits: the cubic terms reach some 10 N before they cancel, with other rounding.
    assert!(
        (found - expected).abs() < 1e-9 * expected.abs().max(1.0),
        "{what}: {found} {expected}"
    );
}

#[test]
#[cfg_attr(not(real_data), ignore = "SHELLCAL_REAL_DATA does not name the recordings")]
fn by_row_results_equal_those_of_the_lab_s_formulas() {
    let (log, matrix) = (real_recording(TRIAL), real_recording(MATRIX));
    let plain = Plain::read(&log, &matrix);
    let forces = ForceOptions {
        low_pass: Some(LowPass { cutoff_hz: 10.0, order: 4, zero_phase: false }),
        rate_hz: Some(1000.0),
        rule: RowRule::Rows,
        ..ForceOptions::default()
    };
    let options = TrialOptions { forces, trace: TraceExtent::Log, ..TrialOptions::default() };
    let result = evaluate(&log, &matrix, &options);
    let trace = result.trace.as_ref().unwrap();
    let (time, power) = (plain.time(), plain.power());
    let inside: Vec<usize> =
        (0..time.len()).filter(|&i| WINDOW.0 <= time[i] && time[i] <= WINDOW.1).collect();
    let mean =
        |signal: &[f64]| inside.iter().map(|&i| signal[i]).sum::<f64>() / inside.len() as f64;
    for axis in 0..6 {
        let untared = plain.axis(axis);
        let tare = untared[..50].iter().sum::<f64>() / 50.0;
        let tared: Vec<f64> = untared.iter().map(|force| force - tare).collect();
        let expected = filter(&tared, &sections(10.0, 1000.0), 0.0);
        // The matrix gives moments in mN·m.
        let unit = if axis < 3 { 1.0 } else { 1e-3 };
        for (found, expected) in trace.wrench[axis].iter().zip(&expected) {
            assert_near(Some(*found), unit * expected, "wrench");
        }
        match axis {
            0 => {
                assert_near(result.row.measures.drag_mean_n, -mean(&expected), "drag");
                assert_near(
                    result.row.measures.drag_energy_j,
                    0.28 * mean(&expected),
                    "drag energy",
                );
            }
            2 => assert_near(result.row.measures.lift_mean_n, mean(&expected), "lift"),
            _ => {}
        }
    }
    let energy: f64 = inside[1..].iter().map(|&i| power[i] * (time[i] - time[i - 1])).sum();
    assert_near(result.row.measures.electrical_energy_j, energy, "electrical energy");
    let duration = WINDOW.1 - WINDOW.0;
    let resistance = energy / duration / (0.087 * 9.81 * 0.28 / duration);
    assert_near(result.row.measures.specific_resistance, resistance, "specific resistance");
    assert_eq!(result.row.rows, inside.len() as u64);
}

#[test]
#[cfg_attr(not(real_data), ignore = "SHELLCAL_REAL_DATA does not name the recordings")]
fn by_time_results_equal_those_of_the_formulas_over_time() {
    let (log, matrix) = (real_recording(TRIAL), real_recording(MATRIX));
    let plain = Plain::read(&log, &matrix);
    let forces = ForceOptions { rate_hz: Some(999.0), ..ForceOptions::default() };
    let options = TrialOptions { forces, ..TrialOptions::default() };
    let result = evaluate(&log, &matrix, &options);
    let (time, power) = (plain.time(), plain.power());
    let slot = |i: usize| ((time[i] - time[0]) * 999.0).round() as usize;
    let fresh: Vec<usize> = (0..time.len()).filter(|&i| plain.is_fresh(i)).take(50).collect();
    // ∫ between the window's ends over straight lines from row to row.
    let integral = |signal: &[f64]| {
        let at = |t: f64, i: usize| {
            signal[i] + (signal[i + 1] - signal[i]) * (t - time[i]) / (time[i + 1] - time[i])
        };
        (0..time.len() - 1)
            .map(|i| (i, time[i].max(WINDOW.0), time[i + 1].min(WINDOW.1)))
            .filter(|(_, from, to)| to > from)
            .map(|(i, from, to)| 0.5 * (to - from) * (at(from, i) + at(to, i)))
            .sum::<f64>()
    };
    let duration = WINDOW.1 - WINDOW.0;
    let force = |axis: usize| {
        let untared = plain.axis(axis);
        let tare = fresh.iter().map(|&i| untared[i]).sum::<f64>() / 50.0;
        // Each slot of the grid shows the last row not after it.
        let mut even = Vec::new();
        for (i, force) in untared.iter().enumerate() {
            let until = if i + 1 < time.len() { slot(i + 1) } else { slot(i) + 1 };
            even.truncate(slot(i));
            even.resize(until.max(slot(i) + 1), force - tare);
        }
        let filtered = filter_both_ways(&even, &sections(10.0, 999.0));
        (0..time.len()).map(|i| filtered[slot(i)]).collect::<Vec<_>>()
    };
    let (fx, fz) = (integral(&force(0)) / duration, integral(&force(2)) / duration);
    assert_near(result.row.measures.drag_mean_n, -fx, "drag");
    assert_near(result.row.measures.lift_mean_n, fz, "lift");
    assert_near(result.row.measures.drag_energy_j, 0.28 * fx, "drag energy");
    assert_near(result.row.measures.electrical_energy_j, integral(&power), "electrical energy");

    let repeats = result.diagnostics.iter().find(|diagnostic| diagnostic.code == "repeated_rows");
    let inside = (0..time.len()).filter(|&i| WINDOW.0 <= time[i] && time[i] <= WINDOW.1);
    let (rows, repeated) = inside
        .fold((0, 0), |(rows, repeated), i| (rows + 1, repeated + u64::from(!plain.is_fresh(i))));
    let text = format!("{repeated} of {rows} rows are duplicates of the previous frame");
    assert_eq!(repeats.map(|diagnostic| &diagnostic.text), Some(&text));
}

#[test]
#[cfg_attr(not(real_data), ignore = "SHELLCAL_REAL_DATA does not name the recordings")]
fn strides_are_found_at_the_commanded_thirteen_hertz() {
    let (log, matrix) = (real_recording(TRIAL), real_recording(MATRIX));
    let result = evaluate(&log, &matrix, &TrialOptions::default());
    let plain = Plain::read(&log, &matrix);
    // Turns of 2π in the window, from the counts alone.
    let turns: Vec<f64> = (plain.rows.iter().zip(plain.time()))
        .filter(|(_, time)| WINDOW.0 <= *time && *time <= WINDOW.1)
        .map(|(row, _)| row[1] * 95.8738e-6 / TAU)
        .collect();
    let whole = turns[turns.len() - 1].floor() - turns[0].ceil();
    assert_eq!(result.row.strides, Some(whole as u64));
    // The commanded 13 Hz are 13.145 turns in a second of the log's clock, by the column of
    // commanded positions; the leg lags behind by less than a quarter of a turn.
    let commanded: Vec<(f64, f64)> = (plain.rows.iter().zip(plain.time()))
        .filter(|(_, time)| WINDOW.0 <= *time && *time <= WINDOW.1)
        .map(|(row, time)| (time, row[3] * 95.8738e-6 / TAU))
        .collect();
    let (first, last) = (commanded[0], commanded[commanded.len() - 1]);
    let commanded = (last.1 - first.1) / (last.0 - first.0);
    assert!((commanded - 13.0).abs() < 0.15, "{commanded}");
    let frequency = result.row.stride_frequency_hz.unwrap();
    assert!((frequency - commanded).abs() < 0.25 / 4.5, "{frequency} {commanded}");
    for stride in &result.stride_rows {
        // No stride is lost or split; under load the leg is late by up to a quarter of one.
        assert!((stride.period_s - 1.0 / 13.0).abs() < 0.3 / 13.0, "{stride:?}");
    }
    // The part computed for the window alone equals that of the whole log.
    let whole_log = TrialOptions { trace: TraceExtent::Log, ..TrialOptions::default() };
    let whole_log = evaluate(&log, &matrix, &whole_log);
    let (a, b) =
        (result.row.measures.drag_mean_n.unwrap(), whole_log.row.measures.drag_mean_n.unwrap());
    // The filter's memory beyond the computed part is 1e-12 of the signal's range, some newtons.
    assert!((a - b).abs() < 1e-11, "{a} {b}");
}

#[test]
#[cfg_attr(not(real_data), ignore = "SHELLCAL_REAL_DATA does not name the recordings")]
fn a_tare_with_motion_warns_and_one_without_does_not() {
    let (log, matrix) = (real_recording(TRIAL), real_recording(MATRIX));
    let moving = |result: &TrialResult| {
        result.diagnostics.iter().any(|diagnostic| diagnostic.code == "moving_tare")
    };
    assert!(moving(&evaluate(&log, &matrix, &TrialOptions::default())), "the legs start at 0.1 s");
    let forces = ForceOptions { tare: TareRule::Between(0.0, 0.05), ..ForceOptions::default() };
    let quiet = TrialOptions { forces, ..TrialOptions::default() };
    assert!(!moving(&evaluate(&log, &matrix, &quiet)));
}

type Mean = (&'static str, f64, f64);

/// `numpy.mean`, `numpy.percentile` and `matplotlib.cbook.boxplot_stats` of the published tables by
/// definition: sort, and interpolate at rank (n − 1)·p.
#[test]
#[cfg_attr(not(real_data), ignore = "SHELLCAL_REAL_DATA does not name the recordings")]
fn published_tables_have_the_paper_s_means_and_their_box_plots() {
    let means: [(&str, &[Mean]); 2] = [
        (
            "published/specific_resistance_per_stride.csv",
            &[
                ("free", 45.2, 0.06),
                ("0", 48.0, 0.05),
                ("1", 41.1, 0.05),
                ("2", 42.9, 0.05),
                ("3", 49.5, 0.05),
            ],
        ),
        (
            "published/drag_energy_per_stride.csv",
            &[("3", -9.12, 0.005), ("2", -3.24, 0.005), ("1", -1.90, 0.005), ("0", -0.52, 0.005)],
        ),
    ];
    // Half a unit of the last digit; the published strides of `free` have 45.146.
    for (name, means) in means {
        let path = real_recording(name);
        let text = fs::read_to_string(path).unwrap();
        let rows = ValueTable::parse(&text, None, None, None).unwrap().statistics(Some("0"), 1);
        assert_eq!(rows.len(), means.len());
        for (condition, mean, half_a_digit) in means {
            let found = rows.iter().find(|row| row.condition == *condition).unwrap();
            let s = &found.statistics;
            assert!((s.mean - mean).abs() <= *half_a_digit, "{condition}: {}", s.mean);
            let mut values: Vec<f64> = text
                .lines()
                .skip(1)
                .filter_map(|line| line.split_once(','))
                .filter(|(name, _)| name == condition)
                .map(|(_, value)| value.parse().unwrap())
                .collect();
            values.sort_by(f64::total_cmp);
            let n = values.len();
            let at = |p: f64| {
                let rank = (n - 1) as f64 * p;
                let (below, share) = (values[rank.floor() as usize], rank.fract());
                (1.0 - share) * below + share * values[rank.ceil() as usize]
            };
            let reach = 1.5 * (at(0.75) - at(0.25));
            let low = values.iter().find(|&&x| x >= at(0.25) - reach).unwrap();
            let high = values.iter().rev().find(|&&x| x <= at(0.75) + reach).unwrap();
            let average = values.iter().sum::<f64>() / n as f64;
            let variance =
                values.iter().map(|x| (x - average).powi(2)).sum::<f64>() / (n - 1) as f64;
            let expected = [
                (s.mean, average),
                (s.sd.unwrap(), variance.sqrt()),
                (s.q1, at(0.25)),
                (s.median, at(0.5)),
                (s.q3, at(0.75)),
                (s.whisker_low, low.min(at(0.25))),
                (s.whisker_high, high.max(at(0.75))),
            ];
            for (found, expected) in expected {
                // A few roundings of values up to 60.
                assert!((found - expected).abs() < 1e-12 * expected.abs().max(1.0), "{condition}");
            }
            assert_eq!(s.n, n);
            let interval = s.mean_95.unwrap();
            assert!(interval.low < s.mean && s.mean < interval.high);
        }
    }
}
