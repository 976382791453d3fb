//! What host and board share, and what the board wants it used with.

use core::fmt;

use crate::bytes::{Bytes, Reader};

/// What host and board share.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Key([u8; Self::LEN]);

/// What a board wants signatures to be made with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Challenge {
    /// Whether the board has a key, and so wants signatures.
    pub is_keyed: bool,
    /// The board's number of this run.
    pub nonce: [u8; 8],
    /// The counter of the last signed command that was accepted.
    pub counter: u32,
    /// Commands that were refused for want of a signature, or for a wrong or an old one, since the
    /// start; it stays at the largest value.
    pub refused: u32,
}

impl Key {
    /// Bytes of a key.
    pub const LEN: usize = 16;

    /// A key of random bytes; `None` of zeros, which stand for none.
    pub fn new(bytes: [u8; Self::LEN]) -> Option<Self> {
        (bytes != [0; Self::LEN]).then_some(Self(bytes))
    }

    /// Its bytes.
    pub const fn bytes(&self) -> &[u8; Self::LEN] {
        &self.0
    }
}

/// Does not show the key.
impl fmt::Debug for Key {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Key(…)")
    }
}

impl Challenge {
    pub(crate) fn write<const N: usize>(&self, out: &mut Bytes<N>) {
        out.push(u8::from(self.is_keyed));
        out.extend(&self.nonce);
        out.extend(&self.counter.to_le_bytes());
        out.extend(&self.refused.to_le_bytes());
    }

    pub(crate) fn read(body: &mut Reader<'_>) -> Option<Self> {
        Some(Self {
            is_keyed: body.u8()? & 1 != 0,
            nonce: body.array()?,
            counter: body.u32()?,
            refused: body.u32()?,
        })
    }
}
