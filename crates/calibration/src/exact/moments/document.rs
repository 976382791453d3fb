//! How moments are written to files.

use num_bigint::BigInt;
use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::channel_range::ChannelRange;
use super::product_sums::Moments;
use super::scaled_integers::ScaledIntegers;
use crate::exact::error::MAX_ROWS;
use crate::model::Basis;

/// How moments are written down: integers as decimal strings, since they exceed what readers of
/// JSON take for numbers.
#[derive(Serialize, Deserialize)]
struct MomentsDocument {
    basis: Basis,
    rows: u64,
    channels: Vec<ChannelRange>,
    readings: Vec<String>,
    wrench: Vec<StoredIntegers>,
    squares: Vec<StoredIntegers>,
}

#[derive(Serialize, Deserialize)]
struct StoredIntegers {
    exponent: i32,
    values: Vec<String>,
}

impl Serialize for Moments {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        MomentsDocument::from(self).serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for Moments {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        MomentsDocument::deserialize(deserializer)?.try_into().map_err(D::Error::custom)
    }
}

impl From<&Moments> for MomentsDocument {
    fn from(moments: &Moments) -> Self {
        let stored = |scaled: &ScaledIntegers| StoredIntegers {
            exponent: scaled.exponent,
            values: scaled.values.iter().map(BigInt::to_string).collect(),
        };
        Self {
            basis: moments.basis,
            rows: moments.rows,
            channels: moments.channels.clone(),
            readings: moments.readings.iter().map(i128::to_string).collect(),
            wrench: moments.wrench.iter().map(stored).collect(),
            squares: moments.squares.iter().map(stored).collect(),
        }
    }
}

impl TryFrom<MomentsDocument> for Moments {
    type Error = String;

    fn try_from(stored: MomentsDocument) -> Result<Self, String> {
        if stored.channels.is_empty() || stored.channels.len() > 255 {
            return Err(format!("`{}` channels, expected 1 to 255", stored.channels.len()));
        }
        let mut moments = Moments::new(stored.basis, stored.channels.len());
        let sane = |c: &ChannelRange| c.fits() && c.unit.is_sane();
        if !stored.channels.iter().all(sane) || stored.rows > MAX_ROWS {
            return Err("ranges or rows beyond what can be summed exactly".to_owned());
        }
        let expect = |what: &str, found: usize, expected: usize| {
            (found == expected)
                .then_some(())
                .ok_or_else(|| format!("`{found}` {what}, expected `{expected}`"))
        };
        expect("sums of readings", stored.readings.len(), moments.readings.len())?;
        expect("axes", stored.wrench.len(), moments.wrench.len())?;
        expect("products of axes", stored.squares.len(), moments.squares.len())?;
        for (sum, text) in moments.readings.iter_mut().zip(&stored.readings) {
            *sum = text.parse().map_err(|_| format!("`{text}` is not an integer of 128 bits"))?;
        }
        if moments.readings[0] != i128::from(stored.rows) {
            return Err("the number of rows is not the sum of ones".to_owned());
        }
        let targets = moments.wrench.iter_mut().chain(&mut moments.squares);
        for (sums, stored) in targets.zip(stored.wrench.iter().chain(&stored.squares)) {
            expect("sums of an axis", stored.values.len(), sums.values.len())?;
            for (value, text) in sums.values.iter_mut().zip(&stored.values) {
                *value = text.parse().map_err(|_| format!("`{text}` is not an integer"))?;
            }
            if !(-4000..=4000).contains(&stored.exponent) {
                return Err(format!("exponent `{}` is out of range", stored.exponent));
            }
            *sums = ScaledIntegers::new(stored.exponent, std::mem::take(&mut sums.values));
        }
        moments.rows = stored.rows;
        moments.channels = stored.channels;
        Ok(moments)
    }
}
