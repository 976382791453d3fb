//! Asking a board all that can be asked, and listening to its stream for a while.
//!
//! Nothing that the board holds is changed; a stream that stood still is started and stopped again.

use std::io::Write;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use shared_proto::{Command, Framing, Identity, Protocol, ResetCause, Status, detect};

use super::record::read_port;
use super::{
    Client, Connection, LinkError, PortOptions, RecordError, RecordOptions, Recorded, Sinks,
    Source, Uplink, Watcher, record,
};
use crate::recording::BoardFrame;
use shell_data::lock::lock;

/// Bits per second that boards and XBees are set to, the likeliest first.
const BAUDS: [u32; 9] =
    [57_600, 115_200, 9_600, 230_400, 460_800, 38_400, 19_200, 921_600, 1_000_000];

/// How long an answer is waited for where one is not expected. At 9,600 baud that is 240 bytes.
const GLANCE: Duration = Duration::from_millis(250);

/// Bytes that are enough to tell what they are.
const ENOUGH: usize = 2048;

/// How to ask.
#[derive(Clone, Debug)]
pub struct HandshakeOptions {
    /// The port and how it should be set.
    pub port: PortOptions,
    /// How the base station should be set.
    pub uplink: Uplink,
    /// How long the stream is listened to.
    pub listen: Duration,
    /// The number of the first command: one that late answers to others do not have.
    pub number: u16,
}

/// What comes from the port.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Heard {
    /// A board, at this speed, bits per second, and with this protocol.
    Board { baud: u32, protocol: Protocol },
    /// Bytes without a frame in them, at any speed; so many at the speed that was asked for.
    Noise { bytes: usize },
    /// Nothing, at any speed.
    #[default]
    Silence,
}

/// All that a board said.
#[derive(Debug, Default)]
pub struct Handshake {
    /// What came from the port.
    pub heard: Heard,
    /// What the board is.
    pub identity: Option<Identity>,
    /// How it did before it was made to stream.
    pub status: Option<Status>,
    /// What it said before its last reset, if that was a crash.
    pub last_words: Option<String>,
    /// A question that it did not answer.
    pub trouble: Option<LinkError>,
    /// A stretch of its stream; `None` if it was not got so far.
    pub stream: Option<Result<Stretch, RecordError>>,
}

/// A stretch of a stream.
#[derive(Clone, Debug)]
pub struct Stretch {
    /// What was recorded, with the books of what was lost.
    pub recorded: Recorded,
    /// The frames, in the order in which they arrived.
    pub frames: Vec<BoardFrame>,
}

/// Asks the board at a port; `stop` ends it early.
///
/// # Errors
/// [`LinkError`] if the port cannot be opened or goes away.
pub fn handshake(options: &HandshakeOptions, stop: &AtomicBool) -> Result<Handshake, LinkError> {
    let heard = listen(options)?;
    let mut found = Handshake { heard, ..Handshake::default() };
    let Heard::Board { baud, protocol } = heard else { return Ok(found) };
    let port = PortOptions { baud, ..options.port.clone() };
    let mut start = None;
    if let Protocol::Packets(framing) = protocol {
        let uplink = Uplink { framing, ..options.uplink };
        let mut client = Client::new(port.open()?, &port.port, uplink, options.number);
        if let Err(trouble) = ask(&mut client, &mut found) {
            found.trouble = Some(trouble);
            return Ok(found);
        }
        if found.status.is_some_and(|status| !status.streaming) {
            start = Some(uplink);
        }
    }
    let frames = Arc::new(Mutex::new(Vec::new()));
    let sinks = Sinks { watcher: Some(Box::new(Keep(Arc::clone(&frames)))), ..Sinks::default() };
    let (protocol, duration) = (Some(protocol), Some(options.listen));
    let recording = RecordOptions { protocol, duration, start, ..RecordOptions::default() };
    let mut source = Source::port(port, false)?;
    let recorded = record(&mut source, sinks, &recording, stop, &mut |_| {});
    found.stream = Some(recorded.map(|recorded| {
        let frames = std::mem::take(&mut *lock(&frames));
        Stretch { recorded, frames }
    }));
    Ok(found)
}

/// Keeps the frames.
#[derive(Debug)]
struct Keep(Arc<Mutex<Vec<BoardFrame>>>);

impl Watcher for Keep {
    fn see(&mut self, frames: &[BoardFrame]) {
        lock(&self.0).extend_from_slice(frames);
    }
}

fn ask(client: &mut Client<Box<dyn Connection>>, found: &mut Handshake) -> Result<(), LinkError> {
    found.identity = Some(client.identify()?);
    let status = client.status()?;
    found.status = Some(status);
    if matches!(status.reset_cause, ResetCause::Panic | ResetCause::Fault) {
        found.last_words = Some(client.last_words()?);
    }
    Ok(())
}

/// What comes from the port as it should be set and, if that is no board, at other speeds.
fn listen(options: &HandshakeOptions) -> Result<Heard, LinkError> {
    let asked = options.port.baud;
    let others = BAUDS.into_iter().filter(|&baud| baud != asked && !options.port.is_tcp());
    let mut at_first = 0;
    for (turn, baud) in [asked].into_iter().chain(others).enumerate() {
        let port = PortOptions { baud, ..options.port.clone() };
        // An adapter that cannot be so fast is not talked to so fast.
        let mut port = match port.open() {
            Err(LinkError::Open { .. }) if turn > 0 => continue,
            port => port?,
        };
        let (mut bytes, asked_in) = (Vec::new(), options.uplink.framing);
        let others = Framing::ALL.into_iter().filter(|&framing| framing != asked_in);
        for framing in [asked_in].into_iter().chain(others) {
            let uplink = Uplink { framing, ..options.uplink };
            // What cannot be sent is not answered, which is what is found out here.
            let _ = port.write_all(&uplink.encode(options.number, None, Command::Identify));
            collect(&mut *port, &mut bytes)
                .map_err(|error| LinkError::lost(&options.port.port, &error))?;
            if let Some(protocol) = detect(&bytes) {
                return Ok(Heard::Board { baud, protocol });
            }
        }
        if turn == 0 {
            at_first = bytes.len();
        }
    }
    Ok(match at_first {
        0 => Heard::Silence,
        bytes => Heard::Noise { bytes },
    })
}

/// What comes in a moment.
fn collect(port: &mut dyn Connection, bytes: &mut Vec<u8>) -> std::io::Result<()> {
    let until = Instant::now() + GLANCE;
    let mut buffer = [0; 1024];
    while Instant::now() < until && bytes.len() < ENOUGH {
        let count = read_port(port, &mut buffer)?;
        bytes.extend_from_slice(&buffer[..count]);
        // An answer is there at once, more often than not.
        if count > 0 && bytes.len() > 64 && detect(bytes).is_some() {
            break;
        }
    }
    Ok(())
}
