//! Rows in little memory: counts, and the wrench of a digital sensor, as what they are, integers of
//! 16 bits.

use std::sync::{Mutex, OnceLock, PoisonError};

use memmap2::MmapMut;

use calibration::decimal_step::{DecimalStep, WordEncoding};
use shell_data::block::Block;

/// Memory for rows: one mapping, of huge pages where there will be rows enough for some. To have
/// small pages one by one would take longer than to write to them.
pub(super) struct Store {
    map: Option<MmapMut>,
    /// What of it may be used: a number of whole words.
    bytes: usize,
}

impl Store {
    /// Room for so many bytes of rows, about `expected` of which will be used.
    pub(super) fn new(bytes: u64, expected: u64) -> Self {
        let word = size_of::<u64>() as u64;
        let bytes = usize::try_from(bytes / word * word).unwrap_or(0);
        // The system begins a mapping of whole huge pages where one begins. What is not written to takes
        // no memory.
        let mapped = bytes.checked_next_multiple_of(HUGE_PAGE as usize);
        let map = mapped.and_then(|bytes| MmapMut::map_anon(bytes).ok());
        if let Some(map) = map.as_ref().filter(|_| expected >= HUGE_PAGE) {
            take_huge_pages(map);
        }
        Self { map, bytes }
    }

    /// All of it.
    pub(super) fn room(&mut self) -> Room<'_> {
        let map = self.map.as_deref_mut().unwrap_or_default();
        let bytes = self.bytes.min(map.len());
        Room(Mutex::new(bytemuck::cast_slice_mut(&mut map[..bytes])))
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
pub(super) struct Room<'a>(Mutex<&'a mut [u64]>);

impl<'a> Room<'a> {
    fn take(&self, words: usize) -> Option<&'a mut [u64]> {
        // A poisoned lock means that a thread has panicked, and the panic will be passed on.
        self.0.lock().unwrap_or_else(PoisonError::into_inner).split_off_mut(..words)
    }

    /// Room for so many numbers as small integers.
    fn words(&self, count: usize) -> Option<&'a mut [u16]> {
        let room = bytemuck::cast_slice_mut(self.take(count.div_ceil(4))?);
        Some(&mut room[..count])
    }

    /// Room for so many numbers as they are.
    fn numbers(&self, count: usize) -> Option<&'a mut [f64]> {
        self.take(count).map(bytemuck::cast_slice_mut)
    }
}

/// The readings and the wrench of some rows, in little memory.
#[derive(Debug)]
pub(super) struct KeptBlock<'a> {
    rows: usize,
    /// The readings, then the wrench.
    columns: Vec<Column<'a>>,
}

/// How the numbers of one column are kept.
#[derive(Clone, Copy, Debug)]
enum Column<'a> {
    /// As multiples of a step.
    Words(WordEncoding, &'a [u16]),
    /// As they are.
    Numbers(&'a [f64]),
}

impl<'a> Column<'a> {
    /// Of `numbers`, most of which are multiples of `step`, if there is one; `None` if there is no room.
    fn new(numbers: &[f64], step: Option<DecimalStep>, room: &Room<'a>) -> Option<Self> {
        if let Some(step) = step {
            let words = room.words(numbers.len())?;
            if let Some(how) = step.count(numbers, words) {
                return Some(Self::Words(how, words));
            }
        }
        let copy = room.numbers(numbers.len())?;
        copy.copy_from_slice(numbers);
        Some(Self::Numbers(copy))
    }
}

/// What the numbers of each column are multiples of: in the first block, and then mostly in all.
pub(super) type Steps = OnceLock<Vec<Option<DecimalStep>>>;

impl<'a> KeptBlock<'a> {
    /// Of the rows of `block`, all of whose readings and wrench there are; `None` if there is no
    /// room for them.
    pub(super) fn new(block: &Block, steps: &Steps, room: &Room<'a>) -> Option<Self> {
        let columns = || block.readings.iter().chain(&block.wrench);
        let steps = steps.get_or_init(|| columns().map(|column| DecimalStep::of(column)).collect());
        let kept = columns().zip(steps).map(|(column, step)| Column::new(column, *step, room));
        Some(Self { rows: block.rows, columns: kept.collect::<Option<_>>()? })
    }

    /// The memory that the rows take.
    pub(super) fn bytes(&self) -> u64 {
        let of = |column: &Column<'_>| match column {
            Column::Words(_, words) => size_of_val(*words),
            Column::Numbers(numbers) => size_of_val(*numbers),
        };
        self.columns.iter().map(of).sum::<usize>() as u64
    }

    /// Writes the rows into `block` as they were read, of so many channels.
    pub(super) fn restore(&self, block: &mut Block, channels: usize) {
        block.rows = self.rows;
        block.readings.resize_with(channels, Vec::new);
        block.wrench.resize_with(self.columns.len() - channels, Vec::new);
        let columns = block.readings.iter_mut().chain(&mut block.wrench);
        for (kept, column) in self.columns.iter().zip(columns) {
            // Those of the block before are written over.
            column.resize(self.rows, 0.0);
            match *kept {
                Column::Words(how, words) => how.values(words, column),
                Column::Numbers(numbers) => column.copy_from_slice(numbers),
            }
        }
    }
}
