//! Axes that were always loaded together, and the load that would tell them apart.

use crate::validation::excitation::{Gap, WrenchSums};
use shell_data::wrench::{Axes, Axis, PerAxis};

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
            let of = sums.excitation()?.correlation[first.index()][second.index()];
            Some(of)
        };
        let all = candidates.iter().enumerate().filter_map(|(at, load)| Some((at, after(load)?)));
        let best = all.min_by(|a, b| a.1.abs().total_cmp(&b.1.abs()));
        let broken_by = best.filter(|(_, after)| after.abs() < correlation.abs() - 0.01);
        Some(Coupling { first, second, correlation, broken_by })
    };
    excitation.gaps(Axes::ALL).into_iter().filter_map(coupling).collect()
}
