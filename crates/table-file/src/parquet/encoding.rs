//! The encodings of values and levels in a page ("Parquet encoding definitions"), decoded as far as
//! they are asked for: a few bytes can stand for any number of values.

use crate::bytes::ByteReader;

/// Integers of a fixed width: runs of one value, and values packed bit by bit.
#[derive(Clone, Debug)]
pub(crate) struct Hybrid {
    bytes: Vec<u8>,
    at: usize,
    width: u32,
    run: EncodedRun,
}

#[derive(Clone, Copy, Debug)]
enum EncodedRun {
    /// A value, so many times.
    Same(u64, u64),
    /// So many values from this bit on.
    Packed(u64, usize),
}

impl Hybrid {
    /// `None` if there is no such width.
    pub(crate) fn new(bytes: Vec<u8>, width: u32) -> Option<Self> {
        (width <= 32).then_some(Self { bytes, at: 0, width, run: EncodedRun::Same(0, 0) })
    }

    /// Single bits, packed without a head.
    pub(super) fn bits(bytes: Vec<u8>) -> Self {
        let run = EncodedRun::Packed(8 * bytes.len() as u64, 0);
        Self { at: bytes.len(), bytes, width: 1, run }
    }

    pub(crate) fn next(&mut self) -> Option<u64> {
        loop {
            match &mut self.run {
                EncodedRun::Same(0, _) | EncodedRun::Packed(0, _) => self.next_run()?,
                EncodedRun::Same(left, value) => {
                    *left -= 1;
                    return Some(*value);
                }
                EncodedRun::Packed(left, bit) => {
                    *left -= 1;
                    let start = *bit;
                    *bit += self.width as usize;
                    return Some(bits(&self.bytes, start, self.width));
                }
            }
        }
    }

    fn next_run(&mut self) -> Option<()> {
        let mut rest = ByteReader::new(self.bytes.get(self.at..)?);
        let before = rest.rest.len();
        let head = rest.varint()?;
        self.run = match head & 1 {
            0 => {
                let mut value = 0;
                for (position, byte) in
                    rest.take(self.width.div_ceil(8) as usize)?.iter().enumerate()
                {
                    value |= u64::from(*byte) << (8 * position);
                }
                EncodedRun::Same(head >> 1, value)
            }
            _ => {
                let start = self.at + before - rest.rest.len();
                // Eight values take as many bytes as one takes bits; the last ones may be cut off.
                let bytes = (head >> 1).saturating_mul(u64::from(self.width));
                let bytes = usize::try_from(bytes).unwrap_or(usize::MAX).min(rest.rest.len());
                rest.take(bytes)?;
                let there = match self.width {
                    0 => (head >> 1).saturating_mul(8),
                    width => 8 * bytes as u64 / u64::from(width),
                };
                EncodedRun::Packed(there, 8 * start)
            }
        };
        self.at += before - rest.rest.len();
        Some(())
    }
}

/// `width` bits from a bit on, the lowest first; zeros where there are none.
fn bits(bytes: &[u8], start: usize, width: u32) -> u64 {
    let first = start / 8;
    let mut word = [0; 16];
    for (to, from) in word.iter_mut().zip(bytes.get(first..).unwrap_or_default()) {
        *to = *from;
    }
    let shifted = u128::from_le_bytes(word) >> (start % 8);
    (shifted & ((1_u128 << width) - 1)) as u64
}

/// Integers as differences, in blocks of some widths.
#[derive(Clone, Debug)]
pub(super) struct Delta {
    bytes: Vec<u8>,
    at: usize,
    miniblocks: usize,
    per_miniblock: usize,
    left: u64,
    value: i64,
    is_first: bool,
    /// Of the block: its smallest difference, the widths of its miniblocks, the one that is read.
    least: i64,
    widths: Vec<u8>,
    miniblock: usize,
    /// Values of the miniblock that have been read.
    read: usize,
}

impl Delta {
    pub(super) fn new(bytes: Vec<u8>) -> Option<Self> {
        let mut head = ByteReader::new(&bytes);
        let block = usize::try_from(head.varint()?).ok()?;
        let miniblocks = usize::try_from(head.varint()?).ok()?;
        let left = head.varint()?;
        let value = head.zigzag()?;
        let per_miniblock = block.checked_div(miniblocks)?;
        if miniblocks > 1024
            || per_miniblock == 0
            || per_miniblock > 1 << 20
            || per_miniblock % 8 != 0
        {
            return None;
        }
        let at = bytes.len() - head.rest.len();
        Some(Self {
            bytes,
            at,
            miniblocks,
            per_miniblock,
            left,
            value,
            is_first: true,
            least: 0,
            widths: Vec::new(),
            miniblock: miniblocks,
            read: per_miniblock,
        })
    }

    pub(super) fn next(&mut self) -> Option<i64> {
        self.left = self.left.checked_sub(1)?;
        if std::mem::take(&mut self.is_first) {
            return Some(self.value);
        }
        if self.read == self.per_miniblock {
            self.next_miniblock()?;
        }
        let width = u32::from(*self.widths.get(self.miniblock)?);
        let difference = bits(&self.bytes, 8 * self.at + self.read * width as usize, width);
        self.read += 1;
        self.value = self.value.wrapping_add(self.least).wrapping_add(difference as i64);
        Some(self.value)
    }

    fn next_miniblock(&mut self) -> Option<()> {
        if let Some(width) = self.widths.get(self.miniblock) {
            self.at += usize::from(*width) * self.per_miniblock / 8;
            self.miniblock += 1;
        }
        if self.miniblock >= self.miniblocks {
            let mut rest = ByteReader::new(self.bytes.get(self.at..)?);
            self.least = rest.zigzag()?;
            self.widths = rest.take(self.miniblocks)?.to_vec();
            self.at = self.bytes.len() - rest.rest.len();
            self.miniblock = 0;
        }
        self.read = 0;
        let width = *self.widths.get(self.miniblock)?;
        // The miniblock must have begun.
        (width <= 64 && (width == 0 || self.at < self.bytes.len())).then_some(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The examples of the format's description.
    #[test]
    fn runs_and_packed_values_are_those_of_the_specification() {
        let packed = vec![0b0000_0011, 0b1000_1000, 0b1100_0110, 0b1111_1010];
        let mut hybrid = Hybrid::new(packed, 3).unwrap();
        let values: Vec<_> = std::iter::from_fn(|| hybrid.next()).collect();
        assert_eq!(values, [0, 1, 2, 3, 4, 5, 6, 7]);
        let mut run = Hybrid::new(vec![10 << 1, 9], 4).unwrap();
        assert_eq!(std::iter::from_fn(|| run.next()).collect::<Vec<_>>(), [9; 10]);
    }

    #[test]
    fn differences_are_those_of_the_specification() {
        // 1 to 5: one block of 128 in four miniblocks, all differences 1.
        let same = vec![0x80, 0x01, 4, 5, 2, 2, 0, 0, 0, 0];
        let mut delta = Delta::new(same).unwrap();
        assert_eq!(std::iter::from_fn(|| delta.next()).collect::<Vec<_>>(), [1, 2, 3, 4, 5]);
        // 7, 5, 3, 1, 2, 3, 4, 5: differences from −2, of two bits.
        let mut bytes = vec![0x80, 0x01, 4, 8, 14, 3, 2, 0, 0, 0, 0b1100_0000, 0b0011_1111];
        bytes.extend([0; 6]);
        let mut delta = Delta::new(bytes).unwrap();
        assert_eq!(
            std::iter::from_fn(|| delta.next()).collect::<Vec<_>>(),
            [7, 5, 3, 1, 2, 3, 4, 5]
        );
    }
}
