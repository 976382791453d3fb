//! Commands to the board, and answers matched by number.

use std::io::{Read, Write};
use std::time::{Duration, Instant};

use shared_proto::xbee::{Address, ApiFrame};
use shared_proto::{
    Answer, BoardId, CHANNELS, Calibration, Command, Event, Framing, Identity, MAX_PIECE, Packet,
    Piece, ReceivedPacket, Refusal, Status, VERSION, crc32,
};

use super::LinkError;
use super::record::read_port;
use crate::recording::PacketWire;

pub(crate) const ATTEMPTS: u32 = 5;

/// Timeout of an answer. A radio takes tens of ms, erasing flash 25 ms.
pub(crate) const WAIT: Duration = Duration::from_millis(400);

const OTHERS: Duration = Duration::from_millis(100);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Uplink {
    pub framing: Framing,
    /// Address of the board's module if the base station is in API mode.
    pub to: Address,
}

pub const EVERY_MODULE: Address = Address::Short(0xFFFF);

impl Uplink {
    /// Encodes a command for a board; `None` is every board.
    pub fn encode(&self, number: u16, board: Option<BoardId>, command: Command) -> Vec<u8> {
        let frame = Packet::Command { number, to: board, command }.encode();
        match self.framing {
            Framing::Cobs => frame.to_vec(),
            Framing::Xbee(mode) => {
                let api = ApiFrame::Transmit { id: 0, to: self.to, payload: &frame };
                api.encode(mode).expect("a frame of ours fits in a radio packet").to_vec()
            }
        }
    }
}

#[derive(Debug)]
pub struct Client<P> {
    port: P,
    name: String,
    uplink: Uplink,
    downlink: PacketWire,
    number: u16,
    /// The board that commands address. If unset, it is set to the board that answers.
    pub board: Option<BoardId>,
    serials: Vec<[u8; 12]>,
}

impl<P: Read + Write> Client<P> {
    /// Creates a client on an open port, called `name` in errors. Choose a `number` that a late
    /// answer to another program is unlikely to carry.
    pub fn new(port: P, name: &str, uplink: Uplink, number: u16) -> Self {
        let (name, downlink) = (name.to_owned(), PacketWire::new(uplink.framing));
        Self { port, name, uplink, downlink, number, board: None, serials: Vec::new() }
    }

    /// Sends a command repeatedly until its answer arrives. A command for one board goes to the
    /// chosen one, or else to the one that answers [`Command::Identify`]. Fails with [`LinkError`]:
    /// no answer, a refusal, another protocol version, or a lost port.
    pub fn ask(&mut self, command: Command) -> Result<Answer, LinkError> {
        if self.board.is_none() && !command.is_for_all() {
            self.board = Some(self.identify()?.id());
        }
        self.number = self.number.wrapping_add(1);
        self.serials.clear();
        let bytes = self.uplink.encode(self.number, self.board, command);
        let mut silent = true;
        for _ in 0..ATTEMPTS {
            match self.port.write_all(&bytes) {
                // The line is held up, perhaps only briefly.
                Err(error) if error.kind() == std::io::ErrorKind::TimedOut => {}
                sent => sent.map_err(|error| self.lost(&error))?,
            }
            if let Some(answer) = self.wait(WAIT, &mut silent)? {
                return match answer {
                    Answer::Refused(refusal) => Err(LinkError::Refused { command, refusal }),
                    answer => Ok(answer),
                };
            }
        }
        Err(LinkError::NoAnswer { port: self.name.clone(), command, silent })
    }

    fn wait(&mut self, time: Duration, silent: &mut bool) -> Result<Option<Answer>, LinkError> {
        let deadline = Instant::now() + time;
        let mut buffer = [0; 1024];
        // Read at least once: the answer may have arrived while this process was suspended.
        loop {
            let count =
                read_port(&mut self.port, &mut buffer).map_err(|error| self.lost(&error))?;
            *silent &= count == 0;
            let (mut found, mut other) = (None, None);
            self.downlink.feed(&buffer[..count], |_, _, event| match event {
                Event::Packet(ReceivedPacket {
                    packet: Packet::Answer { number, answer }, ..
                }) => {
                    let is_ours = number == self.number;
                    if let (true, Answer::Identity(identity)) = (is_ours, &answer) {
                        self.serials.push(identity.serial);
                    }
                    if is_ours || answer == Answer::Refused(Refusal::OtherVersion) {
                        found = Some(answer);
                    }
                }
                // Version 2: its samples can be read, but its commands differ.
                Event::Packet(ReceivedPacket { origin: None, packet: Packet::Sample(_) }) => {
                    other = Some(VERSION - 1);
                }
                Event::OtherVersion { version, .. } => other = Some(version),
                _ => {}
            });
            if found.is_some() {
                return Ok(found);
            }
            if let Some(version) = other {
                return Err(LinkError::OtherVersion(version));
            }
            if Instant::now() >= deadline {
                return Ok(None);
            }
        }
    }

    /// Sends a command whose answer carries no data; fails like [`ask`](Self::ask).
    pub fn order(&mut self, command: Command) -> Result<(), LinkError> {
        match self.ask(command)? {
            Answer::Done => Ok(()),
            _ => Err(LinkError::WrongAnswer(command)),
        }
    }

    /// Identifies the board. Fails like [`ask`](Self::ask); [`LinkError::SeveralBoards`] if more
    /// than one board answers.
    pub fn identify(&mut self) -> Result<Identity, LinkError> {
        let Answer::Identity(identity) = self.ask(Command::Identify)? else {
            return Err(LinkError::WrongAnswer(Command::Identify));
        };
        // Other boards may answer a little later.
        let heard = std::mem::take(&mut self.serials);
        let deadline = Instant::now() + OTHERS;
        while let Some(rest) = deadline.checked_duration_since(Instant::now()) {
            self.wait(rest, &mut false)?;
        }
        let mut serials = [heard, std::mem::take(&mut self.serials)].concat();
        serials.sort_unstable();
        serials.dedup();
        match serials.len() {
            0 | 1 => Ok(identity),
            _ => Err(LinkError::SeveralBoards { port: self.name.clone(), serials }),
        }
    }

    /// Returns the board's last message before its last reset, or ""; fails like [`ask`](Self::ask).
    pub fn last_words(&mut self) -> Result<String, LinkError> {
        let mut words = Vec::new();
        loop {
            let command = Command::LastWords { offset: words.len() as u16 };
            match self.ask(command)? {
                Answer::LastWords { text, .. } if text.is_empty() => break,
                Answer::LastWords { text, .. } if words.len() < usize::from(u16::MAX) => {
                    words.extend_from_slice(&text);
                }
                _ => return Err(LinkError::WrongAnswer(command)),
            }
        }
        Ok(String::from_utf8_lossy(&words).into_owned())
    }

    /// Returns each channel's rise under an emitter, in steps; fails like [`ask`](Self::ask).
    pub fn self_test(&mut self, emitter: u8) -> Result<[i16; CHANNELS], LinkError> {
        let command = Command::SelfTest { emitter };
        match self.ask(command)? {
            Answer::SelfTest { emitter: of, rise } if of == emitter => Ok(rise),
            _ => Err(LinkError::WrongAnswer(command)),
        }
    }

    /// Returns the board's state; fails like [`ask`](Self::ask).
    pub fn status(&mut self) -> Result<Status, LinkError> {
        match self.ask(Command::Status)? {
            Answer::Status(status) => Ok(status),
            _ => Err(LinkError::WrongAnswer(Command::Status)),
        }
    }

    /// Uploads a calibration and checks that the board stores it. Returns its CRC-32. Fails like
    /// [`ask`](Self::ask); [`LinkError::UnknownKind`] if the firmware is too old for this kind;
    /// [`LinkError::NotKept`] if the board has another calibration afterwards.
    pub fn upload(&mut self, calibration: &Calibration) -> Result<u32, LinkError> {
        let bytes = calibration.to_bytes();
        let sent = crc32(&bytes);
        let begin = Command::BeginCalibration { size: bytes.len() as u32, crc32: sent };
        self.order(begin).map_err(|error| match error {
            LinkError::Refused { refusal: Refusal::WrongSize, .. } => {
                LinkError::UnknownKind(calibration.kind())
            }
            error => error,
        })?;
        for (i, piece) in bytes.chunks(MAX_PIECE).enumerate() {
            let data = Piece::copy_of(piece).expect("a piece is at most as long as one can be");
            let offset = (i * MAX_PIECE) as u16;
            self.order(Command::CalibrationPiece { offset, data })?;
        }
        // A commit whose answer was lost can be repeated; the status shows the result.
        self.order(Command::CommitCalibration)?;
        let found = self.status()?.calibration_crc32;
        match found == sent {
            true => Ok(sent),
            false => Err(LinkError::NotKept { sent, found }),
        }
    }

    fn lost(&self, error: &std::io::Error) -> LinkError {
        LinkError::lost(&self.name, error)
    }
}

/// Returns a hint on a refused command, such as the accepted values; empty if there is none.
pub(crate) fn what_fits(command: &Command, refusal: Refusal) -> String {
    let text = match (refusal, command) {
        (Refusal::PeriodTooShort { shortest_us } | Refusal::LineTooSlow { shortest_us }, _) => {
            let fastest_hz = (1e7 / f64::from(shortest_us.max(1))).floor() / 10.0;
            return format!("; {fastest_hz:.1} Hz would do");
        }
        (Refusal::Other(code), _) => return format!(", number {code}"),
        (Refusal::OutOfRange, Command::SetPeriod { .. }) => "; 0.1 to 1000 Hz would do",
        (Refusal::OutOfRange, Command::SetOversampling { .. }) => "; 1 to 64 conversions would do",
        (Refusal::OutOfRange, Command::SetSettling { .. }) => "; 0 to 10000 µs would do",
        (Refusal::OutOfRange, Command::SetBaud { .. }) => {
            "; 9600, 19200, 38400, 57600, 115200, 230400, 460800, 921600 and 1000000 baud would do"
        }
        (Refusal::NotOnThisBoard, Command::SetBaud { .. }) => "; its line has no rate",
        (Refusal::NotOnThisBoard, Command::Bootloader) => "; it has no bootloader",
        _ => "",
    };
    text.to_owned()
}

pub(crate) fn name_of(command: &Command) -> String {
    match command {
        Command::SetPeriod { period_us } => format!("period {period_us} µs"),
        Command::SetOversampling { conversions } => format!("oversampling {conversions}"),
        Command::SetSettling { settling_us } => format!("settling {settling_us} µs"),
        Command::SetStream(stream) => format!("stream {stream:?}").to_lowercase(),
        Command::CalibrationPiece { offset, .. } => format!("calibration from byte {offset}"),
        Command::Zero { frames } => format!("zero over {frames} frames"),
        Command::LastWords { .. } => "last words".to_owned(),
        Command::SelfTest { emitter } => format!("self-test of emitter {}", emitter + 1),
        Command::SetBaud { baud } => format!("baud {baud}"),
        Command::BeginCalibration { .. } => "begin calibration".to_owned(),
        Command::CommitCalibration => "commit calibration".to_owned(),
        one_word => format!("{one_word:?}").to_lowercase(),
    }
}

/// Minimum rise of an emitter's own channel, in converter steps; a reflector gives a thousand.
const LEAST_RISE: i16 = 100;

/// Maximum rise of another channel, as a share of the own channel's; leaks under a shell are lower.
const MOST_LEAK: f64 = 0.05;

/// Rise that noise alone can cause, in steps.
const NOISE: f64 = 8.0;

/// Checks that an emitter raises its own channel and no other. Fails with a description of the
/// fault, with channels counted from 1.
pub fn judge(emitter: usize, rise: &[i16; CHANNELS]) -> Result<(), String> {
    let number = emitter + 1;
    let own = rise.get(emitter).copied().unwrap_or(0);
    let most = (0..CHANNELS).max_by_key(|&channel| rise[channel]).unwrap_or(emitter);
    if own < LEAST_RISE {
        let raised = match rise[most] >= LEAST_RISE {
            true => format!("channel {} instead of its own: wires are exchanged", most + 1),
            false => "no channel: is it wired, with a reflector above it?".to_owned(),
        };
        return Err(format!("emitter {number} raises {raised}"));
    }
    let limit = (MOST_LEAK * f64::from(own)).max(NOISE);
    let others = (0..CHANNELS).filter(|&channel| channel != emitter);
    let channels = others.filter(|&it| f64::from(rise[it]) > limit);
    let channels: Vec<String> = channels.map(|channel| (channel + 1).to_string()).collect();
    match channels.join(" and ").as_str() {
        "" => Ok(()),
        others => Err(format!(
            "emitter {number} raises channel {others} besides its own: a bridge, or light that leaks"
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_emitter_that_raises_another_channel_fails_the_self_test() {
        let good = [3, -2, 1_200, 0, 40, 0, 7, -8];
        assert_eq!(judge(2, &good), Ok(()));
        let said = |emitter, rise| judge(emitter, &rise).unwrap_err();
        assert!(said(1, good).contains("emitter 2 raises channel 3 instead"));
        assert!(said(0, [5; 8]).contains("emitter 1 raises no channel"));
        let leaks = said(2, [0, 61, 1_200, 0, 0, 0, 900, 0]);
        assert!(leaks.contains("emitter 3 raises channel 2 and 7 besides"), "{leaks}");
    }

    #[test]
    fn noise_is_not_reported_as_a_leak_of_a_weak_emitter() {
        assert_eq!(judge(0, &[LEAST_RISE, 8, -9, 7, 0, 0, 0, 0]), Ok(()));
        assert!(judge(0, &[LEAST_RISE, 9, 0, 0, 0, 0, 0, 0]).is_err());
    }
}
