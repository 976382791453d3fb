//! The digits of a number in registers that end with it: what the instruction sets that join them there share.

use super::number::signed;

/// An instruction set that joins the digits of a number within a register or two.
pub(crate) trait DigitRegisters: Copy {
    /// The number that the digits of `lines[start..end]` spell, up to 32 bytes, and how many of them follow a
    /// point. `None` where there are no digits in front of the point or behind it, more than
    /// fit 64 bits, or anything else.
    fn digits(self, lines: &[u8], start: usize, end: usize) -> Option<(u64, usize)>;

    /// [`super::instruction_set::InstructionSet::plain_number`] of what [`DigitRegisters::digits`] leaves: out of the way of
    /// the loop that [`DigitRegisters::decimal`] is inlined in.
    fn other_number(self, lines: &[u8], at: usize, end: usize) -> Option<f64>;

    /// [`super::instruction_set::InstructionSet::plain_number`].
    #[inline(always)]
    fn decimal(self, lines: &[u8], at: usize, end: usize) -> Option<f64> {
        let negative = *lines.get(at)? == b'-';
        let start = at + usize::from(negative);
        let length = end.wrapping_sub(start);
        let plain = if length <= 32 { self.digits(lines, start, end) } else { None };
        match plain {
            Some((mantissa, decimals)) => signed(negative, mantissa, -(decimals as i32)),
            None => self.other_number(lines, at, end),
        }
    }
}
