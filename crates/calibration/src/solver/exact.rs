//! The solver that sums without rounding, see [`crate::exact`].
//!
//! The bits of its answer depend on the rows alone. It chooses its own centre and scale, from all rows.

use faer::Mat;

use super::solution::Solution;
use crate::exact::{Accumulator, ExactRankLoss, Moments, SolveError};
use crate::factor::InverseFactor;
use crate::passes::Pass;
use crate::rank_loss::{Dependence, RankLoss};
use crate::reading_ranges::ReadingRanges;
use crate::scaling::Scaling;
use crate::{FitError, Model};
use shell_data::block::Block;

impl Pass for Accumulator {
    const ANY_ORDER: bool = true;

    fn absorb(&mut self, block: &Block) -> Result<(), FitError> {
        Ok(self.absorb(&block.readings, &block.wrench)?)
    }

    fn merge(&mut self, later: Self) -> Result<(), FitError> {
        Ok(self.merge(later)?)
    }
}

/// The coefficients of `model` that fit the rows of `moments` best. `ranges` is that of the same
/// rows; `ridge` as in the options of a fit.
///
/// # Errors
/// [`FitError`] if the rows do not determine the coefficients.
pub fn solve_moments(
    moments: &Moments,
    model: &Model,
    ridge: f64,
    ranges: &ReadingRanges,
) -> Result<Solution, FitError> {
    let fit = moments.solve(model, ridge).map_err(|error| match error {
        SolveError::TooFewRows { rows, coefficients } => {
            FitError::TooFewRows { rows, coefficients }
        }
        SolveError::RankDeficient(_)
            if ranges.constant_channels().len() == ranges.channels.len() =>
        {
            FitError::IdenticalRows(ranges.rows)
        }
        SolveError::RankDeficient(loss) => FitError::RankDeficient(explain(loss, ranges)),
        SolveError::NearlyDependent => FitError::NearlyDependent,
        SolveError::Overflow => FitError::Overflow,
        SolveError::Ridge(ridge) => FitError::Ridge(ridge),
        SolveError::OtherFeatures { .. } => {
            FitError::Channels { expected: model.channels, found: ranges.channels.len() }
        }
    })?;
    let coefficients = &fit.coefficients;
    Ok(Solution {
        model: fit.model,
        coefficients: Mat::from_fn(coefficients.len(), 6, |i, j| coefficients[i][j].to_f64()),
        factor: InverseFactor::from_inverse(fit.r_factor()),
        residual_products: Mat::from_fn(6, 6, |i, j| fit.residual_products[i][j]),
        rows: fit.rows,
        condition: fit.condition,
        rank: fit.rank,
        ridge,
        scaling: Scaling { centre: fit.centre, scale: fit.scale },
    })
}

/// Names the channels that cause the loss of rank: constant ones first, then other relations.
fn explain(loss: ExactRankLoss, ranges: &ReadingRanges) -> RankLoss {
    let (constant, mut dependences) = Dependence::constants(ranges);
    let moves = |channel: &u8| !constant.contains(&usize::from(*channel));
    let others = loss.relations.into_iter().filter(|r| r.feature.factors().iter().all(moves));
    dependences.extend(others.map(Dependence::from));
    RankLoss { rank: loss.rank, features: loss.features, dependences }
}
