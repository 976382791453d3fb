//! The most useful next load, where no rig is known: within what was loaded so far.

use std::collections::HashMap;
use std::fmt;

use super::planner::{Planner, PredictedError};
use super::sensors::SensorKnowledge;
use crate::physics::PhysicsModel;
use crate::quality::significant;
use shell_data::dataset::Dataset;
use shell_data::wrench::{Axis, PerAxis};

/// Rows without labels that stand for all, at most.
const MOST_ROWS: usize = 2000;

/// A side of an axis counts as loaded from this share of the larger side.
const SMALL_SIDE: f64 = 0.1;

/// The load that tells most.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UsefulLoad {
    /// N and N·m: one axis or two at the ends of what was loaded, the others at zero.
    pub wrench: PerAxis<f64>,
    /// The share by which it lowers the error to expect over the range of loads.
    pub improvement: f64,
}

impl fmt::Display for UsefulLoad {
    /// `Fx +5.0 N with My −0.20 N·m`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let loaded = Axis::ALL.iter().filter(|axis| self.wrench[axis.index()] != 0.0);
        let said: Vec<String> = loaded
            .map(|axis| {
                let value = self.wrench[axis.index()];
                let sign = if value < 0.0 { '−' } else { '+' };
                format!("{} {sign}{} {}", axis.name(), significant(value.abs(), 2), axis.unit())
            })
            .collect();
        f.write_str(&said.join(" with "))
    }
}

/// The load, of one axis or of two within the ranges of `loads`, that tells most; `None` if nothing was loaded. With
/// a model of the sensors, by what that does not know yet; else by the loads alone.
pub fn most_useful_load(
    loads: &[PerAxis<f64>],
    model: Option<&PhysicsModel>,
) -> Option<UsefulLoad> {
    let candidates = candidates(loads);
    let mut planner = match model {
        Some(model) => {
            Planner::from_sensors(SensorKnowledge::from_model(model), loads, &candidates)
        }
        None => Planner::from_loads(loads, &candidates),
    };
    let size = |error: PredictedError| match error {
        PredictedError::Relative(error) => error,
        PredictedError::Wrench(errors) => {
            // Moments count as forces do: in units of the largest load.
            let largest =
                |axis: usize| loads.iter().map(|load| load[axis].abs()).fold(0.0, f64::max);
            let relative = (0..6).filter(|&axis| largest(axis) > 0.0);
            relative.map(|axis| (errors[axis] / largest(axis)).powi(2)).sum::<f64>().sqrt()
        }
    };
    let before = size(planner.error());
    let next = planner.next()?;
    let improvement = if before > 0.0 { 1.0 - size(next.error) / before } else { 0.0 };
    Some(UsefulLoad { wrench: candidates[next.candidate], improvement })
}

/// One axis or two, at the ends of what was loaded.
fn candidates(loads: &[PerAxis<f64>]) -> Vec<PerAxis<f64>> {
    let ends = |axis: usize| {
        let of = loads.iter().map(|load| load[axis]);
        let (low, high) = of.fold((0.0_f64, 0.0_f64), |(low, high), x| (low.min(x), high.max(x)));
        let least = SMALL_SIDE * high.max(-low);
        [low, high].into_iter().filter(move |end| *end != 0.0 && end.abs() >= least)
    };
    let mut candidates = Vec::new();
    for first in 0..6 {
        for end in ends(first) {
            let mut one = [0.0; 6];
            one[first] = end;
            candidates.push(one);
            for second in first + 1..6 {
                candidates.extend(ends(second).map(|end| {
                    let mut two = one;
                    two[second] = end;
                    two
                }));
            }
        }
    }
    candidates
}

/// The loads of a data set: one for each label, the mean of its rows; without labels, rows at equal distances.
pub fn loads_of_dataset(data: &Dataset) -> Vec<PerAxis<f64>> {
    let total: usize = data.blocks().map(|(_, block)| block.rows.rows).sum();
    let every = total.div_ceil(MOST_ROWS).max(1);
    let (mut positions, mut sums) = (HashMap::new(), Vec::<(PerAxis<f64>, f64)>::new());
    let (mut loads, mut passed) = (Vec::new(), 0);
    for (_, block) in data.blocks() {
        let load = |row: usize| -> PerAxis<f64> {
            std::array::from_fn(|axis| {
                block.rows.wrench.get(axis).map_or(0.0, |column| column[row])
            })
        };
        let mut row = 0;
        for (label, count) in &*block.labels {
            let position = *positions.entry(label.clone()).or_insert(sums.len());
            if position == sums.len() {
                sums.push(([0.0; 6], 0.0));
            }
            for at in row..row + count {
                let load = load(at);
                (0..6).for_each(|axis| sums[position].0[axis] += load[axis]);
                sums[position].1 += 1.0;
            }
            row += count;
        }
        let unlabelled = (row..block.rows.rows).filter(|row| (passed + row) % every == 0);
        loads.extend(unlabelled.map(load));
        passed += block.rows.rows;
    }
    loads.extend(sums.into_iter().map(|(sum, count)| sum.map(|sum| sum / count)));
    loads
}
