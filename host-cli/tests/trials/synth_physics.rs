//! The sensor model against physics, statistics and the paper.

use faer::Mat;
use faer::linalg::solvers::SolveLstsq;
use simulation::sensor_model::{
    RecordingKind, RecordingSettings, SensorChannel, SensorModel, SensorParameters,
    SensorRecording, SensorSample, SimulatedFrame,
};

/// The nominal unit without noise, drift, creep and hysteresis, at 16 bits.
fn ideal() -> SensorParameters {
    let mut drawing = SensorParameters::nominal();
    drawing.scale_noise(0.0);
    drawing.elastic = true;
    drawing.surroundings.ambient = 0.0;
    drawing.surroundings.start_k = 0.0;
    drawing.surroundings.warm_up_k = 0.0;
    drawing.adc_bits = 16;
    drawing
}

fn frame(unit: &SensorParameters, wrench: [f64; 6]) -> SimulatedFrame {
    SensorModel::new(unit, 1).expect("a unit that can be modelled").sample(0.0, &wrench)
}

/// Change of every reading under `value` on one axis.
fn answer(axis: usize, value: f64) -> [i32; 8] {
    let mut wrench = [0.0; 6];
    wrench[axis] = value;
    let (rest, loaded) = (frame(&ideal(), [0.0; 6]), frame(&ideal(), wrench));
    std::array::from_fn(|i| i32::from(loaded.readings[i]) - i32::from(rest.readings[i]))
}

#[test]
fn lift_opens_every_gap_and_dims_every_channel() {
    let change = answer(2, 1.0);
    assert!(change[..4].iter().all(|&c| c < -500 && c == change[0]), "{change:?}");
    assert!(change.iter().all(|&c| c < -500), "{change:?}");
}

#[test]
fn force_along_x_is_seen_by_the_pair_tilted_about_y_alone() {
    let change = answer(0, 1.0);
    assert_eq!(change[..4], [0; 4]);
    assert_eq!(change[6..], [0; 2]);
    assert!(change[4].abs() > 500 && change[4] == change[5], "{change:?}");
}

#[test]
fn force_along_y_is_seen_by_the_pair_tilted_about_x_alone() {
    let change = answer(1, 1.0);
    assert_eq!(change[..6], [0; 6]);
    assert!(change[6].abs() > 500 && change[6] == change[7], "{change:?}");
}

#[test]
fn moment_about_z_moves_the_members_of_a_tilted_pair_in_opposite_ways() {
    let change = answer(5, 0.05);
    assert_eq!(change[..4], [0; 4]);
    for pair in [&change[4..6], &change[6..]] {
        assert!(pair[0].signum() == -pair[1].signum() && pair[0].abs() > 200, "{change:?}");
    }
}

#[test]
fn moment_about_x_raises_the_left_and_lowers_the_right() {
    // Flat reflectors: 1 and 2 are on the left (y > 0), 3 and 4 on the right.
    let change = answer(3, 0.05);
    assert!(change[..2].iter().all(|&c| c < -500), "{change:?}");
    assert!(change[2..4].iter().all(|&c| c > 500), "{change:?}");
}

#[test]
fn readings_at_rest_equal_those_of_gain_and_gap() {
    // A gap of 1.2 mm lies a fifth of the way from the node at 1.25 mm (0.52) to that at 1 mm
    // (0.74); the curve there is nearly straight, so 0.559 to two places; gain 0.85.
    let reading = f64::from(frame(&ideal(), [0.0; 6]).readings[0]) / 65536.0;
    assert!((reading - 0.85 * 0.559).abs() < 0.005, "{reading}");
}

#[test]
fn noise_has_the_mean_and_the_variance_of_its_three_parts() {
    let mut unit = ideal();
    unit.noise = SensorParameters::nominal().noise;
    let expected = f64::from(frame(&ideal(), [0.0; 6]).readings[0]) / 65536.0;
    let mut model = SensorModel::new(&unit, 5).unwrap();
    let n = 40_000;
    let (mut sum, mut squares) = (0.0, 0.0);
    for row in 0..n {
        let reading = model.sample(0.01 * f64::from(row), &[0.0; 6]).readings[0];
        let error = f64::from(reading) / 65536.0 - expected;
        sum += error;
        squares += error * error;
    }
    let (mean, n) = (sum / f64::from(n), f64::from(n));
    let variance = (squares - n * mean * mean) / (n - 1.0);
    let noise = unit.noise;
    let parts = [noise.read.powi(2), noise.shot * expected, (noise.emitter * expected).powi(2)];
    let lsb = 1.0 / 65536.0;
    let predicted = parts.iter().sum::<f64>() + lsb * lsb / 12.0;
    // Five standard deviations of the mean, and half a step in `expected`; of the variance.
    assert!(mean.abs() < 5.0 * (predicted / n).sqrt() + 0.5 * lsb, "{mean}");
    assert!((variance / predicted - 1.0).abs() < 5.0 * (2.0 / n).sqrt(), "{variance} {predicted}");
}

#[test]
fn quantisation_error_is_uniform_over_one_step() {
    let mut coarse = ideal();
    coarse.adc_bits = 12;
    let mut models = [coarse, ideal()].map(|unit| SensorModel::new(&unit, 1).unwrap());
    let mut errors = Vec::new();
    for row in 0..20_000 {
        // A ramp from -2 N to 2 N: hundreds of steps, each hit some 20 times at even distances.
        let wrench = [0.0, 0.0, -2.0 + 2e-4 * f64::from(row), 0.0, 0.0, 0.0];
        let [coarse, fine] = models.each_mut().map(|m| m.sample(0.0, &wrench).readings[0]);
        errors.push(f64::from(coarse) - f64::from(fine) / 16.0);
    }
    let n = errors.len() as f64;
    let mean = errors.iter().sum::<f64>() / n;
    let variance = errors.iter().map(|e| (e - mean) * (e - mean)).sum::<f64>() / n;
    assert!(errors.iter().all(|e| e.abs() <= 0.5 + 0.5 / 16.0));
    assert!(mean.abs() < 0.02, "{mean}");
    // 1/12 of one step and 1/12 of a sixteenth of it at most; the ends of the ramp cut steps.
    assert!((variance * 12.0 - 1.0).abs() < 0.02, "{variance}");
}

#[test]
fn saturation_stops_at_the_ends_of_the_range_and_is_flagged() {
    let mut unit = ideal();
    unit.adc_bits = 12;
    unit.channels[0].gain = 3.0;
    unit.channels[1].gain = 0.0;
    let frame = frame(&unit, [0.0; 6]);
    assert_eq!((frame.readings[0], frame.readings[1]), (4095, 0));
    assert_eq!(frame.saturated, 0b11);
}

#[test]
fn warming_up_dims_the_channels_as_the_coefficient_says() {
    let mut unit = ideal();
    unit.surroundings.warm_up_k = 10.0;
    let mut model = SensorModel::new(&unit, 1).unwrap();
    let cold = f64::from(model.sample(0.0, &[0.0; 6]).readings[0]);
    let tau_s = unit.surroundings.warm_up_s;
    let warm = f64::from(model.sample(tau_s, &[0.0; 6]).readings[0]);
    let rise_k = 10.0 * (1.0 - (-1.0_f64).exp());
    let expected = cold * (1.0 + unit.channels[0].gain_drift_per_k * rise_k);
    // Two readings, each rounded.
    assert!((warm - expected).abs() <= 1.0, "{warm} {expected}");
}

#[test]
fn units_differ_by_the_spread_and_have_their_names() {
    let drawing = SensorParameters::nominal();
    let units: Vec<SensorParameters> = (0..200).map(|seed| drawing.unit(seed)).collect();
    assert_eq!(units[7], drawing.unit(7));
    assert_ne!(units[7], units[8]);
    let gains: Vec<f64> = units.iter().flat_map(|unit| unit.channels).map(|c| c.gain).collect();
    let n = gains.len() as f64;
    let mean = gains.iter().sum::<f64>() / n;
    let sd = (gains.iter().map(|g| (g - mean) * (g - mean)).sum::<f64>() / n).sqrt();
    // Gains spread by 10 %.
    let expected = 0.10 * drawing.channels[0].gain;
    // Five standard deviations of mean and sd; cutting off at 3 sigma takes 1.3 % from the sd.
    assert!((mean - 0.85).abs() < 5.0 * expected / n.sqrt(), "{mean}");
    assert!((sd / expected - 0.987).abs() < 5.0 / (2.0 * n).sqrt(), "{sd}");
}

#[test]
fn recordings_of_any_length_are_made_row_by_row() {
    let rows: Vec<SensorSample> =
        SensorRecording::new(RecordingSettings::new(RecordingKind::Training))
            .unwrap()
            .take(700)
            .collect();
    let again = SensorRecording::new(RecordingSettings::new(RecordingKind::Training)).unwrap();
    assert!(rows.iter().copied().eq(again.take(700)));
    assert_eq!(rows[0].pose, 0);
    assert_eq!(rows[600].pose, 3);
}

#[test]
fn seeds_and_kinds_change_a_recording() {
    let sum = |settings| -> u64 {
        let rows = SensorRecording::new(settings).unwrap().skip(100).take(10);
        rows.flat_map(|s| s.frame.readings).map(u64::from).sum()
    };
    let base = RecordingSettings::new(RecordingKind::Training);
    let all = [
        base,
        RecordingSettings::new(RecordingKind::Test),
        RecordingSettings::new(RecordingKind::Zero),
        RecordingSettings { seed: 2, ..base },
        RecordingSettings { unit_seed: 2, ..base },
        RecordingSettings { noise_scale: 3.0, ..base },
        RecordingSettings { adc_bits: 16, ..base },
    ]
    .map(sum);
    for (i, a) in all.iter().enumerate() {
        assert!(all[i + 1..].iter().all(|b| a != b), "{all:?}");
    }
}

#[test]
fn settings_that_describe_no_recording_are_refused() {
    let refused = |settings| SensorRecording::new(settings).unwrap_err().to_string();
    let base = RecordingSettings::new(RecordingKind::Training);
    for rate_hz in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let error = refused(RecordingSettings { rate_hz, ..base });
        assert!(error.starts_with(&format!("rate {rate_hz} Hz from 0 s on: ")), "{error}");
    }
    let start_time_s = f64::NAN;
    let error = refused(RecordingSettings { start_time_s, ..base });
    assert!(error.starts_with("rate 100 Hz from NaN s on: "), "{error}");
    for noise_scale in [-1.0, f64::NAN, f64::INFINITY] {
        let error = refused(RecordingSettings { noise_scale, ..base });
        assert!(error.starts_with(&format!("noise scaled by {noise_scale}, ")), "{error}");
    }
    for adc_bits in [0, 7, 17, u32::MAX] {
        let error = refused(RecordingSettings { adc_bits, ..base });
        assert!(error.starts_with(&format!("a converter of {adc_bits} bits, ")), "{error}");
    }
    let mut loose = SensorParameters::nominal();
    loose.springs.iter_mut().for_each(|spring| spring.position_m = [0.0; 3]);
    let error = SensorModel::new(&loose, 1).unwrap_err().to_string();
    assert_eq!(error, "the springs do not hold the plate in all six directions");
}

#[test]
fn a_wrench_that_is_not_finite_saturates_one_frame_and_no_more() {
    let mut model = SensorModel::new(&ideal(), 1).unwrap();
    let before = model.sample(0.0, &[0.0; 6]);
    let torn = model.sample(0.1, &[f64::NAN, 0.0, 0.0, 0.0, 0.0, 0.0]);
    assert_eq!(torn, SimulatedFrame { readings: [0; 8], saturated: 0xFF });
    assert_eq!(model.sample(0.2, &[0.0; 6]), before);
}

#[test]
fn any_finite_wrench_gives_readings_in_range() {
    let mut model = SensorModel::new(&SensorParameters::nominal().unit(1), 1).unwrap();
    for size in [1e-300, 1.0, 30.0, 1e3, 1e6, 1e9, f64::MAX] {
        for sign in [1.0, -1.0] {
            let frame = model.sample(0.0, &[sign * size; 6]);
            assert!(frame.readings.iter().all(|&reading| reading < 4096));
            assert!(size < 1e9 || frame.saturated == 0xFF);
        }
    }
}

#[test]
fn channels_lie_on_the_board_and_every_gap_can_open_and_close() {
    for SensorChannel { reflector, .. } in SensorParameters::nominal().channels {
        // The board is 5 cm square; the response peaks at 0.7 mm.
        assert!(reflector.position_m.iter().all(|p| p.abs() <= 0.025));
        assert!(reflector.gap_m > 0.7e-3);
    }
}

fn problem(kind: RecordingKind, rows: usize) -> (Mat<f64>, Mat<f64>) {
    let samples: Vec<SensorSample> = SensorRecording::new(RecordingSettings::new(kind))
        .expect("a recording")
        .take(rows)
        .collect();
    let features = Mat::from_fn(rows, 25, |row, column| {
        if column == 24 {
            return 1.0;
        }
        let reading = f64::from(samples[row].frame.readings[column / 3]);
        ((reading - 1800.0) / 1000.0).powi(column as i32 % 3 + 1)
    });
    (features, Mat::from_fn(rows, 6, |row, axis| samples[row].wrench[axis]))
}

#[test]
fn a_cubic_calibration_errs_and_rests_as_the_paper_found() {
    let (features, wrench) = problem(RecordingKind::Training, 77_522);
    let coefficients = features.qr().solve_lstsq(&wrench);
    let rms = |kind, rows| -> [f64; 3] {
        let (features, wrench) = problem(kind, rows);
        let error = &features * &coefficients - &wrench;
        std::array::from_fn(|axis| error.col(axis).norm_l2() / (rows as f64).sqrt())
    };
    // The paper: 0.118, 0.122, 0.126 N on 19,932 test samples. Within a fifth.
    for (axis, (rms, paper)) in
        rms(RecordingKind::Test, 19_932).into_iter().zip([0.118, 0.122, 0.126]).enumerate()
    {
        assert!((rms / paper - 1.0).abs() < 0.2, "axis {axis}: {rms} N, paper {paper} N");
    }
    // The paper's zero-load noise: 0.040, 0.015, 0.048 N.
    let (features, _) = problem(RecordingKind::Zero, 5000);
    let forces = &features * &coefficients;
    for axis in 0..3 {
        let column: Vec<f64> = forces.col(axis).iter().copied().collect();
        let mean = column.iter().sum::<f64>() / 5000.0;
        let noise = (column.iter().map(|f| (f - mean) * (f - mean)).sum::<f64>() / 5000.0).sqrt();
        assert!((0.015..0.05).contains(&noise), "axis {axis}: {noise} N");
    }
}
