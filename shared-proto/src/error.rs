//! Why bytes are not a packet.

/// Why bytes are not a packet of this version.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum DecodeError {
    /// The bytes are not COBS, or too short or too long for any packet.
    Framing,
    /// The CRC does not match.
    Crc,
    /// The CRC matches, the version is another one.
    UnknownVersion {
        /// The version.
        version: u8,
        /// The kind, by that version's count; a command has the same in all.
        kind: u8,
    },
    /// The CRC matches, the version too, but it has no such kind.
    UnknownKind(u8),
    /// The CRC matches and the kind is known, but the body is not one of that kind.
    Body,
}
