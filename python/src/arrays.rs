//! Conversion of numpy arrays, in any memory layout, to rows in memory.

use std::ops::Range;

use calibration::FitError;
use numpy::ndarray::{ArrayView1, ArrayView2, s};
use shell_data::block::Block;
use shell_data::dataset::{BLOCK_ROWS, Dataset};
use shell_data::wrench::{Axes, Axis};
use twox_hash::XxHash3_128;

use crate::error::PythonFailure;
use crate::interrupt::Watch;

pub(crate) struct Arrays<'a, 'w> {
    /// One row per sample, one column per channel, counts.
    pub(crate) readings: ArrayView2<'a, f64>,
    /// One row per sample, one to six columns, N and N·m; missing axes are zero.
    pub(crate) wrench: ArrayView2<'a, f64>,
    /// The position of each row's label, and the labels.
    pub(crate) groups: Option<(ArrayView1<'a, u32>, &'a [String])>,
    pub(crate) time: Option<ArrayView1<'a, f64>>,
    /// Number of repetitions of each row, and the index of the original row for each repeated row.
    pub(crate) repeats: Option<(ArrayView1<'a, u32>, Vec<usize>)>,
    /// Weight of each row, if there are no repetitions.
    pub(crate) weights: Option<ArrayView1<'a, f64>>,
    pub(crate) watch: &'w Watch,
}

/// Returns the index of the original row for each repeated row.
pub(crate) fn repeated(repeats: ArrayView1<'_, u32>) -> Vec<usize> {
    let rows = repeats.iter().enumerate();
    rows.flat_map(|(row, &times)| std::iter::repeat_n(row, times as usize)).collect()
}

impl Arrays<'_, '_> {
    pub(crate) fn rows(&self) -> usize {
        self.repeats.as_ref().map_or(self.readings.nrows(), |(_, rows)| rows.len())
    }

    /// Returns the rows as a data set. Without labels, and with `labels_all`, all rows get the same
    /// label.
    pub(crate) fn dataset(&self, labels_all: bool) -> Result<Dataset, PythonFailure> {
        let rows = self.rows();
        let mut blocks = Vec::with_capacity(rows.div_ceil(BLOCK_ROWS));
        for start in (0..rows).step_by(BLOCK_ROWS) {
            if self.watch.is_stopped() {
                return Err(FitError::Interrupted.into());
            }
            let mut block = self.block(start..rows.min(start + BLOCK_ROWS));
            if labels_all && self.groups.is_none() {
                block.groups = vec![(String::new(), block.rows)];
            }
            blocks.push(block);
        }
        if blocks.is_empty() {
            return Err(FitError::NoRows.into());
        }
        Ok(Dataset::from_blocks("<array>", Axes::ALL, blocks))
    }

    fn block(&self, range: Range<usize>) -> Block {
        let rows = match &self.repeats {
            Some((_, all)) => all[range.clone()].to_vec(),
            None => range.clone().collect::<Vec<usize>>(),
        };
        let picked = |column: ArrayView1<'_, f64>| -> Vec<f64> {
            rows.iter().map(|&row| column[row]).collect()
        };
        let columns = |array: &ArrayView2<'_, f64>| match self.repeats {
            Some(_) => array.columns().into_iter().map(picked).collect(),
            None => range_of_columns(array, range.clone()),
        };
        let mut wrench = columns(&self.wrench);
        wrench.resize_with(Axis::ALL.len(), || vec![0.0; rows.len()]);
        let mut groups: Vec<(String, usize)> = Vec::new();
        if let Some((positions, labels)) = self.groups {
            for run in rows.chunk_by(|a, b| positions[*a] == positions[*b]) {
                groups.push((labels[positions[run[0]] as usize].clone(), run.len()));
            }
        }
        Block {
            rows: rows.len(),
            readings: columns(&self.readings),
            wrench,
            time_s: self.time.map_or_else(Vec::new, picked),
            weights: self.weights.map_or_else(Vec::new, picked),
            groups,
            ..Block::default()
        }
    }

    pub(crate) fn checksum(&self) -> String {
        let mut hash = XxHash3_128::new();
        let mut bytes = Vec::new();
        let rows = self.readings.nrows();
        for start in (0..rows).step_by(CHECKSUM_ROWS) {
            bytes.clear();
            for row in start..rows.min(start + CHECKSUM_ROWS) {
                let values = self.readings.row(row).into_iter().chain(self.wrench.row(row));
                values.for_each(|value| bytes.extend_from_slice(&value.to_le_bytes()));
            }
            hash.write(&bytes);
        }
        let mut end = 0;
        for times in self.repeats.iter().flat_map(|(repeats, _)| repeats) {
            end += u64::from(*times);
            hash.write(&end.to_le_bytes());
        }
        self.weights.iter().flatten().for_each(|weight| hash.write(&weight.to_le_bytes()));
        format!("xxh128:{:032x}", hash.finish_128())
    }
}

/// Number of rows hashed at a time.
const CHECKSUM_ROWS: usize = 512;

/// Copies consecutive rows of an array to columns, each contiguous in memory.
pub(crate) fn range_of_columns(array: &ArrayView2<'_, f64>, rows: Range<usize>) -> Vec<Vec<f64>> {
    array.slice(s![rows, ..]).columns().into_iter().map(|column| column.to_vec()).collect()
}
