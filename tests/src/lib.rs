//! What tests across the crates share: the emulated board, a browser, running `shellcal`, packets as a host
//! receives them, and where the real recordings are.

pub mod browser;
pub mod emulation;
pub mod flashed;
pub mod program;
pub mod random;

use std::path::PathBuf;

use shared_proto::xbee::{Address, ApiFrame};
use shared_proto::{Framing, Packet};

/// The file `name` of the real recordings; where this machine has none, says that the test was
/// skipped.
///
/// The recordings are not part of the repository: `SHELLCAL_REAL_DATA` names the directory that
/// holds them.
#[expect(clippy::print_stdout, reason = "a skipped test says so")]
pub fn real_recording(name: &str) -> Option<PathBuf> {
    let path = std::env::var_os("SHELLCAL_REAL_DATA").map(|root| PathBuf::from(root).join(name));
    let path = path.filter(|path| path.exists());
    if path.is_none() {
        println!("skipped: SHELLCAL_REAL_DATA does not name a directory with `{name}`");
    }
    path
}

/// The bytes of a packet as the base station gives them to the host.
///
/// # Panics
/// Never: every packet fits into a frame.
pub fn on_the_wire(packet: &Packet, framing: Framing) -> Vec<u8> {
    let payload = packet.encode();
    match framing {
        Framing::Cobs => payload.to_vec(),
        Framing::Xbee(mode) => {
            let from = Address::Short(0x2052);
            let frame = ApiFrame::Receive { from, rssi: Some(40), payload: &payload };
            frame.encode(mode).expect("a packet fits into a frame").to_vec()
        }
    }
}
