//! The operations of [`super::rows`] on many bytes at once, for each instruction set.

pub(crate) const BLOCK: usize = 64;

pub(crate) trait InstructionSet: Copy {
    /// Runs `task` with this instruction set enabled, so that the methods can be inlined.
    fn run<R>(self, task: impl FnOnce() -> R) -> R;

    /// Returns a bit mask for each byte of `wanted`: the positions of equal bytes, with the first in the lowest bit.
    fn find(self, bytes: &[u8; BLOCK], wanted: [u8; 2]) -> [u64; 2];

    /// Parses the digits of `lines[start..end]`, up to 32 bytes. Returns the number without its point, and the number
    /// of decimals. `None` if digits are missing before or after a point, if the number exceeds 64 bits, for other
    /// characters, and for processors without wide registers.
    #[inline(always)]
    fn digits(self, _lines: &[u8], _start: usize, _end: usize) -> Option<(u64, usize)> {
        None
    }
}

/// The fields of a column, row by row. It is not a closure, because closures are not always inlined.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ColumnFields<'a> {
    /// `befores`: the position before each field; `ends`: the end of each field. Each has the distance between rows in
    /// its slice.
    pub(crate) befores: (&'a [u32], usize),
    pub(crate) ends: (&'a [u32], usize),
}

impl ColumnFields<'_> {
    #[inline(always)]
    pub(crate) fn position(self, row: usize) -> (usize, usize) {
        let (befores, ends) = (self.befores, self.ends);
        let start = befores.0[row * befores.1].wrapping_add(1);
        (start as usize, ends.0[row * ends.1] as usize)
    }
}

/// The implementation for any processor: eight bytes in a 64-bit word.
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
                // The top bit of each byte is set if it differs: adding 0x7f to the lower seven bits carries
                // into the top bit if any of them is set, and never out of the byte.
                let differs = ((other & (ONES * 0x7f)) + ONES * 0x7f) | other;
                // The product collects the eight bits in the highest byte.
                let equal = (!differs >> 7) & ONES;
                found << 8 | equal.wrapping_mul(0x0102_0408_1020_4080) >> 56
            })
        })
    }
}
