//! The emulated board: what lies in its memory before it starts, and the command that starts it.
//!
//! The other end is the binary `skinproc-emulated` of the firmware, whose `registers.rs` has the
//! same addresses.

use std::ffi::OsString;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::process::Command as Process;

use shared_proto::{BoardId, CHANNELS, Calibration, Command, Packet, crc32};

/// The emulator of an Arm computer.
pub const QEMU: &str = "qemu-system-arm";

/// Time is counted in instructions of 16 ns each and jumps where the core sleeps: a run takes as
/// long as the host needs, and is always the same.
pub const COUNTED_TIME: [&str; 2] = ["-icount", "shift=4,sleep=off"];

/// Names the image that tests run.
pub const IMAGE: &str = "SHELLCAL_EMULATED_IMAGE";

/// The image that tests run, which `cargo xtask test` builds.
///
/// # Panics
/// If there is none.
pub fn image() -> PathBuf {
    std::env::var_os(IMAGE).expect("SHELLCAL_EMULATED_IMAGE names an image").into()
}

/// What the front end plays, what the board is told, and where it keeps its calibration.
const SCRIPT: u32 = 0x2100_0000;
const ORDERS: u32 = 0x2170_0000;
const STORAGE: u32 = 0x2180_0000;

/// The serial number of the emulated board.
const SERIAL: [u8; 12] = *b"mps2-an386  ";

/// Dark and lit code of every channel.
pub type PlayedFrame = [(u16, u16); CHANNELS];

/// What lies in the board's memory before it starts.
#[derive(Clone, Debug, Default)]
pub struct Memory {
    areas: Vec<(u32, Vec<u8>)>,
}

impl Memory {
    /// Nothing but the image.
    pub fn new() -> Self {
        Self::default()
    }

    /// The frames that the front end plays, over and over.
    #[must_use]
    pub fn play(self, frames: &[PlayedFrame]) -> Self {
        let codes = frames.iter().flatten().flat_map(|(dark, lit)| [dark, lit]);
        let codes = codes.flat_map(|code| code.to_le_bytes());
        let count = frames.len() as u32;
        self.bytes(SCRIPT, count.to_le_bytes().into_iter().chain(codes).collect())
    }

    /// Commands that the board finds received, and the number of the frame that it resets itself
    /// after.
    #[must_use]
    pub fn order(self, commands: &[Command], last_frame: u32) -> Self {
        let frames = (1..).zip(commands).map(|(number, &command)| {
            let packet = Packet::Command { number, to: Some(BoardId::of_serial(&SERIAL)), command };
            packet.encode().to_vec()
        });
        let bytes: Vec<u8> = frames.flatten().collect();
        let head = [last_frame.to_le_bytes(), (bytes.len() as u32).to_le_bytes()];
        self.bytes(ORDERS, head.concat().into_iter().chain(bytes).collect())
    }

    /// A calibration that was uploaded earlier.
    #[must_use]
    pub fn keep(self, calibration: &Calibration) -> Self {
        let bytes = calibration.to_bytes();
        // The firmware's record: how many bytes, their CRC-32, the bytes.
        let head = [bytes.len() as u32, crc32(&bytes)].map(u32::to_le_bytes).concat();
        self.bytes(STORAGE, [&head[..], &bytes].concat())
    }

    /// Any bytes at any address.
    #[must_use]
    pub fn bytes(mut self, address: u32, bytes: Vec<u8>) -> Self {
        self.areas.push((address, bytes));
        self
    }

    /// The command that starts the board, up to its serial port and how time passes. What lies in
    /// memory is handed over in files in `dir`.
    ///
    /// # Errors
    /// What the system says of the files.
    pub fn start(&self, image: &Path, dir: &Path) -> io::Result<Process> {
        let mut qemu = Process::new(QEMU);
        qemu.args(["-M", "mps2-an386", "-display", "none", "-monitor", "none"]);
        // The image tells of a panic by semihosting.
        qemu.args(["-semihosting-config", "enable=on,target=native"]);
        for (address, bytes) in &self.areas {
            let file = dir.join(format!("{address:08x}.bin"));
            fs::write(&file, bytes)?;
            let mut loader = OsString::from("loader,force-raw=on,file=");
            loader.push(&file);
            loader.push(format!(",addr={address:#x}"));
            qemu.arg("-device").arg(loader);
        }
        qemu.arg("-kernel").arg(image);
        Ok(qemu)
    }
}
