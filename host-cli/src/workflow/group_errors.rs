//! How a calibration errs on each group of rows, and which loads the rows are of: one pass over logs.

use std::collections::HashMap;

use super::groups::{GroupBy, of_errors};
use super::selection::UsedRows;
use super::{WorkflowError, check_channels};
use calibration::Calibration;
use calibration::quality::{self, AxisErrors};
use log_file::{self, Log, ReadOptions};
use shell_data::block::Block;
use shell_data::wrench::PerAxis;

/// The groups of some logs, and a sample of their loads.
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

/// What one block adds.
struct Part {
    groups: Vec<(String, u64, PerAxis<f64>, PerAxis<AxisErrors>)>,
    loads: Vec<PerAxis<f64>>,
}

/// The errors on each group of `logs`: those of `group_by`, or, without, of the group column, files or
/// plateaus. Of the loads about `sample` are kept.
///
/// # Errors
/// [`WorkflowError`] if a log cannot be read or has not the calibration's number of channels.
pub fn group_errors(
    calibration: &Calibration,
    logs: &[Log],
    group_by: Option<&GroupBy>,
    used: UsedRows<'_>,
    (rows, sample): (u64, u64),
    read: &ReadOptions<'_>,
) -> Result<GroupedErrors, WorkflowError> {
    let found = match group_by {
        None => of_errors(logs, read)?,
        Some(_) => None,
    };
    let group_by = group_by.or(found.as_ref()).unwrap_or(&GroupBy::File);
    for log in logs {
        check_channels(log, calibration.channels())?;
    }
    let stride = (rows / sample.max(1)).max(1) as usize;
    let map = |(): &mut (), log: usize, block: &mut Block| -> Result<Part, WorkflowError> {
        group_by.label(logs, log, block)?;
        used.select(log, block);
        Ok(Part::of(calibration, block, stride))
    };
    let mut places: HashMap<String, usize> = HashMap::new();
    let mut all = GroupedErrors::default();
    let fold = |_, part: Result<Part, WorkflowError>| -> Result<(), WorkflowError> {
        let Part { groups, loads } = part?;
        all.loads.extend(loads);
        for (label, rows, sums, errors) in groups {
            let at = *places.entry(label.clone()).or_insert(all.groups.len());
            if at == all.groups.len() {
                let (load, errors) = (PerAxis::default(), PerAxis::default());
                all.groups.push(GroupErrors { label, rows: 0, load, errors });
            }
            let group = &mut all.groups[at];
            group.rows += rows;
            group.load.iter_mut().zip(sums).for_each(|(load, sum)| *load += sum);
            quality::merge(&mut group.errors, &errors);
        }
        Ok(())
    };
    let read = ReadOptions { checksum: false, ..*read };
    let refs: Vec<&Log> = logs.iter().collect();
    log_file::read_all(&refs, &group_by.wanted(logs), &read, || (), map, fold)?;
    for group in &mut all.groups {
        group.load.iter_mut().for_each(|load| *load /= group.rows as f64);
    }
    Ok(all)
}

impl Part {
    fn of(calibration: &Calibration, block: &Block, stride: usize) -> Self {
        let mut predicted = PerAxis::default();
        calibration.wrench(&block.readings, &mut predicted);
        let wrench_of = |row: usize| std::array::from_fn(|axis| block.wrench[axis][row]);
        let loads = (0..block.rows).step_by(stride).map(wrench_of).collect();
        let mut start = 0;
        let mut groups = Vec::new();
        for (label, rows) in &block.groups {
            let rows_of = start..start + rows;
            start = rows_of.end;
            if rows_of.is_empty() {
                continue;
            }
            let measured: Vec<Vec<f64>> =
                block.wrench.iter().map(|column| column[rows_of.clone()].to_vec()).collect();
            let predicted: PerAxis<Vec<f64>> =
                std::array::from_fn(|axis| predicted[axis][rows_of.clone()].to_vec());
            let sums = std::array::from_fn(|axis| measured[axis].iter().sum());
            groups.push((
                label.clone(),
                *rows as u64,
                sums,
                quality::errors(&predicted, &measured),
            ));
        }
        Self { groups, loads }
    }
}
