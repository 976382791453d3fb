//! [`InstructionSet`] for x86-64: searches 32 bytes at a time, and combines up to 32 digits in one register.

use std::arch::x86_64::__m256i;

use pulp::x86::V3;

use super::instruction_set::{BLOCK, InstructionSet};

#[derive(Clone, Copy, Debug)]
pub(crate) struct Avx2(pub(crate) V3);

impl InstructionSet for Avx2 {
    fn run<R>(self, task: impl FnOnce() -> R) -> R {
        self.0.vectorize(task)
    }

    #[inline(always)]
    fn find(self, bytes: &[u8; BLOCK], wanted: [u8; 2]) -> [u64; 2] {
        let halves = pulp::cast(*bytes);
        [self.places_of(wanted[0], halves), self.places_of(wanted[1], halves)]
    }

    // No closures here: code that is not inlined into a function for these processors cannot use their registers.
    #[inline(always)]
    fn digits(self, lines: &[u8], start: usize, end: usize) -> Option<(u64, usize)> {
        const WIDTH: usize = 32;
        let V3 { avx, avx2, .. } = self.0;
        let length = end - start;
        let register: &[u8; WIDTH] = lines.get(end.wrapping_sub(WIDTH)..)?.first_chunk()?;
        // The bytes shifted by one position towards the end.
        let closer: &[u8; WIDTH] = lines.get(end.wrapping_sub(WIDTH + 1)..)?.first_chunk()?;
        let (register, closer): (__m256i, __m256i) = (pulp::cast(*register), pulp::cast(*closer));
        let points = avx2._mm256_cmpeq_epi8(register, avx._mm256_set1_epi8(b'.' as i8));
        let points =
            (avx2._mm256_movemask_epi8(points) as u32).checked_shr((WIDTH - length) as u32)?;
        let (mut digits, mut decimals, mut values) = (length, 0, register);
        if points != 0 {
            // Removes the point. A second point fails the check for digits.
            let whole_digits = points.trailing_zeros() as usize;
            digits -= 1;
            decimals = digits - whole_digits;
            if decimals == 0 || whole_digits == 0 {
                return None;
            }
            let behind: &[u8; WIDTH] = FIRST_TO_LAST.get(WIDTH + decimals..)?.first_chunk()?;
            values = avx2._mm256_blendv_epi8(closer, register, pulp::cast(*behind));
        }
        // Sets the bytes before the number to zero.
        let own: &[u8; WIDTH] = FIRST_TO_LAST.get(WIDTH + digits..)?.first_chunk()?;
        let values = avx2._mm256_sub_epi8(values, avx._mm256_set1_epi8(b'0' as i8));
        let values = avx2._mm256_and_si256(values, pulp::cast(*own));
        // Sets the top bit of each byte that is not a digit.
        let checked = avx2._mm256_adds_epu8(values, avx._mm256_set1_epi8(0x76));
        if avx2._mm256_movemask_epi8(checked) != 0 {
            return None;
        }
        let tens: __m256i = pulp::cast([[10_u8, 1]; 16]);
        let pairs = avx2._mm256_maddubs_epi16(values, tens);
        let fours = avx2._mm256_madd_epi16(pairs, pulp::cast([[100_i16, 1]; 8]));
        let fours = avx2._mm256_packus_epi32(fours, fours);
        let eights = avx2._mm256_madd_epi16(fours, pulp::cast([[10_000_i16, 1]; 8]));
        // Each half contains its numbers twice.
        let [first, second, _, _, third, fourth, _, _]: [u32; 8] = pulp::cast(eights);
        // True if the number is less than 2⁶⁴.
        let fits = first == 0 && second < 1844;
        let [high, middle, low] = [second, third, fourth].map(u64::from);
        fits.then(|| (high * 10_000_000_000_000_000 + middle * 100_000_000 + low, decimals))
    }
}

impl Avx2 {
    #[inline(always)]
    fn places_of(self, byte: u8, [low, high]: [__m256i; 2]) -> u64 {
        let V3 { avx, avx2, .. } = self.0;
        let byte = avx._mm256_set1_epi8(byte as i8);
        let low = avx2._mm256_movemask_epi8(avx2._mm256_cmpeq_epi8(low, byte));
        let high = avx2._mm256_movemask_epi8(avx2._mm256_cmpeq_epi8(high, byte));
        u64::from(low as u32) | u64::from(high as u32) << 32
    }
}

/// The 32 bytes from offset 32 + n are a mask of the last n bytes.
const FIRST_TO_LAST: [u8; 96] = {
    let mut bytes = [0; 96];
    let mut i = 64;
    while i < 96 {
        bytes[i] = 0xff;
        i += 1;
    }
    bytes
};
