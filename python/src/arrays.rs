//! Arrays of numpy as rows in memory, from whatever layout they are in.

use std::ops::Range;

use calibration::FitError;
use numpy::ndarray::{ArrayView1, ArrayView2, s};
use shell_data::block::Block;
use shell_data::dataset::{BLOCK_ROWS, Dataset};
use shell_data::wrench::{Axes, Axis};
use twox_hash::XxHash3_128;

use crate::error::PythonFailure;
use crate::interrupt::Watch;

/// Rows of readings and wrench.
pub(crate) struct Arrays<'a, 'w> {
    /// One row per sample, one column per channel, counts.
    pub(crate) readings: ArrayView2<'a, f64>,
    /// One row per sample, one to six columns, N and N·m; axes that are not there are zero.
    pub(crate) wrench: ArrayView2<'a, f64>,
    /// For each row the position of its label, and the labels.
    pub(crate) groups: Option<(ArrayView1<'a, u32>, &'a [String])>,
    /// The time of each row, s.
    pub(crate) time: Option<ArrayView1<'a, f64>>,
    /// How much each row counts.
    pub(crate) weights: Weights<'a>,
    pub(crate) watch: &'w Watch,
}

/// How much rows count.
pub(crate) enum Weights<'a> {
    /// All the same.
    Equal,
    /// Each as so many rows: where the last of these ends, among all.
    Repeats(Vec<u64>),
    /// Each by a number of its own.
    Numbers(ArrayView1<'a, f64>),
}

impl Weights<'_> {
    /// Of rows that are there so many times.
    pub(crate) fn from_repeats(repeats: ArrayView1<'_, u32>) -> Self {
        let mut end = 0;
        Self::Repeats(
            repeats
                .iter()
                .map(|&times| {
                    end += u64::from(times);
                    end
                })
                .collect(),
        )
    }
}

impl Arrays<'_, '_> {
    /// Number of rows.
    pub(crate) fn rows(&self) -> usize {
        match &self.weights {
            Weights::Repeats(ends) => ends.last().map_or(0, |&end| end as usize),
            _ => self.readings.nrows(),
        }
    }

    /// The rows as a data set; labels all alike if `labels_all` and there are none.
    pub(crate) fn dataset(&self, labels_all: bool) -> Result<Dataset, PythonFailure> {
        let rows = self.rows();
        let mut blocks = Vec::with_capacity(rows.div_ceil(BLOCK_ROWS));
        for start in (0..rows).step_by(BLOCK_ROWS) {
            if self.watch.is_stopped() {
                return Err(FitError::Interrupted.into());
            }
            let mut block = Block::default();
            self.fill(start..rows.min(start + BLOCK_ROWS), &mut block);
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

    fn fill(&self, rows: Range<usize>, block: &mut Block) {
        block.rows = rows.len();
        let range = rows.clone();
        let rows = self.positions(rows);
        let columns = |array: &ArrayView2<'_, f64>, out: &mut Vec<Vec<f64>>| match self.weights {
            Weights::Repeats(_) => {
                let column =
                    |from: ArrayView1<'_, f64>| rows.iter().map(|&row| from[row]).collect();
                *out = array.columns().into_iter().map(column).collect();
            }
            _ => range_of_columns(array, range.clone(), out),
        };
        columns(&self.readings, &mut block.readings);
        columns(&self.wrench, &mut block.wrench);
        block.wrench.resize_with(Axis::ALL.len(), Vec::new);
        for axis in &mut block.wrench[self.wrench.ncols()..] {
            axis.clear();
            axis.resize(rows.len(), 0.0);
        }
        block.time_s.clear();
        if let Some(time) = self.time {
            block.time_s.extend(rows.iter().map(|&row| time[row]));
        }
        block.weights.clear();
        if let Weights::Numbers(weights) = self.weights {
            block.weights.extend(rows.iter().map(|&row| weights[row]));
        }
        block.groups.clear();
        let Some((positions, labels)) = self.groups else { return };
        let mut last = None;
        for position in rows.iter().map(|&row| positions[row]) {
            match block.groups.last_mut().filter(|_| last == Some(position)) {
                Some((_, count)) => *count += 1,
                None => block.groups.push((labels[position as usize].clone(), 1)),
            }
            last = Some(position);
        }
    }

    /// Where some of the rows are in the arrays.
    fn positions(&self, rows: Range<usize>) -> Vec<usize> {
        let Weights::Repeats(ends) = &self.weights else { return rows.collect() };
        let mut row = ends.partition_point(|&end| end <= rows.start as u64);
        let position = |at: usize| {
            while ends[row] <= at as u64 {
                row += 1;
            }
            row
        };
        rows.map(position).collect()
    }

    /// What tells these rows from others, as checksums tell files.
    pub(crate) fn checksum(&self) -> String {
        let mut hash = XxHash3_128::new();
        let readings = self.readings.ncols() * size_of::<f64>();
        let width = readings + self.wrench.ncols() * size_of::<f64>();
        // A few bytes at a time are slow to hash.
        let mut bytes = vec![0; CHECKSUM_ROWS * width];
        let rows = self.readings.nrows();
        for start in (0..rows).step_by(CHECKSUM_ROWS) {
            let part = start..rows.min(start + CHECKSUM_ROWS);
            let bytes = &mut bytes[..part.len() * width];
            for (row, bytes) in part.zip(bytes.chunks_exact_mut(width)) {
                let (of_readings, of_wrench) = bytes.split_at_mut(readings);
                put(self.readings.row(row), of_readings);
                put(self.wrench.row(row), of_wrench);
            }
            hash.write(bytes);
        }
        match &self.weights {
            Weights::Equal => {}
            Weights::Repeats(ends) => ends.iter().for_each(|end| hash.write(&end.to_le_bytes())),
            Weights::Numbers(weights) => {
                weights.iter().for_each(|weight| hash.write(&weight.to_le_bytes()));
            }
        }
        format!("xxh128:{:032x}", hash.finish_128())
    }
}

/// Rows that are hashed at a time.
const CHECKSUM_ROWS: usize = 512;

/// The numbers of a row as bytes, little-endian.
fn put(row: ArrayView1<'_, f64>, bytes: &mut [u8]) {
    let (bytes, _) = bytes.as_chunks_mut::<{ size_of::<f64>() }>();
    match row.as_slice() {
        Some(row) => bytes.iter_mut().zip(row).for_each(|(to, x)| *to = x.to_le_bytes()),
        None => bytes.iter_mut().zip(row).for_each(|(to, x)| *to = x.to_le_bytes()),
    }
}

/// Rows of an array that follow each other as columns, each one run of memory.
pub(crate) fn range_of_columns(
    array: &ArrayView2<'_, f64>,
    rows: Range<usize>,
    out: &mut Vec<Vec<f64>>,
) {
    let part = array.slice(s![rows, ..]);
    let channels = part.ncols();
    out.resize_with(channels, Vec::new);
    out.iter_mut().for_each(Vec::clear);
    // Rows one after the other, as numpy lays out an array unless told otherwise.
    if let Some(values) = part.as_slice().filter(|_| channels > 0) {
        for tile in values.chunks(TILE_ROWS * channels) {
            for (position, column) in out.iter_mut().enumerate() {
                column.extend(tile.chunks_exact(channels).map(|row| row[position]));
            }
        }
        return;
    }
    for (column, from) in out.iter_mut().zip(part.columns()) {
        match from.as_slice() {
            Some(from) => column.extend_from_slice(from),
            None => column.extend(from.iter()),
        }
    }
}

/// Rows that stay in a core's nearest cache while they become columns.
const TILE_ROWS: usize = 64;
