//! The means of groups of training rows, in place of the rows.
//!
//! Rows of a pose are one observation many times over. A fit to the means gives each pose the same weight, however
//! long it was held.

use std::collections::HashMap;

use crate::double_double::DoubleDouble;
use crate::error::FitError;
use crate::reading_ranges::ReadingRanges;
use shell_data::block::Block;
use shell_data::dataset::{BLOCK_ROWS, Dataset};

/// Sums of readings and wrench of a group, in twice the digits: means are right to the last one, in any order of
/// the rows.
struct GroupSum {
    label: String,
    rows: f64,
    columns: Vec<DoubleDouble>,
}

/// A row for each group of labelled rows, in the order of their first rows.
///
/// # Errors
/// [`FitError`] if there are none, or one is not finite.
pub(super) fn group_means(data: &Dataset) -> Result<Dataset, FitError> {
    let (mut groups, mut positions) = (Vec::<GroupSum>::new(), HashMap::new());
    for (_, block) in data.blocks() {
        // Names what is not finite, as every fit does.
        ReadingRanges::from_block(&block.rows, data.channels())?;
        let columns = || block.rows.readings.iter().chain(&block.rows.wrench);
        let mut start = 0;
        for (label, rows) in &*block.labels {
            let position = *positions.entry(label.clone()).or_insert_with(|| {
                let columns = vec![DoubleDouble::ZERO; columns().count()];
                groups.push(GroupSum { label: label.clone(), rows: 0.0, columns });
                groups.len() - 1
            });
            let group = &mut groups[position];
            group.rows += *rows as f64;
            for (sum, column) in group.columns.iter_mut().zip(columns()) {
                let part = &column[start..start + rows];
                *sum = part.iter().fold(*sum, |sum, &x| sum + DoubleDouble::from(x));
            }
            start += rows;
        }
    }
    let Some(first) = data.logs.first().filter(|_| !groups.is_empty()) else {
        return Err(FitError::NoRows);
    };
    let means = |groups: &[GroupSum]| {
        let mean = |at: usize| {
            let of = |sum: &GroupSum| (sum.columns[at] / DoubleDouble::from(sum.rows)).to_f64();
            groups.iter().map(of).collect::<Vec<f64>>()
        };
        Block {
            rows: groups.len(),
            readings: (0..first.channels).map(mean).collect(),
            wrench: (first.channels..first.channels + 6).map(mean).collect(),
            groups: groups.iter().map(|sum| (sum.label.clone(), 1)).collect(),
            ..Block::default()
        }
    };
    let blocks: Vec<Block> = groups.chunks(BLOCK_ROWS).map(means).collect();
    let repeated = blocks.iter().map(|block| block.repeated_rows() as u64).sum();
    let mut means = Dataset::from_blocks(&first.name, first.axes, blocks);
    means.logs[0].summary.repeated_rows = repeated;
    Ok(means)
}
