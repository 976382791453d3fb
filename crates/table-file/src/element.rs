//! Numbers and times in their binary representation.

use crate::format::{Cell, ColumnPart};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Element {
    /// Floating point, 16 bits.
    Half,
    /// Floating point, 32 bits.
    Single,
    /// Floating point, 64 bits.
    Double,
    /// Signed integer of 1, 2, 4 or 8 bytes.
    Signed(u8),
    /// Unsigned integer of 1, 2, 4 or 8 bytes.
    Unsigned(u8),
    /// Signed integer in the lowest `bits` bits of 1, 2, 4 or 8 bytes.
    SignedBits { size: u8, bits: u8 },
    /// Boolean, 0 or 1 in a byte.
    Truth,
    /// A time since 1970 as a signed integer of `size` bytes, in steps of `units`/`per_second` s.
    Time { size: u8, units: i64, per_second: i64 },
}

impl Element {
    pub(crate) fn size(self) -> usize {
        match self {
            Self::Truth => 1,
            Self::Half => 2,
            Self::Single => 4,
            Self::Double => 8,
            Self::Signed(size)
            | Self::Unsigned(size)
            | Self::SignedBits { size, .. }
            | Self::Time { size, .. } => usize::from(size),
        }
    }

    pub(crate) fn cell(self, bytes: &[u8], is_little: bool) -> Cell {
        // Copies the bytes to the lowest bytes of a word.
        let mut word = [0; 8];
        for (at, &byte) in bytes.iter().take(8).enumerate() {
            word[if is_little { at } else { bytes.len().min(8) - 1 - at }] = byte;
        }
        let bits = u64::from_le_bytes(word);
        match self {
            Self::Double => Cell::Real(f64::from_bits(bits)),
            Self::Single => Cell::Real(f64::from(f32::from_bits(bits as u32))),
            Self::Half => Cell::Real(half(bits as u16)),
            Self::Signed(size) => {
                let unused = 64 - 8 * u32::from(size);
                Cell::Whole((bits << unused) as i64 >> unused)
            }
            Self::SignedBits { bits: there, .. } => {
                let unused = 64 - u32::from(there);
                Cell::Whole((bits << unused) as i64 >> unused)
            }
            Self::Truth => Cell::Whole(i64::from(bits != 0)),
            Self::Time { size, units, per_second } => {
                match Self::Signed(size).cell(bytes, is_little) {
                    // NumPy's NaT ("not a time").
                    Cell::Whole(i64::MIN) => Cell::Missing,
                    Cell::Whole(value) => {
                        Cell::Time { units: value.saturating_mul(units), per_second }
                    }
                    cell => cell,
                }
            }
            Self::Unsigned(_) => match i64::try_from(bits) {
                Ok(whole) => Cell::Whole(whole),
                Err(_) => Cell::Real(bits as f64),
            },
        }
    }
}

/// Values of one size at a constant distance.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Strided<'a> {
    /// The bytes, beginning with the first value.
    pub(crate) bytes: &'a [u8],
    /// Distance from one value to the next, in bytes.
    pub(crate) stride: usize,
    pub(crate) rows: usize,
}

impl Strided<'_> {
    fn chunks<const SIZE: usize>(&self) -> impl Iterator<Item = [u8; SIZE]> {
        let rows = self.bytes.chunks(self.stride.max(1)).take(self.rows);
        rows.map_while(|row| row.first_chunk::<SIZE>().copied())
    }

    pub(crate) fn values(&self, size: usize) -> impl Iterator<Item = &[u8]> {
        self.bytes.chunks(self.stride.max(1)).take(self.rows).map_while(move |row| row.get(..size))
    }
}

impl Element {
    pub(crate) fn read(self, from: Strided<'_>, is_little: bool, part: &mut ColumnPart) {
        let ColumnPart::Numbers { values, .. } = part else {
            from.values(self.size()).for_each(|bytes| part.push(self.cell(bytes, is_little)));
            return;
        };
        macro_rules! numbers {
            ($type:ty) => {
                match is_little {
                    true => {
                        values.extend(from.chunks().map(|it| <$type>::from_le_bytes(it) as f64))
                    }
                    false => {
                        values.extend(from.chunks().map(|it| <$type>::from_be_bytes(it) as f64))
                    }
                }
            };
        }
        match self {
            Self::Double => numbers!(f64),
            Self::Single => numbers!(f32),
            Self::Signed(1) => numbers!(i8),
            Self::Signed(2) => numbers!(i16),
            Self::Signed(4) => numbers!(i32),
            Self::Signed(8) => numbers!(i64),
            Self::Unsigned(1) => numbers!(u8),
            Self::Unsigned(2) => numbers!(u16),
            Self::Unsigned(4) => numbers!(u32),
            Self::Unsigned(8) => numbers!(u64),
            // The remaining types are rare.
            _ => from.values(self.size()).for_each(|bytes| part.push(self.cell(bytes, is_little))),
        }
    }
}

/// Converts a half-precision number (IEEE 754 binary16).
fn half(bits: u16) -> f64 {
    let sign = if bits >> 15 == 1 { -1.0 } else { 1.0 };
    let (exponent, fraction) = (i32::from(bits >> 10 & 0x1f), f64::from(bits & 0x3ff));
    sign * match exponent {
        0 => fraction * 2_f64.powi(-24),
        31 if fraction == 0.0 => f64::INFINITY,
        31 => f64::NAN,
        _ => (1.0 + fraction / 1024.0) * 2_f64.powi(exponent - 15),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_those_of_their_bytes_in_either_order() {
        for (element, little, expected) in [
            (Element::Double, 0.1_f64.to_le_bytes().to_vec(), Cell::Real(0.1)),
            (Element::Single, 0.1_f32.to_le_bytes().to_vec(), Cell::Real(f64::from(0.1_f32))),
            (Element::Signed(2), (-7_i16).to_le_bytes().to_vec(), Cell::Whole(-7)),
            (Element::Signed(8), i64::MIN.to_le_bytes().to_vec(), Cell::Whole(i64::MIN)),
            (Element::Unsigned(1), vec![255], Cell::Whole(255)),
            (Element::Unsigned(8), vec![255; 8], Cell::Real(18_446_744_073_709_551_615.0)),
            // 1, −2, 2⁻²⁴ and 65504 from the table in the standard.
            (Element::Half, vec![0x00, 0x3c], Cell::Real(1.0)),
            (Element::Half, vec![0x00, 0xc0], Cell::Real(-2.0)),
            (Element::Half, vec![0x01, 0x00], Cell::Real(2_f64.powi(-24))),
            (Element::Half, vec![0xff, 0x7b], Cell::Real(65504.0)),
        ] {
            assert_eq!(element.cell(&little, true), expected);
            let big: Vec<u8> = little.into_iter().rev().collect();
            assert_eq!(element.cell(&big, false), expected);
        }
    }
}
