//! R factors in documents.

use faer::Mat;
use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::rows::FactoredRows;
use crate::model::{Basis, LARGEST, MAX_CHANNELS, Model};
use crate::r_factor::RFactor;
use crate::reading_ranges::{ReadingRange, ReadingRanges};
use crate::scaling::{Scaling, is_power_of_two};
use crate::symmetric::triangular_columns;

#[derive(Clone, Debug, Serialize, Deserialize)]
struct StoredRows {
    basis: Basis,
    rows: u64,
    scaling: Scaling,
    channels: Vec<ReadingRange>,
    columns: Vec<Vec<f64>>,
}

impl From<FactoredRows> for StoredRows {
    fn from(of: FactoredRows) -> Self {
        Self {
            basis: of.model().basis,
            rows: of.rows(),
            columns: triangular_columns(of.r_factor.whole()),
            scaling: of.features.scaling,
            channels: of.ranges.channels,
        }
    }
}

impl TryFrom<StoredRows> for FactoredRows {
    type Error = String;

    fn try_from(stored: StoredRows) -> Result<Self, String> {
        let StoredRows { basis, rows, scaling, channels, columns } = stored;
        let Scaling { centre, scale } = &scaling;
        let count = channels.len();
        let ensure = |holds: bool, or: &str| if holds { Ok(()) } else { Err(or.to_owned()) };
        let are_as_many = centre.len() == count && scale.len() == count;
        let are_as_many = are_as_many && (1..=MAX_CHANNELS).contains(&count);
        ensure(are_as_many, "`scaling` and `channels` are not of as many channels")?;
        let model = Model { basis, intercept: true, channels: count, memory: 0 };
        model.check_size().map_err(|error| error.to_string())?;
        ensure(scale.iter().copied().all(is_power_of_two), "a `scale` is no power of two")?;
        let small = |x: &f64| x.abs() <= LARGEST;
        let ranges = channels.iter().flat_map(|range| [&range.min, &range.max]);
        let are_usable = ranges.chain(centre).chain(columns.iter().flatten()).all(small)
            && rows > 0
            && channels.iter().all(|range| range.min <= range.max);
        ensure(are_usable, "a number is too large, a range is empty, or there are no rows")?;
        let mut factored = Self::new(model, scaling);
        let (features, order) = (factored.features.len(), factored.r_factor.whole().ncols());
        let is_upper = columns.iter().enumerate().all(|(j, column)| column.len() == j + 1);
        let of_its_size = "`columns` are not those of an upper triangular matrix of its size";
        ensure(columns.len() == order && is_upper, of_its_size)?;
        let upper = |i: usize, j: usize| columns[j].get(i).copied().unwrap_or(0.0);
        factored.r_factor = RFactor::from_parts(features, rows, Mat::from_fn(order, order, upper));
        factored.ranges = ReadingRanges { rows, channels };
        let ones = factored.r_factor.r().col(features - 1).norm_l2();
        let are_counted = (ones * ones / rows as f64 - 1.0).abs() < 1e-9;
        ensure(are_counted, "the sum of ones is not the number of rows")?;
        Ok(factored)
    }
}

impl Serialize for FactoredRows {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        StoredRows::from(self.clone()).serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for FactoredRows {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        StoredRows::deserialize(deserializer)?.try_into().map_err(D::Error::custom)
    }
}
