//! What a partial fit keeps of its rows, in memory and in a document.

use calibration::exact::Moments;
use calibration::factored::FactoredRows;
use calibration::model::{Basis, MAX_CHANNELS, Model};
use calibration::reading_ranges::{ReadingRange, ReadingRanges};
use calibration::scaling::Scaling;
use serde::{Deserialize, Serialize};

use super::MergeError;
use crate::LARGEST;
use crate::document::is_power_of_two;

/// What is kept of some rows.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
// What serde calls it where a document has neither.
#[serde(rename = "`moments` or `triangle`")]
pub enum Sums {
    /// Exact sums: merged in any order they are the same, bit for bit.
    #[serde(rename = "moments")]
    Exact(Moments),
    /// The R factor of rows that cannot be summed exactly: merged in another order it differs in its last digits.
    #[serde(rename = "triangle")]
    Factored(#[serde(with = "r_factor")] FactoredRows),
}

impl Sums {
    /// Number of rows.
    pub fn rows(&self) -> u64 {
        match self {
            Self::Exact(moments) => moments.rows(),
            Self::Factored(rows) => rows.rows(),
        }
    }

    /// Number of channels.
    pub fn channels(&self) -> usize {
        match self {
            Self::Exact(moments) => moments.channels(),
            Self::Factored(rows) => rows.model().channels,
        }
    }

    /// Whether they are of the features of a model.
    pub(super) fn suit(&self, model: &Model) -> bool {
        let basis = match self {
            Self::Exact(moments) => moments.basis(),
            Self::Factored(rows) => rows.model().basis,
        };
        (self.channels(), basis) == (model.channels, model.basis)
    }

    /// The field that has them.
    pub(super) fn field(&self) -> &'static str {
        match self {
            Self::Exact(_) => "moments",
            Self::Factored(_) => "triangle",
        }
    }

    /// What they are called.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Exact(_) => "exact sums",
            Self::Factored(_) => "R factors",
        }
    }

    /// Adds the rows of `other`.
    pub(super) fn merge(&mut self, other: &Self) -> Result<(), MergeError> {
        match (&mut *self, other) {
            (Self::Exact(own), Self::Exact(other)) => own.merge(other)?,
            (Self::Factored(own), Self::Factored(other)) => own.merge(other),
            (own, other) => super::expect(own.kind(), other.kind(), MergeError::Kind)?,
        }
        Ok(())
    }
}

/// Rows that cannot be summed exactly, in a document: the R factor of their features and wrench.
#[derive(Serialize, Deserialize)]
struct RFactorDocument {
    basis: Basis,
    rows: u64,
    /// What features are made of: `z = (s − centre) / scale`.
    scaling: Scaling,
    channels: Vec<ReadingRange>,
    /// Columns of the upper triangular matrix, of lengths 1, 2, …: features with a constant, then all six axes.
    columns: Vec<Vec<f64>>,
}

mod r_factor {
    use super::{Deserialize, FactoredRows, RFactorDocument, Serialize};
    use serde::de::Error;
    use serde::{Deserializer, Serializer};

    pub(super) fn serialize<S: Serializer>(rows: &FactoredRows, to: S) -> Result<S::Ok, S::Error> {
        let document = RFactorDocument {
            basis: rows.model().basis,
            rows: rows.rows(),
            scaling: rows.scaling().clone(),
            channels: rows.reading_ranges().channels.clone(),
            columns: rows.columns(),
        };
        document.serialize(to)
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(of: D) -> Result<FactoredRows, D::Error> {
        RFactorDocument::deserialize(of)?.value().map_err(D::Error::custom)
    }
}

impl RFactorDocument {
    /// # Errors
    /// What does not fit together.
    fn value(self) -> Result<FactoredRows, String> {
        let Self { basis, rows, scaling, channels, columns } = self;
        let Scaling { centre, scale } = &scaling;
        let count = channels.len();
        let are_as_many = centre.len() == count && scale.len() == count;
        let are_as_many = are_as_many && (1..=MAX_CHANNELS).contains(&count);
        ensure!(are_as_many, "`scaling` and `channels` are not of as many channels");
        let model = Model { basis, intercept: true, channels: count, memory: 0 };
        model.check_size().map_err(|error| error.to_string())?;
        let are_powers = scale.iter().copied().all(is_power_of_two);
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
