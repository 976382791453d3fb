//! Selection of the kinds of memory in the model, and the uncertainty of the offset due to this choice.
//!
//! All combinations of families of features ([`Family`]) are compared on one Gram matrix, at the solution of the
//! largest model. The combination with the lowest `BIC = n log det Σ̂ + p C log n` (Schwarz, Ann. Statist. 6, 461,
//! 1978) is chosen, with n rows, C channels, p features in use and the residual covariance Σ̂.
//!
//! Other models are equally plausible if their residuals are not much larger. Each gives another offset, one
//! Gauss-Newton step away. Noise alone makes nested models differ by `Var(ô₁ − ô₂) = |Var ô₁ − Var ô₂|` (Hausman,
//! Econometrica 46, 1251, 1978). Further scatter of the offsets is an error that no residual shows.
//!
//! Friction that depends on the speed ([`Family::QuickLags`]) delays all readings by about the same time, nearly like
//! an offset. This family is never chosen. If the criterion prefers it, the change of the offset with it, times
//! [`SPEED`], is an uncertainty.

use super::normal::{GramSums, Projected, inverse};
use super::response::Family;

/// Largest factor (geometric mean over channels) by which residuals of a plausible model exceed those of the chosen.
const PLAUSIBLE: f64 = 1.3;

/// Error due to speed-dependent friction, relative to the shift by quick lags, by simulation (`docs/alignment.md`).
const SPEED: f64 = 3.0;

/// Number of standard deviations of the noise up to which a difference counts as noise.
const CHANCE: f64 = 2.0;

struct FamilyChoice {
    keep: Vec<bool>,
    is_quick: bool,
    step: [f64; 2],
    white: [[f64; 2]; 2],
    log_volume: f64,
    criterion: f64,
}

pub(super) struct Candidates {
    all: Vec<FamilyChoice>,
    channels: usize,
}

impl Candidates {
    pub(super) fn new(gram: &GramSums, families: &[Option<Family>], channels: usize) -> Self {
        let present: Vec<Family> =
            Family::ALL.into_iter().filter(|family| families.contains(&Some(*family))).collect();
        let kept = |set: usize, family: &Option<Family>| {
            let position = family.and_then(|family| present.iter().position(|p| *p == family));
            position.is_none_or(|position| set & (1 << position) != 0)
        };
        let quick = Some(Family::QuickLags);
        let candidate = |set: usize| {
            let keep = families.iter().map(|f| kept(set, f)).collect();
            let is_quick = families.contains(&quick) && kept(set, &quick);
            FamilyChoice::new(gram, keep, is_quick, channels)
        };
        Self { all: (0..1 << present.len()).filter_map(candidate).collect(), channels }
    }

    pub(super) fn best(&self) -> Option<&Vec<bool>> {
        self.best_of(false).map(|best| &best.keep)
    }

    fn best_of(&self, quick: bool) -> Option<&FamilyChoice> {
        let all = self.all.iter().filter(|choice| choice.is_quick == quick);
        all.min_by(|a, b| a.criterion.total_cmp(&b.criterion))
    }

    /// Variance of offset (s²) and skew over the plausible models, about the model with the features `keep`.
    pub(super) fn spread_about(&self, keep: &[bool]) -> [f64; 2] {
        let Some(chosen) = self.all.iter().find(|c| c.keep == keep) else { return [0.0; 2] };
        let ruled_out = chosen.log_volume + 2.0 * self.channels as f64 * PLAUSIBLE.ln();
        // Features that the criterion rejects make the offset differ only by noise.
        let has_more = |c: &FamilyChoice| {
            c.keep != keep && c.keep.iter().zip(keep).all(|(more, kept)| *more || !kept)
        };
        let is_plausible =
            |c: &&FamilyChoice| !c.is_quick && c.log_volume <= ruled_out && !has_more(c);
        let plausible = || self.all.iter().filter(is_plausible);
        let quick = self.best_of(true).filter(|quick| quick.criterion < chosen.criterion);
        [0, 1].map(|i| {
            let excess = |other: &FamilyChoice| {
                let noise = (other.white[i][i] - chosen.white[i][i]).abs();
                let difference = other.step[i] - chosen.step[i];
                (difference * difference - CHANCE * CHANCE * noise).max(0.0)
            };
            plausible().map(excess).sum::<f64>() / plausible().count() as f64
                + quick.map_or(0.0, |quick| SPEED * SPEED * excess(quick))
        })
    }
}

impl FamilyChoice {
    fn new(gram: &GramSums, keep: Vec<bool>, is_quick: bool, channels: usize) -> Option<Self> {
        let projected = Projected::new(gram, |i| keep[i])?;
        let (hessian, gradient) = projected.normal_equations();
        let white = inverse(hessian)?;
        let step = white.map(|row| row[0] * gradient[0] + row[1] * gradient[1]);
        let (rows, log_volume) = (gram.total, projected.log_volume());
        let parameters = (projected.used * channels) as f64;
        let criterion = rows * log_volume + parameters * rows.ln();
        Some(Self { keep, is_quick, step, white, log_volume, criterion })
    }
}

#[cfg(test)]
mod tests {
    use super::super::optics::POWERS;
    use super::*;
    use system_tests::random::Random;

    const FAMILIES: [Option<Family>; 3] = [None, Some(Family::AxisPlays), Some(Family::Lags)];

    /// One channel that follows feature 0, which is also the slope, delayed by a share of memory 1. Memory 2 is unused.
    fn gram(share: f64, noise: f64) -> GramSums {
        let mut gram = GramSums::new(3, 1);
        let mut random = Random(3);
        for i in 0..2000 {
            let t = f64::from(i) / 20.0;
            let (load, slope) = (t.sin(), t.cos());
            let play = (t - 0.3).sin() + 0.2 * (3.0 * t - 0.9).sin();
            let mut row = vec![load, play, (t / 7.0).sin(), slope, (t - 50.0) * slope];
            row.push(load + share * (play - load) + noise * random.normal());
            row.extend([0.0; POWERS]);
            gram.add(&row, 1.0);
        }
        gram
    }

    #[test]
    fn memory_is_chosen_for_sensors_with_memory() {
        for (share, expected) in [(0.0, [true, false, false]), (0.3, [true, true, false])] {
            let candidates = Candidates::new(&gram(share, 0.01), &FAMILIES, 1);
            assert_eq!(candidates.best().unwrap(), &expected);
        }
    }

    #[test]
    fn models_with_other_offsets_widen_the_error_unless_their_residuals_are_worse() {
        // Without the play, its delay goes to the offset: 0.3 of a play that is 0.3 late is about 0.09.
        let seen = gram(0.3, 0.02);
        let candidates = Candidates::new(&seen, &FAMILIES, 1);
        let keep = candidates.best().unwrap().clone();
        assert_eq!(candidates.spread_about(&keep), [0.0; 2], "the residuals tell");
        let hidden = Candidates::new(&gram(0.3, 0.5), &FAMILIES, 1);
        let [offset, skew] = hidden.spread_about(&keep);
        // Half of the plausible models lack the play.
        let expected = 0.5 * 0.09 * 0.09;
        assert!((0.2..5.0).contains(&(offset / expected)), "{offset}");
        assert!(skew < 1e-4 * offset, "the delay does not change with time: {skew}");
    }

    #[test]
    fn without_memory_models_differ_by_noise_alone() {
        let candidates = Candidates::new(&gram(0.0, 0.1), &FAMILIES, 1);
        let [offset, _] = candidates.spread_about(candidates.best().unwrap());
        assert!(offset < 0.1 * 0.1 / 1000.0, "{offset}");
    }
}
