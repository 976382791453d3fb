//! Sessions on two clocks whose truth is known.
use alignment::{Aligned, ClockMap, Recording};
use simulation::sensor_model::{Pair, PairSettings};
use system_tests::random::Random;

/// A minute of taps and pushes at the paper's noise, reference at 1 kHz, board at 100 Hz.
pub(crate) const SESSION: PairSettings = PairSettings {
    seed: 1,
    unit_seed: 1,
    loaded: true,
    duration_s: 60.0,
    margin_s: 3.0,
    reference_rate_hz: 1000.0,
    board_rate_hz: 100.0,
    offset_s: -123.4567,
    skew: 150e-6,
    loss: 0.0,
    noise_scale: 1.0,
};

pub(crate) fn recordings(settings: PairSettings) -> (Recording, Recording) {
    let pair = Pair::new(settings).unwrap();
    let mut reference = Recording { time_s: vec![], columns: vec![vec![]; 6] };
    for (time_s, wrench) in pair.reference() {
        reference.time_s.push(time_s);
        reference.columns.iter_mut().zip(wrench).for_each(|(column, w)| column.push(w));
    }
    let mut board = Recording { time_s: vec![], columns: vec![vec![]; 8] };
    for (time_s, frame) in pair.board() {
        board.time_s.push(time_s);
        let readings = frame.readings.map(f64::from);
        board.columns.iter_mut().zip(readings).for_each(|(column, r)| column.push(r));
    }
    (reference, board)
}

/// Errors of offset (s, at the pivot) and skew.
pub(crate) fn errors(clock: &ClockMap, truth: &PairSettings) -> (f64, f64) {
    let offset_s = truth.offset_s + truth.skew * clock.pivot_s;
    (clock.offset_s - offset_s, clock.skew - truth.skew)
}

/// Largest error of the offset within a session, s.
pub(crate) fn worst_offset_error(aligned: &Aligned, truth: &PairSettings) -> f64 {
    let error = |t: f64| aligned.clock.offset_at_s(t) - (truth.offset_s + truth.skew * t);
    error(0.0).abs().max(error(truth.duration_s).abs())
}

/// A session without memory: taps (squared half-sines) of random direction, length and time, a
/// random linear map, white noise of `noise` counts.
pub(crate) fn linear_session(
    seed: u64,
    duration_s: f64,
    rate_hz: f64,
    (offset_s, skew): (f64, f64),
    noise: f64,
) -> (Recording, Recording) {
    let mut random = Random(seed);
    let mut taps = Vec::new();
    let mut start_s = -2.0;
    while start_s < duration_s + 2.0 {
        let width_s = 0.08 + 0.1 * random.unit();
        let size: [f64; 6] = std::array::from_fn(|_| random.normal());
        taps.push((start_s, width_s, size));
        start_s += width_s + 0.6 * random.unit();
    }
    let load = |t: f64| -> [f64; 6] {
        let i = taps.partition_point(|tap| tap.0 <= t);
        match taps[..i].last() {
            Some(&(start_s, width_s, size)) if t < start_s + width_s => {
                let sin = (std::f64::consts::PI * (t - start_s) / width_s).sin();
                size.map(|w| w * sin * sin)
            }
            _ => [0.0; 6],
        }
    };
    let map: [[f64; 6]; 8] =
        std::array::from_fn(|_| std::array::from_fn(|_| 100.0 * random.normal()));
    let mut reference = Recording { time_s: vec![], columns: vec![vec![]; 6] };
    for k in 0..((duration_s + 3.0) * 1000.0) as usize {
        let t = k as f64 / 1000.0 - 1.5;
        reference.time_s.push(t * (1.0 + skew) + offset_s);
        reference.columns.iter_mut().zip(load(t)).for_each(|(column, w)| column.push(w));
    }
    let mut board = Recording { time_s: vec![], columns: vec![vec![]; 8] };
    for k in 0..(duration_s * rate_hz) as usize {
        let t = k as f64 / rate_hz;
        let wrench = load(t);
        board.time_s.push(t);
        for (column, row) in board.columns.iter_mut().zip(&map) {
            let clean: f64 = row.iter().zip(wrench).map(|(m, w)| m * w).sum();
            column.push((2000.0 + clean + noise * random.normal()).round());
        }
    }
    (reference, board)
}
