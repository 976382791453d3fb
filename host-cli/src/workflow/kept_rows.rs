//! Rows in little memory: counts, and the wrench of a digital sensor, as what they are, integers of
//! 16 bits.

use std::sync::{Mutex, OnceLock, PoisonError};

use memmap2::MmapMut;

use calibration::decimal_step::{DecimalStep, WordEncoding};
use shell_data::block::Block;

/// Memory for rows: one mapping, of huge pages where there will be rows enough for some. To have
/// small pages one by one would take longer than to write to them.
pub(super) struct Store(Option<MmapMut>);

impl Store {
    /// Room for so many bytes of rows, about `expected` of which will be used.
    pub(super) fn new(bytes: usize, expected: u64) -> Self {
        let map = MmapMut::map_anon(bytes).ok();
        if let Some(map) = map.as_ref().filter(|_| expected >= HUGE_PAGE) {
            take_huge_pages(map);
        }
        Self(map)
    }

    /// All of it.
    pub(super) fn room(&mut self) -> Room<'_> {
        let bytes = self.0.as_deref_mut().unwrap_or_default();
        Room(Mutex::new(bytemuck::cast_slice_mut(bytes)))
    }
}

#[cfg(target_os = "linux")]
fn take_huge_pages(map: &MmapMut) {
    // Without them it takes longer, and that is all.
    let _ = map.advise(memmap2::Advice::HugePage);
}

#[cfg(not(target_os = "linux"))]
fn take_huge_pages(_: &MmapMut) {}

/// The size of a huge page.
const HUGE_PAGE: u64 = 2 << 20;

/// Memory for rows that is not yet taken.
pub(super) struct Room<'a>(Mutex<&'a mut [u16]>);

impl<'a> Room<'a> {
    fn take(&self, words: usize) -> Option<&'a mut [u16]> {
        // A poisoned lock means that a thread has panicked, and the panic will be passed on.
        self.0.lock().unwrap_or_else(PoisonError::into_inner).split_off_mut(..words)
    }
}

/// The readings and the wrench of some rows, in little memory.
#[derive(Debug)]
pub(super) struct KeptBlock<'a> {
    rows: usize,
    /// The readings, then the wrench.
    columns: Vec<Column>,
    /// Those columns that are small integers, one after another.
    words: &'a [u16],
    others: Vec<f64>,
}

/// How the numbers of one column are kept.
#[derive(Clone, Copy, Debug)]
enum Column {
    /// As multiples of a step.
    Words(WordEncoding),
    /// As they are.
    Other,
}

/// What the numbers of each column are multiples of: in the first block, and then mostly in all.
pub(super) type Steps = OnceLock<Vec<Option<DecimalStep>>>;

impl<'a> KeptBlock<'a> {
    /// Of the rows of `block`, all of whose readings and wrench there are; `None` if there is no
    /// room for them.
    pub(super) fn new(block: &Block, steps: &Steps, room: &Room<'a>) -> Option<Self> {
        let columns = || block.readings.iter().chain(&block.wrench);
        let steps = steps.get_or_init(|| columns().map(|column| DecimalStep::of(column)).collect());
        let words = room.take(steps.len() * block.rows)?;
        let (mut kept, mut others, mut used) = (Vec::with_capacity(steps.len()), Vec::new(), 0);
        for (column, step) in columns().zip(steps) {
            let out = &mut words[used..used + block.rows];
            let column_words = step.and_then(|step| step.count(column, out));
            match column_words {
                Some(_) => used += block.rows,
                None => others.extend_from_slice(column),
            }
            kept.push(column_words.map_or(Column::Other, Column::Words));
        }
        Some(Self { rows: block.rows, columns: kept, words, others })
    }

    /// What the rows take besides the room.
    pub(super) fn other_bytes(&self) -> usize {
        size_of_val(&self.others[..])
    }

    /// Writes the rows into `block` as they were read, of so many channels.
    pub(super) fn restore(&self, block: &mut Block, channels: usize) {
        block.rows = self.rows;
        block.readings.resize_with(channels, Vec::new);
        block.wrench.resize_with(self.columns.len() - channels, Vec::new);
        let (mut words, mut others) = (self.words, &self.others[..]);
        let columns = block.readings.iter_mut().chain(&mut block.wrench);
        for (kept, column) in self.columns.iter().zip(columns) {
            // Those of the block before are written over.
            column.resize(self.rows, 0.0);
            match kept {
                Column::Words(how) => {
                    let words = words.split_off(..self.rows).expect("as many as there are rows");
                    how.values(words, column);
                }
                Column::Other => {
                    let numbers = others.split_off(..self.rows).expect("likewise");
                    column.copy_from_slice(numbers);
                }
            }
        }
    }
}
