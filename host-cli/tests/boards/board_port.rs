//! `shellcal board` over a pty, with fake boards.

use std::io::{Read, Write};
use std::panic::{RefUnwindSafe, catch_unwind, resume_unwind};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use serialport::TTYPort;
use shared_proto::{
    Answer, Board, BoardId, Calibration, Command, Decoder, Event, Framing, Identity, Packet,
    Refusal, ResetCause, Status, Stream, crc32,
};
use system_tests::program::{refused, succeed};

use crate::board::pty;
use crate::recording::{assert_rows_are, calibration, frame, read_log};

fn serve(
    mut port: TTYPort,
    stopped: &AtomicBool,
    mut obey: impl FnMut(u16, Option<BoardId>, Command) -> Vec<u8>,
) {
    let (mut decoder, mut buffer) = (Decoder::new(Framing::Cobs), [0; 256]);
    while !stopped.load(Ordering::Relaxed) {
        let Ok(count) = port.read(&mut buffer) else {
            thread::sleep(Duration::from_millis(1));
            continue;
        };
        let mut replies = Vec::new();
        decoder.feed(&buffer[..count], |event| {
            let Event::Packet(received) = event else { return };
            let Packet::Command { number, to, command } = received.packet else { return };
            replies.extend(obey(number, to, command));
        });
        let _ = port.write_all(&replies);
    }
}

/// A board that hears only every second frame, and streams noise and old answers between.
struct FakeBoard {
    stop: Arc<AtomicBool>,
    heard: Arc<Mutex<Vec<Command>>>,
    thread: JoinHandle<()>,
}

impl FakeBoard {
    fn start(port: TTYPort, deaf: bool, keeps: bool) -> Self {
        let (stop, heard) = (Arc::new(AtomicBool::new(false)), Arc::new(Mutex::new(Vec::new())));
        let (stopped, commands) = (Arc::clone(&stop), Arc::clone(&heard));
        let thread = thread::spawn(move || {
            let (mut upload, mut crc, mut arrivals) = (Vec::new(), 0, 0);
            let (mut last, mut reply) = (None, Answer::Done);
            serve(port, &stopped, |number, to, command| {
                let ours = to.map_or(command.is_for_all(), |to| to == id());
                assert!(ours, "{command:?} does not name the board");
                arrivals += 1;
                if deaf || arrivals % 2 == 1 {
                    return Vec::new();
                }
                // A repeat of a command that was answered too late is answered again.
                if last != Some(number) {
                    last = Some(number);
                    commands.lock().unwrap().push(command);
                    reply = answer(&command, &mut upload, &mut crc, keeps);
                }
                let stale = Answer::Refused(Refusal::OutOfRange);
                let stale = Packet::Answer { number: number.wrapping_sub(1), answer: stale };
                let replies = [stale, Packet::Answer { number, answer: reply }];
                let bytes = replies.iter().flat_map(|packet| [frame(7), packet.encode().to_vec()]);
                bytes.collect::<Vec<_>>().concat()
            });
        });
        Self { stop, heard, thread }
    }

    fn stop(self) -> Vec<Command> {
        self.stop.store(true, Ordering::Relaxed);
        self.thread.join().unwrap();
        std::mem::take(&mut *self.heard.lock().unwrap())
    }
}

/// Repeats a scenario, up to five times, if a busy machine holds the fake board up for longer than
/// the program waits for an answer, two seconds in all.
fn where_the_board_is_not_held_up(scenario: impl Fn() + RefUnwindSafe) {
    for run in 1.. {
        let Err(panic) = catch_unwind(&scenario) else { return };
        let is_held_up =
            panic.downcast_ref::<String>().is_some_and(|it| it.contains("no answer to"));
        if run == 5 || !is_held_up {
            resume_unwind(panic);
        }
    }
}

const SERIAL: [u8; 12] = *b"serialnumber";

fn id() -> BoardId {
    BoardId::from_serial(&SERIAL)
}

fn answer(command: &Command, upload: &mut Vec<u8>, crc: &mut u32, keeps: bool) -> Answer {
    match command {
        Command::Identify => Answer::Identity(Identity {
            board: Board::Simulated,
            firmware: [1, 2, 3],
            serial: SERIAL,
            min_period_us: 1000,
        }),
        Command::Status => Answer::Status(Status {
            streaming: true,
            calibrated: *crc != 0,
            zeroed: false,
            stream: Stream::Raw,
            reset_cause: ResetCause::Watchdog,
            period_us: 10_000,
            conversions: 16,
            settling_us: 200,
            uptime_s: 12,
            frames: 1234,
            late: 1,
            overflowed: 2,
            damaged: 3,
            longest_frame_us: 4567,
            calibration_crc32: *crc,
            foreign: 4,
        }),
        Command::SetPeriod { period_us } if *period_us < 1000 => {
            Answer::Refused(Refusal::PeriodTooShort { shortest_us: 3_000 })
        }
        // Firmware older than the physics model accepts only calibrations with powers, which have this size.
        Command::BeginCalibration { size, .. } if *size != 668 => {
            Answer::Refused(Refusal::WrongSize)
        }
        Command::CalibrationPiece { offset, data } => {
            upload.truncate(usize::from(*offset));
            upload.extend_from_slice(data);
            Answer::Done
        }
        Command::CommitCalibration => {
            *crc = if keeps { crc32(upload) } else { 1 };
            Answer::Done
        }
        _ => Answer::Done,
    }
}

#[test]
fn commands_are_repeated_until_they_are_answered() {
    where_the_board_is_not_held_up(|| {
        let dir = tempfile::tempdir().unwrap();
        let (port, name) = pty();
        let board = FakeBoard::start(port, false, true);
        let said = succeed(dir.path(), &format!("board {name} identify"));
        assert!(said.contains("simulated") && said.contains("1.2.3") && said.contains("1000 Hz"));
        let said = succeed(dir.path(), &format!("board {name} status"));
        assert!(said.contains("streams readings at 100 Hz") && said.contains("watchdog"), "{said}");
        let said = succeed(dir.path(), &format!("--json board {name} status"));
        let said: serde_json::Value = serde_json::from_str(&said).unwrap();
        assert_eq!((&said["frames"], &said["rate_hz"]), (&1234.into(), &100.0.into()));
        let sampling = "sampling --conversions 8 --settling 30";
        for order in ["start", "stop", "rate 250", sampling, "mode wrench", "zero --frames 20"] {
            succeed(dir.path(), &format!("board {name} {order}"));
        }
        let error = refused(dir.path(), &format!("board {name} rate 2000"));
        assert!(error.contains("refuses `period 500 µs`: conversions and settling"), "{error}");
        assert!(error.contains("333.3 Hz would do"), "{error}");
        let mut heard = board.stop();
        // Commands that change the board ask for its name first.
        assert_eq!(heard.iter().filter(|command| **command == Command::Identify).count(), 6);
        heard.retain(|command| *command != Command::Identify);
        let expected = [
            Command::Status,
            Command::Status,
            Command::Start,
            Command::Stop,
            Command::SetPeriod { period_us: 4000 },
            Command::SetOversampling { conversions: 8 },
            Command::SetSettling { settling_us: 30 },
            Command::SetStream(Stream::Wrench),
            Command::Zero { frames: 20 },
            Command::SetPeriod { period_us: 500 },
        ];
        assert_eq!(heard, expected);
    });
}

#[test]
fn start_is_sent_until_the_board_streams_and_stop_at_the_end() {
    let dir = tempfile::tempdir().unwrap();
    let (port, name) = pty();
    // While no program has the line open, the board's end reports it dead, even with unread bytes.
    let _open = std::fs::File::open(&name).unwrap();
    // It hears every second command: the second start and the second stop.
    let board = FakeBoard::start(port, false, true);
    succeed(dir.path(), &format!("record {name} -o log.csv --duration 1.5 --start"));
    let deadline = Instant::now() + Duration::from_secs(20);
    while !board.heard.lock().unwrap().contains(&Command::Stop) {
        assert!(Instant::now() < deadline, "it is not told to stop");
        thread::sleep(Duration::from_millis(5));
    }
    let mut heard = board.stop();
    heard.dedup();
    assert_eq!(heard, [Command::Start, Command::Stop]);
    assert_rows_are(&read_log(&dir.path().join("log.csv")).unwrap(), [7]);
}

#[test]
fn an_upload_arrives_whole_and_is_checked() {
    where_the_board_is_not_held_up(|| {
        let dir = tempfile::tempdir().unwrap();
        calibration(dir.path());
        let (port, name) = pty();
        let board = FakeBoard::start(port, false, true);
        succeed(dir.path(), &format!("board {name} upload cal.json"));
        let heard = board.stop();
        let pieces = heard.iter().filter_map(|command| match command {
            Command::CalibrationPiece { data, .. } => Some(data.to_vec()),
            _ => None,
        });
        let bytes: Vec<u8> = pieces.flatten().collect();
        let Some(Calibration::Cubic(uploaded)) = Calibration::from_bytes(&bytes) else { panic!() };
        assert!(uploaded.centre.iter().all(|&centre| (1.0..65_536.0).contains(&centre)));
        let begin = Command::BeginCalibration { size: bytes.len() as u32, crc32: crc32(&bytes) };
        assert_eq!(heard[..2], [Command::Identify, begin]);

        let (port, name) = pty();
        let board = FakeBoard::start(port, false, false);
        let error = refused(dir.path(), &format!("board {name} upload cal.json"));
        assert!(error.contains("after the upload the board has calibration 0x00000001"), "{error}");
        board.stop();
    });
}

#[test]
fn commands_to_two_boards_need_a_serial_number() {
    where_the_board_is_not_held_up(|| {
        let dir = tempfile::tempdir().unwrap();
        let other = *b"another one.";
        let (port, name) = pty();
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = Arc::clone(&stop);
        // Both boards answer a query; a command with a serial number is answered only by that board.
        let thread = thread::spawn(move || {
            let mut orders = Vec::new();
            serve(port, &stopped, |number, to, command| {
                let mut replies = Vec::new();
                for serial in [SERIAL, other] {
                    let is_ours = to.is_none_or(|to| to == BoardId::from_serial(&serial));
                    if !is_ours {
                        continue;
                    }
                    let answer = match answer(&command, &mut Vec::new(), &mut 0, true) {
                        Answer::Identity(identity) => {
                            Answer::Identity(Identity { serial, ..identity })
                        }
                        answer => answer,
                    };
                    if !command.is_for_all() {
                        orders.push((serial, command));
                    }
                    replies.extend_from_slice(&Packet::Answer { number, answer }.encode());
                }
                replies
            });
            orders
        });
        let error = refused(dir.path(), &format!("board {name} rate 250"));
        assert!(error.contains("2 boards answer") && error.contains("--board SERIAL"), "{error}");
        let serial: String = other.iter().map(|byte| format!("{byte:02x}")).collect();
        assert!(error.contains(&serial), "{error}");
        succeed(dir.path(), &format!("board {name} --board {serial} rate 250"));
        stop.store(true, Ordering::Relaxed);
        let mut orders = thread.join().unwrap();
        orders.dedup();
        assert_eq!(orders, [(other, Command::SetPeriod { period_us: 4000 })]);
    });
}

#[test]
fn a_deaf_board_and_a_calibration_not_for_it_are_errors() {
    let dir = tempfile::tempdir().unwrap();
    calibration(dir.path());
    succeed(dir.path(), "fit training.csv --model quadratic --output quadratic.json");
    let (port, name) = pty();
    let board = FakeBoard::start(port, true, true);
    let error = refused(dir.path(), &format!("board {name} identify"));
    assert!(error.contains("no answer to `identify`") && error.contains("not a byte"), "{error}");
    let error = refused(dir.path(), &format!("board {name} upload quadratic.json"));
    assert!(error.contains("`quadratic`") && error.contains("--model cubic"), "{error}");
    board.stop();
}

#[test]
fn firmware_from_before_the_physics_model_is_named() {
    where_the_board_is_not_held_up(|| {
        let dir = tempfile::tempdir().unwrap();
        let data =
            Path::new(env!("CARGO_MANIFEST_DIR")).join("../calibration-data/synthetic-train.csv");
        succeed(dir.path(), &format!("fit {} --model physics -o cal.json", data.display()));
        let (port, name) = pty();
        let board = FakeBoard::start(port, false, true);
        let error = refused(dir.path(), &format!("board {name} upload cal.json"));
        assert!(error.contains("does not know calibrations of kind `physics`"), "{error}");
        assert!(error.contains("flash the firmware"), "{error}");
        board.stop();
    });
}
