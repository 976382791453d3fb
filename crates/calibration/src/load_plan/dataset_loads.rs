//! The loads that were recorded so far, to plan from.

use crate::grouped_rows::{GroupedRows, Run, count};
use shell_data::block::Block;
use shell_data::dataset::Dataset;
use shell_data::wrench::PerAxis;

/// Rows without labels that stand for all, at most.
const MOST_ROWS: u64 = 2000;

/// The loads of a data set: one for each label, the mean of its rows; without labels, rows at equal distances.
pub fn loads_of_dataset(data: &Dataset) -> Vec<PerAxis<f64>> {
    let (rows, labels) = GroupedRows::from_labels(data);
    if labels.is_empty() {
        let every = data.rows().div_ceil(MOST_ROWS).max(1) as usize;
        let loads = data.blocks().flat_map(|(_, block)| {
            let Block { rows, wrench, .. } = &*block.rows;
            (0..*rows).map(|row| std::array::from_fn(|axis| wrench[axis][row]))
        });
        return loads.step_by(every).collect();
    }
    let mean = |runs: &[Run]| {
        let sum = |axis| rows.column(runs, axis).fold(0.0, |sum, load| sum + load);
        std::array::from_fn(|axis| sum(axis) / count(runs) as f64)
    };
    rows.groups().map(mean).collect()
}
