//! How a calibration errs on each group of rows, and which loads the rows are of.

use std::collections::HashMap;

use crate::conversion::Calibration;
use crate::error::FitError;
use crate::passes::{Workers, each};
use crate::quality::{self, AxisErrors};
use shell_data::block::Block;
use shell_data::dataset::{Dataset, LabelledBlock};
use shell_data::wrench::PerAxis;

/// The groups of some rows, and a sample of their loads.
#[derive(Clone, Debug, Default)]
pub struct GroupedErrors {
    /// In the order in which they are met.
    pub groups: Vec<GroupErrors>,
    /// Wrenches that were measured, evenly from all rows, N and N·m.
    pub loads: Vec<PerAxis<f64>>,
}

/// The errors of a calibration on one group.
#[derive(Clone, Debug)]
pub struct GroupErrors {
    /// The label of a column, a file, a plateau.
    pub label: String,
    /// Its rows.
    pub rows: u64,
    /// The mean wrench that was measured, N and N·m.
    pub load: PerAxis<f64>,
    /// Predicted less measured.
    pub errors: PerAxis<AxisErrors>,
}

/// The errors on each group of labelled rows. Of the loads about `sample` are kept.
///
/// # Errors
/// [`FitError::Interrupted`].
pub fn group_errors(
    calibration: &Calibration,
    data: &Dataset,
    sample: u64,
    workers: Workers<'_>,
) -> Result<GroupedErrors, FitError> {
    let stride = (data.rows() / sample.max(1)).max(1) as usize;
    let work = |(): &mut (), (_, block): &(usize, &LabelledBlock)| {
        Ok(GroupedErrors::of_block(calibration, &block.rows, &block.labels, stride))
    };
    let mut positions: HashMap<String, usize> = HashMap::new();
    let mut all = GroupedErrors::default();
    let fold = |of_block: GroupedErrors| {
        all.loads.extend(of_block.loads);
        for group in of_block.groups {
            let at = *positions.entry(group.label.clone()).or_insert(all.groups.len());
            let Some(known) = all.groups.get_mut(at) else {
                all.groups.push(group);
                continue;
            };
            known.rows += group.rows;
            known.load.iter_mut().zip(group.load).for_each(|(load, sum)| *load += sum);
            quality::merge(&mut known.errors, &group.errors);
        }
        Ok(())
    };
    let blocks: Vec<_> = data.blocks().collect();
    each(&blocks, |(_, block)| &block.rows, workers, || (), work, fold)?;
    for group in &mut all.groups {
        group.load.iter_mut().for_each(|load| *load /= group.rows as f64);
    }
    Ok(all)
}

impl GroupedErrors {
    /// Those of one block, with sums of loads in place of means.
    fn of_block(
        calibration: &Calibration,
        block: &Block,
        labels: &[(String, usize)],
        stride: usize,
    ) -> Self {
        let mut predicted = PerAxis::default();
        calibration.wrench(&block.readings, &mut predicted);
        let wrench_of = |row: usize| std::array::from_fn(|axis| block.wrench[axis][row]);
        let loads = (0..block.rows).step_by(stride).map(wrench_of).collect();
        let mut start = 0;
        let mut groups = Vec::new();
        for (label, rows) in labels {
            let of_group = start..start + rows;
            start = of_group.end;
            if of_group.is_empty() {
                continue;
            }
            let measured: PerAxis<&[f64]> =
                std::array::from_fn(|axis| &block.wrench[axis][of_group.clone()]);
            let load = measured.map(|axis| axis.iter().fold(0.0, |sum, load| sum + load));
            let errors = std::array::from_fn(|axis| {
                AxisErrors::new(&predicted[axis][of_group.clone()], measured[axis])
            });
            groups.push(GroupErrors { label: label.clone(), rows: *rows as u64, load, errors });
        }
        Self { groups, loads }
    }
}
