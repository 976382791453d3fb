//! The operations of [`super::rows`] on many bytes at once, for each instruction set.

/// The number of bytes that are searched together.
pub(crate) const BLOCK: usize = 64;

/// An instruction set that works on several bytes at once.
pub(crate) trait InstructionSet: Copy {
    /// Runs `task` with the instructions of this processor, so that the methods can be inlined.
    fn run<R>(self, task: impl FnOnce() -> R) -> R;

    /// For each of `wanted`, a bit for each byte that is one, the first in the lowest bit.
    fn find(self, bytes: &[u8; BLOCK], wanted: [u8; 2]) -> [u64; 2];

    /// The number that the digits of `lines[start..end]` spell, up to 32 bytes, joined within a register or two,
    /// and how many of them follow a point. `None` where there are no digits in front of the point or behind it,
    /// more than fit 64 bits, or anything else; and where there are no such registers.
    #[inline(always)]
    fn digits(self, _lines: &[u8], _start: usize, _end: usize) -> Option<(u64, usize)> {
        None
    }
}

/// The fields of a column, row by row. Not a closure, because closures are not always inlined.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ColumnFields<'a> {
    /// What precedes each field, and where each ends; both a slice and how far rows are apart in it.
    pub(crate) befores: (&'a [u32], usize),
    pub(crate) ends: (&'a [u32], usize),
}

impl ColumnFields<'_> {
    /// Where the field of a row starts and ends.
    #[inline(always)]
    pub(crate) fn position(self, row: usize) -> (usize, usize) {
        let (befores, ends) = (self.befores, self.ends);
        let start = befores.0[row * befores.1].wrapping_add(1);
        (start as usize, ends.0[row * ends.1] as usize)
    }
}

/// For any processor: eight bytes within one 64-bit word.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Portable;

impl InstructionSet for Portable {
    fn run<R>(self, task: impl FnOnce() -> R) -> R {
        task()
    }

    #[inline(always)]
    fn find(self, bytes: &[u8; BLOCK], wanted: [u8; 2]) -> [u64; 2] {
        const ONES: u64 = 0x0101_0101_0101_0101;
        let (words, _) = bytes.as_chunks::<8>();
        wanted.map(|byte| {
            words.iter().rev().fold(0, |found, word| {
                let other = u64::from_le_bytes(*word) ^ (ONES * u64::from(byte));
                // The top bit of each byte says whether it differs: 0x7f carries into it from any
                // of the other bits, and out of no byte.
                let differs = ((other & (ONES * 0x7f)) + ONES * 0x7f) | other;
                // The product brings the eight top bits together in the highest byte.
                let equal = (!differs >> 7) & ONES;
                found << 8 | equal.wrapping_mul(0x0102_0408_1020_4080) >> 56
            })
        })
    }
}
