//! [`InstructionSet`] in the wide registers of x86-64: marks are looked for in 32 bytes at a time, and the
//! digits of a number of up to 16 bytes are joined within one register.

use std::arch::x86_64::{__m128i, __m256i};

use pulp::x86::V3;

use super::digit_registers::{CLOSE_UP, DigitRegisters, LAST};
use super::instruction_set::{BLOCK, InstructionSet, Portable};

/// Processors with AVX2 and what came before it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Avx2(V3);

impl Avx2 {
    pub(crate) fn new(v3: V3) -> Self {
        Self(v3)
    }
}

impl InstructionSet for Avx2 {
    fn run<R>(self, task: impl FnOnce() -> R) -> R {
        self.0.vectorize(task)
    }

    #[inline(always)]
    fn find(self, bytes: &[u8; BLOCK], wanted: [u8; 2]) -> [u64; 2] {
        let halves = pulp::cast(*bytes);
        [self.places_of(wanted[0], halves), self.places_of(wanted[1], halves)]
    }

    #[inline(always)]
    fn plain_number(self, lines: &[u8], at: usize, end: usize) -> Option<f64> {
        self.decimal(lines, at, end)
    }
}

// No closures here, nor below: what is not inlined into code for these processors cannot use their registers.
impl DigitRegisters for Avx2 {
    #[inline(always)]
    fn digits(self, register: &[u8; 16], mut length: usize) -> Option<(u64, usize)> {
        let V3 { sse2, ssse3, .. } = self.0;
        let mut register: __m128i = pulp::cast(*register);
        let points = sse2._mm_cmpeq_epi8(register, sse2._mm_set1_epi8(b'.' as i8));
        let points = sse2._mm_movemask_epi8(points) as u32 >> ((16 - length) % 32);
        let mut decimals = 0;
        if points != 0 {
            // The point is closed up.
            let whole_digits = points.trailing_zeros() as usize;
            length -= 1;
            decimals = length.wrapping_sub(whole_digits);
            let close_up = CLOSE_UP.get(decimals)?;
            if decimals == 0 || whole_digits == 0 {
                return None;
            }
            register = ssse3._mm_shuffle_epi8(register, pulp::cast(*close_up));
        }
        // What precedes the number becomes zeros.
        let last = LAST.get(length.wrapping_sub(1)).filter(|_| length <= 15)?;
        let values = sse2._mm_sub_epi8(register, sse2._mm_set1_epi8(b'0' as i8));
        let values = sse2._mm_and_si128(values, pulp::cast(*last));
        // Sets the top bit of whatever is no digit.
        let checked = sse2._mm_adds_epu8(values, sse2._mm_set1_epi8(0x76));
        let is_number = sse2._mm_movemask_epi8(checked) == 0;
        is_number.then(|| (self.join(values), decimals))
    }

    #[inline(always)]
    fn many_digits(self, lines: &[u8], start: usize, end: usize) -> Option<(u64, usize)> {
        const WIDTH: usize = 32;
        let V3 { avx, avx2, .. } = self.0;
        let length = end - start;
        let register: &[u8; WIDTH] = lines.get(end.wrapping_sub(WIDTH)..)?.first_chunk()?;
        // The same bytes one place closer to the end.
        let closer: &[u8; WIDTH] = lines.get(end.wrapping_sub(WIDTH + 1)..)?.first_chunk()?;
        let (register, closer): (__m256i, __m256i) = (pulp::cast(*register), pulp::cast(*closer));
        let points = avx2._mm256_cmpeq_epi8(register, avx._mm256_set1_epi8(b'.' as i8));
        let points =
            (avx2._mm256_movemask_epi8(points) as u32).checked_shr((WIDTH - length) as u32)?;
        let (mut digits, mut decimals, mut values) = (length, 0, register);
        if points != 0 {
            // The point is closed up. A second one is no digit.
            let whole_digits = points.trailing_zeros() as usize;
            digits -= 1;
            decimals = digits - whole_digits;
            if decimals == 0 || whole_digits == 0 {
                return None;
            }
            let behind: &[u8; WIDTH] = FIRST_TO_LAST.get(WIDTH + decimals..)?.first_chunk()?;
            values = avx2._mm256_blendv_epi8(closer, register, pulp::cast(*behind));
        }
        // What precedes the number becomes zeros.
        let own: &[u8; WIDTH] = FIRST_TO_LAST.get(WIDTH + digits..)?.first_chunk()?;
        let values = avx2._mm256_sub_epi8(values, avx._mm256_set1_epi8(b'0' as i8));
        let values = avx2._mm256_and_si256(values, pulp::cast(*own));
        // Sets the top bit of whatever is no digit.
        let checked = avx2._mm256_adds_epu8(values, avx._mm256_set1_epi8(0x76));
        if avx2._mm256_movemask_epi8(checked) != 0 {
            return None;
        }
        let tens: __m256i = pulp::cast([[10_u8, 1]; 16]);
        let pairs = avx2._mm256_maddubs_epi16(values, tens);
        let fours = avx2._mm256_madd_epi16(pairs, pulp::cast([[100_i16, 1]; 8]));
        let fours = avx2._mm256_packus_epi32(fours, fours);
        let eights = avx2._mm256_madd_epi16(fours, pulp::cast([[10_000_i16, 1]; 8]));
        // Each half has its numbers twice.
        let [first, second, _, _, third, fourth, _, _]: [u32; 8] = pulp::cast(eights);
        // Below 2⁶⁴.
        let fits = first == 0 && second < 1844;
        let [high, middle, low] = [second, third, fourth].map(u64::from);
        fits.then(|| (high * 10_000_000_000_000_000 + middle * 100_000_000 + low, decimals))
    }

    #[inline(never)]
    fn other_number(self, lines: &[u8], at: usize, end: usize) -> Option<f64> {
        self.run(
            #[inline(always)]
            || Portable.plain_number(lines, at, end),
        )
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

    /// The number that sixteen digit values spell: neighbours are joined to 8 pairs, 4 fours, 2
    /// eights.
    #[inline(always)]
    fn join(self, values: __m128i) -> u64 {
        let V3 { sse2, ssse3, sse4_1, .. } = self.0;
        let weights = |high: i16, low: i16| -> __m128i {
            pulp::cast([high, low, high, low, high, low, high, low])
        };
        let tens: __m128i = pulp::cast([10_u8, 1, 10, 1, 10, 1, 10, 1, 10, 1, 10, 1, 10, 1, 10, 1]);
        let pairs = ssse3._mm_maddubs_epi16(values, tens);
        let fours = sse2._mm_madd_epi16(pairs, weights(100, 1));
        let fours = sse4_1._mm_packus_epi32(fours, fours);
        let eights: [u64; 2] = pulp::cast(sse2._mm_madd_epi16(fours, weights(10_000, 1)));
        (eights[0] & 0xffff_ffff) * 100_000_000 + (eights[0] >> 32)
    }
}

/// From its 32nd byte and so many bytes on: a mask of as many bytes at the end of 32.
const FIRST_TO_LAST: [u8; 96] = {
    let mut bytes = [0; 96];
    let mut i = 64;
    while i < 96 {
        bytes[i] = 0xff;
        i += 1;
    }
    bytes
};
