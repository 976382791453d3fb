//! Exact sums in a document: integers as decimal strings.

use calibration::exact::{Moments, StoredIntegers, StoredMoments, StoredMomentsError, StoredRange};
use calibration::model::Basis;
use serde::{Deserialize, Serialize};
use shell_data::wrench::Axes;

use super::stored::{Name, Stored};

#[derive(Serialize, Deserialize)]
pub(super) struct MomentsDocument {
    basis: Name<Basis>,
    rows: u64,
    channels: Vec<WrittenRange>,
    readings: Vec<String>,
    wrench: Vec<Integers>,
    squares: Vec<Integers>,
}

#[derive(Serialize, Deserialize)]
struct WrittenRange {
    unit: Unit,
    lowest: i64,
    highest: i64,
}

/// 2⁻ᵏ·5⁻ᵐ counts.
#[derive(Serialize, Deserialize)]
struct Unit {
    twos: u32,
    fives: u32,
}

#[derive(Serialize, Deserialize)]
struct Integers {
    exponent: i32,
    values: Vec<String>,
}

impl MomentsDocument {
    /// Of these axes alone.
    pub(super) fn new(moments: &Moments, axes: Axes) -> Self {
        let stored = StoredMoments::of(moments, axes);
        let StoredMoments { basis, rows, channels, readings, wrench, squares, .. } = stored;
        let range = |range: StoredRange| {
            let StoredRange { twos, fives, lowest, highest } = range;
            WrittenRange { unit: Unit { twos, fives }, lowest, highest }
        };
        let integers = |stored: Vec<StoredIntegers>| {
            stored
                .into_iter()
                .map(|StoredIntegers { exponent, values }| Integers { exponent, values })
        };
        Self {
            basis: Name::of(&basis, axes),
            rows,
            channels: channels.into_iter().map(range).collect(),
            readings,
            wrench: integers(wrench).collect(),
            squares: integers(squares).collect(),
        }
    }

    /// # Errors
    /// What does not fit together.
    pub(super) fn value(self, axes: Axes) -> Result<Moments, String> {
        let range = |WrittenRange { unit: Unit { twos, fives }, lowest, highest }| StoredRange {
            twos,
            fives,
            lowest,
            highest,
        };
        let integers = |document: Vec<Integers>| {
            document
                .into_iter()
                .map(|Integers { exponent, values }| StoredIntegers { exponent, values })
        };
        let stored = StoredMoments {
            basis: self.basis.value(axes)?,
            axes,
            rows: self.rows,
            channels: self.channels.into_iter().map(range).collect(),
            readings: self.readings,
            wrench: integers(self.wrench).collect(),
            squares: integers(self.squares).collect(),
        };
        stored.try_into().map_err(|error: StoredMomentsError| format!("`moments`: {error}"))
    }
}
