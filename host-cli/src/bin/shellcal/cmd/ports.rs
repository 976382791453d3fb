//! Serial ports: a list of this computer's ports, their names on the command line, and the options for opening one.

use std::path::Path;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use anyhow::Context;
use board_link::recording::PROTOCOLS;
use board_link::{EVERY_MODULE, FlowControl, PortOptions, RecordOptions, TCP, Uplink, ports};
use frame_stream::{Destination, NetFtAddress};
use shared_proto::xbee::Address;
use shared_proto::{Framing, Protocol};

use super::choices::one_of;
use crate::printer::Printer;

pub(super) fn list(printer: &Printer) -> anyhow::Result<()> {
    let ports = ports()?;
    printer.finish(&ports, |printer| {
        if ports.is_empty() {
            printer.note("no serial ports; is the adapter plugged in?");
        }
        ports.iter().for_each(|port| {
            let serial = port.serial.as_deref().map(|serial| format!("serial {serial}"));
            let description = (!port.description.is_empty()).then(|| port.description.clone());
            let parts = [Some(port.port.clone()), Some(port.kind.to_owned()), description, serial];
            printer.line(parts.into_iter().flatten().collect::<Vec<_>>().join("  "));
        });
    })
}

/// True if a name is the name of a port, existing or not.
pub(super) fn is_port(path: &Path) -> bool {
    if let Ok(metadata) = std::fs::metadata(path) {
        return is_device(&metadata);
    }
    let text = path.to_string_lossy();
    let is_com = text.strip_prefix("COM").is_some_and(|rest| rest.parse::<u16>().is_ok());
    is_com || text.starts_with("/dev/") || text.starts_with(TCP)
}

#[cfg(unix)]
fn is_device(metadata: &std::fs::Metadata) -> bool {
    use std::os::unix::fs::FileTypeExt;
    metadata.file_type().is_char_device()
}

#[cfg(not(unix))]
fn is_device(metadata: &std::fs::Metadata) -> bool {
    !metadata.is_file() && !metadata.is_dir()
}

/// How to open a port
#[derive(Debug, clap::Args)]
pub(crate) struct SerialArgs {
    /// Bits per second
    #[arg(long, value_name = "BAUD", default_value_t = 57_600, value_parser = clap::value_parser!(u32).range(50..))]
    pub(crate) baud: u32,

    /// Handshake that lets one end pause the other
    #[arg(long, value_name = "KIND", value_parser = one_of(&FLOWS), default_value = "none")]
    pub(crate) flow_control: FlowControl,

    /// Framing of bytes by the base station [default: detected; for commands: cobs]
    #[arg(long, value_name = "FRAMING", value_parser = one_of(&PROTOCOLS))]
    pub(crate) framing: Option<Protocol>,

    /// Address of the board's XBee, for a base station in API mode: 0x0000 to 0xFFFF, or the 16 digits of its
    /// serial number; of `stream` also `netft[:PORT]`, which is `--output netft[:PORT]` without the standard
    /// output
    #[arg(long, value_name = "ADDRESS", default_value = "0xFFFF", value_parser = parse_recipient)]
    pub(crate) to: Recipient,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Recipient {
    Board(Address),
    NetFt(NetFtAddress),
}

const FLOWS: [(&str, &str, FlowControl); 3] = [
    ("none", "None", FlowControl::None),
    ("hardware", "RTS/CTS", FlowControl::Hardware),
    ("software", "XON/XOFF", FlowControl::Software),
];

impl SerialArgs {
    pub(crate) fn port(&self, port: &str) -> PortOptions {
        PortOptions { port: port.to_owned(), baud: self.baud, flow_control: self.flow_control }
    }

    /// The uplink for commands to a board; `None` for the original board, which takes none from this program.
    pub(crate) fn uplink(&self) -> Option<Uplink> {
        let framing = self.framing.map_or(Some(Framing::Cobs), Protocol::framing)?;
        Some(Uplink { framing, to: self.address() })
    }

    /// The address of the board's module; all boards where `--to` names none.
    pub(crate) fn address(&self) -> Address {
        match self.to {
            Recipient::Board(address) => address,
            Recipient::NetFt(_) => EVERY_MODULE,
        }
    }

    /// Refuses recipients that only `stream` supports. Fails if `--to` names no board.
    pub(crate) fn expect_board(&self) -> anyhow::Result<()> {
        let is_board = matches!(self.to, Recipient::Board(_));
        anyhow::ensure!(
            is_board,
            "`--to netft` is for `shellcal stream`; here `--to` is the address of a board"
        );
        Ok(())
    }
}

/// A recording from a port
#[derive(Debug, clap::Args)]
pub(crate) struct SourceArgs {
    /// Tell the board to start streaming, and to stop at the end
    #[arg(long)]
    start: bool,

    /// End after this many seconds
    #[arg(long, value_name = "S", value_parser = parse_duration)]
    pub(crate) duration: Option<Duration>,

    #[command(flatten)]
    pub(crate) serial: SerialArgs,
}

impl SourceArgs {
    pub(crate) fn options(&self) -> anyhow::Result<RecordOptions> {
        let uplink = || self.serial.uplink().context("`--start` is not for the original board");
        Ok(RecordOptions {
            protocol: self.serial.framing,
            duration: self.duration,
            start: self.start.then(uplink).transpose()?,
            ..RecordOptions::default()
        })
    }
}

/// The number of the first command to a board. It differs between runs, so that a late answer to another run
/// is not taken for one to this run.
pub(crate) fn first_number() -> u16 {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    (now.as_millis() / 10) as u16
}

fn parse_recipient(text: &str) -> Result<Recipient, String> {
    if text.starts_with("netft") {
        return match text.parse() {
            Ok(Destination::NetFt(address)) => Ok(Recipient::NetFt(address)),
            Ok(_) => Err("of programs there is `netft` and `netft:PORT`".to_owned()),
            Err(bad) => Err(bad.to_string()),
        };
    }
    parse_address(text).map(Recipient::Board)
}

fn parse_address(text: &str) -> Result<Address, String> {
    let digits = text.strip_prefix("0x").or_else(|| text.strip_prefix("0X"));
    let parsed = match digits.unwrap_or(text) {
        // Serial numbers are printed without a prefix.
        serial if serial.len() == 16 => u64::from_str_radix(serial, 16).map(Address::Long),
        short if digits.is_some() => u16::from_str_radix(short, 16).map(Address::Short),
        short => short.parse().map(Address::Short),
    };
    let wrong = "an address is 0x0000 to 0xFFFF, or a serial number: 0013A20040522BAA";
    parsed.map_err(|error| format!("{error}; {wrong}"))
}

pub(crate) fn parse_duration(text: &str) -> Result<Duration, &'static str> {
    let seconds = text.parse().map_err(|_| "a time in s, such as 90")?;
    let duration = Duration::try_from_secs_f64(seconds).ok();
    duration.filter(|duration| !duration.is_zero()).ok_or("a time in s above 0")
}
