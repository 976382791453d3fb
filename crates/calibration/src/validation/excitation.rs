//! How well the loads of a recording cover the six axes.
//!
//! A calibration cannot know what was never pressed. Per axis and sign: the range, the root mean
//! square, the share of rows, and the share of the sum of squares, which tells a real load from
//! noise about zero. Across axes: the condition number of the correlation matrix of the wrench
//! about its mean, 1 where the axes move independently. Some correlation is the shell's own: a
//! push from the side at some height is a force and a moment.

use crate::symmetric::SymmetricMatrix;
use shell_data::statistics::MergeWeights;
use shell_data::vectorised;
use shell_data::wrench::{Axes, Axis, PerAxis};

/// The share of an axis's sum of squares below which a sign counts as hardly loaded.
const SMALL_SHARE: f64 = 0.1;

/// A shell of 10 cm has levers of a few cm, an arm of 1 m less than this; moments of a longer one are in another unit.
pub const LONGEST_LEVER_M: f64 = 2.0;

/// Correlation from which two axes count as moving together.
const STRONG_CORRELATION: f64 = 0.9;

/// Sums over wrenches. Merge with those over other rows.
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
    min: f64,
    max: f64,
    positive: Sign,
    negative: Sign,
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Sign {
    rows: u64,
    squares: f64,
}

/// How well the training loads cover the six axes.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Excitation {
    /// Per axis.
    #[serde(with = "shell_data::by_axis")]
    pub axes: PerAxis<AxisExcitation>,
    /// Correlation of the axes about their means; 0 for an axis that never changes.
    #[serde(with = "shell_data::by_axis::matrix")]
    pub correlation: PerAxis<PerAxis<f64>>,
    /// Condition number of the correlation of the axes that change; `None` if infinite.
    pub condition: Option<f64>,
}

/// How well one axis is covered, N or N·m.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct AxisExcitation {
    /// The smallest value.
    pub min: f64,
    /// The largest value.
    pub max: f64,
    /// Root mean square.
    pub rms: f64,
    /// Share of rows above zero.
    pub rows_positive: f64,
    /// Share of rows below zero.
    pub rows_negative: f64,
    /// What the rows above zero contribute to the sum of squares, 0 to 1; 0 without load.
    pub load_positive: f64,
    /// What the rows below zero contribute.
    pub load_negative: f64,
}

/// What is missing from the training loads, and what to record.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Gap {
    /// An axis that never changes.
    #[error("{name} never changes: record loads on {name}", name = .0.name())]
    Unloaded(Axis),
    /// An axis that is hardly loaded one way: upwards if `positive`.
    #[error(
        "{name} is hardly loaded towards {sign}{name} ({:.1} % of its square sum): record such loads if the sensor will \
         see them",
        100.0 * share,
        name = axis.name(),
        sign = if *positive { '+' } else { '−' }
    )]
    OneSided {
        /// The axis.
        axis: Axis,
        /// Whether loads above zero are missing.
        positive: bool,
        /// Their share of the sum of squares.
        share: f64,
    },
    /// Two axes that nearly always move together.
    #[error(
        "{} and {} nearly always move together (correlation {correlation:.2}): record loads that tell them apart",
        first.name(),
        second.name()
    )]
    Together {
        /// One axis.
        first: Axis,
        /// The other.
        second: Axis,
        /// Their correlation.
        correlation: f64,
    },
}

impl WrenchSums {
    /// Of some rows: six columns of the same length, N and N·m, finite.
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

    /// Adds the rows of `other`.
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
            self.axes[a].merge(&other.axes[a]);
        }
        self.rows += other.rows;
    }

    /// The figures; `None` for zero rows.
    pub fn excitation(&self) -> Option<Excitation> {
        if self.rows == 0 {
            return None;
        }
        let rows = self.rows as f64;
        let axes = self.axes.map(|axis| {
            let squares = axis.positive.squares + axis.negative.squares;
            let share = |part: f64| if squares > 0.0 { part / squares } else { 0.0 };
            AxisExcitation {
                min: axis.min,
                max: axis.max,
                rms: (squares / rows).sqrt(),
                rows_positive: axis.positive.rows as f64 / rows,
                rows_negative: axis.negative.rows as f64 / rows,
                load_positive: share(axis.positive.squares),
                load_negative: share(axis.negative.squares),
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
    /// [`WrenchSums::new`] of at least one row.
    fn wrench_sums(wrench: &[Vec<f64>]) -> WrenchSums {
        let rows = wrench[0].len();
        let mut sums = WrenchSums { rows: rows as u64, ..WrenchSums::default() };
        // A loop: the closure of an array may stay a call, and then knows nothing of vectors.
        for (axis, column) in wrench.iter().enumerate() {
            sums.axes[axis] = AxisSums::new(column);
            sums.mean[axis] = sum(column) / rows as f64;
        }
        sums.products = products(wrench, &sums.mean);
        sums
    }
}

/// Interleaved sums.
const LANES: usize = 8;

impl Sign {
    /// Of what is above zero after it is multiplied by `sign`; zeros are on neither side.
    ///
    /// A loop for each sum and each side: where the compiler sees that one condition follows from another, it
    /// makes branches of them, and no vectors.
    #[inline(always)]
    fn new(column: &[f64], sign: f64) -> Self {
        let load = |x: f64| if sign * x > 0.0 { sign * x } else { 0.0 };
        let squares = lane_sum(column, |x| load(x) * load(x));
        let rows = lane_sum(column, |x| if sign * x > 0.0 { 1.0 } else { 0.0 });
        Self { rows: rows as u64, squares }
    }
}

/// The sum over a column of what `term` makes of its values.
#[inline(always)]
fn lane_sum(column: &[f64], term: impl Fn(f64) -> f64) -> f64 {
    let mut sums = [0.0; LANES];
    let (chunks, rest) = column.as_chunks::<LANES>();
    for chunk in chunks {
        for i in 0..LANES {
            sums[i] += term(chunk[i]);
        }
    }
    for (sum, &x) in sums.iter_mut().zip(rest) {
        *sum += term(x);
    }
    sums.iter().sum()
}

impl AxisSums {
    #[inline(always)]
    fn new(column: &[f64]) -> Self {
        Self {
            // A pass for each: compiled together, they are shuffled through one vector.
            min: first_of(column, |x, min| x < min),
            max: first_of(column, |x, max| x > max),
            positive: Sign::new(column, 1.0),
            negative: Sign::new(column, -1.0),
        }
    }

    fn merge(&mut self, other: &Self) {
        self.min = self.min.min(other.min);
        self.max = self.max.max(other.max);
        for (own, other) in
            [(&mut self.positive, other.positive), (&mut self.negative, other.negative)]
        {
            own.rows += other.rows;
            own.squares += other.squares;
        }
    }
}

impl Excitation {
    /// The moments over the forces, m; `None` without forces.
    pub fn lever_m(&self) -> Option<f64> {
        let square =
            |axes: &[AxisExcitation]| axes.iter().map(|axis| axis.rms.powi(2)).sum::<f64>();
        let (forces, moments) = (square(&self.axes[..3]), square(&self.axes[3..]));
        (forces > 0.0).then(|| (moments / forces).sqrt())
    }

    /// The largest load of each axis, either way, N and N·m.
    pub fn largest_loads(&self) -> PerAxis<f64> {
        self.axes.map(|axis| axis.max.abs().max(axis.min.abs()))
    }

    /// What is missing on these axes.
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

/// The value of a column that comes before all others, by an order.
#[inline(always)]
fn first_of(column: &[f64], is_before: impl Fn(f64, f64) -> bool) -> f64 {
    let first = |a: f64, b: f64| if is_before(a, b) { a } else { b };
    let mut lanes = [column[0]; LANES];
    let (chunks, rest) = column.as_chunks::<LANES>();
    for chunk in chunks {
        for i in 0..LANES {
            lanes[i] = first(chunk[i], lanes[i]);
        }
    }
    lanes.iter().chain(rest).copied().fold(column[0], first)
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

/// Sums of products of deviations from the means, the upper triangle.
#[inline(always)]
fn products(wrench: &[Vec<f64>], mean: &PerAxis<f64>) -> PerAxis<PerAxis<f64>> {
    let mut sums = [[0.0; 6]; 6];
    for a in 0..6 {
        for b in a..6 {
            let mut lanes = [0.0; LANES];
            let ((x, x_rest), (y, y_rest)) = (wrench[a].as_chunks(), wrench[b].as_chunks());
            for (x, y) in x.iter().zip(y) {
                let (x, y): (&[f64; LANES], &[f64; LANES]) = (x, y);
                for i in 0..LANES {
                    lanes[i] += (x[i] - mean[a]) * (y[i] - mean[b]);
                }
            }
            for (lane, (x, y)) in lanes.iter_mut().zip(x_rest.iter().zip(y_rest)) {
                *lane += (x - mean[a]) * (y - mean[b]);
            }
            sums[a][b] = lanes.iter().sum();
        }
    }
    sums
}

fn condition(correlation: &PerAxis<PerAxis<f64>>) -> Option<f64> {
    let moving: Vec<usize> = (0..6).filter(|&a| correlation[a][a] > 0.0).collect();
    let matrix = SymmetricMatrix::from_fn(moving.len(), |i, j| correlation[moving[i]][moving[j]]);
    let values = matrix.eigen()?.values;
    let (smallest, largest) =
        (values.iter().copied().reduce(f64::min)?, values.iter().copied().reduce(f64::max)?);
    // Eigenvalues of a 6 × 6 matrix are this uncertain.
    (smallest > 1e-14 * largest).then(|| largest / smallest)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn columns(rows: usize, of: impl Fn(usize, usize) -> f64) -> Vec<Vec<f64>> {
        (0..6).map(|axis| (0..rows).map(|row| of(axis, row)).collect()).collect()
    }

    /// Orthogonal waves: a full number of periods each.
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
    fn what_is_missing_is_named() {
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
