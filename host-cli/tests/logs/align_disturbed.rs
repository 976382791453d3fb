//! Recordings with real-world defects, and pairs that do not belong together.
use alignment::{AlignError, Options, Recording, RecordingSide, align};
use simulation::sensor_model::PairSettings;
use system_tests::random::Random;

use crate::alignment::{SESSION, errors, linear_session, recordings};

/// Checks offset and skew of a disturbed session against the truth, within their standard errors.
fn check(reference: Recording, board: Recording, truth: &PairSettings) {
    let aligned = align(reference, board, Options::default()).unwrap();
    let (offset_s, skew) = errors(&aligned.clock, truth);
    let clock = aligned.clock;
    // The tolerance is four standard errors, but at most the limit for an undisturbed session.
    assert!(offset_s.abs() < (4.0 * clock.offset_se_s).min(200e-6), "{offset_s} {clock:?}");
    assert!(skew.abs() < 4.0 * clock.skew_se && skew.abs() < 5e-6, "{skew} {clock:?}");
}

fn keep_rows(recording: &mut Recording, mut keep: impl FnMut(usize, f64) -> bool) {
    let flags: Vec<bool> =
        recording.time_s.iter().enumerate().map(|(row, &time_s)| keep(row, time_s)).collect();
    for column in recording.columns.iter_mut().chain([&mut recording.time_s]) {
        let mut flags = flags.iter();
        column.retain(|_| *flags.next().unwrap());
    }
}

#[test]
fn lost_frames_do_not_bias() {
    let truth = PairSettings { loss: 0.3, ..SESSION };
    let (reference, board) = recordings(truth);
    check(reference, board, &truth);
}

#[test]
fn gaps_on_both_sides_do_not_bias() {
    let (mut reference, mut board) = recordings(SESSION);
    let start_s = reference.time_s[0];
    keep_rows(&mut board, |_, t| !(20.0..24.0).contains(&t));
    keep_rows(&mut reference, |_, t| !(40.0..43.0).contains(&(t - start_s)));
    check(reference, board, &SESSION);
}

#[test]
fn an_uneven_clock_does_not_bias() {
    let (mut reference, board) = recordings(PairSettings { seed: 2, ..SESSION });
    let mut random = Random(5);
    // One in ten rows of the reference is lost, at random.
    keep_rows(&mut reference, |_, _| random.unit() > 0.1);
    let mut board = board;
    keep_rows(&mut board, |row, _| row % 7 != 3 && row % 11 != 5);
    check(reference, board, &PairSettings { seed: 2, ..SESSION });
}

#[test]
fn repeated_rows_do_not_bias() {
    // A logger at 1 kHz writes each frame ten times; only the first row is new.
    let (reference, fresh) = recordings(SESSION);
    let mut board = Recording { time_s: vec![], columns: vec![vec![]; 8] };
    for row in 0..fresh.time_s.len() {
        for repeat in 0..10 {
            board.time_s.push(fresh.time_s[row] + 1e-3 * f64::from(repeat));
            for (column, fresh) in board.columns.iter_mut().zip(&fresh.columns) {
                column.push(fresh[row]);
            }
        }
    }
    let rows = board.time_s.len();
    let options = Options { repeats_are_stale: true, ..Options::default() };
    let aligned = align(reference.clone(), board.clone(), options).unwrap();
    assert_eq!(aligned.board_left_out.repeated, rows / 10 * 9);
    let (offset_s, _) = errors(&aligned.clock, &SESSION);
    assert!(offset_s.abs() < 200e-6, "{offset_s}");
    // Without the option, repeats are recognised by the jumps around them.
    let aligned = align(reference, board, Options::default()).unwrap();
    let (offset_s, _) = errors(&aligned.clock, &SESSION);
    assert!(offset_s.abs() < 200e-6, "{offset_s}");
}

#[test]
fn readings_at_the_end_of_the_range_do_not_bias() {
    let (reference, mut board) = recordings(SESSION);
    for column in &mut board.columns[..3] {
        let mut sorted = column.clone();
        sorted.sort_by(f64::total_cmp);
        let limit = sorted[sorted.len() * 98 / 100];
        column.iter_mut().for_each(|x| *x = x.min(limit));
    }
    check(reference, board, &SESSION);
}

#[test]
fn damaged_frames_do_not_bias() {
    let (reference, mut board) = recordings(SESSION);
    for row in (50..board.time_s.len()).step_by(997) {
        board.columns[row % 8][row] = 65_535.0;
    }
    check(reference, board, &SESSION);
}

#[test]
fn a_partial_overlap_is_found() {
    // The board records from 25 s before the reference until 25 s after it.
    let truth = PairSettings { duration_s: 100.0, margin_s: -25.0, ..SESSION };
    let (reference, board) = recordings(truth);
    let aligned = align(reference, board, Options::default()).unwrap();
    let (offset_s, skew) = errors(&aligned.clock, &truth);
    assert!(offset_s.abs() < 200e-6 && skew.abs() < 5e-6, "{offset_s} {skew}");
    let mut rows = 0;
    let uncovered = aligned.resample(|_, _, _| {
        rows += 1;
        Ok::<(), ()>(())
    });
    // The overlap is 50 s of 100 s, less half a kernel (0.125 s) at both ends.
    assert!((4970..=4980).contains(&rows), "{rows}");
    assert_eq!(uncovered.unwrap() + rows, 10_000);
}

#[test]
fn clocks_that_show_the_time_of_day_are_fine() {
    let truth = PairSettings { offset_s: 1.6e9, ..SESSION };
    let (reference, board) = recordings(truth);
    check(reference, board, &truth);
}

#[test]
fn a_sensor_with_fewer_channels_or_axes_is_fine() {
    let (mut reference, mut board) = linear_session(3, 30.0, 100.0, (1.0, 20e-6), 5.0);
    reference.columns[4].fill(0.0);
    board.columns.truncate(3);
    let clock = align(reference, board, Options::default()).unwrap().clock;
    assert!((clock.offset_s - 1.0 - 20e-6 * clock.pivot_s).abs() < 1e-3);
}

#[test]
fn the_scale_of_the_columns_does_not_matter() {
    let (reference, board) = linear_session(4, 20.0, 100.0, (-3.0, 0.0), 5.0);
    let plain = align(reference.clone(), board.clone(), Options::default()).unwrap().clock;
    let scaled = |recording: Recording, factor: f64| Recording {
        columns: recording
            .columns
            .into_iter()
            .map(|column| column.into_iter().map(|x| factor * x).collect())
            .collect(),
        ..recording
    };
    let other = align(scaled(reference, 1024.0), scaled(board, 1.0 / 64.0), Options::default());
    let other = other.unwrap().clock;
    // Powers of two scale without rounding, but the lower limits that prevent division by zero are not scaled.
    assert!((plain.offset_s - other.offset_s).abs() < 1e-9);
    assert!((plain.skew - other.skew).abs() < 1e-10);
}

#[test]
fn no_load_is_refused() {
    let (reference, board) = recordings(PairSettings { loaded: false, ..SESSION });
    let error = align(reference, board, Options::default()).unwrap_err();
    assert!(error.is_refusal(), "{error}");
}

#[test]
fn recordings_of_different_sessions_are_refused() {
    for seed in 1..=6 {
        let (reference, _) = recordings(PairSettings { seed, ..SESSION });
        let (_, board) = recordings(PairSettings { seed: seed + 50, ..SESSION });
        let error = align(reference, board, Options::default()).unwrap_err();
        assert!(error.is_refusal(), "seed {seed}: {error}");
        let (reference, _) = linear_session(seed, 30.0, 100.0, (0.0, 0.0), 5.0);
        let (_, board) = linear_session(seed + 50, 30.0, 100.0, (0.0, 0.0), 5.0);
        let error = align(reference, board, Options::default()).unwrap_err();
        assert!(error.is_refusal(), "seed {seed}: {error}");
    }
}

fn one_load(duration_s: f64, rate_hz: f64, columns: usize, load: impl Fn(f64) -> f64) -> Recording {
    let mut random = Random(columns as u64);
    let time_s: Vec<f64> =
        (0..(duration_s * rate_hz) as usize).map(|k| k as f64 / rate_hz).collect();
    let column = |c: usize, random: &mut Random| -> Vec<f64> {
        let value =
            |&t: &f64| (1000.0 * (c as f64 + 1.0) * load(t)).round() + random.normal().round();
        time_s.iter().map(value).collect()
    };
    let columns = (0..columns).map(|c| column(c, &mut random)).collect();
    Recording { time_s, columns }
}

#[test]
fn a_periodic_load_is_ambiguous() {
    type Load = fn(f64) -> f64;
    let sine: Load = |t| (std::f64::consts::TAU * 1.5 * t).sin();
    let taps: Load =
        |t| if t % 0.5 < 0.08 { (t % 0.5 / 0.08 * std::f64::consts::PI).sin() } else { 0.0 };
    for load in [sine, taps] {
        let reference = one_load(60.0, 1000.0, 6, load);
        let board = one_load(40.0, 100.0, 8, |t| load(t + 7.3));
        let error = align(reference, board, Options::default()).unwrap_err();
        assert!(matches!(error, AlignError::Ambiguous { .. }), "{error}");
    }
}

#[test]
fn recordings_that_are_none_are_refused_by_name() {
    let (reference, board) = linear_session(1, 10.0, 100.0, (0.0, 0.0), 1.0);
    let refuse = |reference: &Recording, board: &Recording| {
        align(reference.clone(), board.clone(), Options::default()).unwrap_err()
    };
    let empty = Recording::default();
    assert!(matches!(
        refuse(&empty, &board),
        AlignError::Shape { side: RecordingSide::Reference, found: 0, .. }
    ));
    let mut ragged = board.clone();
    ragged.columns[3].pop();
    assert!(matches!(
        refuse(&reference, &ragged),
        AlignError::Shape { side: RecordingSide::Board, .. }
    ));
    let mut short = board.clone();
    keep_rows(&mut short, |_, t| t < 2.0);
    assert!(matches!(
        refuse(&reference, &short),
        AlignError::TooShort { side: RecordingSide::Board, .. }
    ));
    let mut constant = board.clone();
    constant.columns.iter_mut().for_each(|column| column.fill(7.0));
    assert!(matches!(
        refuse(&reference, &constant),
        AlignError::Constant(RecordingSide::Board) | AlignError::TooShort { .. }
    ));
    let mut backward = reference.clone();
    backward.time_s.reverse();
    assert!(matches!(
        refuse(&backward, &board),
        AlignError::TimeGoesBack { side: RecordingSide::Reference, .. }
    ));
    let mut nothing = board;
    nothing.columns.iter_mut().for_each(|column| column.fill(f64::NAN));
    assert!(matches!(refuse(&reference, &nothing), AlignError::TooShort { rows: 0, .. }));
}
