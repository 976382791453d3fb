//! What a partial fit keeps of its rows, in memory and in a document.

use calibration::exact::{Moments, StoredMoments};
use calibration::factored::FactoredRows;
use calibration::model::{Basis, MAX_CHANNELS, Model};
use calibration::reading_ranges::{ReadingRange, ReadingRanges};
use calibration::scaling::Scaling;
use serde::{Deserialize, Serialize};
use shell_data::by_axis;

use super::MergeError;
use crate::LARGEST;

/// What is kept of some rows.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "SumsDocument", into = "SumsDocument")]
pub enum Sums {
    /// Exact sums: merged in any order they are the same, bit for bit.
    Exact(Moments),
    /// The R factor of rows that cannot be summed exactly: merged in another order it differs in its last digits.
    Factored(FactoredRows),
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

/// Sums in a document: one of the two.
#[derive(Serialize, Deserialize)]
struct SumsDocument {
    #[serde(default, skip_serializing_if = "Option::is_none")]
    moments: Option<StoredMoments>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    triangle: Option<RFactorDocument>,
}

impl From<Sums> for SumsDocument {
    fn from(sums: Sums) -> Self {
        let (moments, triangle) = match &sums {
            Sums::Exact(moments) => (Some(StoredMoments::of(moments, by_axis::axes())), None),
            Sums::Factored(rows) => (None, Some(RFactorDocument::new(rows))),
        };
        Self { moments, triangle }
    }
}

impl TryFrom<SumsDocument> for Sums {
    type Error = String;

    fn try_from(SumsDocument { moments, triangle }: SumsDocument) -> Result<Self, String> {
        match (moments, triangle) {
            (Some(moments), None) => Ok(Self::Exact(read_moments(moments)?)),
            (None, Some(triangle)) => {
                let rows = triangle.value().map_err(|error| format!("`triangle`: {error}"))?;
                Ok(Self::Factored(rows))
            }
            (None, None) => Err("missing field `moments` or `triangle`".to_owned()),
            (Some(_), Some(_)) => Err("it has both `moments` and `triangle`".to_owned()),
        }
    }
}

fn read_moments(stored: StoredMoments) -> Result<Moments, String> {
    Moments::from_stored(stored, by_axis::axes()).map_err(|error| format!("`moments`: {error}"))
}

/// Several exact sums in a document.
pub(super) mod each_moments {
    use super::{Deserialize, Moments, StoredMoments, by_axis, read_moments};
    use serde::de::Error;
    use serde::{Deserializer, Serializer};

    pub(crate) fn serialize<S: Serializer>(sums: &[Moments], to: S) -> Result<S::Ok, S::Error> {
        to.collect_seq(sums.iter().map(|moments| StoredMoments::of(moments, by_axis::axes())))
    }

    pub(crate) fn deserialize<'de, D: Deserializer<'de>>(of: D) -> Result<Vec<Moments>, D::Error> {
        let stored: Vec<StoredMoments> = Vec::deserialize(of)?;
        stored.into_iter().map(|one| read_moments(one).map_err(D::Error::custom)).collect()
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

impl RFactorDocument {
    fn new(rows: &FactoredRows) -> Self {
        Self {
            basis: rows.model().basis,
            rows: rows.rows(),
            scaling: rows.scaling().clone(),
            channels: rows.reading_ranges().channels.clone(),
            columns: rows.columns(),
        }
    }

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
