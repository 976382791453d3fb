//! Sessions of sensors unlike the sensor model: other springs, optics, loads and noise.
//!
//! ```text
//! force on a spring f = D w     displacement q = spring(f)     reading = lo + h g(b + C q) + noise
//! ```
mod load;
mod memory;

pub(crate) use load::Load;
pub(crate) use memory::Kind;

use alignment::Recording;
use system_tests::random::Random;

/// Response of a channel to its displacement z (of order 1), about ±1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Optics {
    /// Light falls with the square of the distance.
    InverseSquare,
    Exponential,
    /// Each channel saturates toward one end.
    Saturating,
}

impl Optics {
    const ALL: [Self; 3] = [Self::InverseSquare, Self::Exponential, Self::Saturating];

    fn response(self, z: f64, bend: f64) -> f64 {
        match self {
            // The distance is 1/bend at z = 0. The slope there is −2 bend; dividing by it
            // normalises the response.
            Self::InverseSquare => ((1.0 + bend * z).max(0.2).powi(-2) - 1.0) / (-2.0 * bend),
            Self::Exponential => -f64::exp_m1(-bend * z) / bend,
            Self::Saturating => f64::tanh(bend * z + 0.3) / bend,
        }
    }
}

pub(crate) struct Session {
    pub(crate) load: Load,
    pub(crate) optics: Optics,
    pub(crate) offset_s: f64,
    pub(crate) skew: f64,
    pub(crate) reference: Recording,
    pub(crate) board: Recording,
}

/// Duration of the board's recording, s.
const DURATION_S: f64 = 60.0;
/// Duration of the reference's recording before and after that of the board, s.
const MARGIN_S: f64 = 2.0;
const REFERENCE_STEP_S: f64 = 1e-3;

impl Session {
    /// Draws a session; consecutive seeds have different loads and optics.
    pub(crate) fn draw(kind: Kind, seed: u64) -> Self {
        let mut random = Random(1000 * (kind as u64 + 1) + seed);
        let load = Load::ALL[(seed % 6) as usize];
        let optics = Optics::ALL[(seed / 6 % 3) as usize];
        let offset_s = 200.0 * random.unit() - 100.0;
        let skew = 4e-4 * random.unit() - 2e-4;
        let rows = ((DURATION_S + 2.0 * MARGIN_S) / REFERENCE_STEP_S) as usize;
        let wrench = load.draw(rows, REFERENCE_STEP_S, &mut random);
        let readings = readings(kind, optics, &wrench, &mut random);
        let reference = reference(&wrench, offset_s, &mut random);
        let board = board(&readings, skew, &mut random);
        Self { load, optics, offset_s, skew, reference, board }
    }
}

/// Noiseless readings at the rows of the reference.
fn readings(kind: Kind, optics: Optics, wrench: &[[f64; 6]], random: &mut Random) -> Vec<[f64; 8]> {
    // Sensitivity of each channel (row) to each displacement. Columns have about unit length.
    let normal_row = |random: &mut Random| -> [f64; 6] {
        let row: [f64; 6] = std::array::from_fn(|_| random.normal());
        let length = row.iter().map(|x| x * x).sum::<f64>().sqrt();
        row.map(|x| x / length)
    };
    let sees: [[f64; 6]; 8] = std::array::from_fn(|_| normal_row(random));
    let directions = match kind.per_channel() {
        true => sees.to_vec(),
        false => rotation(random).to_vec(),
    };
    let mut springs: Vec<_> = directions.iter().map(|_| kind.draw(random)).collect();
    let bend: [f64; 8] = std::array::from_fn(|_| 0.1 + 0.25 * random.unit());
    let height: [f64; 8] = std::array::from_fn(|_| 200.0 + 400.0 * random.unit());
    let row = |w: &[f64; 6]| -> [f64; 8] {
        let dot = |a: &[f64; 6], b: &[f64; 6]| -> f64 { a.iter().zip(b).map(|(a, b)| a * b).sum() };
        let moved: Vec<f64> = directions
            .iter()
            .zip(&mut springs)
            .map(|(direction, spring)| spring.displacement(dot(direction, w), REFERENCE_STEP_S))
            .collect();
        std::array::from_fn(|c| {
            let z = match kind.per_channel() {
                true => moved[c],
                false => moved.iter().zip(&sees[c]).map(|(q, s)| q * s).sum(),
            };
            2000.0 + height[c] * optics.response(z, bend[c])
        })
    };
    wrench.iter().map(row).collect()
}

/// An orthonormal basis, by Gram and Schmidt from random vectors.
fn rotation(random: &mut Random) -> [[f64; 6]; 6] {
    let mut basis = [[0.0; 6]; 6];
    for k in 0..6 {
        let mut row: [f64; 6] = std::array::from_fn(|_| random.normal());
        for before in &basis[..k] {
            let along: f64 = before.iter().zip(row).map(|(a, b)| a * b).sum();
            row.iter_mut().zip(before).for_each(|(x, b)| *x -= along * b);
        }
        let length = row.iter().map(|x| x * x).sum::<f64>().sqrt();
        basis[k] = row.map(|x| x / length);
    }
    basis
}

/// Returns the reference's recording: 3 N and 0.05 N·m per unit of load, with white noise of 0.3 %.
fn reference(wrench: &[[f64; 6]], offset_s: f64, random: &mut Random) -> Recording {
    let time_s =
        (0..wrench.len()).map(|k| k as f64 * REFERENCE_STEP_S - MARGIN_S + offset_s).collect();
    let columns = (0..6)
        .map(|axis| {
            let full = if axis < 3 { 3.0 } else { 0.05 };
            wrench.iter().map(|w| full * (w[axis] + 0.003 * random.normal())).collect()
        })
        .collect();
    Recording { time_s, columns }
}

/// Returns frames at 100 or 200 Hz (board's clock), with white noise, a slow drift and rounding.
fn board(readings: &[[f64; 8]], skew: f64, random: &mut Random) -> Recording {
    let rate_hz = if random.percent(50) { 100.0 } else { 200.0 };
    let noise = 1.0 + 5.0 * random.unit();
    let mut wander = [0.0; 8];
    let mut board = Recording { time_s: vec![], columns: vec![vec![]; 8] };
    for k in 0..(DURATION_S * rate_hz) as usize {
        let time_s = k as f64 / rate_hz;
        // Reference time is (1 + skew) board time + offset.
        let position = (time_s * (1.0 + skew) + MARGIN_S) / REFERENCE_STEP_S;
        let (row, part) = (position as usize, position.fract());
        board.time_s.push(time_s);
        for channel in 0..8 {
            wander[channel] += 0.02 * noise * random.normal();
            let clean = readings[row][channel]
                + part * (readings[row + 1][channel] - readings[row][channel]);
            let reading = clean + wander[channel] + noise * random.normal();
            board.columns[channel].push(reading.round());
        }
    }
    board
}
