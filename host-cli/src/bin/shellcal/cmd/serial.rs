//! Arguments for a serial port, shared by the commands that talk to a board.

use std::time::{SystemTime, UNIX_EPOCH};

use anyhow::Context;
use board_link::{FlowControl, PortOptions, Uplink};
use shared_proto::{Framing, Protocol};

use super::choices::one_of;

/// How to open a port
#[derive(Debug, clap::Args)]
pub(crate) struct SerialArgs {
    /// Bits per second
    #[arg(long, value_name = "BAUD", default_value_t = 57_600, value_parser = clap::value_parser!(u32).range(50..))]
    pub(crate) baud: u32,

    /// Who may hold up whom
    #[arg(long, value_name = "KIND", value_parser = one_of(&FLOWS), default_value = "none")]
    pub(crate) flow_control: FlowControl,

    /// Address of the board's XBee, for a base station in API mode
    #[arg(long, value_name = "ADDRESS", default_value = "0xFFFF", value_parser = parse_address)]
    pub(crate) to: u16,
}

/// Who may hold up whom.
const FLOWS: [(&str, &str, FlowControl); 3] = [
    ("none", "None", FlowControl::None),
    ("hardware", "RTS/CTS", FlowControl::Hardware),
    ("software", "XON/XOFF", FlowControl::Software),
];

impl SerialArgs {
    pub(crate) fn port(&self, port: &str) -> PortOptions {
        PortOptions { port: port.to_owned(), baud: self.baud, flow_control: self.flow_control }
    }

    /// The way to the board on which it is told to start.
    pub(crate) fn uplink(&self, protocol: Option<Protocol>) -> anyhow::Result<Uplink> {
        let framing = protocol.map_or(Some(Framing::Cobs), Protocol::framing);
        let framing = framing.context("`--start` is not for the original board")?;
        Ok(Uplink { framing, to: self.to })
    }
}

/// A number for the first command to a board. It differs from run to run, so that a late answer to another run is
/// not taken for one of ours.
pub(crate) fn first_number() -> u16 {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    (now.as_millis() / 10) as u16
}

fn parse_address(text: &str) -> Result<u16, String> {
    let parsed = match text.strip_prefix("0x").or_else(|| text.strip_prefix("0X")) {
        Some(digits) => u16::from_str_radix(digits, 16),
        None => text.parse(),
    };
    parsed.map_err(|error| format!("{error}; an address is 0x0000 to 0xFFFF"))
}
