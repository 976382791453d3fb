//! Errors on held-out folds, and their differences.

use least_squares::validation::comparison::FoldMean;
use shell_data::wrench::PerAxis;

#[derive(Clone, Debug)]
pub(super) struct FoldErrors {
    pub(super) rows: u64,
    pub(super) squares: PerAxis<f64>,
    /// For each fold, its rows and its squared error relative to the loads' variance, averaged over varying axes.
    pub(super) scores: Vec<(u64, f64)>,
    /// Scores minus the part caused by noise of readings and loads.
    pub(super) systematic: Vec<(u64, f64)>,
}

impl FoldErrors {
    pub(super) fn score(&self) -> f64 {
        FoldMean::new(&self.scores).value
    }

    /// Score without the part of noise. The search minimises it, because terms that only average noise raise it.
    pub(super) fn systematic(&self) -> f64 {
        FoldMean::new(&self.systematic).value
    }

    pub(super) fn are_lowered_by(&self, later: &Self, share: f64) -> bool {
        let gain = gain(&self.scores, &later.scores);
        gain.value > gain.standard_error && gain.value > share * self.score()
    }

    /// Returns true if the errors with and without noise both fall by this share, and by more than a standard error.
    pub(super) fn are_explained_by(&self, later: &Self, share: f64) -> bool {
        let least = share * self.score();
        let of = [(&self.scores, &later.scores), (&self.systematic, &later.systematic)];
        of.into_iter().all(|(before, after)| {
            let gain = gain(before, after);
            gain.value > gain.standard_error && gain.value > least
        })
    }

    pub(super) fn rms(&self) -> PerAxis<f64> {
        self.squares.map(|squares| (squares / self.rows as f64).sqrt())
    }
}

fn gain(before: &[(u64, f64)], after: &[(u64, f64)]) -> FoldMean {
    let lower = |(&(rows, before), (_, after)): (&(u64, f64), &(u64, f64))| (rows, before - after);
    FoldMean::new(&before.iter().zip(after).map(lower).collect::<Vec<_>>())
}
