//! Which protocol a stream speaks, and telling when it speaks none.

use std::time::Duration;

use shared_proto::xbee::Mode;
use shared_proto::{Decoder, Event, Framing, Protocol, detect};

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

/// Bytes that are enough to tell the protocol by: half a second of 100 Hz takes 1,500.
const ENOUGH: usize = 2048;

/// Time from the first byte after which fewer have to do. It adds to what a kill can lose, so it
/// is short; 100 Hz sends a dozen frames in it.
const PATIENCE: Duration = Duration::from_millis(250);

/// Bytes and time without a frame after which there will be none.
const HOPELESS: (usize, Duration) = (1 << 16, Duration::from_secs(3));

/// Fewest bytes for that verdict: a frame of the longest kind and the start of a next.
const SOME: usize = 100;

/// Finds out which protocol a stream speaks.
#[derive(Clone, Debug, Default)]
pub struct Recognition {
    asked_for: Option<Protocol>,
    bytes: Vec<u8>,
    first_at: Option<Duration>,
}

/// Why there is no frame of the protocol wanted.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NoFrame {
    /// Not a single byte has come.
    #[error("nothing arrived")]
    Silence,
    /// Packets, but none with readings or forces.
    #[error("the board is there, but sends no frames")]
    NotStreaming,
    /// No protocol has frames in so many bytes.
    #[error("bytes arrive ({0} so far) but no valid frame")]
    Any(usize),
    /// Frames of another protocol than the one asked for, in so many bytes.
    #[error(
        "no valid frame of framing `{}` in {bytes} bytes; they are framed `{}`",
        protocol_name(*asked_for), protocol_name(*found)
    )]
    OtherProtocol { bytes: usize, asked_for: Protocol, found: Protocol },
}

impl Recognition {
    /// Nothing has arrived. With a protocol `asked_for`, no other is accepted.
    pub fn new(asked_for: Option<Protocol>) -> Self {
        Self { asked_for, ..Self::default() }
    }

    /// Takes bytes that arrived at time `now`: the protocol, and all bytes since the start of the stream, which are still
    /// to be decoded; `None` as long as more are needed.
    ///
    /// # Errors
    /// [`NoFrame`] once there is little hope.
    pub fn feed(
        &mut self,
        bytes: &[u8],
        now: Duration,
    ) -> Result<Option<(Protocol, Vec<u8>)>, NoFrame> {
        self.bytes.extend_from_slice(bytes);
        if self.bytes.is_empty() {
            return Ok(None);
        }
        let elapsed = now.saturating_sub(*self.first_at.get_or_insert(now));
        if self.bytes.len() < ENOUGH && elapsed < PATIENCE {
            return Ok(None);
        }
        if let Some(recognised) = self.recognise()? {
            return Ok(Some(recognised));
        }
        let length = self.bytes.len();
        match length >= HOPELESS.0 || length >= SOME && elapsed >= HOPELESS.1 {
            true => Err(self.no_frame()),
            false => Ok(None),
        }
    }

    /// The stream is over: what it was, `None` if nothing arrived.
    ///
    /// # Errors
    /// [`NoFrame`].
    pub fn finish(&mut self) -> Result<Option<(Protocol, Vec<u8>)>, NoFrame> {
        match self.bytes.is_empty() {
            true => Ok(None),
            false => self.recognise()?.ok_or_else(|| self.no_frame()).map(Some),
        }
    }

    fn recognise(&mut self) -> Result<Option<(Protocol, Vec<u8>)>, NoFrame> {
        let found = match self.asked_for {
            Some(protocol) => (protocol.frames_in(&self.bytes).0 > 0).then_some(protocol),
            None => detect(&self.bytes),
        };
        let Some(protocol) = found else { return Ok(None) };
        Ok(Some((protocol, std::mem::take(&mut self.bytes))))
    }

    fn no_frame(&self) -> NoFrame {
        let bytes = self.bytes.len();
        match (self.asked_for, detect(&self.bytes)) {
            (Some(asked_for), Some(found)) => NoFrame::OtherProtocol { bytes, asked_for, found },
            _ => NoFrame::Any(bytes),
        }
    }
}

/// The version of the packets, if none of them is of ours.
pub(crate) fn other_version(protocol: Protocol, bytes: &[u8]) -> Option<u8> {
    let Protocol::Packets(framing) = protocol else { return None };
    let mut decoder = Decoder::new(framing);
    let mut other = None;
    decoder.feed(bytes, |event| {
        if let Event::OtherVersion { version, .. } = event {
            other = Some(version);
        }
    });
    other.filter(|_| decoder.counters.packets == 0)
}
