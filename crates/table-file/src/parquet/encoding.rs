//! The encodings of values and levels in a page ("Parquet encoding definitions"), decoded as far as
//! they are asked for: a few bytes can stand for any number of values.

use crate::bytes::ByteReader;

/// Integers of a fixed width: runs of one value, and values packed bit by bit; `None` if there is no such width.
pub(crate) fn integers(bytes: Vec<u8>, width: u32) -> Option<impl Iterator<Item = u64> + Send> {
    if width > 32 {
        return None;
    }
    let (mut at, mut run) = (0, EncodedRun::Same(0, 0));
    Some(std::iter::from_fn(move || {
        loop {
            match &mut run {
                EncodedRun::Same(0, _) | EncodedRun::Packed(0, _) => {
                    let mut rest = ByteReader::new(bytes.get(at..)?);
                    run = next_run(&bytes, &mut rest, width)?;
                    at = bytes.len() - rest.rest.len();
                }
                EncodedRun::Same(left, value) => {
                    *left -= 1;
                    return Some(*value);
                }
                EncodedRun::Packed(left, bit) => {
                    *left -= 1;
                    let start = *bit;
                    *bit += width as usize;
                    return Some(bits(&bytes, start, width));
                }
            }
        }
    }))
}

#[derive(Clone, Copy, Debug)]
enum EncodedRun {
    /// A value, so many times.
    Same(u64, u64),
    /// So many values from this bit on.
    Packed(u64, usize),
}

/// The run that begins `rest`, the end of `bytes`.
fn next_run(bytes: &[u8], rest: &mut ByteReader<'_>, width: u32) -> Option<EncodedRun> {
    let head = rest.varint()?;
    if head & 1 == 0 {
        let mut value = [0; 8];
        let stored = rest.take(width.div_ceil(8) as usize)?;
        value[..stored.len()].copy_from_slice(stored);
        return Some(EncodedRun::Same(head >> 1, u64::from_le_bytes(value)));
    }
    let start = bytes.len() - rest.rest.len();
    // Eight values take as many bytes as one takes bits; the last ones may be cut off.
    let packed = (head >> 1).saturating_mul(u64::from(width));
    let packed = usize::try_from(packed).unwrap_or(usize::MAX).min(rest.rest.len());
    rest.take(packed)?;
    let there = match width {
        0 => (head >> 1).saturating_mul(8),
        width => 8 * packed as u64 / u64::from(width),
    };
    Some(EncodedRun::Packed(there, 8 * start))
}

/// Single bits, packed without a head.
pub(super) fn single_bits(bytes: Vec<u8>) -> impl Iterator<Item = u64> + Send {
    (0..8 * bytes.len()).map(move |bit| bits(&bytes, bit, 1))
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

/// Integers as differences, in blocks of miniblocks that have a width each; `None` if there are no such blocks.
pub(super) fn deltas(bytes: Vec<u8>) -> Option<impl Iterator<Item = i64> + Send> {
    let mut head = ByteReader::new(&bytes);
    let block = usize::try_from(head.varint()?).ok()?;
    let miniblocks = usize::try_from(head.varint()?).ok()?;
    let mut left = head.varint()?;
    let mut value = head.zigzag()?;
    let size = block.checked_div(miniblocks)?;
    if miniblocks > 1024 || size == 0 || size > 1 << 20 || size % 8 != 0 {
        return None;
    }
    let mut at = bytes.len() - head.rest.len();
    // Of the block: its smallest difference, and the widths of its miniblocks that have not begun.
    let (mut least, mut widths) = (0, Vec::new().into_iter());
    // Of the miniblock: its width, and how many of its values have been read.
    let (mut width, mut read, mut is_first) = (0, size, true);
    Some(std::iter::from_fn(move || {
        left = left.checked_sub(1)?;
        if std::mem::take(&mut is_first) {
            return Some(value);
        }
        if read == size {
            at += width as usize * size / 8;
            if widths.len() == 0 {
                let mut rest = ByteReader::new(bytes.get(at..)?);
                least = rest.zigzag()?;
                widths = rest.take(miniblocks)?.to_vec().into_iter();
                at = bytes.len() - rest.rest.len();
            }
            (width, read) = (u32::from(widths.next()?), 0);
            // The miniblock must have begun.
            if width > 64 || (width > 0 && at >= bytes.len()) {
                return None;
            }
        }
        let difference = bits(&bytes, 8 * at + read * width as usize, width);
        read += 1;
        value = value.wrapping_add(least).wrapping_add(difference as i64);
        Some(value)
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The examples of the format's description.
    #[test]
    fn runs_and_packed_values_are_those_of_the_specification() {
        let packed = vec![0b0000_0011, 0b1000_1000, 0b1100_0110, 0b1111_1010];
        let values: Vec<_> = integers(packed, 3).unwrap().collect();
        assert_eq!(values, [0, 1, 2, 3, 4, 5, 6, 7]);
        let run = integers(vec![10 << 1, 9], 4).unwrap();
        assert_eq!(run.collect::<Vec<_>>(), [9; 10]);
    }

    #[test]
    fn differences_are_those_of_the_specification() {
        // 1 to 5: one block of 128 in four miniblocks, all differences 1.
        let same = vec![0x80, 0x01, 4, 5, 2, 2, 0, 0, 0, 0];
        assert_eq!(deltas(same).unwrap().collect::<Vec<_>>(), [1, 2, 3, 4, 5]);
        // 7, 5, 3, 1, 2, 3, 4, 5: differences from −2, of two bits.
        let mut bytes = vec![0x80, 0x01, 4, 8, 14, 3, 2, 0, 0, 0, 0b1100_0000, 0b0011_1111];
        bytes.extend([0; 6]);
        assert_eq!(deltas(bytes).unwrap().collect::<Vec<_>>(), [7, 5, 3, 1, 2, 3, 4, 5]);
    }
}
