//! The operations of [`super::rows`] on many bytes at once, for each instruction set.

use super::number::{parse_digits, parse_long, signed};

/// The number of bytes that are searched together.
pub(crate) const BLOCK: usize = 64;

/// An instruction set that works on several bytes at once.
pub(crate) trait InstructionSet: Copy {
    /// Runs `task` with the instructions of this processor, so that the methods can be inlined.
    fn run<R>(self, task: impl FnOnce() -> R) -> R;

    /// For each of `wanted`, a bit for each byte that is one, the first in the lowest bit.
    fn find(self, bytes: &[u8; BLOCK], wanted: [u8; 2]) -> [u64; 2];

    /// Writes down the positions of the bits that are set, lowest first, counted from `base`; returns
    /// how many there are. Places behind these may be written to as well.
    #[inline(always)]
    fn write_ends(self, mut bits: u64, base: u32, positions: &mut [u32; BLOCK]) -> usize {
        /// More than there are, mostly. Writing too many takes less time than a loop whose length
        /// cannot be predicted.
        const USUAL: usize = 16;
        let count = bits.count_ones() as usize;
        for position in &mut positions[..USUAL] {
            *position = base.wrapping_add(bits.trailing_zeros());
            bits &= bits.wrapping_sub(1);
        }
        for position in &mut positions[USUAL..count.max(USUAL)] {
            *position = base + bits.trailing_zeros();
            bits &= bits - 1;
        }
        count
    }

    /// The number that the digits of `lines[start..end]` spell, up to 32 bytes, joined within a register or two,
    /// and how many of them follow a point. `None` where there are no digits in front of the point or behind it,
    /// more than fit 64 bits, or anything else.
    fn digits(self, lines: &[u8], start: usize, end: usize) -> Option<(u64, usize)>;

    /// The slow path for fields that [`Self::digits`] does not take, kept out of the loop that
    /// [`Self::plain_number`] is inlined in.
    fn other_number(self, lines: &[u8], at: usize, end: usize) -> Option<f64>;

    /// The number that all of `lines[at..end]` spells if it is a plain decimal (`-12`, `-0.125`).
    /// `None` leaves the field to [`super::number::parse_field`].
    #[inline(always)]
    fn plain_number(self, lines: &[u8], at: usize, end: usize) -> Option<f64> {
        let negative = *lines.get(at)? == b'-';
        let start = at + usize::from(negative);
        let length = end.wrapping_sub(start);
        let plain = if length <= 32 { self.digits(lines, start, end) } else { None };
        match plain {
            Some((mantissa, decimals)) => signed(negative, mantissa, -(decimals as i32)),
            None => self.other_number(lines, at, end),
        }
    }

    /// The first numbers of a column that are whole and have up to eight digits; how many were parsed, which may be
    /// fewer than there are.
    #[inline(always)]
    fn whole_numbers(self, lines: &[u8], fields: ColumnFields<'_>, values: &mut [f64]) -> usize {
        for (row, value) in values.iter_mut().enumerate() {
            let (start, end) = fields.position(row);
            let Some(number) = parse_digits(lines, start, end) else { return row };
            *value = number as i64 as f64;
        }
        values.len()
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

    /// Has no such registers.
    #[inline(always)]
    fn digits(self, _: &[u8], _: usize, _: usize) -> Option<(u64, usize)> {
        None
    }

    #[inline(always)]
    fn other_number(self, lines: &[u8], at: usize, end: usize) -> Option<f64> {
        parse_long(lines, at, end)
    }
}
