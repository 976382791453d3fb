//! Commands that only who knows a key can give.
//!
//! HMAC-SHA-256 (RFC 2104, FIPS 180-4) over what identifies the command, cut to eight bytes (allowed by
//! NIST SP 800-107r1, 5.3.3; a board tells of every failure, and at 57,600 baud 2⁶⁴ tries take longer
//! than there is time):
//!
//! ```text
//! nonce (8) ‖ counter (4) ‖ number (2) ‖ board (4) ‖ code (1) ‖ arguments
//! ```
//!
//! The nonce is the board's, new at every start; the counter is the host's and goes up. So a command
//! that was recorded is of no use later, neither on this run of the board nor on the next. What is
//! sent is not hidden: the radio's own encryption does that.

use crate::board::BoardId;
use crate::bytes::{Bytes, Reader};
use crate::command::{Command, MAX_PIECE};
use crate::key::Key;
use hmac::{Hmac, KeyInit, Mac};
use sha2::Sha256;

/// Most bytes of a calibration in one signed command.
pub const MAX_SIGNED_PIECE: usize = 24;

const TAG: usize = 8;

/// What makes a command one of who knows the key.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Signature {
    /// Above that of any signed command before.
    pub counter: u32,
    tag: [u8; TAG],
}

impl Key {
    fn mac(
        &self,
        nonce: &[u8; 8],
        counter: u32,
        number: u16,
        to: Option<BoardId>,
        command: &Command,
    ) -> Hmac<Sha256> {
        let mut content = Bytes::<{ 8 + 4 + 2 + 4 + 1 + 4 + MAX_PIECE }>::new();
        content.extend(nonce);
        content.extend(&counter.to_le_bytes());
        content.extend(&number.to_le_bytes());
        content.extend(&BoardId::code(to).to_le_bytes());
        command.write(&mut content);
        // A key of any length is one.
        let mut mac = Hmac::<Sha256>::new(&padded(self.bytes()).into());
        mac.update(&content);
        mac
    }

    /// The signature of a command.
    pub fn sign(
        &self,
        nonce: &[u8; 8],
        counter: u32,
        number: u16,
        to: Option<BoardId>,
        command: &Command,
    ) -> Signature {
        let whole = self.mac(nonce, counter, number, to, command).finalize().into_bytes();
        let tag = whole.first_chunk().copied().unwrap_or_default();
        Signature { counter, tag }
    }

    /// Whether a signature is that of the command, found in the same time for any wrong one.
    pub fn accepts(
        &self,
        signature: &Signature,
        nonce: &[u8; 8],
        number: u16,
        to: Option<BoardId>,
        command: &Command,
    ) -> bool {
        let mac = self.mac(nonce, signature.counter, number, to, command);
        mac.verify_truncated_left(&signature.tag).is_ok()
    }
}

/// A key of a block of the hash: HMAC fills up with zeros.
fn padded(key: &[u8; Key::LEN]) -> [u8; 64] {
    let mut block = [0; 64];
    block[..Key::LEN].copy_from_slice(key);
    block
}

impl Signature {
    pub(crate) fn write<const N: usize>(&self, out: &mut Bytes<N>) {
        out.extend(&self.counter.to_le_bytes());
        out.extend(&self.tag);
    }

    pub(crate) fn read(body: &mut Reader<'_>) -> Option<Self> {
        Some(Self { counter: body.u32()?, tag: body.array()? })
    }
}
