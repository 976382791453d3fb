//! Intervals from errors on held-out groups.
//!
//! A group is one observation, however many rows it has. The score of a row is its error in standard errors. Each of G
//! groups has the mass `1/(G + 1)`, spread evenly over its rows. The remaining mass, for a new group, is at infinity.
//! The quantile of level L covers the score of a row of a new group with a probability of at least L, for any
//! distribution of errors, if groups are exchangeable (Lee, Barber & Willett, arXiv:2306.06342, hierarchical conformal
//! prediction; Lei et al., J. Am. Stat. Assoc. 113, 2018, §2.2 and 5.2, with one row per group). Models trained without
//! a fold, instead of without a single group, give intervals that cover nearly the same.

use std::collections::{BTreeMap, BTreeSet};

use super::quantile::{normal_quantile, student_quantile};
use shell_data::wrench::PerAxis;
use statrs::distribution::{ContinuousCDF, Normal};

/// The levels that are kept. For a level in between, the next higher one is used.
pub const LEVELS: [f64; 10] = [0.5, 0.683, 0.8, 0.9, 0.95, 0.975, 0.99, 0.995, 0.998, 0.999];

/// Numbers of standard errors that contain given fractions of the errors on new groups.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct GroupIntervals {
    pub groups: usize,
    /// [`LEVELS`] for which there are enough groups.
    pub levels: Vec<f64>,
    /// Number of standard errors, per axis and level.
    #[serde(with = "shell_data::by_axis")]
    pub factors: PerAxis<Vec<f64>>,
}

/// The level is too high for the number of groups.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error(
    "an interval of {} % needs `{needed}` held-out groups or blocks of time, there are `{groups}`",
    100.0 * level
)]
pub struct TooFewGroups {
    pub level: f64,
    pub needed: usize,
    pub groups: usize,
}

/// Mean and scatter of the errors of a group, in standard errors.
pub(crate) type GroupScore = PerAxis<(f64, f64)>;

/// Scores of rows, by group.
#[derive(Clone, Debug, Default)]
pub struct Scores(BTreeMap<u64, PerAxis<Vec<f64>>>);

impl Scores {
    /// Adds a row: the error and the standard error of each axis, in N and N·m.
    pub fn add(&mut self, group: u64, error: &PerAxis<f64>, standard_error: &PerAxis<f64>) {
        let scores = self.0.entry(group).or_default();
        for (axis, scores) in scores.iter_mut().enumerate() {
            let score = (error[axis] / standard_error[axis]).abs();
            scores.push(if score.is_nan() { f64::INFINITY } else { score });
        }
    }

    pub fn without(&self, groups: &BTreeSet<u64>) -> Self {
        let others = self.0.iter().filter(|(group, _)| !groups.contains(group));
        Self(others.map(|(&group, scores)| (group, scores.clone())).collect())
    }

    /// Divides the scores of each axis by their root mean square, with equal weights of groups; the
    /// existing standard errors count as `prior` groups with a mean square of one. Returns the
    /// divisors.
    pub fn rescale(&mut self, prior: f64) -> PerAxis<f64> {
        let count = prior + self.0.len() as f64;
        let mean_square = |scores: &Vec<f64>| {
            scores.iter().map(|score| score * score).sum::<f64>() / scores.len() as f64
        };
        std::array::from_fn(|axis| {
            let squares = self.0.values().map(|of| mean_square(&of[axis]));
            let sum: f64 = squares.filter(|square| square.is_finite()).sum();
            let scale = ((prior + sum) / count).sqrt();
            self.0.values_mut().flat_map(|of| &mut of[axis]).for_each(|score| *score /= scale);
            scale
        })
    }

    pub fn intervals(&self) -> GroupIntervals {
        let groups = self.0.len();
        let levels = levels_known(groups);
        let factors = std::array::from_fn(|axis| {
            let mut scores = Vec::new();
            for of_group in self.0.values() {
                let mass = ((groups + 1) as f64 * of_group[axis].len() as f64).recip();
                scores.extend(of_group[axis].iter().map(|&score| (score, mass)));
            }
            scores.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
            quantiles(&scores, &levels)
        });
        GroupIntervals { groups, levels, factors }
    }
}

/// The size at a level, interpolated linearly between the levels `k/(G + 1)` that G groups provide.
fn size_between(scores: &[GroupScore], axis: usize, level: f64) -> f64 {
    let mass = (scores.len() + 1) as f64;
    let below = (level * mass + 1e-9).floor();
    let share = (level * mass - below).max(0.0);
    let low = size_that_holds(scores, axis, below / mass);
    match share > 1e-9 {
        true => low + share * (size_that_holds(scores, axis, (below + 1.0) / mass) - low),
        false => low,
    }
}

/// The smallest size that contains the errors of a new group with a probability of `level`.
fn size_that_holds(scores: &[GroupScore], axis: usize, level: f64) -> f64 {
    let normal = Normal::standard();
    let within = |size: f64, (mean, scatter): (f64, f64)| match scatter > 0.0 {
        true => normal.cdf((size - mean) / scatter) - normal.cdf((-size - mean) / scatter),
        false => f64::from(u8::from(mean <= size)),
    };
    let mass = |size: f64| {
        let held: f64 = scores.iter().map(|score| within(size, score[axis])).sum();
        held / (scores.len() + 1) as f64
    };
    // Eight standard deviations contain all but 10⁻¹⁵.
    let reach = |score: &GroupScore| score[axis].0 + 8.0 * score[axis].1;
    let sizes = scores.iter().map(reach).filter(|size| size.is_finite());
    let (mut below, mut at) = (0.0, sizes.fold(0.0, f64::max));
    if mass(at) < level - 1e-9 {
        return f64::INFINITY;
    }
    for _ in 0..60 {
        let middle = 0.5 * (below + at);
        if mass(middle) < level - 1e-9 { below = middle } else { at = middle }
    }
    at
}

/// Share of the variance that lies between files: the intraclass correlation of the analysis of
/// variance (Searle, Casella & McCulloch, Variance Components, 1992, §3.6), from 0 to 1.
fn share_between(files: &[Vec<f64>]) -> f64 {
    let sizes = || files.iter().map(|file| file.len() as f64);
    let (n, count) = (sizes().sum::<f64>(), files.len() as f64);
    let mean = files.iter().flatten().sum::<f64>() / n;
    let (mut between, mut within) = (0.0, 0.0);
    for file in files {
        let own = file.iter().sum::<f64>() / file.len() as f64;
        between += file.len() as f64 * (own - mean).powi(2);
        within += file.iter().map(|value| (value - own).powi(2)).sum::<f64>();
    }
    let (between, within) = (between / (count - 1.0), within / (n - count).max(1.0));
    let usual = (n - sizes().map(|size| size * size).sum::<f64>() / n) / (count - 1.0);
    let share = (between - within) / (between + (usual - 1.0) * within);
    if share.is_finite() { share.clamp(0.0, 1.0) } else { 0.0 }
}

/// The smallest G with `G/(G + 1) ≥ level`.
fn groups_needed(level: f64) -> usize {
    // A level such as 0.95 has a rounding error.
    (level / (1.0 - level) - 1e-9).ceil() as usize
}

/// The [`LEVELS`] for which there are enough groups.
fn levels_known(groups: usize) -> Vec<f64> {
    LEVELS.into_iter().filter(|&level| groups_needed(level) <= groups).collect()
}

/// Smallest score, for each of the ascending levels, up to which the scores have that mass.
fn quantiles(scores: &[(f64, f64)], levels: &[f64]) -> Vec<f64> {
    let (mut rest, mut mass, mut quantile) = (scores.iter(), 0.0, 0.0);
    let mut of_level = |&level: &f64| {
        while mass < level - 1e-9 {
            let Some(&(score, more)) = rest.next() else { break };
            (quantile, mass) = (score, mass + more);
        }
        quantile
    };
    levels.iter().map(&mut of_level).collect()
}

impl GroupIntervals {
    /// Computes the intervals from the errors of every held-out group in standard errors: magnitude of the mean, and
    /// scatter around it, assumed normal. Interpolates linearly between the levels `k/(G + 1)`; omits higher levels.
    pub fn from_groups(scores: &[GroupScore]) -> Self {
        let groups = scores.len();
        let mut levels = levels_known(groups);
        let mut factors: PerAxis<Vec<f64>> = std::array::from_fn(|axis| {
            levels.iter().map(|&level| size_between(scores, axis, level)).collect()
        });
        let finite =
            |position: &usize| factors.iter().all(|factors| factors[*position].is_finite());
        let known = (0..levels.len()).take_while(finite).count();
        levels.truncate(known);
        factors.iter_mut().for_each(|factors| factors.truncate(known));
        Self { groups, levels, factors }
    }

    /// Computes the intervals from the errors on blocks of time of held-out files, in standard
    /// errors. The share ρ of their squared errors that differs from file to file is known from as
    /// many observations as there are files. With F files, squared sizes are therefore larger by
    /// `1 + ρ·((t/z)² − 1)`, with the quantiles t of Student's distribution with F − 1 degrees of
    /// freedom and z of the normal distribution.
    pub fn from_files(scores: &[Vec<GroupScore>]) -> Self {
        let mut intervals = Self::from_groups(&scores.concat());
        if scores.len() < 2 {
            return intervals;
        }
        for (axis, factors) in intervals.factors.iter_mut().enumerate() {
            let square = |of: &GroupScore| of[axis].0.powi(2) + of[axis].1.powi(2);
            let squares = scores.iter().map(|file| file.iter().map(square).collect());
            let share = share_between(&squares.collect::<Vec<_>>());
            for (factor, &level) in factors.iter_mut().zip(&intervals.levels) {
                let t = student_quantile(level, (scores.len() - 1) as f64);
                let ratio = t / normal_quantile(level);
                *factor *= (1.0 + share * (ratio * ratio - 1.0)).sqrt();
            }
        }
        intervals
    }

    /// Half-width of an interval of this level in standard errors, per axis.
    ///
    /// # Errors
    /// [`TooFewGroups`].
    pub fn factors(&self, level: f64) -> Result<PerAxis<f64>, TooFewGroups> {
        let position = self.levels.iter().position(|&kept| kept >= level - 1e-9);
        let too_few = TooFewGroups { level, needed: groups_needed(level), groups: self.groups };
        let position = position.ok_or(too_few)?;
        Ok(self.factors.each_ref().map(|factors| factors[position]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scores(groups: &[&[f64]]) -> GroupIntervals {
        let mut all = Scores::default();
        for (group, errors) in groups.iter().enumerate() {
            errors.iter().for_each(|&error| all.add(group as u64, &[error; 6], &[1.0; 6]));
        }
        all.intervals()
    }

    #[test]
    fn one_row_per_group_gives_the_conformal_quantile() {
        let sizes: Vec<[f64; 1]> = (1..=39).map(|i| [f64::from(i)]).collect();
        let groups: Vec<&[f64]> = sizes.iter().map(|size| &size[..]).collect();
        // ⌈(39 + 1)·0.95⌉ = 38, ⌈40·0.5⌉ = 20.
        let intervals = scores(&groups);
        assert_eq!(intervals.factors(0.95), Ok([38.0; 6]));
        assert_eq!(intervals.factors(0.5), Ok([20.0; 6]));
        // With nineteen groups it is the largest score; with fewer there is no quantile.
        assert_eq!(scores(&groups[..19]).factors(0.95), Ok([19.0; 6]));
        let refused = scores(&groups[..18]).factors(0.95).unwrap_err();
        assert_eq!((refused.needed, refused.groups), (19, 18));
    }

    #[test]
    fn groups_without_scatter_count_as_one_row_and_normal_errors_have_normal_quantiles() {
        let alone: Vec<GroupScore> = (1..=39).map(|i| [(f64::from(i), 0.0); 6]).collect();
        let intervals = GroupIntervals::from_groups(&alone);
        for (level, expected) in [(0.95, 38.0), (0.5, 20.0)] {
            let found = intervals.factors(level).unwrap()[3];
            assert!((found - expected).abs() < 1e-12, "{found}");
        }
        // Scattered around zero, many groups give normal quantiles, except for 1/(G + 1).
        let many = vec![[(0.0, 2.0); 6]; 100_000];
        let found = GroupIntervals::from_groups(&many).factors(0.95).unwrap()[0];
        assert!((found - 2.0 * 1.959_964).abs() < 1e-3, "{found}");
        // Two of forty groups are unknown: 95 % is beyond the coverage of the others, 90 % is not.
        let mut unknown = alone;
        unknown[..2].fill([(f64::INFINITY, 0.0); 6]);
        let intervals = GroupIntervals::from_groups(&unknown);
        assert!(intervals.factors(0.9).is_ok() && intervals.factors(0.95).is_err());
    }

    #[test]
    fn a_group_of_many_rows_counts_no_more_than_one_of_few() {
        let many = vec![5.0; 1000];
        let intervals = scores(&[&[1.0], &[2.0], &[3.0], &many]);
        // Each group has a mass of a fifth, so the first three have 0.6.
        assert_eq!(intervals.factors(0.5), Ok([3.0; 6]));
        assert_eq!(intervals.factors(0.8), Ok([5.0; 6]));
    }
}
