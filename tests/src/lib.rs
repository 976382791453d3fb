//! Shared code of the tests across crates.

pub mod browser;
pub mod chromium;
pub mod flashed;
pub mod program;
pub mod random;
pub mod transcript;
pub mod workload;

use std::path::PathBuf;

use shared_proto::xbee::{Address, ApiFrame};
use shared_proto::{Framing, Packet};

/// The reference solution of the beam channel, perhaps in a folder next to the real recordings.
pub const REFERENCE_VALUES: &str = "../oracles/beam.json";

/// Returns the file `name` of the recordings in `SHELLCAL_REAL_DATA`; panics if either is missing.
pub fn real_recording(name: &str) -> PathBuf {
    let root =
        std::env::var_os("SHELLCAL_REAL_DATA").expect("SHELLCAL_REAL_DATA names a directory");
    let path = PathBuf::from(root).join(name);
    assert!(path.exists(), "there is no `{}`", path.display());
    path
}

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
