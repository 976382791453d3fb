//! Edges at the board's sync input: a signal that another recorder has, too, so that its clock and the
//! board's can be compared.

use crate::bytes::{Bytes, Reader};

/// A rising edge at the board's sync input.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Edge {
    /// Counts the edges that the board has seen since its reset, also those that it did not send, and
    /// wraps: a gap is edges that came faster than the line carries them, or that were lost on the way.
    pub number: u16,
    /// The board's clock at the edge, in µs, as in samples.
    pub clock_us: u32,
}

impl Edge {
    pub(crate) fn write<const N: usize>(&self, out: &mut Bytes<N>) {
        out.extend(&self.clock_us.to_le_bytes());
    }

    pub(crate) fn read(number: u16, mut body: Reader<'_>) -> Option<Self> {
        let clock_us = body.u32()?;
        body.end(Self { number, clock_us })
    }
}
