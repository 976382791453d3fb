//! The protocols by the names that people know them by.

use shared_proto::xbee::Mode;
use shared_proto::{Framing, Protocol};

/// What the bytes of a stream can be: names, and what they are.
pub const PROTOCOLS: [(&str, &str, Protocol); 4] = [
    ("cobs", "Packets over a wire or a transparent XBee", Protocol::Packets(Framing::Cobs)),
    ("xbee-ap1", "Packets over an XBee in API mode", Protocol::Packets(Framing::Xbee(Mode::Plain))),
    (
        "xbee-ap2",
        "Packets over an XBee in API mode with escapes",
        Protocol::Packets(Framing::Xbee(Mode::Escaped)),
    ),
    ("original", "The original SkinProc board", Protocol::Original),
];

/// The name of a protocol.
pub fn protocol_name(protocol: Protocol) -> &'static str {
    let named = PROTOCOLS.iter().find(|(.., known)| *known == protocol);
    named.map(|(name, ..)| *name).expect("every protocol has a name")
}
