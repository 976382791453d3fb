//! Rows that cannot be summed exactly, in a document: the R factor of their features and wrench.

use calibration::factored::FactoredRows;
use calibration::model::{Basis, MAX_CHANNELS, Model};
use calibration::reading_ranges::{ReadingRange, ReadingRanges};
use calibration::scaling::Scaling;
use serde::{Deserialize, Serialize};

use super::LARGEST;

#[derive(Serialize, Deserialize)]
pub(super) struct RFactorDocument {
    basis: Basis,
    rows: u64,
    /// What features are made of: `z = (s − centre) / scale`.
    scaling: Scaling,
    channels: Vec<ReadingRange>,
    /// Columns of the upper triangular matrix, of lengths 1, 2, …: features with a constant, then all six axes.
    columns: Vec<Vec<f64>>,
}

impl RFactorDocument {
    pub(super) fn new(rows: &FactoredRows) -> Self {
        Self {
            basis: rows.basis(),
            rows: rows.rows(),
            scaling: rows.scaling().clone(),
            channels: rows.reading_ranges().channels.clone(),
            columns: rows.columns(),
        }
    }

    /// # Errors
    /// What does not fit together.
    pub(super) fn value(self) -> Result<FactoredRows, String> {
        let Self { basis, rows, scaling, channels, columns } = self;
        let Scaling { centre, scale } = &scaling;
        let count = channels.len();
        let are_as_many = centre.len() == count && scale.len() == count;
        let are_as_many = are_as_many && (1..=MAX_CHANNELS).contains(&count);
        ensure!(are_as_many, "`scaling` and `channels` are not of as many channels");
        let model = Model { basis, intercept: true, channels: count, memory: 0 };
        model.check_size().map_err(|error| error.to_string())?;
        let is_power_of_two = |scale: &f64| scale.is_normal() && scale.to_bits() << 12 == 0;
        let are_powers = scale.iter().all(|scale| *scale > 0.0 && is_power_of_two(scale));
        ensure!(are_powers, "a `scale` is no power of two");
        let small = |x: &f64| x.abs() <= LARGEST;
        let ranges = channels.iter().flat_map(|range| [&range.min, &range.max]);
        let are_usable = ranges.chain(centre).chain(columns.iter().flatten()).all(small)
            && rows > 0
            && channels.iter().all(|range| range.min <= range.max);
        ensure!(are_usable, "a number is too large, a range is empty, or there are no rows");
        let ranges = ReadingRanges { rows, channels };
        let rows = FactoredRows::from_parts((model, scaling), ranges, &columns)
            .ok_or("`columns` are not those of an upper triangular matrix of its size")?;
        ensure!(rows.counts_its_rows(), "the sum of ones is not the number of rows");
        Ok(rows)
    }
}
