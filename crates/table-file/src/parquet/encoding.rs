//! Encodings of values and levels in a page ("Parquet encoding definitions"). Values are decoded on request, because
//! a few bytes can stand for any number of them.

use crate::bytes::ByteReader;

/// Integers of a fixed width in the RLE/bit-packing hybrid encoding.
pub(crate) struct Integers {
    bytes: Vec<u8>,
    /// Position of the next run.
    at: usize,
    width: u32,
    run: EncodedRun,
}

impl Integers {
    /// Returns `None` if the width is invalid.
    pub(crate) fn new(bytes: Vec<u8>, width: u32) -> Option<Self> {
        (width <= 32).then_some(Self { bytes, at: 0, width, run: EncodedRun::Same(0, 0) })
    }

    /// Decodes single bits, packed without a header.
    pub(super) fn of_bits(bytes: Vec<u8>) -> Self {
        let (at, run) = (bytes.len(), EncodedRun::Packed(8 * bytes.len() as u64, 0));
        Self { bytes, at, width: 1, run }
    }

    /// Appends the next values, at most `most`; `None` if there are no more.
    pub(crate) fn read(&mut self, most: usize, values: &mut Vec<u64>) -> Option<()> {
        loop {
            match &mut self.run {
                EncodedRun::Same(0, _) | EncodedRun::Packed(0, _) => {
                    let mut rest = ByteReader::new(self.bytes.get(self.at..)?);
                    self.run = next_run(&self.bytes, &mut rest, self.width)?;
                    self.at = self.bytes.len() - rest.rest.len();
                }
                EncodedRun::Same(left, value) => {
                    let count = most.min(usize::try_from(*left).unwrap_or(usize::MAX));
                    *left -= count as u64;
                    values.resize(values.len() + count, *value);
                    return Some(());
                }
                EncodedRun::Packed(left, bit) => {
                    let count = most.min(usize::try_from(*left).unwrap_or(usize::MAX));
                    *left -= count as u64;
                    let (start, width) = (*bit, self.width);
                    *bit += count * width as usize;
                    let packed =
                        (0..count).map(|at| bits(&self.bytes, start + at * width as usize, width));
                    values.extend(packed);
                    return Some(());
                }
            }
        }
    }
}

#[derive(Clone, Copy, Debug)]
enum EncodedRun {
    /// A value, and the number of repetitions.
    Same(u64, u64),
    /// A number of packed values, and the position of the first bit.
    Packed(u64, usize),
}

/// Decodes the header of the run at the start of `rest`, which is the end of `bytes`.
fn next_run(bytes: &[u8], rest: &mut ByteReader<'_>, width: u32) -> Option<EncodedRun> {
    let head = rest.varint()?;
    if head & 1 == 0 {
        let mut value = [0; 8];
        let stored = rest.take(width.div_ceil(8) as usize)?;
        value[..stored.len()].copy_from_slice(stored);
        return Some(EncodedRun::Same(head >> 1, u64::from_le_bytes(value)));
    }
    let start = bytes.len() - rest.rest.len();
    // Eight values take as many bytes as a value has bits. The last ones may be cut off.
    let packed = (head >> 1).saturating_mul(u64::from(width));
    let packed = usize::try_from(packed).unwrap_or(usize::MAX).min(rest.rest.len());
    rest.take(packed)?;
    let there = match width {
        0 => (head >> 1).saturating_mul(8),
        width => 8 * packed as u64 / u64::from(width),
    };
    Some(EncodedRun::Packed(there, 8 * start))
}

/// Returns `width` bits from a bit position, lowest first; zeros beyond the end.
#[inline]
fn bits(bytes: &[u8], start: usize, width: u32) -> u64 {
    let first = start / 8;
    if width <= 56
        && let Some(word) = bytes.get(first..).and_then(<[u8]>::first_chunk)
    {
        return u64::from_le_bytes(*word) >> (start % 8) & ((1 << width) - 1);
    }
    let mut word = [0; 16];
    for (to, from) in word.iter_mut().zip(bytes.get(first..).unwrap_or_default()) {
        *to = *from;
    }
    let shifted = u128::from_le_bytes(word) >> (start % 8);
    (shifted & ((1_u128 << width) - 1)) as u64
}

/// Delta-encoded integers, in blocks of miniblocks with a width each.
pub(super) struct Deltas {
    bytes: Vec<u8>,
    at: usize,
    left: u64,
    value: i64,
    /// Number of values per miniblock, and number of miniblocks per block.
    size: usize,
    miniblocks: usize,
    /// The block's smallest difference, and the widths of its remaining miniblocks.
    least: i64,
    widths: std::vec::IntoIter<u8>,
    /// The miniblock's width, and the number of values read from it.
    width: u32,
    read: usize,
    is_first: bool,
}

impl Deltas {
    /// Returns `None` for an invalid header.
    pub(super) fn new(bytes: Vec<u8>) -> Option<Self> {
        let mut head = ByteReader::new(&bytes);
        let block = usize::try_from(head.varint()?).ok()?;
        let miniblocks = usize::try_from(head.varint()?).ok()?;
        let left = head.varint()?;
        let value = head.zigzag()?;
        let size = block.checked_div(miniblocks)?;
        if miniblocks > 1024 || size == 0 || size > 1 << 20 || size % 8 != 0 {
            return None;
        }
        let at = bytes.len() - head.rest.len();
        let (widths, read) = (Vec::new().into_iter(), size);
        let (least, width, is_first) = (0, 0, true);
        Some(Self {
            bytes,
            at,
            left,
            value,
            size,
            miniblocks,
            least,
            widths,
            width,
            read,
            is_first,
        })
    }

    /// Moves to the next miniblock.
    fn advance(&mut self) -> Option<()> {
        self.at += self.width as usize * self.size / 8;
        if self.widths.len() == 0 {
            let mut rest = ByteReader::new(self.bytes.get(self.at..)?);
            self.least = rest.zigzag()?;
            self.widths = rest.take(self.miniblocks)?.to_vec().into_iter();
            self.at = self.bytes.len() - rest.rest.len();
        }
        (self.width, self.read) = (u32::from(self.widths.next()?), 0);
        let is_there = self.width == 0 || self.at < self.bytes.len();
        (self.width <= 64 && is_there).then_some(())
    }

    /// Splits bytes that begin with delta-encoded integers, after the last integer.
    pub(super) fn split(mut bytes: Vec<u8>) -> Option<(Self, Vec<u8>)> {
        let mut integers = Self::new(bytes)?;
        let mut left = integers.left.saturating_sub(1);
        while left > 0 {
            integers.advance()?;
            left = left.saturating_sub(integers.size as u64);
        }
        // The last miniblock is stored whole.
        let end = integers.at + integers.width as usize * integers.size / 8;
        bytes = integers.bytes;
        let rest = if end <= bytes.len() { bytes.split_off(end) } else { return None };
        Some((Self::new(bytes)?, rest))
    }
}

impl Iterator for Deltas {
    type Item = i64;

    fn next(&mut self) -> Option<i64> {
        self.left = self.left.checked_sub(1)?;
        if std::mem::take(&mut self.is_first) {
            return Some(self.value);
        }
        if self.read == self.size {
            self.advance()?;
        }
        let start = 8 * self.at + self.read * self.width as usize;
        let difference = bits(&self.bytes, start, self.width);
        self.read += 1;
        self.value = self.value.wrapping_add(self.least).wrapping_add(difference as i64);
        Some(self.value)
    }
}

/// Texts that are stored as the lengths of all texts, followed by their bytes. The number of bytes that each text
/// shares with the previous one may precede the lengths.
pub(super) struct DeltaTexts {
    shared: Option<Deltas>,
    lengths: Deltas,
    bytes: Vec<u8>,
    at: usize,
    before: Vec<u8>,
}

impl DeltaTexts {
    pub(super) fn new(bytes: Vec<u8>, shares: bool) -> Option<Self> {
        let (shared, bytes) = match shares {
            true => Deltas::split(bytes).map(|(shared, rest)| (Some(shared), rest))?,
            false => (None, bytes),
        };
        let (lengths, bytes) = Deltas::split(bytes)?;
        Some(Self { shared, lengths, bytes, at: 0, before: Vec::new() })
    }

    pub(super) fn next(&mut self) -> Option<&[u8]> {
        let shared = self.shared.as_mut().map_or(Some(0), Deltas::next)?;
        let (shared, length) = (usize::try_from(shared).ok()?, self.lengths.next()?);
        let end = self.at.checked_add(usize::try_from(length).ok()?)?;
        let own = self.bytes.get(self.at..end)?;
        if shared > self.before.len() {
            return None;
        }
        self.before.truncate(shared);
        self.before.extend_from_slice(own);
        self.at = end;
        Some(&self.before)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Examples from the format specification.
    #[test]
    fn runs_and_packed_values_are_those_of_the_specification() {
        let packed = vec![0b0000_0011, 0b1000_1000, 0b1100_0110, 0b1111_1010];
        let values = |bytes, width, most| {
            let (mut integers, mut values) = (Integers::new(bytes, width).unwrap(), Vec::new());
            while integers.read(most, &mut values).is_some() {}
            values
        };
        for most in [1, 3, 100] {
            assert_eq!(values(packed.clone(), 3, most), [0, 1, 2, 3, 4, 5, 6, 7]);
            assert_eq!(values(vec![10 << 1, 9], 4, most), [9; 10]);
        }
    }

    #[test]
    fn texts_are_those_of_the_specification() {
        // Four integers: the least difference, and the others relative to it in `width` bits.
        let integers = |first: u8, least: u8, width: u8, packed: u16| {
            let mut bytes = vec![0x80, 0x01, 4, 4, 2 * first, least, width, 0, 0, 0];
            bytes.extend(packed.to_le_bytes());
            // Thirty-two numbers.
            bytes.resize(10 + 4 * usize::from(width), 0);
            bytes
        };
        let texts = |bytes: Vec<u8>, shares: bool| {
            let mut texts = DeltaTexts::new(bytes, shares).unwrap();
            let next = || Some(String::from_utf8_lossy(texts.next()?).into_owned());
            std::iter::from_fn(next).collect::<Vec<String>>()
        };
        let lengths = integers(5, 0, 1, 0b010);
        let bytes = [&lengths[..], b"HelloWorldFoobarABCDEF"].concat();
        assert_eq!(texts(bytes, false), ["Hello", "World", "Foobar", "ABCDEF"]);
        // Shared bytes 0, 2, 0, 3; lengths of the rest 4, 2, 6, 5.
        let (shared, rest) = (integers(0, 3, 3, 0o504), integers(4, 3, 3, 0o160));
        let bytes = [&shared[..], &rest, b"axislebabbleyhood"].concat();
        assert_eq!(texts(bytes, true), ["axis", "axle", "babble", "babyhood"]);
        assert!(DeltaTexts::new(vec![0x80, 0x01, 4, 4, 10, 0, 1, 0], false).is_none());
    }

    #[test]
    fn differences_are_those_of_the_specification() {
        // 1 to 5: one block of 128 in four miniblocks, all differences are 1.
        let same = vec![0x80, 0x01, 4, 5, 2, 2, 0, 0, 0, 0];
        assert_eq!(Deltas::new(same).unwrap().collect::<Vec<_>>(), [1, 2, 3, 4, 5]);
        // 7, 5, 3, 1, 2, 3, 4, 5: differences relative to −2, in two bits.
        let mut bytes = vec![0x80, 0x01, 4, 8, 14, 3, 2, 0, 0, 0, 0b1100_0000, 0b0011_1111];
        bytes.extend([0; 6]);
        assert_eq!(Deltas::new(bytes).unwrap().collect::<Vec<_>>(), [7, 5, 3, 1, 2, 3, 4, 5]);
    }
}
