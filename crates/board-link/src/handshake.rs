//! A complete query of a board, and a short recording of its stream. The board's state does not
//! change; a stream that was off is stopped again.

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

/// Bit rates of boards and XBees, most likely first.
const BAUDS: [u32; 9] =
    [57_600, 115_200, 9_600, 230_400, 460_800, 38_400, 19_200, 921_600, 1_000_000];

/// Timeout of an answer at a speed that may be wrong. At 9,600 baud, 240 bytes arrive in this time.
const GLANCE: Duration = Duration::from_millis(250);

const ENOUGH: usize = 2048;

#[derive(Clone, Debug)]
pub struct HandshakeOptions {
    pub port: PortOptions,
    pub uplink: Uplink,
    pub listen: Duration,
    /// Number of the first command, which late answers to other programs are unlikely to carry.
    pub number: u16,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Heard {
    Board {
        baud: u32,
        protocol: Protocol,
    },
    /// Bytes without a frame at any speed; `bytes` counts those at the requested speed.
    Noise {
        bytes: usize,
    },
    #[default]
    Silence,
}

#[derive(Debug, Default)]
pub struct Handshake {
    pub heard: Heard,
    pub identity: Option<Identity>,
    /// State of the board before its stream was started.
    pub status: Option<Status>,
    pub last_words: Option<String>,
    /// The error of a query without an answer.
    pub trouble: Option<LinkError>,
    /// A recorded part of the stream; `None` if the handshake ended before it.
    pub stream: Option<Result<StreamPart, RecordError>>,
}

#[derive(Clone, Debug)]
pub struct StreamPart {
    pub recorded: Recorded,
    pub frames: Vec<BoardFrame>,
}

/// Queries the board at a port; `stop` ends it early. Fails with [`LinkError`] if the port cannot
/// be opened or is lost.
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
        StreamPart { recorded, frames }
    }));
    Ok(found)
}

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

/// Listens at the requested speed, then at others if there is no board.
fn listen(options: &HandshakeOptions) -> Result<Heard, LinkError> {
    let asked = options.port.baud;
    let others = BAUDS.into_iter().filter(|&baud| baud != asked && !options.port.is_tcp());
    let mut at_first = 0;
    for (turn, baud) in [asked].into_iter().chain(others).enumerate() {
        let port = PortOptions { baud, ..options.port.clone() };
        // Skip speeds that the adapter lacks.
        let mut port = match port.open() {
            Err(LinkError::Open { .. }) if turn > 0 => continue,
            port => port?,
        };
        let (mut bytes, asked_in) = (Vec::new(), options.uplink.framing);
        let others = Framing::ALL.into_iter().filter(|&framing| framing != asked_in);
        for framing in [asked_in].into_iter().chain(others) {
            let uplink = Uplink { framing, ..options.uplink };
            // A failed write shows below, as a missing answer.
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

fn collect(port: &mut dyn Connection, bytes: &mut Vec<u8>) -> std::io::Result<()> {
    let until = Instant::now() + GLANCE;
    let mut buffer = [0; 1024];
    while Instant::now() < until && bytes.len() < ENOUGH {
        let count = read_port(port, &mut buffer)?;
        bytes.extend_from_slice(&buffer[..count]);
        // An answer usually arrives at once.
        if count > 0 && bytes.len() > 64 && detect(bytes).is_some() {
            break;
        }
    }
    Ok(())
}
