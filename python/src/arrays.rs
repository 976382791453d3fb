//! Arrays of numpy as rows, in whatever layout they are, without a copy of the whole.

use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};

use numpy::ndarray::{ArrayView1, ArrayView2, s};
use shell_data::block::Block;
use shell_data::wrench::Axis;
use shellcal::workflow::in_memory::RowSource;
use twox_hash::XxHash3_128;

/// Rows of readings and wrench.
pub(crate) struct Arrays<'a> {
    /// One row per sample, one column per channel, counts.
    pub(crate) readings: ArrayView2<'a, f64>,
    /// One row per sample, one to six columns, N and N·m; axes that are not there are zero.
    pub(crate) wrench: ArrayView2<'a, f64>,
    /// For each row the place of its label, and the labels.
    pub(crate) groups: Option<(ArrayView1<'a, u32>, &'a [String])>,
    pub(crate) stop: &'a AtomicBool,
}

impl RowSource for Arrays<'_> {
    fn rows(&self) -> usize {
        self.readings.nrows()
    }

    fn channels(&self) -> usize {
        self.readings.ncols()
    }

    fn has_groups(&self) -> bool {
        self.groups.is_some()
    }

    fn fill(&self, rows: Range<usize>, block: &mut Block) {
        block.rows = rows.len();
        columns(&self.readings, rows.clone(), &mut block.readings);
        block.wrench.resize_with(Axis::ALL.len(), Vec::new);
        let given = self.wrench.ncols();
        columns(&self.wrench, rows.clone(), &mut block.wrench[..given]);
        for axis in &mut block.wrench[given..] {
            axis.clear();
            axis.resize(rows.len(), 0.0);
        }
        block.groups.clear();
        let Some((places, labels)) = self.groups else { return };
        let mut last = None;
        for &place in places.slice(s![rows]) {
            match block.groups.last_mut().filter(|_| last == Some(place)) {
                Some((_, count)) => *count += 1,
                None => block.groups.push((labels[place as usize].clone(), 1)),
            }
            last = Some(place);
        }
    }

    fn is_stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

impl Arrays<'_> {
    /// What tells these rows from others, as checksums tell files.
    pub(crate) fn checksum(&self) -> String {
        let (mut hash, mut bytes) = (XxHash3_128::new(), Vec::new());
        for (readings, wrench) in self.readings.rows().into_iter().zip(self.wrench.rows()) {
            readings.iter().chain(wrench.iter()).for_each(|v| bytes.extend(v.to_le_bytes()));
            // A few bytes at a time are slow to hash.
            if bytes.len() >= 1 << 16 {
                hash.write(&bytes);
                bytes.clear();
            }
        }
        hash.write(&bytes);
        format!("xxh128:{:032x}", hash.finish_128())
    }
}

/// Some rows of an array as columns, each one run of memory.
pub(crate) fn columns<C>(array: &ArrayView2<'_, f64>, rows: Range<usize>, out: &mut C)
where
    C: AsColumns + ?Sized,
{
    let part = array.slice(s![rows, ..]);
    for (column, from) in out.columns(array.ncols()).iter_mut().zip(part.columns()) {
        column.clear();
        column.extend(from.iter());
    }
}

/// Columns that are there, or made.
pub(crate) trait AsColumns {
    fn columns(&mut self, count: usize) -> &mut [Vec<f64>];
}

impl AsColumns for Vec<Vec<f64>> {
    fn columns(&mut self, count: usize) -> &mut [Vec<f64>] {
        self.resize_with(count, Vec::new);
        self
    }
}

impl AsColumns for [Vec<f64>] {
    fn columns(&mut self, _: usize) -> &mut [Vec<f64>] {
        self
    }
}
