//! [`InstructionSet`] for aarch64: searches 16 bytes at a time, four times, and combines up to 32 digits in two
//! registers.

use std::arch::aarch64::uint8x16_t;

use pulp::aarch64::Neon as Registers;

use super::instruction_set::{BLOCK, InstructionSet};

/// NEON, which all aarch64 processors with an operating system have.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Neon(pub(crate) Registers);

impl InstructionSet for Neon {
    fn run<R>(self, task: impl FnOnce() -> R) -> R {
        self.0.vectorize(task)
    }

    #[inline(always)]
    fn find(self, bytes: &[u8; BLOCK], wanted: [u8; 2]) -> [u64; 2] {
        [self.places_of(wanted[0], bytes), self.places_of(wanted[1], bytes)]
    }

    // No closures here: code that is not inlined into a function for these processors cannot use their registers.
    #[inline(always)]
    fn digits(self, lines: &[u8], start: usize, end: usize) -> Option<(u64, usize)> {
        let neon = self.0.neon;
        let length = end - start;
        let register: &[u8; 32] = lines.get(end.wrapping_sub(32)..)?.first_chunk()?;
        let (before, last) = register.split_first_chunk::<16>()?;
        let last: &[u8; 16] = last.first_chunk()?;
        // The bytes shifted by one position towards the end.
        let closer: &[u8; 32] = lines.get(end.wrapping_sub(33)..)?.first_chunk()?;
        let (before_closer, closer) = closer.split_first_chunk::<16>()?;
        let closer: &[u8; 16] = closer.first_chunk()?;
        let (mut high, mut low) = (self.load(before), self.load(last));
        let point = neon.vdupq_n_u8(b'.');
        let of_high = u128::from(self.marks(neon.vceqq_u8(high, point)));
        let of_low = u128::from(self.marks(neon.vceqq_u8(low, point)));
        // Shifts out the points before the number.
        let points = (of_high | of_low << 64).checked_shr(128 - 4 * length as u32)?;
        let (mut digits, mut decimals) = (length, 0);
        if points != 0 {
            // Removes the point. A second point fails the check for digits.
            let whole_digits = points.trailing_zeros() as usize / 4;
            digits -= 1;
            decimals = digits - whole_digits;
            if decimals == 0 || whole_digits == 0 {
                return None;
            }
            let [first, second] = self.last_of_32(decimals);
            high = neon.vbslq_u8(first, high, self.load(before_closer));
            low = neon.vbslq_u8(second, low, self.load(closer));
        }
        let [first, second] = self.last_of_32(digits);
        let zero = neon.vdupq_n_u8(b'0');
        let high = neon.vandq_u8(neon.vsubq_u8(high, zero), first);
        let low = neon.vandq_u8(neon.vsubq_u8(low, zero), second);
        if neon.vmaxvq_u8(neon.vmaxq_u8(high, low)) > 9 {
            return None;
        }
        let ([first, second], [third, fourth]) = (self.join(high), self.join(low));
        // True if the number is less than 2⁶⁴.
        let fits = first == 0 && second < 1844;
        fits.then(|| (second * 10_000_000_000_000_000 + third * 100_000_000 + fourth, decimals))
    }
}

impl Neon {
    #[inline(always)]
    fn load(self, bytes: &[u8; 16]) -> uint8x16_t {
        pulp::cast(*bytes)
    }

    #[inline(always)]
    fn places_of(self, byte: u8, bytes: &[u8; BLOCK]) -> u64 {
        let neon = self.0.neon;
        let (quarters, _) = bytes.as_chunks::<16>();
        let byte = neon.vdupq_n_u8(byte);
        // Gives each byte its bit within a group of eight; adding neighbours three times makes one byte of a group.
        let bits = self.load(&[1, 2, 4, 8, 16, 32, 64, 128, 1, 2, 4, 8, 16, 32, 64, 128]);
        let first = neon.vandq_u8(neon.vceqq_u8(self.load(&quarters[0]), byte), bits);
        let second = neon.vandq_u8(neon.vceqq_u8(self.load(&quarters[1]), byte), bits);
        let third = neon.vandq_u8(neon.vceqq_u8(self.load(&quarters[2]), byte), bits);
        let fourth = neon.vandq_u8(neon.vceqq_u8(self.load(&quarters[3]), byte), bits);
        let low = neon.vpaddq_u8(first, second);
        let high = neon.vpaddq_u8(third, fourth);
        let all = neon.vpaddq_u8(low, high);
        let all = neon.vpaddq_u8(all, all);
        let [places, _]: [u64; 2] = pulp::cast(all);
        places
    }

    /// Returns four bits per byte, all ones or all zeros, of a register; the first byte in the lowest bits.
    #[inline(always)]
    fn marks(self, bytes: uint8x16_t) -> u64 {
        let neon = self.0.neon;
        pulp::cast(neon.vshrn_n_u16::<4>(pulp::cast(bytes)))
    }

    /// Returns masks of the last `bytes` bytes of 32.
    #[inline(always)]
    fn last_of_32(self, bytes: usize) -> [uint8x16_t; 2] {
        let neon = self.0.neon;
        let places = self.load(&[15, 14, 13, 12, 11, 10, 9, 8, 7, 6, 5, 4, 3, 2, 1, 0]);
        let low = neon.vcgtq_u8(neon.vdupq_n_u8(bytes as u8), places);
        let high = neon.vcgtq_u8(neon.vdupq_n_u8((bytes as u8).saturating_sub(16)), places);
        [high, low]
    }

    /// Returns the two numbers of eight digits: digits are combined into pairs, pairs into fours, fours into eights.
    #[inline(always)]
    fn join(self, values: uint8x16_t) -> [u64; 2] {
        let neon = self.0.neon;
        let tens = self.load(&[10, 1, 10, 1, 10, 1, 10, 1, 10, 1, 10, 1, 10, 1, 10, 1]);
        // Products are at most 90.
        let pairs = neon.vpaddlq_u8(neon.vmulq_u8(values, tens));
        let hundreds = pulp::cast([[100_u16, 1]; 4]);
        let fours = neon.vpaddlq_u16(neon.vmulq_u16(pairs, hundreds));
        let myriads = pulp::cast([[10_000_u32, 1]; 2]);
        let eights = neon.vpaddlq_u32(neon.vmulq_u32(fours, myriads));
        pulp::cast(eights)
    }
}
