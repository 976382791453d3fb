//! Loads of order 1 on each axis, on an even grid of time.
use system_tests::random::Random;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Load {
    /// Contacts of 60 to 350 ms in random directions.
    Taps,
    /// A sine on each axis whose frequency sweeps between 0.1 and 4 Hz, different for every axis.
    Sweeps,
    /// Random loads, held for 0.2 to 1.2 s each, with transitions of 50 to 400 ms.
    Ramps,
    /// White noise through two first-order low-passes.
    Walk,
    /// Three sines of 0.2 to 3 Hz on each axis.
    Sines,
    /// Random loads, held for 0.5 to 3 s each, with transitions of 2 to 10 ms, like hung weights.
    Steps,
}

impl Load {
    pub(crate) const ALL: [Self; 6] =
        [Self::Taps, Self::Sweeps, Self::Ramps, Self::Walk, Self::Sines, Self::Steps];

    pub(crate) fn draw(self, rows: usize, step_s: f64, random: &mut Random) -> Vec<[f64; 6]> {
        match self {
            Self::Taps => taps(rows, step_s, random),
            Self::Sweeps => sweeps(rows, step_s, random),
            Self::Ramps => ramps(rows, step_s, [0.05, 0.35], [0.2, 1.0], random),
            Self::Walk => walk(rows, step_s, random),
            Self::Sines => sines(rows, step_s, random),
            Self::Steps => ramps(rows, step_s, [0.002, 0.008], [0.5, 2.5], random),
        }
    }
}

fn normals(random: &mut Random, size: f64) -> [f64; 6] {
    std::array::from_fn(|_| size * random.normal())
}

fn taps(rows: usize, step_s: f64, random: &mut Random) -> Vec<[f64; 6]> {
    let mut load = vec![[0.0; 6]; rows];
    let mut start_s = 0.3;
    while start_s < rows as f64 * step_s {
        let (width_s, size) = (0.06 + 0.29 * random.unit(), normals(random, 0.7));
        // The load rises fast and falls more slowly, as if a hand strikes.
        let early = 0.3 + 0.4 * random.unit();
        let first = (start_s / step_s) as usize;
        for (k, row) in load.iter_mut().enumerate().skip(first) {
            let x = (k as f64 * step_s - start_s) / width_s;
            if x >= 1.0 {
                break;
            }
            let phase =
                if x < early { 0.5 * x / early } else { 0.5 + 0.5 * (x - early) / (1.0 - early) };
            let height = (std::f64::consts::PI * phase.max(0.0)).sin().powi(2);
            for (w, size) in row.iter_mut().zip(size) {
                *w += size * height;
            }
        }
        start_s += width_s + 0.5 * random.unit();
    }
    load
}

fn sweeps(rows: usize, step_s: f64, random: &mut Random) -> Vec<[f64; 6]> {
    let mut load = vec![[0.0; 6]; rows];
    for axis in 0..6 {
        let (low, high) = (0.1 + 0.2 * random.unit(), 2.0 + 2.0 * random.unit());
        let (period_s, size) = (10.0 + 15.0 * random.unit(), 0.6 + 0.6 * random.unit());
        let mut phase = std::f64::consts::TAU * random.unit();
        let start_s = period_s * random.unit();
        for (k, row) in load.iter_mut().enumerate() {
            // The frequency sweeps up and down, on a logarithmic scale.
            let x = ((k as f64 * step_s + start_s) / period_s).fract();
            let rate_hz = low * f64::powf(high / low, 1.0 - (2.0 * x - 1.0).abs());
            phase += std::f64::consts::TAU * rate_hz * step_s;
            row[axis] = size * phase.sin();
        }
    }
    load
}

/// `ramp` and `hold` are pairs: the minimum time, and the range above it, s.
fn ramps(
    rows: usize,
    step_s: f64,
    ramp: [f64; 2],
    hold: [f64; 2],
    random: &mut Random,
) -> Vec<[f64; 6]> {
    let mut load = Vec::with_capacity(rows);
    let mut from = [0.0; 6];
    while load.len() < rows {
        let to = normals(random, 0.7);
        let [ramp_s, hold_s] = [ramp, hold].map(|[least, more]| least + more * random.unit());
        for k in 0..((ramp_s + hold_s) / step_s) as usize {
            let x = (k as f64 * step_s / ramp_s).min(1.0);
            load.push(std::array::from_fn(|axis| from[axis] + x * (to[axis] - from[axis])));
        }
        from = to;
    }
    load.truncate(rows);
    load
}

fn sines(rows: usize, step_s: f64, random: &mut Random) -> Vec<[f64; 6]> {
    let mut load = vec![[0.0; 6]; rows];
    for axis in 0..6 {
        for _ in 0..3 {
            let rate_hz = 0.2 * f64::powf(15.0, random.unit());
            let (size, phase) = (0.2 + 0.4 * random.unit(), std::f64::consts::TAU * random.unit());
            for (k, row) in load.iter_mut().enumerate() {
                let turns = rate_hz * k as f64 * step_s;
                row[axis] += size * (std::f64::consts::TAU * turns + phase).sin();
            }
        }
    }
    load
}

fn walk(rows: usize, step_s: f64, random: &mut Random) -> Vec<[f64; 6]> {
    let corners_hz = [0.5 + random.unit(), 2.0 + 4.0 * random.unit()];
    let kept = corners_hz.map(|hz| (-std::f64::consts::TAU * hz * step_s).exp());
    let mut state = [[0.0; 6]; 2];
    let mut load: Vec<[f64; 6]> = Vec::with_capacity(rows);
    for _ in 0..rows {
        let [first, second] = &mut state;
        for (first, second) in first.iter_mut().zip(second) {
            *first = kept[0] * *first + (1.0 - kept[0]) * random.normal();
            *second = kept[1] * *second + (1.0 - kept[1]) * *first;
        }
        load.push(state[1]);
    }
    for axis in 0..6 {
        let square = load.iter().map(|row| row[axis] * row[axis]).sum::<f64>() / rows as f64;
        load.iter_mut().for_each(|row| row[axis] *= 0.7 / square.sqrt());
    }
    load
}
