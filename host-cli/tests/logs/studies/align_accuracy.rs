//! Errors of an alignment, on sessions with known truth, and the bound of Cramér and Rao.
use alignment::{Options, align};
use simulation::sensor_model::PairSettings;

use crate::alignment::{SESSION, errors, linear_session, recordings, worst_offset_error};

#[test]
fn a_minute_with_taps_gives_the_offset_to_200_us_and_the_skew_to_3_ppm() {
    for seed in 1..=6 {
        let offset_s = [12.3, -123.4567, 0.0, 500.0, -0.004, 77.7][seed as usize - 1];
        let skew = [200e-6, -200e-6, 0.0, 50e-6, -3e-6, 120e-6][seed as usize - 1];
        for (board_rate_hz, reference_rate_hz) in [(100.0, 1000.0), (1000.0, 10_000.0)] {
            if board_rate_hz > 500.0 && seed > 2 {
                continue;
            }
            let truth = PairSettings {
                seed,
                unit_seed: seed,
                offset_s,
                skew,
                board_rate_hz,
                reference_rate_hz,
                ..SESSION
            };
            let (reference, board) = recordings(truth);
            let aligned = align(reference, board, Options::default()).unwrap();
            let (_, skew_error) = errors(&aligned.clock, &truth);
            // The error is the largest of the whole session, not only at the time at which the offset is known best.
            let offset_error_s = worst_offset_error(&aligned, &truth);
            assert!(offset_error_s < 200e-6, "seed {seed}, {board_rate_hz} Hz: {offset_error_s} s");
            assert!(skew_error.abs() < 3e-6, "seed {seed}, {board_rate_hz} Hz: {skew_error}");
        }
    }
}

#[test]
fn errors_on_the_sensor_model_are_of_the_size_that_is_stated() {
    let mut squares = [0.0; 2];
    const SESSIONS: u64 = 16;
    for seed in 101..101 + SESSIONS {
        let truth = PairSettings { seed, unit_seed: seed, duration_s: 40.0, ..SESSION };
        let (reference, board) = recordings(truth);
        let clock = align(reference, board, Options::default()).unwrap().clock;
        let (offset, skew) = errors(&clock, &truth);
        squares[0] += (offset / clock.offset_se_s).powi(2);
        squares[1] += (skew / clock.skew_se).powi(2);
    }
    // χ² with 16 degrees of freedom is above 5 and below 36 with 99.5 % probability each. Errors on the model are not
    // normal, hence a margin of √2 for errors. The stated offset error is for unknown memory; here the model has the
    // right kind, and the error may be seven times smaller.
    for (what, sum, lowest) in [("offset", squares[0], 16.0 / 49.0), ("skew", squares[1], 2.5)] {
        assert!((lowest..72.0).contains(&sum), "{what}: {sum}");
    }
}

#[test]
fn stated_errors_have_unit_variance_where_the_model_holds() {
    const SESSIONS: u64 = 40;
    let mut squares = [0.0; 2];
    let mut sums = [0.0; 2];
    for seed in 1..=SESSIONS {
        let (offset_s, skew) = (7.5, 80e-6);
        let (reference, board) = linear_session(seed, 12.0, 200.0, (offset_s, skew), 20.0);
        let clock = align(reference, board, Options::default()).unwrap().clock;
        let offset = (clock.offset_s - offset_s - skew * clock.pivot_s) / clock.offset_se_s;
        let skew = (clock.skew - skew) / clock.skew_se;
        for (i, z) in [offset, skew].into_iter().enumerate() {
            squares[i] += z * z;
            sums[i] += z;
        }
    }
    for i in 0..2 {
        // χ² with 40 degrees of freedom is within 16.9 to 76.1 with 99.9 % probability. Standard errors from residuals
        // of 12 s scatter by some 10 % themselves, which adds a few percent.
        assert!((16.9..80.0).contains(&squares[i]), "{i}: {}", squares[i]);
        // A sum of 40 has the standard deviation √40; the limit is four of these.
        assert!(sums[i].abs() < 25.3, "{i}: {}", sums[i]);
    }
}

#[test]
fn a_long_session_is_aligned_from_a_block_outward() {
    // A skew of 200 ppm is 80 ms over 400 s, the length of a tap: too much for one search.
    let truth = PairSettings {
        duration_s: 400.0,
        skew: -200e-6,
        board_rate_hz: 50.0,
        reference_rate_hz: 500.0,
        ..SESSION
    };
    let (reference, board) = recordings(truth);
    let aligned = align(reference, board, Options::default()).unwrap();
    let (_, skew_error) = errors(&aligned.clock, &truth);
    assert!(worst_offset_error(&aligned, &truth) < 200e-6, "{:?}", aligned.clock);
    assert!(skew_error.abs() < 0.5e-6, "{:?}", aligned.clock);
}

/// Returns the bound for a known response. Slopes are central differences of noiseless readings, the noise is noisy
/// minus noiseless readings.
fn bound(truth: PairSettings) -> (f64, f64) {
    const SHIFT_S: f64 = 1e-3;
    let readings = |offset_s: f64, noise_scale: f64| {
        // The load moves and the board does not, so the margin is the earlier start of the load.
        let margin_s = truth.margin_s + offset_s;
        recordings(PairSettings { margin_s, noise_scale, ..truth }).1
    };
    let (ahead, behind) = (readings(SHIFT_S, 0.0), readings(-SHIFT_S, 0.0));
    let (clean, noisy) = (readings(0.0, 0.0), readings(0.0, 1.0));
    let mut information = [[0.0; 2]; 2];
    for channel in 0..8 {
        let rows = clean.time_s.len() as f64;
        let noise = clean.columns[channel].iter().zip(&noisy.columns[channel]);
        // Ambient light shifts a whole recording, so the variance is taken about the mean.
        let difference: Vec<f64> = noise.map(|(a, b)| b - a).collect();
        let mean = difference.iter().sum::<f64>() / rows;
        let variance =
            difference.iter().map(|d| (d - mean) * (d - mean)).sum::<f64>() / (rows - 1.0);
        let slopes = ahead.columns[channel].iter().zip(&behind.columns[channel]);
        for ((a, b), t) in slopes.zip(&clean.time_s) {
            let slope = (a - b) / (2.0 * SHIFT_S);
            let t = t - 0.5 * truth.duration_s;
            information[0][0] += slope * slope / variance;
            information[0][1] += t * slope * slope / variance;
            information[1][1] += t * t * slope * slope / variance;
        }
    }
    let [[a, b], [_, c]] = information;
    let determinant = a * c - b * b;
    ((c / determinant).sqrt(), (a / determinant).sqrt())
}

#[test]
fn errors_are_within_a_small_factor_of_the_bound() {
    const SESSIONS: u64 = 8;
    let (mut errors_squared, mut bounds_squared) = ([0.0; 2], [0.0; 2]);
    for seed in 1..=SESSIONS {
        let truth = PairSettings { seed, unit_seed: seed, ..SESSION };
        let (reference, board) = recordings(truth);
        let clock = align(reference, board, Options::default()).unwrap().clock;
        let (offset, skew) = errors(&clock, &truth);
        let (offset_bound, skew_bound) = bound(truth);
        errors_squared[0] += offset * offset;
        errors_squared[1] += skew * skew;
        bounds_squared[0] += offset_bound * offset_bound;
        bounds_squared[1] += skew_bound * skew_bound;
    }
    let ratio = |i: usize| f64::sqrt(errors_squared[i] / bounds_squared[i]);
    let rms = |x: f64| f64::sqrt(x / SESSIONS as f64);
    println!(
        "offset: RMS error {:.1} µs, bound {:.1} µs; skew: {:.2} ppm, bound {:.2} ppm",
        1e6 * rms(errors_squared[0]),
        1e6 * rms(bounds_squared[0]),
        1e6 * rms(errors_squared[1]),
        1e6 * rms(bounds_squared[1])
    );
    // The bound, below which no unbiased estimate is, assumes a known response of springs and optics. Here, some 600
    // numbers are estimated in addition to offset and skew.
    assert!(ratio(0) < 6.0, "{}", ratio(0));
    assert!(ratio(1) < 4.0, "{}", ratio(1));
}
