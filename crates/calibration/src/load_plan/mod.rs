//! Design of calibrations: the choice of the next load.
//!
//! A pose gives the more information, the less is known about its readings. This is computed before it is recorded:
//!
//! | criterion | chosen load, among all that the rig can apply |
//! |---|---|
//! | [`Order::Gain`] | greatest gain of information, `Σᵢ ln(1 + jᵢᵀCᵢjᵢ/vᵢ)` over the sensors; without a model of the sensors, `ln(1 + φᵀCφ)` on the terms φ of [`Surface`]: the D-optimal design, one load at a time |
//! | [`Order::AverageVariance`] | least variance of a wrench afterwards, on average over the range of loads (ALC) |
//!
//! `j` is the gradient of a sensor's response with respect to its parameters, `C` their covariance, and `v` the
//! variance of the response. A rank-one update of `C` follows each load.
//!
//! Sources: Fedorov, Theory of Optimal Experiments, 1972, ch. 3 (exchange and sequential D-optimal designs);
//! DuMouchel & Jones, Technometrics 36, 37, 1994 (D-optimal with a prior on terms of higher order); MacKay, Neural
//! Computation 4, 590, 1992, and Cohn, Neural Networks 9, 1071, 1996 (information gain, and average variance: ALC);
//! for wind-tunnel balances, Parker et al., AIAA 2001-0170.

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

/// Most rows that represent a data set without labels.
const MOST_ROWS: u64 = 2000;

/// Loads of a data set: the mean of the rows of each label; without labels, rows at equal distances.
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
    pub first: Axis,
    pub second: Axis,
    pub correlation: f64,
    /// Candidate that lowers the correlation most, and the result; `None` if none lowers it by a hundredth.
    pub broken_by: Option<(usize, f64)>,
}

/// Couplings of `loads`, with the candidates that would break them.
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
