//! Bytes of a port to packets: those of a wire or a transparent radio, or of every module behind a base station.

use shared_proto::xbee::{Address, ApiFrame, Deframer};
use shared_proto::{Decoder, Event, Framing};

/// Most modules, and most boards, that are told apart: more than a channel has room for.
pub(super) const MOST: usize = 256;

/// What cuts bytes into packets.
#[derive(Clone, Debug)]
pub(crate) enum PacketWire {
    Transparent(Box<Decoder>),
    BaseStation { deframer: Deframer, modules: Vec<(Address, Decoder)> },
}

impl PacketWire {
    /// Nothing has arrived.
    pub(crate) fn new(framing: Framing) -> Self {
        match framing {
            Framing::Cobs => Self::Transparent(Box::new(Decoder::new(framing))),
            Framing::Xbee(mode) => {
                Self::BaseStation { deframer: Deframer::new(mode), modules: Vec::new() }
            }
        }
    }

    /// Takes bytes, in slices of any size, and calls `sink` with every event, and the address of its module and how
    /// strongly that was received where a base station says so.
    pub(crate) fn feed(
        &mut self,
        bytes: &[u8],
        mut sink: impl FnMut(Option<Address>, Option<u8>, Event),
    ) {
        match self {
            Self::Transparent(decoder) => decoder.feed(bytes, |event| sink(None, None, event)),
            Self::BaseStation { deframer, modules } => deframer.feed(bytes, |frame| {
                let ApiFrame::Receive { from, rssi, payload } = frame else { return };
                let known = modules.iter().position(|(address, _)| *address == from);
                let at = known.unwrap_or_else(|| {
                    modules.truncate(MOST);
                    modules.push((from, Decoder::new(Framing::Cobs)));
                    modules.len() - 1
                });
                modules[at].1.feed(payload, |event| sink(Some(from), rssi, event));
            }),
        }
    }
}
