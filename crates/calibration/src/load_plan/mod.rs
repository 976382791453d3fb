//! Which load to hang next: designs of calibrations.
//!
//! A further pose tells the more, the less is known of what it would show. That does not depend on its readings, so it
//! is known before it is recorded:
//!
//! | criterion | of all loads that the rig can do, take the one |
//! |---|---|
//! | [`Order::Gain`] | with the greatest gain of information, `Σᵢ ln(1 + jᵢᵀCᵢjᵢ/vᵢ)` over the sensors; with no model of them, `ln(1 + φᵀCφ)` on the terms φ of [`Surface`]: the D-optimal design, one load at a time |
//! | [`Order::AverageVariance`] | after which the variance of a wrench is least on average over the range of loads (ALC) |
//!
//! `j` is the gradient of a sensor's answer by its parameters, `C` the covariance of these, `v` the variance of its
//! answer. After each load `C` is what it will be when that is recorded, by a rank-one change.
//!
//! Sources: Fedorov, Theory of Optimal Experiments, 1972, ch. 3 (exchange and sequential D-optimal designs);
//! DuMouchel & Jones, Technometrics 36, 37, 1994 (D-optimal with a prior on terms of higher order); MacKay, Neural
//! Computation 4, 590, 1992, and Cohn, Neural Networks 9, 1071, 1996 (information gain, and average variance: ALC).
//! Wind-tunnel balances are calibrated so: Parker et al., AIAA 2001-0170.

mod planner;
mod replay;
#[cfg(test)]
mod tests;

pub use self::planner::{Order, PlannedLoad, Planner, PredictedError, SensorKnowledge, Surface};
pub use self::replay::{Replay, ReplayError, ReplayOptions};

use crate::validation::excitation::{Gap, WrenchSums};
use least_squares::grouped_rows::{GroupedRows, Run, count};
use shell_data::dataset::Dataset;
use shell_data::wrench::{Axes, Axis, PerAxis};

/// Rows without labels that stand for all, at most.
const MOST_ROWS: u64 = 2000;

/// The loads of a data set: one for each label, the mean of its rows; without labels, rows at equal distances.
pub fn loads_of_dataset(data: &Dataset) -> Vec<PerAxis<f64>> {
    let (rows, labels) = GroupedRows::from_labels(data);
    if labels.is_empty() {
        let every = data.rows().div_ceil(MOST_ROWS).max(1) as usize;
        let loads = data.blocks().flat_map(|(_, block)| {
            let rows = &*block.rows;
            (0..rows.rows).map(|row| std::array::from_fn(|axis| rows.wrench[axis][row]))
        });
        return loads.step_by(every).collect();
    }
    let mean = |runs: &[Run]| {
        let sum = |axis| rows.column(runs, axis).fold(0.0, |sum, load| sum + load);
        std::array::from_fn(|axis| sum(axis) / count(runs) as f64)
    };
    rows.groups().map(mean).collect()
}

/// Two axes that nearly always moved together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coupling {
    /// One axis.
    pub first: Axis,
    /// The other.
    pub second: Axis,
    /// Their correlation.
    pub correlation: f64,
    /// The candidate that lowers it most, and the correlation after it; `None` where none lowers it by a hundredth.
    pub broken_by: Option<(usize, f64)>,
}

/// The couplings of `loads`, with what would break them.
pub fn couplings(loads: &[PerAxis<f64>], candidates: &[PerAxis<f64>]) -> Vec<Coupling> {
    let columns = |of: &[PerAxis<f64>]| -> Vec<Vec<f64>> {
        (0..6).map(|axis| of.iter().map(|load| load[axis]).collect()).collect()
    };
    let sums = WrenchSums::new(&columns(loads));
    let Some(excitation) = sums.excitation() else { return Vec::new() };
    let coupling = |gap: Gap| {
        let Gap::Together { first, second, correlation } = gap else { return None };
        let after = |candidate: &PerAxis<f64>| {
            let mut sums = sums;
            sums.merge(&WrenchSums::new(&columns(&[*candidate])));
            Some(sums.excitation()?.correlation[first.index()][second.index()])
        };
        let all = candidates.iter().enumerate().filter_map(|(at, load)| Some((at, after(load)?)));
        let best = all.min_by(|a, b| a.1.abs().total_cmp(&b.1.abs()));
        let broken_by = best.filter(|(_, after)| after.abs() < correlation.abs() - 0.01);
        Some(Coupling { first, second, correlation, broken_by })
    };
    excitation.gaps(Axes::ALL).into_iter().filter_map(coupling).collect()
}
