//! Detection of a stream's protocol, or of its absence.

use std::time::Duration;

use shared_proto::xbee::Mode;
use shared_proto::{Decoder, Event, Framing, Protocol, detect};

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

pub fn protocol_name(protocol: Protocol) -> &'static str {
    let named = PROTOCOLS.iter().find(|(.., known)| *known == protocol);
    named.map(|(name, ..)| *name).expect("every protocol has a name")
}

/// Sufficient bytes for detection: half a second at 100 Hz has 1,500 bytes.
const ENOUGH: usize = 2048;

/// Time after which fewer bytes suffice: two dozen frames at 100 Hz, which a kill would lose.
const PATIENCE: Duration = Duration::from_millis(250);

/// Bytes and time without a frame after which detection gives up.
const HOPELESS: (usize, Duration) = (1 << 16, Duration::from_secs(3));

/// Minimum number of bytes to give up: the longest frame and the start of the next.
const SOME: usize = 100;

#[derive(Clone, Debug, Default)]
pub struct Recognition {
    asked_for: Option<Protocol>,
    bytes: Vec<u8>,
    first_at: Option<Duration>,
}

#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NoFrame {
    #[error("nothing arrived")]
    Silence,
    #[error("the board is there, but sends no frames")]
    NotStreaming,
    /// No protocol matches this number of bytes.
    #[error("bytes arrive ({0} so far) but no valid frame")]
    Any(usize),
    #[error(
        "no valid frame of framing `{}` in {bytes} bytes; they are framed `{}`",
        protocol_name(*asked_for), protocol_name(*found)
    )]
    OtherProtocol { bytes: usize, asked_for: Protocol, found: Protocol },
}

impl Recognition {
    pub fn new(asked_for: Option<Protocol>) -> Self {
        Self { asked_for, ..Self::default() }
    }

    /// Takes bytes that arrived at `now`; returns the protocol once known, and all bytes so far.
    /// Fails with [`NoFrame`] once frames are unlikely to come.
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

    /// Ends the stream: returns its protocol, `None` if no byte arrived.
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

/// Returns the version of the packets, if it differs from this program's in all of them.
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
