//! Finding out which protocol a stream of bytes speaks.

use crate::decoder::{Decoder, Framing};
use crate::skinproc;

/// What a board can speak.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Protocol {
    /// The packets of this crate.
    Packets(Framing),
    /// That of the original SkinProc board.
    Original,
}

impl Protocol {
    /// The framing of packets, `None` for the original board.
    pub fn framing(self) -> Option<Framing> {
        match self {
            Self::Packets(framing) => Some(framing),
            Self::Original => None,
        }
    }
}

/// The protocol that makes the most of `bytes`, `None` if none finds anything in them.
///
/// Frames inside API frames look like COBS with damage between, so damage counts against what is
/// found; of equals the simpler is taken, for escapes may not have occurred yet. A second of a
/// stream is plenty.
pub fn detect(bytes: &[u8]) -> Option<Protocol> {
    let packets = Framing::ALL.into_iter().map(|framing| {
        let mut decoder = Decoder::new(framing);
        decoder.feed(bytes, |_| {});
        let counters = decoder.counters();
        let damaged = counters.bad_crc + counters.malformed + counters.bad_api_frames;
        let found = counters.packets + counters.unknown_version;
        (Protocol::Packets(framing), found, damaged)
    });
    let mut original = skinproc::Decoder::new();
    original.feed(bytes, |_| {});
    let damaged = original.skipped / skinproc::SCAN_LEN as u64;
    packets
        .chain([(Protocol::Original, original.scans, damaged)])
        .filter(|&(_, found, _)| found > 0)
        .map(|(protocol, found, damaged)| (protocol, found.cast_signed() - damaged.cast_signed()))
        .reduce(|best, next| if next.1 > best.1 { next } else { best })
        .map(|(protocol, _)| protocol)
}
