//! Means that replace groups of training rows, because the weight of a pose should not depend on
//! how long it was held.

use least_squares::double_double::DoubleDouble;
use least_squares::error::FitError;
use least_squares::grouped_rows::{GroupedRows, Run, count};
use least_squares::reading_ranges::ReadingRanges;
use shell_data::block::Block;
use shell_data::dataset::{BLOCK_ROWS, Dataset};

/// Returns a row of means for each group of labelled rows, in the order of their first rows.
///
/// # Errors
/// [`FitError`] if there are no groups, or a value is not finite.
pub(super) fn group_means(data: &Dataset) -> Result<Dataset, FitError> {
    ReadingRanges::from_dataset(data)?;
    let (rows, labels) = GroupedRows::from_labels(data);
    let Some(first) = data.logs.first().filter(|_| !labels.is_empty()) else {
        return Err(FitError::NoRows);
    };
    let groups: Vec<(String, &[Run])> = labels.into_iter().zip(rows.groups()).collect();
    let means = |groups: &[(String, &[Run])]| {
        let mean = |column: usize| {
            // Double-double sums: means are correct to the last digit in any order of the rows.
            let of = |(_, runs): &(String, &[Run])| {
                let values = rows.column(runs, column).map(DoubleDouble::from);
                let sum = values.fold(DoubleDouble::ZERO, |sum, x| sum + x);
                (sum / DoubleDouble::from(count(runs) as f64)).to_f64()
            };
            groups.iter().map(of).collect::<Vec<f64>>()
        };
        Block {
            rows: groups.len(),
            readings: (6..6 + first.channels).map(mean).collect(),
            wrench: (0..6).map(mean).collect(),
            groups: groups.iter().map(|(label, _)| (label.clone(), 1)).collect(),
            ..Block::default()
        }
    };
    let blocks: Vec<Block> = groups.chunks(BLOCK_ROWS).map(means).collect();
    let repeated = blocks.iter().map(|block| block.repeated_rows() as u64).sum();
    let mut means = Dataset::from_blocks(&first.name, first.axes, blocks);
    means.logs[0].summary.repeated_rows = repeated;
    Ok(means)
}
