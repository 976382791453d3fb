//! Coverage of the six axes by the loads of a recording: a calibration knows nothing about loads
//! that were never applied. Each axis and sign has a range, a root mean square, a share of the
//! rows, and a share of the sum of squares, which distinguishes a real load from noise about zero.
//! The condition number of the correlation matrix of the wrench is 1 if the axes move
//! independently. Some correlation comes from the shell: a push from the side at some height is a
//! force and a moment.

use least_squares::block_ranges::range_of;
use least_squares::reading_ranges::ReadingRange;
use least_squares::symmetric::SymmetricMatrix;
use shell_data::statistics::{MergeWeights, extremes};
use shell_data::vectorised;
use shell_data::wrench::{Axes, Axis, PerAxis};

/// Share of an axis's sum of squares below which a sign counts as hardly loaded.
const SMALL_SHARE: f64 = 0.1;

/// Longest plausible lever: a 10 cm shell has levers of a few cm, an arm of 1 m less than this.
/// A longer lever means that the moments are in another unit.
pub const LONGEST_LEVER_M: f64 = 2.0;

const STRONG_CORRELATION: f64 = 0.9;

/// Mergeable sums over wrenches.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WrenchSums {
    rows: u64,
    axes: PerAxis<AxisSums>,
    mean: PerAxis<f64>,
    /// Sums of products of deviations from the mean, the upper triangle.
    products: PerAxis<PerAxis<f64>>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct AxisSums {
    range: ReadingRange,
    /// Number of rows above and below zero, and their sums of squares.
    signs: [(u64, f64); 2],
}

#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Excitation {
    #[serde(with = "shell_data::by_axis")]
    pub axes: PerAxis<AxisExcitation>,
    /// Correlation of the axes about their means; 0 for an axis that never changes.
    #[serde(with = "shell_data::by_axis::matrix")]
    pub correlation: PerAxis<PerAxis<f64>>,
    /// Condition number of the correlation of the axes that change; `None` if infinite.
    pub condition: Option<f64>,
}

/// Coverage of one axis, N or N·m.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct AxisExcitation {
    pub min: f64,
    pub max: f64,
    pub rms: f64,
    pub rows_positive: f64,
    pub rows_negative: f64,
    /// Contribution of the rows above zero to the sum of squares, 0 to 1; 0 without load.
    pub load_positive: f64,
    pub load_negative: f64,
}

/// A gap in the training loads, with the loads to record.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Gap {
    #[error("{name} never changes: record loads on {name}", name = .0.name())]
    Unloaded(Axis),
    /// Few loads in one direction.
    #[error(
        "few loads towards {sign}{name}: record more, if the sensor will see them",
        name = axis.name(),
        sign = if *positive { '+' } else { '−' }
    )]
    OneSided {
        axis: Axis,
        /// True if loads above zero are missing.
        positive: bool,
        share: f64,
    },
    #[error(
        "{} and {} nearly always move together (correlation {correlation:.2}): record loads that separate \
         them",
        first.name(),
        second.name()
    )]
    Together {
        first: Axis,
        second: Axis,
        /// From −1 to 1.
        correlation: f64,
    },
}

impl WrenchSums {
    /// Sums rows: six columns of one length, N and N·m, finite.
    ///
    /// # Panics
    /// If there are not six columns of one length.
    pub fn new(wrench: &[Vec<f64>]) -> Self {
        assert_eq!(wrench.len(), 6, "columns");
        let rows = wrench[0].len();
        if rows == 0 {
            return Self::default();
        }
        wrench_sums(wrench)
    }

    pub fn merge(&mut self, other: &Self) {
        if other.rows == 0 {
            return;
        }
        if self.rows == 0 {
            *self = *other;
            return;
        }
        let weights = MergeWeights::new(self.rows, other.rows);
        let step: PerAxis<f64> = std::array::from_fn(|a| other.mean[a] - self.mean[a]);
        for a in 0..6 {
            for b in a..6 {
                self.products[a][b] += other.products[a][b] + step[a] * step[b] * weights.product;
            }
            self.mean[a] += step[a] * weights.mean;
            let (own, other) = (&mut self.axes[a], &other.axes[a]);
            own.range.merge(other.range);
            for (own, other) in own.signs.iter_mut().zip(other.signs) {
                *own = (own.0 + other.0, own.1 + other.1);
            }
        }
        self.rows += other.rows;
    }

    /// Coverage of the axes; `None` for zero rows.
    pub fn excitation(&self) -> Option<Excitation> {
        if self.rows == 0 {
            return None;
        }
        let rows = self.rows as f64;
        let axes = self.axes.map(|AxisSums { range, signs: [positive, negative] }| {
            let squares = positive.1 + negative.1;
            let share = |part: f64| if squares > 0.0 { part / squares } else { 0.0 };
            AxisExcitation {
                min: range.min,
                max: range.max,
                rms: (squares / rows).sqrt(),
                rows_positive: positive.0 as f64 / rows,
                rows_negative: negative.0 as f64 / rows,
                load_positive: share(positive.1),
                load_negative: share(negative.1),
            }
        });
        let correlation: PerAxis<PerAxis<f64>> = std::array::from_fn(|a| {
            std::array::from_fn(|b| {
                let both = (self.products[a][a] * self.products[b][b]).sqrt();
                match both > 0.0 {
                    true if a == b => 1.0,
                    true => (self.products[a.min(b)][a.max(b)] / both).clamp(-1.0, 1.0),
                    false => 0.0,
                }
            })
        });
        Some(Excitation { axes, condition: condition(&correlation), correlation })
    }
}

vectorised! {
    fn wrench_sums(wrench: &[Vec<f64>]) -> WrenchSums {
        let rows = wrench[0].len();
        let mut sums = WrenchSums { rows: rows as u64, ..WrenchSums::default() };
        // A loop, because the closure of an array may remain a call without vectors.
        for (axis, column) in wrench.iter().enumerate() {
            let signs = [sign(column, 1.0), sign(column, -1.0)];
            sums.axes[axis] = AxisSums { range: range_of(column), signs };
            sums.mean[axis] = sum(column) / rows as f64;
        }
        let mean = sums.mean;
        for a in 0..6 {
            for b in a..6 {
                let product = |x: f64, y: f64| (x - mean[a]) * (y - mean[b]);
                sums.products[a][b] = lane_sum(&wrench[a], &wrench[b], product);
            }
        }
        sums
    }
}

const LANES: usize = 8;

/// Number of rows above zero after multiplication by `sign`, and their sum of squares. Each has its
/// own loop: the compiler generates branches instead of vectors if one condition follows from
/// another.
#[inline(always)]
fn sign(column: &[f64], sign: f64) -> (u64, f64) {
    let load = |x: f64| if sign * x > 0.0 { sign * x } else { 0.0 };
    let rows = lane_sum(column, column, |x, _| if sign * x > 0.0 { 1.0 } else { 0.0 });
    (rows as u64, lane_sum(column, column, |x, _| load(x) * load(x)))
}

#[inline(always)]
fn lane_sum(x: &[f64], y: &[f64], term: impl Fn(f64, f64) -> f64) -> f64 {
    let mut sums = [0.0; LANES];
    let ((x, x_rest), (y, y_rest)) = (x.as_chunks::<LANES>(), y.as_chunks::<LANES>());
    for (x, y) in x.iter().zip(y) {
        for i in 0..LANES {
            sums[i] += term(x[i], y[i]);
        }
    }
    for (sum, (&x, &y)) in sums.iter_mut().zip(x_rest.iter().zip(y_rest)) {
        *sum += term(x, y);
    }
    sums.iter().sum()
}

#[inline(always)]
fn sum(column: &[f64]) -> f64 {
    let mut sums = [0.0; LANES];
    let (chunks, rest) = column.as_chunks::<LANES>();
    for chunk in chunks {
        for i in 0..LANES {
            sums[i] += chunk[i];
        }
    }
    sums.iter().chain(rest).sum()
}

impl Excitation {
    /// Ratio of moments to forces, m; `None` without forces.
    pub fn lever_m(&self) -> Option<f64> {
        let square =
            |axes: &[AxisExcitation]| axes.iter().map(|axis| axis.rms.powi(2)).sum::<f64>();
        let (forces, moments) = (square(&self.axes[..3]), square(&self.axes[3..]));
        (forces > 0.0).then(|| (moments / forces).sqrt())
    }

    /// Largest load of each axis in either direction, N and N·m.
    pub fn largest_loads(&self) -> PerAxis<f64> {
        self.axes.map(|axis| axis.max.abs().max(axis.min.abs()))
    }

    pub fn gaps(&self, axes: Axes) -> Vec<Gap> {
        let mut gaps = Vec::new();
        for axis in axes.iter() {
            let of = &self.axes[axis.index()];
            if of.min == of.max {
                gaps.push(Gap::Unloaded(axis));
                continue;
            }
            for (positive, share) in [(true, of.load_positive), (false, of.load_negative)] {
                if share < SMALL_SHARE {
                    gaps.push(Gap::OneSided { axis, positive, share });
                }
            }
        }
        for first in axes.iter() {
            for second in axes.iter().filter(|second| second.index() > first.index()) {
                let correlation = self.correlation[first.index()][second.index()];
                if correlation.abs() > STRONG_CORRELATION {
                    gaps.push(Gap::Together { first, second, correlation });
                }
            }
        }
        gaps
    }
}

fn condition(correlation: &PerAxis<PerAxis<f64>>) -> Option<f64> {
    let moving: Vec<usize> = (0..6).filter(|&a| correlation[a][a] > 0.0).collect();
    let matrix = SymmetricMatrix::from_fn(moving.len(), |i, j| correlation[moving[i]][moving[j]]);
    let (smallest, largest) = extremes(matrix.eigen()?.values);
    // The relative uncertainty of eigenvalues of a 6 × 6 matrix.
    (smallest > 1e-14 * largest).then(|| largest / smallest)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn columns(rows: usize, of: impl Fn(usize, usize) -> f64) -> Vec<Vec<f64>> {
        (0..6).map(|axis| (0..rows).map(|row| of(axis, row)).collect()).collect()
    }

    fn wave(axis: usize, row: usize) -> f64 {
        (std::f64::consts::TAU * (axis + 1) as f64 * (row as f64 + 0.25) / 64.0).sin()
    }

    #[test]
    fn loads_both_ways_on_independent_axes_leave_no_gap() {
        let excitation = WrenchSums::new(&columns(64, wave)).excitation().unwrap();
        assert!(excitation.gaps(Axes::ALL).is_empty());
        // Rounding of 64 sines.
        assert!((excitation.condition.unwrap() - 1.0).abs() < 1e-13);
        for axis in excitation.axes {
            assert!((axis.rms - 0.5f64.sqrt()).abs() < 1e-14);
            assert!((axis.rows_positive - 0.5).abs() < 0.05);
            assert!((axis.load_positive + axis.load_negative - 1.0).abs() < 1e-15);
        }
    }

    #[test]
    fn axes_without_loads_with_one_sign_or_coupled_are_named() {
        let wrench = columns(64, |axis, row| match axis {
            1 => 0.0,
            2 => -wave(2, row).abs(),
            4 => 3.0 * wave(0, row) + 0.01 * wave(4, row),
            _ => wave(axis, row),
        });
        let excitation = WrenchSums::new(&wrench).excitation().unwrap();
        let [Gap::Unloaded(Axis::Fy), fz, together] = excitation.gaps(Axes::ALL)[..] else {
            panic!()
        };
        assert_eq!(fz, Gap::OneSided { axis: Axis::Fz, positive: true, share: 0.0 });
        let Gap::Together { first: Axis::Fx, second: Axis::My, correlation } = together else {
            panic!()
        };
        assert!(correlation > 0.9999);
        assert!(excitation.condition.unwrap() > 1e4);
        assert!(excitation.axes[2].max <= 0.0 && excitation.axes[2].rows_positive == 0.0);
    }

    #[test]
    fn parts_merge_to_the_whole() {
        let wrench = columns(61, |axis, row| wave(axis, row) + axis as f64);
        let whole = WrenchSums::new(&wrench).excitation().unwrap();
        let mut merged = WrenchSums::default();
        for rows in [0..7, 7..7, 7..40, 40..61] {
            let part: Vec<Vec<f64>> = wrench.iter().map(|c| c[rows.clone()].to_vec()).collect();
            merged.merge(&WrenchSums::new(&part));
        }
        let merged = merged.excitation().unwrap();
        for (a, b) in std::iter::zip(merged.axes, whole.axes) {
            assert_eq!((a.min, a.max, a.rows_positive), (b.min, b.max, b.rows_positive));
            assert!((a.rms - b.rms).abs() < 1e-14 * b.rms);
        }
        assert!((merged.condition.unwrap() / whole.condition.unwrap() - 1.0).abs() < 1e-12);
        assert_eq!(WrenchSums::default().excitation(), None);
    }
}
