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

    /// How many frames of this protocol are in `bytes`, and how much in them is damage.
    pub fn frames_in(self, bytes: &[u8]) -> (u64, u64) {
        match self {
            Self::Packets(framing) => {
                let mut decoder = Decoder::new(framing);
                decoder.feed(bytes, |_| {});
                let counters = decoder.counters();
                let damaged = counters.bad_crc + counters.malformed + counters.bad_api_frames;
                (counters.packets + counters.unknown_version, damaged)
            }
            Self::Original => {
                let mut decoder = skinproc::Decoder::new();
                decoder.feed(bytes, |_| {});
                (decoder.scans, decoder.skipped / skinproc::SCAN_LEN as u64)
            }
        }
    }
}

/// The protocol that makes the most of `bytes`, `None` if none finds anything in them.
///
/// Frames inside API frames look like COBS with damage between, so damage counts against what is
/// found; of equals the simpler is taken, for escapes may not have occurred yet. A second of a
/// stream is plenty.
pub fn detect(bytes: &[u8]) -> Option<Protocol> {
    let protocols = Framing::ALL.into_iter().map(Protocol::Packets).chain([Protocol::Original]);
    protocols
        .map(|protocol| (protocol, protocol.frames_in(bytes)))
        .filter(|&(_, (found, _))| found > 0)
        .map(|(protocol, (found, damaged))| (protocol, found.cast_signed() - damaged.cast_signed()))
        .reduce(|best, next| if next.1 > best.1 { next } else { best })
        .map(|(protocol, _)| protocol)
}
