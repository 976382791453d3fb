//! A bridge between the serial port of the modelled board and a pty for `shellcal`. The model never
//! waits: it produces minutes of samples in seconds, which the bridge stores until `shellcal` has
//! read them. While too much is stored, the emulator is stopped, which the board cannot notice, so
//! no data are lost even if the host stalls for long.

use std::collections::VecDeque;
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::process::{Command, Stdio};
use std::sync::{Arc, Condvar, Mutex};
use std::thread;
use std::time::Duration;

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use serialport::{SerialPort, TTYPort};
use shared_proto::xbee::{Address, ApiFrame, Deframer, Mode};
use system_tests::program::Running;

/// Stored bytes at which the emulator stops, and at which it continues.
const HIGH_WATER: usize = 1 << 14;
const LOW_WATER: usize = 1 << 12;

const RADIO_PACKET: usize = 100;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BaseStation {
    /// A wire, or an XBee in transparent mode.
    Transparent,
    /// The board's own XBee is transparent.
    Api(Mode),
}

pub struct EmulatedBoard {
    _emulator: Running,
    pub port: String,
}

struct Shared {
    emulator: Pid,
    outgoing: Mutex<VecDeque<u8>>,
    arrived: Condvar,
}

impl EmulatedBoard {
    /// Starts an emulator; `command` connects its serial line to an address.
    pub fn start(base: BaseStation, command: impl FnOnce(SocketAddr) -> Command) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let mut command = command(listener.local_addr().unwrap());
        let emulator = command.stdin(Stdio::null()).spawn().expect("the emulator is installed");
        let (serial, _) = listener.accept().unwrap();
        let (mut pty, host) = TTYPort::pair().unwrap();
        pty.set_timeout(Duration::from_millis(20)).unwrap();
        let port = host.name().unwrap();
        let shared = Arc::new(Shared {
            emulator: Pid::from_raw(emulator.id().cast_signed()),
            outgoing: Mutex::default(),
            arrived: Condvar::new(),
        });
        let (from_board, from_host) =
            (serial.try_clone().unwrap(), pty.try_clone_native().unwrap());
        let here = Arc::clone(&shared);
        thread::spawn(move || here.take_from_board(from_board, base));
        thread::spawn(move || shared.give_to_host(pty));
        thread::spawn(move || give_to_board(from_host, serial, base));
        Self { _emulator: Running(emulator), port }
    }
}

impl Shared {
    fn take_from_board(&self, mut serial: TcpStream, base: BaseStation) {
        let mut bytes = [0; 4096];
        while let Ok(count @ 1..) = serial.read(&mut bytes) {
            let bytes = &bytes[..count];
            let mut outgoing = self.outgoing.lock().unwrap();
            match base {
                BaseStation::Transparent => outgoing.extend(bytes),
                BaseStation::Api(mode) => bytes.chunks(RADIO_PACKET).for_each(|payload| {
                    let from = Address::Short(0x2052);
                    let frame = ApiFrame::Receive { from, rssi: Some(40), payload };
                    outgoing.extend(frame.encode(mode).unwrap().iter());
                }),
            }
            if outgoing.len() > HIGH_WATER {
                _ = kill(self.emulator, Signal::SIGSTOP);
            }
            drop(outgoing);
            self.arrived.notify_one();
        }
    }

    /// Retries unread data, which a pty refuses until its other end is open.
    fn give_to_host(&self, mut pty: TTYPort) {
        loop {
            let mut outgoing = self.outgoing.lock().unwrap();
            while outgoing.is_empty() {
                outgoing = self.arrived.wait(outgoing).unwrap();
            }
            let count = outgoing.len().min(512);
            let bytes: Vec<u8> = outgoing.iter().take(count).copied().collect();
            drop(outgoing);
            match pty.write(&bytes) {
                Ok(written) => {
                    let mut outgoing = self.outgoing.lock().unwrap();
                    outgoing.drain(..written);
                    if outgoing.len() < LOW_WATER {
                        _ = kill(self.emulator, Signal::SIGCONT);
                    }
                }
                Err(_) => thread::sleep(Duration::from_millis(2)),
            }
        }
    }
}

fn give_to_board(mut pty: TTYPort, mut serial: TcpStream, base: BaseStation) {
    let mut deframer = match base {
        BaseStation::Transparent => None,
        BaseStation::Api(mode) => Some(Deframer::new(mode)),
    };
    let mut bytes = [0; 256];
    loop {
        let Ok(count) = pty.read(&mut bytes) else {
            thread::sleep(Duration::from_millis(2));
            continue;
        };
        let bytes = &bytes[..count];
        let sent = match &mut deframer {
            None => serial.write_all(bytes),
            Some(deframer) => {
                let mut payloads = Vec::new();
                deframer.feed(bytes, |frame| {
                    if let ApiFrame::Transmit { payload, .. } = frame {
                        payloads.extend_from_slice(payload);
                    }
                });
                serial.write_all(&payloads)
            }
        };
        if sent.is_err() {
            return; // the emulator has ended
        }
    }
}
