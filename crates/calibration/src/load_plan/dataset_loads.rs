//! The loads that were recorded so far, to plan from.

use std::collections::HashMap;

use shell_data::dataset::Dataset;
use shell_data::wrench::PerAxis;

/// Rows without labels that stand for all, at most.
const MOST_ROWS: usize = 2000;

/// The loads of a data set: one for each label, the mean of its rows; without labels, rows at equal distances.
pub fn loads_of_dataset(data: &Dataset) -> Vec<PerAxis<f64>> {
    let total: usize = data.blocks().map(|(_, block)| block.rows.rows).sum();
    let every = total.div_ceil(MOST_ROWS).max(1);
    let (mut positions, mut sums) = (HashMap::new(), Vec::<(PerAxis<f64>, f64)>::new());
    let (mut loads, mut passed) = (Vec::new(), 0);
    for (_, block) in data.blocks() {
        let load = |row: usize| -> PerAxis<f64> {
            std::array::from_fn(|axis| {
                block.rows.wrench.get(axis).map_or(0.0, |column| column[row])
            })
        };
        let mut row = 0;
        for (label, count) in &*block.labels {
            let position = *positions.entry(label.clone()).or_insert(sums.len());
            if position == sums.len() {
                sums.push(([0.0; 6], 0.0));
            }
            for at in row..row + count {
                let load = load(at);
                (0..6).for_each(|axis| sums[position].0[axis] += load[axis]);
                sums[position].1 += 1.0;
            }
            row += count;
        }
        let unlabelled = (row..block.rows.rows).filter(|row| (passed + row) % every == 0);
        loads.extend(unlabelled.map(load));
        passed += block.rows.rows;
    }
    loads.extend(sums.into_iter().map(|(sum, count)| sum.map(|sum| sum / count)));
    loads
}
