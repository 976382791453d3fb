//! The digits of a number in registers that end with it: what the instruction sets that join them there share.

use super::number::{quotient, signed};

/// An instruction set that joins the digits of a number within a register or two.
pub(crate) trait DigitRegisters: Copy {
    /// The number that the digits spell in the last `length` bytes of a register, and how many of
    /// them follow a point. `None` where there are no digits in front of the point or behind it, more
    /// than 15 in all, or anything else.
    fn digits(self, register: &[u8; 16], length: usize) -> Option<(u64, usize)>;

    /// The number that the digits of `lines[start..end]` spell, more than 16 bytes and up to 32, and how many
    /// of them follow a point. `None` where there are no digits in front of the point or behind it, more than
    /// fit 64 bits, or anything else.
    fn many_digits(self, lines: &[u8], start: usize, end: usize) -> Option<(u64, usize)>;

    /// [`super::instruction_set::InstructionSet::plain_number`] of what these two leave: out of the way of
    /// the loop that [`DigitRegisters::decimal`] is inlined in.
    fn other_number(self, lines: &[u8], at: usize, end: usize) -> Option<f64>;

    /// [`super::instruction_set::InstructionSet::plain_number`].
    #[inline(always)]
    fn decimal(self, lines: &[u8], at: usize, end: usize) -> Option<f64> {
        let negative = *lines.get(at)? == b'-';
        let start = at + usize::from(negative);
        let length = end.wrapping_sub(start);
        // The last digit stands at the end of the register.
        let register = lines.get(end.wrapping_sub(16)..).and_then(<[u8]>::first_chunk::<16>);
        let plain = match register {
            Some(register) if length <= 16 => self.digits(register, length),
            Some(_) if length <= 32 => self.many_digits(lines, start, end),
            _ => None,
        };
        match plain {
            // Fifteen digits are below 2⁵³.
            Some((mantissa, decimals)) if length <= 16 => {
                Some(quotient(negative, mantissa, decimals))
            }
            Some((mantissa, decimals)) => signed(negative, mantissa, -(decimals as i32)),
            None => self.other_number(lines, at, end),
        }
    }
}

/// For each number of decimals, where digits are taken from: those before the point come one place
/// closer. Where there are no decimals, there is no point.
pub(crate) const CLOSE_UP: [[u8; 16]; 16] = {
    let mut rows = [[0; 16]; 16];
    let mut decimals = 0;
    while decimals < rows.len() {
        let mut i = 0;
        while i < 16 {
            let is_before_point = decimals > 0 && i + decimals < 16;
            // 0x80 gives zero: the first place is left without a source.
            rows[decimals][i] = match (is_before_point, i) {
                (false, _) => i as u8,
                (true, 0) => 0x80,
                (true, _) => i as u8 - 1,
            };
            i += 1;
        }
        decimals += 1;
    }
    rows
};

/// For each number of digits from 1 on, a mask of as many bytes at the end.
pub(crate) const LAST: [[u8; 16]; 16] = {
    let mut rows = [[0; 16]; 16];
    let mut digits = 1;
    while digits <= rows.len() {
        let mut i = 16 - digits;
        while i < 16 {
            rows[digits - 1][i] = 0xff;
            i += 1;
        }
        digits += 1;
    }
    rows
};
