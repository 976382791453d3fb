//! The link to a board: serial ports, recording, and commands.
//!
//! [`record()`] reads bytes from a [`Source`] (a port, or a file of raw bytes) into a log, through
//! a [`Recorder`], which needs neither port nor clock, and [`crate::recording`]. [`Client`] sends
//! commands and waits for the board's answers. Ports are opened for exclusive use, so only one of
//! the two can have a port at a time.

#![allow(clippy::disallowed_methods, clippy::disallowed_types, reason = "opens ports, keeps time")]

mod append_writer;
mod board_log;
mod capture;
mod client;
mod handshake;
mod port;
mod record;
mod record_options;
mod recorder;
pub mod recording;
mod resume;
mod upload;

pub use append_writer::{AppendWriter, LogSink, open_growing};
pub use board_log::RecordedBoard;
pub use capture::CaptureReader;
pub use client::{Client, EVERY_MODULE, Uplink, judge};
pub use handshake::{Handshake, HandshakeOptions, Heard, StreamPart, handshake};
pub use port::{Connection, FlowControl, PortInfo, PortOptions, PortState, TCP, ports};
pub use record::{Source, record};
pub use record_options::{RecordCommand, RecordError, RecordOptions, RecordingProgress, Watcher};
pub use recorder::{Recorded, Recorder, Sinks};
pub use upload::{NotForBoard, for_board};

use shared_proto::{Board, Command, Refusal};
use shell_data::hint::Hint;

/// Errors of a link. System errors are stored as text: a lost board must not look like a closed output pipe, a normal
/// end.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LinkError {
    #[error("there is no port `{0}`")]
    Missing(String),
    #[error("port `{0}` is in use by another program")]
    Busy(String),
    #[error("no permission to open port `{0}`")]
    Denied(String),
    #[error("cannot open port `{port}`: {reason}")]
    Open { port: String, reason: String },
    /// The port was lost, usually unplugged.
    #[error("port `{port}` is gone: {reason}")]
    Lost { port: String, reason: String },
    #[error("cannot read `{path}`: {reason}")]
    Replay { path: String, reason: String },
    /// A command had no answer in all attempts; if `silent`, not a single byte arrived.
    #[error(
        "no answer to `{}` on `{port}` ({} attempts, {} ms each{})",
        client::name_of(command), client::ATTEMPTS, client::WAIT.as_millis(), if *silent { ", not a byte" } else { "" }
    )]
    NoAnswer { port: String, command: Command, silent: bool },
    #[error(
        "the board refuses `{}`: {}{}",
        client::name_of(command), refusal_text(*refusal), client::what_fits(command, *refusal)
    )]
    Refused { command: Command, refusal: Refusal },
    #[error(
        "the board speaks version `{0}` of the protocol, this program version `{VERSION}`",
        VERSION = shared_proto::VERSION
    )]
    OtherVersion(u8),
    #[error("{} boards answer on `{port}`: {}", serials.len(), serials.iter().map(serial_text).collect::<Vec<_>>().join(", "))]
    SeveralBoards { port: String, serials: Vec<[u8; 12]> },
    #[error("the board's answer to `{}` is not one to it", client::name_of(_0))]
    WrongAnswer(Command),
    #[error("the board's firmware does not know calibrations of kind `{0}`")]
    UnknownKind(&'static str),
    #[error("after the upload the board has calibration {found:#010x}, sent was {sent:#010x}")]
    NotKept { sent: u32, found: u32 },
}

impl LinkError {
    fn lost(port: &str, error: &std::io::Error) -> Self {
        Self::Lost { port: port.to_owned(), reason: error.to_string() }
    }
}

impl Hint for LinkError {
    fn hint(&self) -> Option<String> {
        let text = match self {
            Self::Missing { .. } => "`shellcal board` lists the ports there are",
            Self::Busy { .. } => "close the program that has it: a terminal, another recording",
            Self::Denied { .. } => {
                "on Linux, join the group that owns the port, as a rule `dialout`, and log in again"
            }
            Self::Lost { .. } => {
                "what arrived until then is kept; with `--reconnect` the port is waited for"
            }
            Self::NoAnswer { silent: true, .. } => {
                "is the board on? Try another `--baud`, or `--framing xbee-ap1` or `xbee-ap2` for a radio in \
                 API mode"
            }
            Self::NoAnswer { .. } => {
                "try another `--baud`, or `--framing xbee-ap1` or `xbee-ap2` for a radio in API mode"
            }
            Self::OtherVersion { .. } => {
                "flash the firmware that belongs to this version of shellcal"
            }
            Self::Refused { refusal: Refusal::NoCalibration, .. } => {
                "upload one: `shellcal board PORT upload CAL`"
            }
            Self::Refused { refusal: Refusal::PeriodTooShort { .. }, .. } => {
                "choose a lower rate, or fewer conversions and less settling: `shellcal board PORT \
                 sampling`"
            }
            Self::Refused { refusal: Refusal::LineTooSlow { .. }, .. } => {
                "choose a lower rate, or stream readings in place of wrenches"
            }
            Self::Refused { refusal: Refusal::Streaming, .. } => {
                "stop it first: `shellcal board PORT stop`"
            }
            Self::SeveralBoards { .. } => "name one of them with `--board SERIAL`",
            Self::NotKept { .. } => "upload it again",
            Self::UnknownKind { .. } => {
                "flash the firmware of this version of shellcal, or upload a fit with `--model cubic`"
            }
            _ => return None,
        };
        Some(text.to_owned())
    }
}

fn refusal_text(refusal: Refusal) -> &'static str {
    match refusal {
        Refusal::UnknownCommand => "its firmware does not know the command",
        Refusal::OtherVersion => "it speaks another version of the protocol",
        Refusal::OutOfRange => "a value is outside its range",
        Refusal::PeriodTooShort { .. } => "conversions and settling take longer than the period",
        Refusal::LineTooSlow { .. } => "its serial line does not carry so many samples",
        Refusal::NoCalibration => "it has no calibration",
        Refusal::NoUpload => "no upload was begun",
        Refusal::WrongOffset => "a piece is missing",
        Refusal::WrongSize => "that is not the size of a calibration",
        Refusal::WrongCrc => "the CRC does not match",
        Refusal::BadCalibration => "that is not a calibration it can use",
        Refusal::StorageFailed => "its flash did not keep the calibration",
        Refusal::Streaming => "not while it streams",
        Refusal::NotOnThisBoard => "there is nothing on this board that could do it",
        _ => "for a reason that this program does not know",
    }
}

/// Formats a serial number like `shellcal board identify`.
pub fn serial_text(serial: &[u8; 12]) -> String {
    serial.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Formats a board type like `shellcal board identify`.
pub fn board_text(board: Board) -> String {
    match board {
        Board::Other(code) => format!("number {code}, which this program does not know"),
        Board::NucleoG491re => "nucleo-g491re".to_owned(),
        board => format!("{board:?}").to_lowercase(),
    }
}
