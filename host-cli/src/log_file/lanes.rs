//! What [`super::rows`] does with many bytes at once, and how a processor does it.

use super::number::parse_plain;

/// How a processor works on several bytes at once.
pub(super) trait Lanes: Copy {
    /// Runs `task` with the instructions of this processor, so that the methods can be inlined.
    fn run<R>(self, task: impl FnOnce() -> R) -> R;

    /// A bit for each byte, the first in the lowest bit, that is among `wanted`.
    fn find(self, bytes: &[u8; 64], wanted: [u8; 2]) -> u64;

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
    fn find(self, bytes: &[u8; 64], wanted: [u8; 2]) -> u64 {
        const ONES: u64 = 0x0101_0101_0101_0101;
        let (words, _) = bytes.as_chunks::<8>();
        words.iter().rev().fold(0, |found, word| {
            let word = u64::from_le_bytes(*word);
            // The top bit of each byte says whether it differs: 0x7f carries into it from any of
            // the other bits, and out of no byte.
            let differs = |byte: u8| {
                let other = word ^ (ONES * u64::from(byte));
                ((other & (ONES * 0x7f)) + ONES * 0x7f) | other
            };
            let [a, b] = wanted.map(differs);
            // The product brings the eight top bits together in the highest byte.
            let equal = (!(a & b) >> 7) & ONES;
            found << 8 | equal.wrapping_mul(0x0102_0408_1020_4080) >> 56
        })
    }

    #[inline(always)]
    fn plain_number(self, lines: &[u8], at: usize, end: usize) -> Option<f64> {
        let (value, number_end) = parse_plain(lines, at)?;
        (number_end == end).then_some(value)
    }
}

/// Walks over the places in `lines` where either of two bytes stands. A mark is found without
/// looking at what stands between it and the one before, so numbers can be worked on in parallel.
#[derive(Clone, Copy, Debug)]
pub(super) struct Marks<'a, L> {
    lanes: L,
    lines: &'a [u8],
    wanted: [u8; 2],
    /// Where the 64 bytes start that `found` is about.
    base: usize,
    found: u64,
}

impl<'a, L: Lanes> Marks<'a, L> {
    #[inline(always)]
    pub(super) fn new(lanes: L, lines: &'a [u8], at: usize, wanted: [u8; 2]) -> Self {
        let mut marks = Self { lanes, lines, wanted, base: at, found: 0 };
        marks.find();
        marks
    }

    /// The next place, `None` when there are no more.
    #[inline(always)]
    pub(super) fn next(&mut self) -> Option<usize> {
        while self.found == 0 {
            self.base += 64;
            if self.base >= self.lines.len() {
                return None;
            }
            self.find();
        }
        let place = self.base + self.found.trailing_zeros() as usize;
        self.found &= self.found - 1;
        Some(place)
    }

    #[inline(always)]
    fn find(&mut self) {
        let rest = self.lines.get(self.base..).unwrap_or_default();
        self.found = match rest.first_chunk() {
            Some(bytes) => self.lanes.find(bytes, self.wanted),
            None => {
                let mut padded = [0; 64];
                padded[..rest.len()].copy_from_slice(rest);
                self.lanes.find(&padded, self.wanted) & !(u64::MAX << rest.len())
            }
        };
    }
}
