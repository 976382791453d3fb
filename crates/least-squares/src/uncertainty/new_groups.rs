//! Intervals of polynomials from held-out groups. The score of a group is the mean of its errors, in standard errors,
//! and the scatter around that mean, which is assumed normal. Errors and standard errors come from the fit without the
//! group. [`GroupIntervals`] derives intervals from the scores.

use super::group_intervals::{GroupIntervals, GroupScore};
use crate::exact::ExactSums;
use crate::held_out_errors::HeldOutErrors;
use crate::model::Model;
use crate::passes::{Workers, map};
use crate::sandwich::GroupScatter;
use shell_data::wrench::PerAxis;

/// Maximum number of groups with scores. For more, the scatter of the groups and the shape of the training errors
/// suffice (95 % intervals contain 95.0 to 95.7 % of the sensor model's errors from 60 groups on), and fits take long.
pub(super) const MOST_GROUPS: usize = 50;

/// The intervals from the `score` of each group; `None` if there are too many, or only one.
pub(super) fn of_scores(
    groups: usize,
    workers: Workers<'_>,
    score: impl Fn(usize) -> Option<GroupScore> + Sync,
) -> Option<GroupIntervals> {
    if !(2..=MOST_GROUPS).contains(&groups) {
        return None;
    }
    let unknown = [(f64::INFINITY, 0.0); 6];
    // Only [`Workers::watch`] can stop this; the next pass over the rows reports it.
    let groups: Vec<_> = (0..groups).collect();
    let scores = map(&groups, workers, |&group| Ok(score(group).unwrap_or(unknown))).ok()?;
    Some(GroupIntervals::from_groups(&scores))
}

/// Mean and scatter of a group's errors, in standard errors of the fit to all others; `None` if there is no such fit.
pub(super) fn score_without(
    total: &ExactSums,
    groups: &[(String, ExactSums)],
    (model, ridge): (&Model, f64),
    group: usize,
) -> Option<GroupScore> {
    let held_out = &groups[group..=group];
    let fit = total.without(&held_out[0].1).solve(model, ridge).ok()?;
    let others = groups[..group].iter().chain(&groups[group + 1..]);
    let scatter = fit.scatter(others, false).ok()?;
    let (errors, variances) = (fit.errors_on(&held_out[0].1), fit.variances(&scatter, held_out));
    Some(score_of(&errors, &variances[0], &scatter, fit.solution.rows))
}

/// Score of a group in the fit to `rows` other rows. `variance` is the part due to the coefficients.
pub(crate) fn score_of(
    errors: &PerAxis<HeldOutErrors>,
    variance: &PerAxis<f64>,
    scatter: &GroupScatter,
    rows: u64,
) -> GroupScore {
    let residual = scatter.residual_covariance(rows);
    std::array::from_fn(|axis| {
        let errors = &errors[axis];
        let rows = errors.rows.max(1) as f64;
        let (mean, square) = (errors.sum / rows, errors.squares / rows);
        let unit = (residual[axis][axis] + variance[axis]).sqrt();
        // An axis without errors has zero scores.
        let score = |value: f64| if unit > 0.0 { value / unit } else { 0.0 };
        (score(mean.abs()), score((square - mean * mean).max(0.0).sqrt()))
    })
}

#[cfg(test)]
mod tests {
    use super::super::{CoefficientCovariance, Covariance};
    use super::*;
    use crate::features::LANES;
    use crate::model::Basis;
    use crate::polynomial::Polynomial;
    use crate::validation::grouped::{Apart, GroupSums, RandomSplit, SumsByGroup};
    use shell_data::block::Block;
    use system_tests::random::Random;

    fn noise(i: usize) -> f64 {
        2.0 * Random(i as u64).unit() - 1.0
    }

    /// Two channels. Nine tenths of the error of a group are common to its rows.
    fn block(groups: usize) -> Block {
        let rows = 12 * groups;
        let reading = |c: usize, row: usize| {
            (2000.0 + 800.0 * noise(row / 12 * 7 + c) + 20.0 * noise(row * 3 + c)).round()
        };
        let readings: Vec<Vec<f64>> =
            (0..2).map(|c| (0..rows).map(|row| reading(c, row)).collect()).collect();
        let load = |axis: usize, row: usize| {
            0.01 * readings[axis % 2][row]
                + noise(row / 12 * 13 + axis + 500)
                + 0.1 * noise(row * 29 + axis)
        };
        Block {
            rows,
            wrench: (0..6).map(|axis| (0..rows).map(|row| load(axis, row)).collect()).collect(),
            readings,
            groups: (0..groups).map(|group| (group.to_string(), 12)).collect(),
            ..Block::default()
        }
    }

    fn sums(block: &Block) -> SumsByGroup {
        let mut sums = GroupSums::new(Basis::Linear, 2, Apart::Groups, RandomSplit::default());
        let mut worker = sums.worker();
        sums.add(worker.add(block, &block.groups).unwrap()).unwrap();
        sums.finish([worker]).unwrap()
    }

    /// Variances of predictions: the variance of a row plus the contribution of the coefficients.
    fn variances(
        polynomial: &Polynomial,
        covariance: &Covariance,
        rows: &Block,
    ) -> PerAxis<Vec<f64>> {
        let CoefficientCovariance::Groups { factors, .. } = &covariance.coefficients else {
            panic!("a covariance by groups");
        };
        let mut lanes = vec![[0.0; LANES]; polynomial.features.len()];
        std::array::from_fn(|axis| {
            let variance = |row: usize| {
                polynomial.features.lanes(&rows.readings, row - row % LANES, &mut lanes);
                let product = |column: &Vec<f64>| {
                    lanes.iter().zip(column).map(|(x, f)| x[row % LANES] * f).sum::<f64>()
                };
                let spread: f64 = factors[axis].iter().map(|column| product(column).powi(2)).sum();
                covariance.residual[axis][axis] + spread
            };
            (0..rows.rows).map(variance).collect()
        })
    }

    #[test]
    fn scores_equal_those_of_fits_to_the_other_rows() {
        let model = Model { basis: Basis::Linear, intercept: true, channels: 2, memory: 0 };
        let block = block(12);
        let grouped = sums(&block);
        for group in [0, 7] {
            let total = grouped.total().unwrap();
            let found = score_without(total, &grouped.groups, (&model, 0.0), group).unwrap();
            let is_in = |row: usize| row / 12 == group;
            let rest = block.kept(&(0..block.rows).map(|row| !is_in(row)).collect::<Vec<_>>());
            let part = block.kept(&(0..block.rows).map(is_in).collect::<Vec<_>>());
            let rest = sums(&rest);
            let total = rest.total().unwrap();
            let solution = total.solve(&model, 0.0).unwrap().solution;
            let c = &solution.coefficients;
            let rows = (0..c.nrows()).map(|j| std::array::from_fn(|axis| c[(j, axis)]));
            let polynomial = Polynomial::new(model, solution.scaling.clone(), rows.collect());
            let covariance = Covariance::from_groups(&rest, &model, 0.0, false, Workers::ONE);
            let covariance = covariance.unwrap();
            let mut wrench = PerAxis::default();
            polynomial.wrench(&part.readings, part.rows, &mut wrench);
            let variances = variances(&polynomial, &covariance, &part);
            for axis in 0..6 {
                let off: Vec<f64> =
                    wrench[axis].iter().zip(&part.wrench[axis]).map(|(a, b)| a - b).collect();
                let mean = off.iter().sum::<f64>() / 12.0;
                let scatter = (off.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / 12.0).sqrt();
                let unit = variances[axis].iter().sum::<f64>() / 12.0;
                let expected = (mean.abs() / unit.sqrt(), scatter / unit.sqrt());
                // The condition number is below 100, squared in double precision.
                assert!((found[axis].0 / expected.0 - 1.0).abs() < 1e-9, "{found:?} {expected:?}");
                assert!((found[axis].1 / expected.1 - 1.0).abs() < 1e-9, "{found:?} {expected:?}");
            }
        }
    }

    #[test]
    fn the_scatter_of_all_blocks_replaces_a_missing_one() {
        let model = Model { basis: Basis::Linear, intercept: true, channels: 2, memory: 0 };
        let sums = sums(&block(40));
        let intervals = |are_time_blocks: bool| {
            let found = Covariance::from_groups(&sums, &model, 0.0, are_time_blocks, Workers::ONE);
            found.unwrap().intervals.unwrap()
        };
        let (all, without) = (intervals(true), intervals(false));
        let (all, without) = (all.factors(0.95).unwrap(), without.factors(0.95).unwrap());
        for (all, without) in all.into_iter().zip(without) {
            // One block of time has a fortieth of the variance; with an error of two standard errors, a tenth.
            assert!(all <= without && all > 0.94 * without, "{all} {without}");
        }
    }

    #[test]
    fn many_groups_give_all_levels_and_few_give_low_ones() {
        let model = Model { basis: Basis::Linear, intercept: true, channels: 2, memory: 0 };
        let of = |groups| {
            let sums = sums(&block(groups));
            Covariance::from_groups(&sums, &model, 0.0, false, Workers::ONE).unwrap().intervals
        };
        assert_eq!(of(MOST_GROUPS + 1), None);
        assert!(of(MOST_GROUPS).unwrap().factors(0.95).is_ok());
        let few = of(12).unwrap();
        assert!(few.factors(0.9).is_ok() && few.factors(0.95).is_err());
    }
}
