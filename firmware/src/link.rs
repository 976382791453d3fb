//! Frames to bytes on the serial line to the XBee.

use embedded_io_async::Write;
use shared_proto::xbee::{Address, ApiFrame, Mode};
use shared_proto::{Frame, Framing};

/// How the board's own XBee is set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Link {
    /// Transparent (AP=0), or a wire.
    Transparent,
    /// In API mode.
    Api {
        /// With or without escapes.
        mode: Mode,
        /// The base station.
        to: Address,
    },
}

impl Link {
    /// What the board receives.
    pub const fn framing(self) -> Framing {
        match self {
            Self::Transparent => Framing::Cobs,
            Self::Api { mode, .. } => Framing::Xbee(mode),
        }
    }

    /// Bytes that a frame of so many takes on the line, at most.
    pub(crate) const fn bytes_on_line(self, frame: usize) -> usize {
        match self {
            Self::Transparent => frame,
            Self::Api { mode, to } => {
                // Start, two of length and the checksum; the header by the kind of address; in
                // escaped mode length, address and checksum may take two bytes each. A frame holds
                // no byte that is escaped.
                let (header, address) = match to {
                    Address::Short(_) => (5, 2),
                    Address::Long(_) => (11, 8),
                    Address::Zigbee { .. } => (14, 10),
                };
                let escapes = match mode {
                    Mode::Plain => 0,
                    Mode::Escaped => 2 + address + 1,
                };
                4 + header + frame + escapes
            }
        }
    }

    /// Sends a frame.
    ///
    /// # Errors
    /// Those of the writer.
    pub async fn send<W: Write>(self, frame: &Frame, writer: &mut W) -> Result<(), W::Error> {
        match self {
            Self::Transparent => writer.write_all(frame).await,
            Self::Api { mode, to } => {
                // No status is asked for: a sample that got lost is too old to send again.
                let api = ApiFrame::Transmit { id: 0, to, payload: frame };
                match api.encode(mode) {
                    Some(bytes) => writer.write_all(&bytes).await,
                    None => Ok(()), // a frame of ours is never too long for the radio
                }
            }
        }
    }
}
