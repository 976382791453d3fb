//! What [`super::rows`] does with many bytes at once, and how a processor does it.

use super::number::parse_plain;

/// How a processor works on several bytes at once.
pub(super) trait Lanes: Copy {
    /// Runs `task` with the instructions of this processor, so that the methods can be inlined.
    fn run<R>(self, task: impl FnOnce() -> R) -> R;

    /// For each of `wanted`, a bit for each byte that is one, the first in the lowest bit.
    fn find(self, bytes: &[u8; 64], wanted: [u8; 2]) -> [u64; 2];

    /// The number that all of `lines[at..end]` spells if it is a plain decimal (`-12`, `-0.125`).
    /// `None` leaves the field to [`super::number::parse_field`].
    fn plain_number(self, lines: &[u8], at: usize, end: usize) -> Option<f64>;
}

/// Any processor: eight bytes within one 64-bit word.
#[derive(Clone, Copy, Debug)]
pub(super) struct Portable;

impl Lanes for Portable {
    fn run<R>(self, task: impl FnOnce() -> R) -> R {
        task()
    }

    #[inline(always)]
    fn find(self, bytes: &[u8; 64], wanted: [u8; 2]) -> [u64; 2] {
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

    #[inline(always)]
    fn plain_number(self, lines: &[u8], at: usize, end: usize) -> Option<f64> {
        let (value, number_end) = parse_plain(lines, at)?;
        (number_end == end).then_some(value)
    }
}
