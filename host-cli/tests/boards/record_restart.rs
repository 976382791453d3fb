//! `record --start` at a board that resets meanwhile.

use std::fs;
use std::io::{Read, Write};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use serialport::{SerialPort, TTYPort};
use shared_proto::{
    Answer, Board, BoardId, Boot, Command, Decoder, Event, Framing, Identity, Packet, PacketOrigin,
    ResetCause, Sample, Status, Stream, Values,
};
use system_tests::program::{finish, interrupt, succeed};

use crate::board::{pty, start_before_the_port};
use crate::recording::column;

const SERIAL: [u8; 12] = *b"restart-test";

/// Programs of other tests may inherit the board's end: a pulled cable is noticed when the last has ended.
const PATIENCE: Duration = Duration::from_secs(600);

/// Status after a reset.
const FRESH: Status = Status {
    streaming: false,
    calibrated: false,
    zeroed: false,
    stream: Stream::Raw,
    reset_cause: ResetCause::Power,
    period_us: 10_000,
    conversions: 8,
    settling_us: 100,
    uptime_s: 0,
    frames: 0,
    late: 0,
    overflowed: 0,
    damaged: 0,
    longest_frame_us: 0,
    calibration_crc32: 0,
    foreign: 0,
};

struct ResettingBoard {
    port: TTYPort,
    decoder: Decoder,
    start: u16,
    status: Status,
    began: Instant,
    sent: u64,
}

impl ResettingBoard {
    fn new(port: TTYPort) -> Self {
        let status = Status { period_us: 20_000, settling_us: 70, ..FRESH };
        let decoder = Decoder::new(Framing::Cobs);
        Self { port, decoder, start: 1, status, began: Instant::now(), sent: 0 }
    }

    /// Resets all settings. The announcement of the start is lost unless `is_announced`.
    fn reset(&mut self, is_announced: bool) {
        (self.start, self.status, self.sent) = (self.start + 1, FRESH, 0);
        self.began = Instant::now();
        if is_announced {
            let cause = ResetCause::Power;
            self.send(Packet::Boot(Boot { board: Board::Simulated, firmware: [0, 1, 0], cause }));
        }
    }

    fn send(&mut self, packet: Packet) {
        let origin =
            PacketOrigin { board: BoardId::from_serial(&SERIAL).short(), start: self.start };
        let _ = self.port.write_all(&packet.encode_from(origin));
    }

    fn answer(&mut self, command: Command) -> Answer {
        match command {
            Command::Identify => {
                return Answer::Identity(Identity {
                    board: Board::Simulated,
                    firmware: [0, 1, 0],
                    serial: SERIAL,
                    min_period_us: 1_000,
                });
            }
            Command::Status => return Answer::Status(self.status),
            Command::Start if !self.status.streaming => {
                (self.status.streaming, self.began) = (true, Instant::now());
            }
            Command::Stop => self.status.streaming = false,
            Command::SetPeriod { period_us } => self.status.period_us = period_us,
            Command::SetSettling { settling_us } => self.status.settling_us = settling_us,
            _ => {}
        }
        Answer::Done
    }

    fn go_on(&mut self) {
        let (mut buffer, mut asked) = ([0; 256], Vec::new());
        let count = self.port.read(&mut buffer).unwrap_or(0);
        self.decoder.feed(&buffer[..count], |event| {
            if let Event::Packet(received) = event
                && let Packet::Command { number, command, .. } = received.packet
            {
                asked.push((number, command));
            }
        });
        for (number, command) in asked {
            let answer = self.answer(command);
            self.send(Packet::Answer { number, answer });
        }
        let period_us = u64::from(self.status.period_us);
        let due = self.began.elapsed().as_micros() as u64 / period_us;
        while self.status.streaming && self.sent < due {
            let values = Values::Readings([16_000 + self.start; 8]);
            let clock_us = (4_000 + self.sent * period_us) as u32;
            let sequence = self.sent as u16;
            self.send(Packet::Sample(Sample {
                sequence,
                clock_us,
                values,
                saturated: 0,
                dropped: 0,
            }));
            self.sent += 1;
        }
    }
}

#[derive(Clone, Copy, PartialEq)]
enum Loss {
    Announced,
    Silent,
    /// The cable, by which it is powered, is pulled and put back.
    Unplugged,
}

fn plug(link: &Path) -> TTYPort {
    let (mut port, name) = pty();
    port.set_timeout(Duration::from_millis(2)).unwrap();
    _ = fs::remove_file(link);
    std::os::unix::fs::symlink(name, link).unwrap();
    port
}

#[test]
fn a_board_that_resets_is_restarted_with_its_settings() {
    for loss in [Loss::Announced, Loss::Silent, Loss::Unplugged] {
        let dir = tempfile::tempdir().unwrap();
        let link = dir.path().join("adapter");
        let arguments = "--json record adapter --start --reconnect -o log.csv --raw raw";
        let child = start_before_the_port(dir.path(), arguments);
        let port = plug(&link);
        let end = Arc::new(AtomicBool::new(false));
        let ended = Arc::clone(&end);
        let gone = Arc::new(AtomicBool::new(false));
        let host_is_gone = Arc::clone(&gone);
        let board = thread::spawn(move || {
            let mut board = ResettingBoard::new(port);
            // The last commands to the board may be lost with the port.
            while !host_is_gone.load(Ordering::Relaxed) {
                board.go_on();
                // The host asks for the board's state after 0.4 s and keeps the answer 0.4 s later.
                if board.start == 1 && board.sent > 150 {
                    if loss == Loss::Unplugged {
                        board.port = plug(&link);
                    }
                    board.reset(loss == Loss::Announced);
                }
                if board.start == 2 && board.sent > 50 {
                    ended.store(true, Ordering::Relaxed);
                }
                if ended.load(Ordering::Relaxed) && !board.status.streaming {
                    return board.status;
                }
            }
            board.status
        });
        let began = Instant::now();
        while !end.load(Ordering::Relaxed) && began.elapsed() < PATIENCE {
            thread::sleep(Duration::from_millis(20));
        }
        interrupt(&child);
        let said = finish(child, arguments, 0);
        gone.store(true, Ordering::Relaxed);
        let status = board.join().unwrap();
        assert_eq!((status.period_us, status.settling_us), (20_000, 70), "{said}");
        let said: serde_json::Value = serde_json::from_str(&said).unwrap();
        assert_eq!(said["restarts"], 1, "{said}");
        assert_eq!(said["reconnections"], u64::from(loss == Loss::Unplugged), "{said}");
        let path = dir.path().join("log.csv");
        let (flags, missing) = (column(&path, "flags"), column(&path, "missing"));
        let restarts: Vec<usize> =
            (0..flags.len()).filter(|&row| flags[row].contains("restart")).collect();
        let [restart] = restarts[..] else { panic!("{restarts:?}") };
        assert!(flags.len() - restart >= 40, "{} rows after the restart", flags.len() - restart);
        // The gap is at least as long as the restart takes, and contains no frame.
        let times: Vec<f64> = column(&path, "t_s").iter().map(|t| t.parse().unwrap()).collect();
        assert!(times.is_sorted());
        let gap_frames = (times[restart] - times[restart - 1]) / 0.02;
        let missing: f64 = missing[restart].parse().unwrap();
        assert!((gap_frames - 1.0 - missing).abs() <= 1.0, "{gap_frames} {missing}");
        // The times of the bytes tell the length of the gap.
        succeed(dir.path(), "record --replay raw -o again.csv");
        let log = |name| fs::read_to_string(dir.path().join(name)).unwrap();
        assert_eq!(log("log.csv"), log("again.csv"));
    }
}
