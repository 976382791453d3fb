//! The summary that a partial fit keeps of its rows, in memory and in a document.

use calibration::exact::ExactSums;
use calibration::factored::FactoredRows;
use calibration::model::Model;
use serde::{Deserialize, Serialize};

use super::MergeError;

/// The summary of some rows.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "SumsDocument")]
pub enum Sums {
    /// Exact sums: merging in any order gives the same bits.
    #[serde(rename = "moments")]
    Exact(ExactSums),
    /// The R factor of rows that cannot be summed exactly: the order of merging changes the last digits.
    #[serde(rename = "triangle")]
    Factored(FactoredRows),
}

/// The fields of a document; exactly one must be present.
#[derive(Deserialize)]
struct SumsDocument {
    moments: Option<ExactSums>,
    triangle: Option<FactoredRows>,
}

impl TryFrom<SumsDocument> for Sums {
    type Error = &'static str;

    fn try_from(SumsDocument { moments, triangle }: SumsDocument) -> Result<Self, Self::Error> {
        match (moments, triangle) {
            (Some(moments), None) => Ok(Self::Exact(moments)),
            (None, Some(triangle)) => Ok(Self::Factored(triangle)),
            (None, None) => Err("missing field `moments` or `triangle`"),
            (Some(_), Some(_)) => Err("it has both `moments` and `triangle`"),
        }
    }
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

    /// Returns true if these are sums of the features of `model`.
    pub(super) fn suit(&self, model: &Model) -> bool {
        let basis = match self {
            Self::Exact(moments) => moments.basis(),
            Self::Factored(rows) => rows.model().basis,
        };
        (self.channels(), basis) == (model.channels, model.basis)
    }

    /// The name of the field in the document.
    pub(super) fn field(&self) -> &'static str {
        match self {
            Self::Exact(_) => "moments",
            Self::Factored(_) => "triangle",
        }
    }

    /// The name in messages.
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
