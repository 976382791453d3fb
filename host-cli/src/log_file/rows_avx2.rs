//! The short way of [`super::rows`] with the wide registers of x86-64.
//!
//! A first pass notes where separators, line ends and decimal points are, 64 bytes at a time. Where
//! each number starts and ends is then known without reading the one before it, so the processor
//! works on several at once; the digits of a number are joined within one register. Numbers that
//! are not plain go to the standard library, rows that are wrong to the portable way.

use std::arch::x86_64::{__m128i, __m256i};

use pulp::x86::V3;

use super::number::{ParsePlain, Portable, parse_field, plain_value};
use super::rows::{Parsed, RowPlan, Step};

/// How many bytes are indexed at a time: the index stays in the first-level cache.
const WINDOW: usize = 1 << 13;

/// A call that parses rows from `lines[at]` on and returns where it stopped: at the end, or at a
/// row that is not plain.
pub(super) struct PlainRows<'a> {
    pub(super) simd: V3,
    pub(super) plan: &'a RowPlan,
    pub(super) lines: &'a [u8],
    pub(super) at: usize,
    pub(super) parsed: &'a mut Parsed,
}

impl pulp::NullaryFnOnce for PlainRows<'_> {
    type Output = usize;

    #[inline(always)]
    fn call(self) -> usize {
        let Self { simd, plan, lines, mut at, parsed } = self;
        let mut index = Index::default();
        while at < lines.len() {
            index.fill(simd, lines, at, plan.separator);
            let window = at;
            let mut next = 0;
            while let Some(row) = parse_row(simd, plan, lines, window, at, &index, next, parsed) {
                parsed.rows += 1;
                (at, next) = row;
                if next == index.length {
                    break;
                }
            }
            // What was parsed of a row that then proved cut off, or not plain.
            parsed.columns.iter_mut().for_each(|column| column.truncate(parsed.rows));
            // Not one row: it is not plain, or longer than the window.
            if at == window {
                break;
            }
            // The row that was cut off by the end of the window comes again in the next.
            let row_end = index.places[next..index.length].iter();
            let mut ends = row_end.filter(|&&place| lines[window + usize::from(place)] == b'\n');
            if ends.next().is_some() {
                break;
            }
        }
        at
    }
}

/// Places of separators, line ends and points, from the start of a window.
struct Index {
    places: Box<[u16; WINDOW + 64]>,
    length: usize,
}

impl Default for Index {
    fn default() -> Self {
        Self { places: Box::new([0; WINDOW + 64]), length: 0 }
    }
}

impl Index {
    #[inline(always)]
    fn fill(&mut self, simd: V3, lines: &[u8], at: usize, separator: u8) {
        let V3 { avx, avx2, .. } = simd;
        let splat = |byte: u8| avx._mm256_set1_epi8(byte as i8);
        let (separator, line_end, point) = (splat(separator), splat(b'\n'), splat(b'.'));
        let marks = |half: __m256i| {
            let ends = avx2._mm256_or_si256(
                avx2._mm256_cmpeq_epi8(half, separator),
                avx2._mm256_cmpeq_epi8(half, line_end),
            );
            let marks = avx2._mm256_or_si256(ends, avx2._mm256_cmpeq_epi8(half, point));
            u64::from(avx2._mm256_movemask_epi8(marks) as u32)
        };
        self.length = 0;
        let window = &lines[at..lines.len().min(at + WINDOW)];
        for (block, bytes) in window.chunks(64).enumerate() {
            let mut padded = [0; 64];
            let bytes: &[u8; 64] = match bytes.first_chunk() {
                Some(whole) => whole,
                None => {
                    padded[..bytes.len()].copy_from_slice(bytes);
                    &padded
                }
            };
            let [low, high]: [__m256i; 2] = pulp::cast(*bytes);
            let mut marks = marks(low) | marks(high) << 32;
            let count = marks.count_ones() as usize;
            let base = (64 * block) as u16;
            let places = &mut self.places[self.length..];
            // Most blocks have no more than this; a count that varies would cost a wrong guess.
            const USUAL: usize = 12;
            if let Some(places) = places.first_chunk_mut::<USUAL>() {
                for place in places {
                    *place = base + marks.trailing_zeros() as u16;
                    marks &= marks.wrapping_sub(1);
                }
            }
            for place in places.iter_mut().take(count).skip(USUAL) {
                *place = base + marks.trailing_zeros() as u16;
                marks &= marks.wrapping_sub(1);
            }
            self.length += count;
        }
    }
}

/// Parses the row that starts at `lines[at]`, the marks of which start at `index.places[next]`;
/// returns the same for the row after it, or `None` if it is not plain.
#[inline(always)]
#[expect(clippy::too_many_arguments, reason = "the state of one loop")]
fn parse_row(
    simd: V3,
    plan: &RowPlan,
    lines: &[u8],
    window: usize,
    mut at: usize,
    index: &Index,
    mut next: usize,
    parsed: &mut Parsed,
) -> Option<(usize, usize)> {
    let places = &index.places[..index.length];
    let mut label = None;
    let last = plan.steps.len() - 1;
    let mut columns = parsed.columns.iter_mut();
    for (column, step) in plan.steps.iter().enumerate() {
        let mut end = window + usize::from(*places.get(next)?);
        next += 1;
        let mut decimals = 0;
        if *step == Step::Number {
            if *lines.get(end)? == b'.' {
                let point = end;
                end = window + usize::from(*places.get(next)?);
                next += 1;
                decimals = end - point;
            }
        } else {
            while *lines.get(end)? == b'.' {
                end = window + usize::from(*places.get(next)?);
                next += 1;
            }
        }
        let after = end + 1;
        if column < last {
            if *lines.get(end)? != plan.separator {
                return None;
            }
        } else {
            if *lines.get(end)? != b'\n' {
                return None;
            }
            if *lines.get(end.checked_sub(1)?)? == b'\r' {
                end -= 1;
                decimals = decimals.saturating_sub(1);
                // A point just before the line end is not plain.
                if end < at {
                    return None;
                }
            }
        }
        match step {
            Step::Number => {
                let value = match parse_number(simd, lines, at, end, decimals) {
                    Some(value) => value,
                    None => parse_field(lines.get(at..end)?).ok()?,
                };
                columns.next()?.push(value);
            }
            Step::Group => label = Some(at..end),
            Step::Skip => {}
        }
        at = after;
    }
    if let Some(label) = label {
        parsed.push_group(lines[label].trim_ascii());
    }
    Some((at, next))
}

/// The plain number in `lines[at..end]`; `tail` is how many bytes it has from its point on, 0 if
/// it has no point.
#[inline(always)]
fn parse_number(simd: V3, lines: &[u8], at: usize, end: usize, tail: usize) -> Option<f64> {
    let V3 { sse2, ssse3, sse4_1, .. } = simd;
    let negative = *lines.get(at)? == b'-';
    let length = end.checked_sub(at + usize::from(negative))?;
    let digits = length.checked_sub(usize::from(tail > 0))?;
    // Digits are wanted on both sides of a point, as many as fit the register with the point.
    if digits < tail.max(1) || tail == 1 {
        return None;
    }
    if length > 16 {
        let (value, number_end) = Portable.parse_plain(lines, at)?;
        return (number_end == end).then_some(value);
    }
    // The last digit stands at the end of the register; the point is closed up, and what precedes
    // the number becomes zeros.
    let register: &[u8; 16] = lines.get(end.checked_sub(16)?..)?.first_chunk()?;
    let closed = ssse3._mm_shuffle_epi8(pulp::cast(*register), pulp::cast(CLOSE_UP[tail]));
    let values = sse2._mm_sub_epi8(closed, sse2._mm_set1_epi8(b'0' as i8));
    let values = sse2._mm_and_si128(values, pulp::cast(LAST[digits]));
    let clamped = sse2._mm_min_epu8(values, sse2._mm_set1_epi8(9));
    if sse2._mm_movemask_epi8(sse2._mm_cmpeq_epi8(values, clamped)) != 0xffff {
        return None;
    }
    // Neighbours are joined: 16 digits, 8 pairs, 4 fours, 2 eights.
    let weights = |high: i16, low: i16| -> __m128i {
        pulp::cast([high, low, high, low, high, low, high, low])
    };
    let tens: __m128i = pulp::cast([10_u8, 1, 10, 1, 10, 1, 10, 1, 10, 1, 10, 1, 10, 1, 10, 1]);
    let pairs = ssse3._mm_maddubs_epi16(values, tens);
    let fours = sse2._mm_madd_epi16(pairs, weights(100, 1));
    let fours = sse4_1._mm_packus_epi32(fours, fours);
    let eights: [u64; 2] = pulp::cast(sse2._mm_madd_epi16(fours, weights(10_000, 1)));
    let mantissa = (eights[0] & 0xffff_ffff) * 100_000_000 + (eights[0] >> 32);
    plain_value(negative, mantissa, tail.saturating_sub(1))
}

/// For each number of bytes from the point on, where digits are taken from: those before the
/// point come one place closer. The first row is for numbers without a point.
const CLOSE_UP: [[u8; 16]; 17] = {
    let mut rows = [[0; 16]; 17];
    let mut tail = 0;
    while tail <= 16 {
        let mut i = 0;
        while i < 16 {
            let is_before_point = tail > 0 && i <= 16 - tail;
            // 0x80 gives zero: the first place is then left without a source.
            rows[tail][i] = match (is_before_point, i) {
                (false, _) => i as u8,
                (true, 0) => 0x80,
                (true, _) => i as u8 - 1,
            };
            i += 1;
        }
        tail += 1;
    }
    rows
};

/// For each number of digits, a mask of the last so many places.
const LAST: [[u8; 16]; 17] = {
    let mut rows = [[0; 16]; 17];
    let mut digits = 0;
    while digits <= 16 {
        let mut i = 16 - digits;
        while i < 16 {
            rows[digits][i] = 0xff;
            i += 1;
        }
        digits += 1;
    }
    rows
};
