use crate::error::FitError;
use crate::reading_ranges::{ReadingRange, ReadingRanges};
use shell_data::block::Block;
use shell_data::dataset::Dataset;
use shell_data::vectorised;
use shell_data::wrench::Axis;

impl ReadingRanges {
    /// Scans one block with `channels` channels.
    ///
    /// # Errors
    /// [`FitError::NotFinite`], [`FitError::Channels`].
    pub fn from_block(block: &Block, channels: usize) -> Result<Self, FitError> {
        if block.readings.len() != channels {
            return Err(FitError::Channels { expected: channels, found: block.readings.len() });
        }
        let names = (1..=channels)
            .map(|i| format!("s{i}"))
            .chain(Axis::ALL.map(|axis| axis.name().to_owned()));
        for (name, column) in names.zip(block.readings.iter().chain(&block.wrench)) {
            if !are_finite(column) {
                let row = column.iter().position(|x| !x.is_finite()).unwrap_or(0);
                return Err(FitError::NotFinite { column: name, row });
            }
        }
        let ranges = block.readings.iter().map(|column| range_of(column)).collect();
        Ok(Self { rows: block.rows as u64, channels: ranges })
    }

    /// Merges the ranges of all blocks of a data set.
    ///
    /// # Errors
    /// As [`Self::from_block`].
    pub fn from_dataset(data: &Dataset) -> Result<Self, FitError> {
        let mut all = Self::new(data.channels());
        for (_, block) in data.blocks() {
            all.merge(&Self::from_block(&block.rows, data.channels())?);
        }
        Ok(all)
    }
}

/// Number of partial minima and maxima. They are independent of each other, so the loop vectorises.
const LANES: usize = 16;

vectorised! {
    fn are_finite(column: &[f64]) -> bool {
        column.iter().fold(true, |all, x| all & x.is_finite())
    }

    pub fn range_of(column: &[f64]) -> ReadingRange {
        let (mut min, mut max) = ([f64::INFINITY; LANES], [f64::NEG_INFINITY; LANES]);
        let (chunks, rest) = column.as_chunks::<LANES>();
        for chunk in chunks {
            for i in 0..LANES {
                min[i] = if chunk[i] < min[i] { chunk[i] } else { min[i] };
                max[i] = if chunk[i] > max[i] { chunk[i] } else { max[i] };
            }
        }
        ReadingRange {
            min: min.iter().chain(rest).copied().fold(f64::INFINITY, f64::min),
            max: max.iter().chain(rest).copied().fold(f64::NEG_INFINITY, f64::max),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn block(column: Vec<f64>) -> Block {
        Block { rows: column.len(), readings: vec![column], ..Block::default() }
    }

    #[test]
    fn ranges_of_blocks_merge_to_the_range_of_all() {
        let all: Vec<f64> = (0..37).map(|i| f64::from(i * 29 % 37)).collect();
        let whole = ReadingRanges::from_block(&block(all.clone()), 1).unwrap();
        let mut merged = ReadingRanges::new(1);
        for part in all.chunks(11) {
            merged.merge(&ReadingRanges::from_block(&block(part.to_vec()), 1).unwrap());
        }
        assert_eq!(merged, whole);
        assert_eq!(whole.channels, [ReadingRange { min: 0.0, max: 36.0 }]);
    }

    #[test]
    fn values_that_are_not_finite_are_named_with_their_row() {
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            for row in [0, 8, 16] {
                let mut column = vec![1.0; 17];
                column[row] = bad;
                let error = ReadingRanges::from_block(&block(column), 1).unwrap_err();
                assert_eq!(error, FitError::NotFinite { column: "s1".into(), row });
            }
        }
    }

    #[test]
    fn a_channel_that_never_moved_is_constant_and_one_without_rows_is_not() {
        let ranges = ReadingRanges::from_block(&block(vec![3.0, 3.0]), 1).unwrap();
        assert_eq!(ranges.constant_channels(), [0]);
        assert!(ReadingRanges::new(1).constant_channels().is_empty());
    }
}
