//! Parts of a data set and quick fits to them, for the examination of a fit.

use super::{CovarianceRule, Fit, FitOptions, OutlierRule};
use crate::conversion::Calibration;
use least_squares::error::FitError;
use least_squares::model::Basis;
use least_squares::passes::Workers;
use shell_data::block::Block;
use shell_data::dataset::Dataset;
use shell_data::wrench::{Axes, PerAxis};

pub(super) const ROWS: usize = 4000;

/// Takes up to [`ROWS`] rows, spread evenly over the `part` of all rows that is given as a range of shares.
pub(super) fn spread(blocks: &[&Block], part: std::ops::Range<f64>) -> Block {
    let rows: usize = blocks.iter().map(|block| block.rows).sum();
    let [from, to] = [part.start, part.end].map(|share| (share * rows as f64) as usize);
    let every = (to - from).div_ceil(ROWS).max(1);
    let (mut all, mut start) = (Block::default(), 0);
    for block in blocks {
        for row in 0..block.rows {
            let at = start + row;
            if (from..to).contains(&at) && (at - from).is_multiple_of(every) {
                all.append(block, row..row + 1);
            }
        }
        start += block.rows;
    }
    all
}

pub(super) fn predicted(calibration: &Calibration, rows: &Block) -> PerAxis<Vec<f64>> {
    let mut predicted = PerAxis::default();
    calibration.wrench(&rows.readings, &mut predicted);
    predicted
}

/// Fits a linear model for the prediction of other rows; `None` if the rows do not determine it.
pub(super) fn linear(
    rows: Block,
    axes: Axes,
    workers: Workers<'_>,
) -> Result<Option<Fit>, FitError> {
    let options = FitOptions {
        model: Basis::Linear.into(),
        covariance: CovarianceRule::Nothing,
        outliers: OutlierRule::Keep,
        workers,
        ..FitOptions::default()
    };
    match super::fit(Dataset::from_blocks("part", axes, vec![rows]), Dataset::default(), &options) {
        Ok(fitted) => Ok(Some(fitted)),
        Err(FitError::Interrupted) => Err(FitError::Interrupted),
        Err(_) => Ok(None),
    }
}
