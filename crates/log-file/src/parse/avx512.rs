//! [`InstructionSet`] in the registers of 64 bytes that x86-64 processors with AVX-512 have: eight whole
//! numbers of up to 8 digits or four decimals of up to 16 bytes are read side by side. All else is
//! as with [`Avx2`].

use std::arch::x86_64::{__m256d, __m256i, __m512i};

use pulp::x86::V4;

use super::avx2::Avx2;
use super::digit_registers::{CLOSE_UP, LAST};
use super::instruction_set::{BLOCK, ColumnFields, InstructionSet};
use super::number::EXACT_POWERS_OF_TEN;

/// Processors with AVX-512 and what came before it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Widest {
    v4: V4,
    /// For what is read one by one.
    wide: Avx2,
}

impl Widest {
    pub(crate) fn new(v4: V4) -> Self {
        Self { v4, wide: Avx2::new(*v4) }
    }
}

impl InstructionSet for Widest {
    fn run<R>(self, task: impl FnOnce() -> R) -> R {
        self.v4.vectorize(task)
    }

    #[inline(always)]
    fn find(self, bytes: &[u8; BLOCK], wanted: [u8; 2]) -> [u64; 2] {
        let V4 { avx512f, avx512bw, .. } = self.v4;
        let bytes: __m512i = pulp::cast(*bytes);
        let [a, b] = wanted;
        [
            avx512bw._mm512_cmpeq_epi8_mask(bytes, avx512f._mm512_set1_epi8(a as i8)),
            avx512bw._mm512_cmpeq_epi8_mask(bytes, avx512f._mm512_set1_epi8(b as i8)),
        ]
    }

    /// Sixteen at a time: compilers would count zeros in vectors otherwise, which takes longer.
    #[inline(always)]
    fn write_ends(self, bits: u64, base: u32, positions: &mut [u32; BLOCK]) -> usize {
        let V4 { avx512f, .. } = self.v4;
        let mut count = 0;
        for quarter in 0..4 {
            let bits = (bits >> (16 * quarter)) as u16;
            let first = avx512f._mm512_set1_epi32((base + 16 * quarter) as i32);
            let all = avx512f._mm512_add_epi32(first, pulp::cast(FIRST_SIXTEEN));
            let found: [u32; 16] = pulp::cast(avx512f._mm512_maskz_compress_epi32(bits, all));
            positions[count..count + 16].copy_from_slice(&found);
            count += bits.count_ones() as usize;
        }
        count
    }

    #[inline(always)]
    fn plain_number(self, lines: &[u8], at: usize, end: usize) -> Option<f64> {
        self.wide.plain_number(lines, at, end)
    }

    #[inline(always)]
    fn whole_numbers(self, lines: &[u8], fields: ColumnFields<'_>, values: &mut [f64]) -> usize {
        let (groups, _) = values.as_chunks_mut::<8>();
        let mut done = 0;
        for group in groups {
            let Some(eight) = self.eight(lines, fields.some(done)) else { break };
            *group = eight;
            done += group.len();
        }
        done + self.wide.whole_numbers(lines, fields.after_rows(done), &mut values[done..])
    }

    #[inline(always)]
    fn plain_numbers(self, lines: &[u8], fields: ColumnFields<'_>, values: &mut [f64]) -> usize {
        let (groups, _) = values.as_chunks_mut::<4>();
        for (i, group) in groups.iter_mut().enumerate() {
            match self.four(lines, fields.some(4 * i)) {
                Some(four) => *group = four,
                None => return 4 * i,
            }
        }
        4 * groups.len()
    }
}

/// The top bit of each byte that is a minus sign.
#[inline(always)]
fn minus_signs(bytes: u32) -> u32 {
    const LOW_BITS: u32 = 0x7f7f_7f7f;
    let others = bytes ^ u32::from_le_bytes([b'-'; 4]);
    !(((others & LOW_BITS) + LOW_BITS) | others) & !LOW_BITS
}

const FIRST_SIXTEEN: [u32; 16] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15];

/// The lowest and the highest of the bits of each lane.
const FIRST_PLACES: u64 = 0x0001_0001_0001_0001;
const LAST_PLACES: u64 = 0x8000_8000_8000_8000;

// No closures here, as for [`Avx2`].
impl Widest {
    /// Eight whole numbers of one to eight digits from where they start and end; `None` if one of
    /// them is not.
    #[inline(always)]
    fn eight(self, lines: &[u8], positions: [(usize, usize); 8]) -> Option<[f64; 8]> {
        let V4 { avx512f, avx512bw, avx512dq, .. } = self.v4;
        let (mut words, mut lengths, mut all_lengths) = ([0_u64; 8], [0_u64; 8], 0);
        for (lane, (start, end)) in positions.into_iter().enumerate() {
            words[lane] = u64::from_le_bytes(*lines.get(..end)?.last_chunk()?);
            let length = end.wrapping_sub(start).wrapping_sub(1);
            all_lengths |= length;
            lengths[lane] = length as u64;
        }
        if all_lengths >= 8 {
            return None;
        }
        let (words, lengths): (__m512i, __m512i) = (pulp::cast(words), pulp::cast(lengths));
        // What precedes a number becomes zeros: 7, 6, … bytes for one, two … digits.
        let before = avx512f._mm512_sub_epi64(avx512f._mm512_set1_epi64(7), lengths);
        let before = avx512f._mm512_slli_epi64::<3>(before);
        let own = avx512f._mm512_sllv_epi64(avx512f._mm512_set1_epi64(-1), before);
        let values = avx512f._mm512_xor_si512(words, avx512f._mm512_set1_epi8(b'0' as i8));
        let values = avx512f._mm512_and_si512(values, own);
        let others = avx512bw._mm512_cmpgt_epu8_mask(values, avx512f._mm512_set1_epi8(9));
        if others != 0 {
            return None;
        }
        let pairs = avx512bw._mm512_maddubs_epi16(values, pulp::cast([[10_u8, 1]; 32]));
        let fours = avx512bw._mm512_madd_epi16(pairs, pulp::cast([[100_i16, 1]; 16]));
        let high = avx512f._mm512_mul_epu32(fours, avx512f._mm512_set1_epi64(10_000));
        let numbers = avx512f._mm512_add_epi64(high, avx512f._mm512_srli_epi64::<32>(fours));
        Some(pulp::cast(avx512dq._mm512_cvtepi64_pd(numbers)))
    }

    /// Four plain decimals from where they start and end; `None` if one of them is not, or has more
    /// than 15 digits.
    #[inline(always)]
    fn four(self, lines: &[u8], positions: [(usize, usize); 4]) -> Option<[f64; 4]> {
        let V4 { avx, avx2, avx512f, avx512bw, avx512dq, .. } = self.v4;
        // The last digit stands at the end of the lane. What precedes the number is not its own.
        let mut bytes = [&[0; 16]; 4];
        let mut own = [&[0; 16]; 4];
        let mut firsts = [0; 4];
        for (first, (start, _)) in firsts.iter_mut().zip(positions) {
            *first = *lines.get(start)?;
        }
        let negative = minus_signs(u32::from_le_bytes(firsts));
        for (lane, (start, end)) in positions.into_iter().enumerate() {
            bytes[lane] = lines.get(end.wrapping_sub(16)..)?.first_chunk()?;
            let sign = (negative >> (8 * lane + 7) & 1) as usize;
            own[lane] = LAST.get(end.wrapping_sub(start + sign).wrapping_sub(1))?;
        }
        let (bytes, own) = (self.lanes(bytes), self.lanes(own));
        let points = avx512bw._mm512_cmpeq_epi8_mask(bytes, avx512f._mm512_set1_epi8(b'.' as i8));
        let positions = avx512bw._mm512_movepi8_mask(own);
        let points = points & positions;
        // Digits are wanted on both sides of a point.
        let first_own = positions & !((positions & !LAST_PLACES) << 1);
        if points & (first_own | LAST_PLACES) != 0 {
            return None;
        }
        // Points are closed up. A second one in a lane is no digit.
        let mut close_up = [&[0; 16]; 4];
        let mut divisors = [0.0; 4];
        for lane in 0..4 {
            let points = points >> (16 * lane) | 1 << 15;
            let decimals = 15 - (points.trailing_zeros() as usize & 15);
            close_up[lane] = &CLOSE_UP[decimals];
            divisors[lane] = EXACT_POWERS_OF_TEN[decimals];
        }
        let close_up = self.lanes(close_up);
        let own = avx512bw._mm512_shuffle_epi8(own, close_up);
        let values = avx512bw._mm512_shuffle_epi8(bytes, close_up);
        let values = avx512bw._mm512_sub_epi8(values, avx512f._mm512_set1_epi8(b'0' as i8));
        let values = avx512f._mm512_and_si512(values, own);
        let others = avx512bw._mm512_cmpgt_epu8_mask(values, avx512f._mm512_set1_epi8(9));
        // Fifteen digits are below 2⁵³.
        if others != 0 || avx512bw._mm512_movepi8_mask(own) & FIRST_PLACES != 0 {
            return None;
        }
        let mantissas = avx512dq._mm256_cvtepi64_pd(self.join(values));
        let [a, b, c, d] = divisors;
        let magnitudes = avx._mm256_div_pd(mantissas, avx._mm256_set_pd(d, c, b, a));
        // The top bit of each byte becomes that of a number.
        let signs = avx2._mm256_cvtepu8_epi64(pulp::cast([negative, 0, 0, 0]));
        let signs: __m256d = pulp::cast(avx2._mm256_slli_epi64::<56>(signs));
        Some(pulp::cast(avx._mm256_or_pd(magnitudes, signs)))
    }

    /// Four times sixteen bytes, side by side. By way of memory it would take longer.
    #[inline(always)]
    fn lanes(self, lanes: [&[u8; 16]; 4]) -> __m512i {
        let V4 { avx512f, avx512dq, .. } = self.v4;
        let all = avx512f._mm512_castsi128_si512(pulp::cast(*lanes[0]));
        let all = avx512dq._mm512_inserti64x2::<1>(all, pulp::cast(*lanes[1]));
        let all = avx512dq._mm512_inserti64x2::<2>(all, pulp::cast(*lanes[2]));
        avx512dq._mm512_inserti64x2::<3>(all, pulp::cast(*lanes[3]))
    }

    /// The numbers that sixteen digit values each spell, lane by lane: neighbours are joined to 8
    /// pairs, 4 fours, 2 eights.
    #[inline(always)]
    fn join(self, values: __m512i) -> __m256i {
        let V4 { avx512f, avx512bw, .. } = self.v4;
        let tens: __m512i = pulp::cast([[10_u8, 1]; 32]);
        let hundreds: __m512i = pulp::cast([[100_i16, 1]; 16]);
        let myriads: __m512i = pulp::cast([[10_000_i16, 1]; 16]);
        let pairs = avx512bw._mm512_maddubs_epi16(values, tens);
        let fours = avx512bw._mm512_madd_epi16(pairs, hundreds);
        let fours = avx512bw._mm512_packus_epi32(fours, fours);
        let eights = avx512bw._mm512_madd_epi16(fours, myriads);
        let high = avx512f._mm512_mul_epu32(eights, avx512f._mm512_set1_epi64(100_000_000));
        let low = avx512f._mm512_srli_epi64::<32>(eights);
        let all = avx512f._mm512_add_epi64(high, low);
        // Each lane has its number twice.
        let one_each = avx512f._mm512_set_epi64(0, 0, 0, 0, 6, 4, 2, 0);
        avx512f._mm512_castsi512_si256(avx512f._mm512_permutexvar_epi64(one_each, all))
    }
}
