//! [`InstructionSet`] in the registers of 64 bytes that x86-64 processors with AVX-512 have: eight whole
//! numbers of up to 8 digits are read side by side. All else is as with [`Avx2`].

use std::arch::x86_64::__m512i;

use pulp::x86::V4;

use super::avx2::Avx2;
use super::instruction_set::{BLOCK, ColumnFields, InstructionSet};

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
    fn digits(self, lines: &[u8], start: usize, end: usize) -> Option<(u64, usize)> {
        self.wide.digits(lines, start, end)
    }

    #[inline(always)]
    fn other_number(self, lines: &[u8], at: usize, end: usize) -> Option<f64> {
        self.wide.other_number(lines, at, end)
    }

    #[inline(always)]
    fn whole_numbers(self, lines: &[u8], fields: ColumnFields<'_>, values: &mut [f64]) -> usize {
        let (groups, _) = values.as_chunks_mut::<8>();
        for (i, group) in groups.iter_mut().enumerate() {
            match self.eight(lines, fields, 8 * i) {
                Some(eight) => *group = eight,
                None => return 8 * i,
            }
        }
        8 * groups.len()
    }
}

const FIRST_SIXTEEN: [u32; 16] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15];

// No closures here, as for [`Avx2`].
impl Widest {
    /// The whole numbers of one to eight digits in eight rows, from `first` on; `None` if one of them is not.
    #[inline(always)]
    fn eight(self, lines: &[u8], fields: ColumnFields<'_>, first: usize) -> Option<[f64; 8]> {
        let V4 { avx512f, avx512bw, avx512dq, .. } = self.v4;
        let (mut words, mut lengths, mut all_lengths) = ([0_u64; 8], [0_u64; 8], 0);
        for lane in 0..8 {
            let (start, end) = fields.position(first + lane);
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
}
