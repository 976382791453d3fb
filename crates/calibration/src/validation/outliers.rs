//! Suspicious rows: a column leaves its neighbours in time, and no other column says why.
//!
//! Of three rows in order, a column *jumps* by
//!
//! ```text
//! J = min(|xₜ − xₜ₋₁|, |xₜ − xₜ₊₁|) / σ   if both differences have one sign, else 0
//! ```
//!
//! with `σ` the standard deviation of the differences of neighbouring rows. Real motion has sharp peaks, too, but
//! moves channels and loads together. So the differences `d` of all columns, in units of σ, have a covariance `C`, and
//! what the other columns do not predict of one is
//!
//! ```text
//! v = (C⁻¹·d)ᵢ / (C⁻¹)ᵢᵢ                   (Whittaker, Graphical Models, 1990, §5.8)
//! ```
//!
//! A row is suspicious if a column jumps by more than [`JUMP`], and the unpredicted part of one by more than
//! [`UNPREDICTED`]. No model is fitted: σ and C come from pieces of the recording, without the rows that jump and those
//! beside them, so that no row is judged by itself.
//!
//! Where the limits are from: spikes of eight σ in one channel of real recordings have jumps of 4 to 10 and unpredicted
//! parts of 5 to 10; of 60,000 real rows none that jumps by 4 has one above 2.5.

use faer::linalg::solvers::DenseSolveCore;
use faer::{Mat, Side};
use pulp::NullaryFnOnce;

use shell_data::instructions::arch;

/// The largest jump of a column, and the largest part of it that other columns do not predict, of a row that is
/// not suspicious; both in standard deviations of the differences of neighbouring rows.
pub const JUMP: f64 = 4.0;
pub const UNPREDICTED: f64 = 3.0;

/// The jumps from which on rows are looked at, and the unpredicted part that is unusual. Where more than a share of the
/// rows has both, the columns scatter by nature.
pub const LOOK_AT: f64 = 3.0;
const UNUSUAL: f64 = 1.5;

/// Share of the differences that a first standard deviation is found from, and its size for normal ones.
const INNER: f64 = 0.9;
const INNER_LIMIT: f64 = 1.645;

/// Rounds in which rows that jump are left out; two or three do.
const ROUNDS: usize = 12;

/// Differences for each column that it takes to know their covariance.
const DIFFERENCES_PER_COLUMN: usize = 4;

/// What is added to the diagonal of the covariance of columns with variance one: some follow from others.
const FLOOR: f64 = 1e-6;

/// How the columns of a recording change from one row to the next.
#[derive(Clone, Debug)]
pub struct RowChanges {
    /// 1/σ of each column; zero for one that never changes.
    scale: Vec<f64>,
    /// `(C⁻¹)ᵢⱼ / (C⁻¹)ᵢᵢ`.
    unpredicted: Mat<f64>,
}

/// What is unusual about a row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RowJump {
    /// The largest jump of a column.
    pub jump: f64,
    /// The largest part of a change that other columns do not predict.
    pub unpredicted: f64,
}

impl RowJump {
    /// Whether the row is suspicious.
    pub fn is_suspicious(&self) -> bool {
        self.jump > JUMP && self.unpredicted > UNPREDICTED
    }

    /// Whether it nearly is.
    pub fn is_unusual(&self) -> bool {
        self.jump > LOOK_AT && self.unpredicted > UNUSUAL
    }
}

impl RowChanges {
    /// Of pieces of a recording, each of some columns of consecutive rows. `None` if there are too few.
    pub fn new(pieces: &[Vec<&[f64]>]) -> Option<Self> {
        let columns = pieces.first()?.len();
        // Of every pair of rows: the differences, and the larger of the jumps of both rows.
        let (mut differences, mut jumps) = (vec![Vec::new(); columns], vec![Vec::new(); columns]);
        for (column, (differences, jumps)) in differences.iter_mut().zip(&mut jumps).enumerate() {
            for piece in pieces {
                let values = piece[column];
                let inner = values.windows(3).map(|of| jump(of[1] - of[0], of[1] - of[2]));
                let of_rows: Vec<f64> =
                    std::iter::once(0.0).chain(inner).chain([0.0]).take(values.len()).collect();
                differences.extend(values.windows(2).map(|pair| pair[1] - pair[0]));
                jumps.extend(of_rows.windows(2).map(|pair| pair[0].max(pair[1])));
            }
        }
        let mut deviations: Vec<Deviation> =
            differences.iter().map(|of| Deviation::new(of)).collect();
        let pairs = differences.first()?.len();
        let mut calm = vec![true; pairs];
        for _ in 0..ROUNDS {
            let is_calm = |pair: usize| {
                jumps.iter().zip(&deviations).all(|(of, sd)| of[pair] <= LOOK_AT * sd.value)
            };
            let next: Vec<bool> = (0..pairs).map(is_calm).collect();
            for (of, deviation) in differences.iter().zip(&mut deviations) {
                deviation.of_calm(of, &next);
            }
            if std::mem::replace(&mut calm, next) == calm {
                break;
            }
        }
        let scale = |of: &Deviation| if of.value > 0.0 { of.value.recip() } else { 0.0 };
        let scale: Vec<f64> = deviations.iter().map(scale).collect();
        let calm: Vec<usize> = (0..pairs).filter(|&pair| calm[pair]).collect();
        if calm.len() < DIFFERENCES_PER_COLUMN * columns {
            return None;
        }
        let weight = (calm.len() as f64).sqrt().recip();
        let scaled = Mat::from_fn(calm.len(), columns, |row, i| {
            weight * scale[i] * differences[i][calm[row]]
        });
        let mut covariance = scaled.transpose() * &scaled;
        (0..columns).for_each(|i| covariance[(i, i)] += if scale[i] > 0.0 { FLOOR } else { 1.0 });
        let inverse = covariance.llt(Side::Lower).ok()?.inverse();
        let unpredicted = Mat::from_fn(columns, columns, |i, j| inverse[(i, j)] / inverse[(i, i)]);
        Some(Self { scale, unpredicted })
    }

    /// The largest jump of each row of some columns; of the first and the last, whose neighbours are not all there, zero.
    pub fn jumps(&self, columns: &[&[f64]]) -> Vec<f64> {
        arch().dispatch(LargestJumps { scale: &self.scale, columns })
    }

    /// Judges a row by the rows before and after.
    pub fn judge(&self, [before, row, after]: [&[f64]; 3]) -> RowJump {
        let differences = |other: &[f64]| -> Vec<f64> {
            let of = |i: usize| (row[i] - other[i]) * self.scale[i];
            (0..row.len()).map(of).collect()
        };
        let (back, forth) = (differences(before), differences(after));
        let unpredicted = |i: usize| {
            let of = |all: &[f64]| -> f64 {
                (0..all.len()).map(|j| self.unpredicted[(i, j)] * all[j]).sum()
            };
            jump(of(&back), of(&forth))
        };
        RowJump {
            jump: back
                .iter()
                .zip(&forth)
                .map(|(&back, &forth)| jump(back, forth))
                .fold(0.0, f64::max),
            unpredicted: (0..row.len()).map(unpredicted).fold(0.0, f64::max),
        }
    }

    /// By how many standard deviations a column jumps.
    pub fn jump_of(&self, column: usize, [before, value, after]: [f64; 3]) -> f64 {
        jump(value - before, value - after) * self.scale[column]
    }
}

/// The standard deviation of differences, as far as it is known.
struct Deviation {
    value: f64,
    /// The smallest difference that there is: a reading that flickers by its last digit is no spike.
    least: f64,
}

impl Deviation {
    /// By the inner differences, as rows that jump are not known yet.
    fn new(differences: &[f64]) -> Self {
        let mut sizes: Vec<f64> = differences.iter().map(|d| d.abs()).collect();
        let least = sizes.iter().copied().filter(|&d| d > 0.0).fold(f64::INFINITY, f64::min);
        let least = if least.is_finite() { least } else { 0.0 };
        let inner = ((INNER * sizes.len() as f64) as usize).min(sizes.len().saturating_sub(1));
        let limit = match sizes.is_empty() {
            true => 0.0,
            false => *sizes.select_nth_unstable_by(inner, f64::total_cmp).1,
        };
        Self { value: (limit / INNER_LIMIT).max(least), least }
    }

    fn of_calm(&mut self, differences: &[f64], calm: &[bool]) {
        let squares = differences.iter().zip(calm).filter(|(_, calm)| **calm).map(|(d, _)| d * d);
        let (sum, count) = squares.fold((0.0, 0), |(sum, count), square| (sum + square, count + 1));
        if count > 0 {
            self.value = (sum / f64::from(count)).sqrt().max(self.least);
        }
    }
}

/// By how much a value is above both others, or below both, from the differences to them; else 0.
#[inline(always)]
fn jump(back: f64, forth: f64) -> f64 {
    let least = |a: f64, b: f64| if a < b { a } else { b };
    let most = |a: f64, b: f64| if a > b { a } else { b };
    most(most(least(back, forth), least(-back, -forth)), 0.0)
}

/// Inlined whole into code for the widest vectors of the processor.
struct LargestJumps<'a> {
    scale: &'a [f64],
    columns: &'a [&'a [f64]],
}

impl NullaryFnOnce for LargestJumps<'_> {
    type Output = Vec<f64>;

    #[inline(always)]
    fn call(self) -> Vec<f64> {
        let rows = self.columns.first().map_or(0, |column| column.len());
        let mut largest = vec![0.0; rows];
        let Some(inner) = rows.checked_sub(2).filter(|&inner| inner > 0) else { return largest };
        for (column, &scale) in self.columns.iter().zip(self.scale) {
            let (before, now, after) =
                (&column[..inner], &column[1..][..inner], &column[2..][..inner]);
            let largest = &mut largest[1..][..inner];
            for i in 0..inner {
                let jump = jump(now[i] - before[i], now[i] - after[i]) * scale;
                largest[i] = if jump > largest[i] { jump } else { largest[i] };
            }
        }
        largest
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use shell_data::random::{Purpose, Stream};

    /// Two channels and a load that follow one motion, with a little noise each.
    fn recording(rows: usize) -> Vec<Vec<f64>> {
        let mut random = Stream::new(7, Purpose::Readings, 0);
        let load: Vec<f64> = (0..rows).map(|row| (0.03 * row as f64).sin()).collect();
        let mut column = |gain: f64, noise: f64| -> Vec<f64> {
            load.iter().map(|load| gain * load + noise * random.normal()).collect()
        };
        vec![column(100.0, 0.3), column(-40.0, 0.3), column(1.0, 0.003)]
    }

    fn found(columns: &[Vec<f64>]) -> Vec<usize> {
        let columns: Vec<&[f64]> = columns.iter().map(Vec::as_slice).collect();
        let changes = RowChanges::new(&[columns.clone()]).unwrap();
        let row = |at: usize| -> Vec<f64> { columns.iter().map(|column| column[at]).collect() };
        let is_suspicious =
            |&at: &usize| changes.judge([&row(at - 1), &row(at), &row(at + 1)]).is_suspicious();
        let jumps = changes.jumps(&columns);
        (1..columns[0].len() - 1).filter(|&at| jumps[at] > JUMP).filter(is_suspicious).collect()
    }

    #[test]
    fn a_spike_of_one_column_is_suspicious_and_a_peak_of_all_is_not() {
        let clean = recording(2000);
        assert_eq!(found(&clean), [0; 0]);
        let mut spiked = clean.clone();
        // Eight standard deviations of neighbouring differences, which are 2 here.
        spiked[0][700] += 16.0;
        spiked[2][1200] -= 0.17;
        assert_eq!(found(&spiked), [700, 1200]);
        let mut tapped = clean;
        for (column, gain) in tapped.iter_mut().zip([100.0, -40.0, 1.0]) {
            column[700] += 0.5 * gain;
        }
        assert_eq!(found(&tapped), [0; 0]);
    }

    #[test]
    fn a_step_is_no_jump_and_spikes_do_not_hide_each_other() {
        let mut columns = recording(2000);
        for (column, gain) in columns.iter_mut().zip([100.0, -40.0, 1.0]) {
            column[1000..].iter_mut().for_each(|value| *value += 5.0 * gain);
        }
        assert_eq!(found(&columns), [0; 0]);
        let places: Vec<usize> = (0..40).map(|i| 20 + 48 * i).collect();
        places.iter().for_each(|&at| columns[1][at] += 4000.0);
        assert_eq!(found(&columns), places);
    }
}
