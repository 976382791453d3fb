//! `shellcal board PORT baud` and `bootloader`, with a fake and with the simulated board.

use std::io::{Read, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use serialport::SerialPort;
use shared_proto::{Answer, Board, Command, Decoder, Event, Framing, Identity, Packet, Refusal};
use system_tests::program::{self, ended, refused, succeed};

use crate::board::{pty, sound_status};

/// A board whose line has a rate; the wire carries rates up to `fastest`.
struct RatedBoard {
    port: String,
    rate: Arc<AtomicU32>,
    in_bootloader: Arc<AtomicBool>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl RatedBoard {
    fn start(fastest: u32) -> Self {
        let (mut board, port) = pty();
        let (rate, in_bootloader, stop) =
            <(Arc<AtomicU32>, Arc<AtomicBool>, Arc<AtomicBool>)>::default();
        rate.store(57_600, Ordering::Relaxed);
        let (its_rate, booted, stopped) =
            (Arc::clone(&rate), Arc::clone(&in_bootloader), Arc::clone(&stop));
        let thread = thread::spawn(move || {
            let mut decoder = Decoder::new(Framing::Cobs);
            let mut trial: Option<(u32, Instant)> = None;
            let mut buffer = [0; 256];
            while !stopped.load(Ordering::Relaxed) {
                if let Some((old, _)) = trial.take_if(|(_, end)| Instant::now() >= *end) {
                    its_rate.store(old, Ordering::Relaxed);
                }
                let Ok(count) = board.read(&mut buffer) else {
                    thread::sleep(Duration::from_millis(2));
                    continue;
                };
                let rate = its_rate.load(Ordering::Relaxed);
                // A pty carries bytes at any speed; a line does not.
                let is_heard = board.baud_rate().unwrap() == rate && rate <= fastest;
                if !is_heard || booted.load(Ordering::Relaxed) {
                    continue;
                }
                let mut answers = Vec::new();
                decoder.feed(&buffer[..count], |event| {
                    let Event::Packet(received) = event else { return };
                    let Packet::Command { number, command, .. } = received.packet else { return };
                    trial = None;
                    answers.push((number, command));
                });
                for (number, command) in answers {
                    let answer = answer(&command);
                    // Act before answering: the test looks at the effect as soon as the host has the answer.
                    match (command, answer) {
                        (Command::SetBaud { baud }, Answer::Done) => {
                            trial = Some((rate, Instant::now() + Duration::from_secs(3)));
                            its_rate.store(baud, Ordering::Relaxed);
                        }
                        (Command::Bootloader, _) => booted.store(true, Ordering::Relaxed),
                        _ => {}
                    }
                    let _ = board.write_all(&Packet::Answer { number, answer }.encode());
                }
            }
        });
        Self { port, rate, in_bootloader, stop, thread: Some(thread) }
    }

    fn rate(&self) -> u32 {
        self.rate.load(Ordering::Relaxed)
    }
}

impl Drop for RatedBoard {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        self.thread.take().unwrap().join().unwrap();
    }
}

fn answer(command: &Command) -> Answer {
    match command {
        Command::Identify => Answer::Identity(Identity {
            board: Board::SkinProc,
            firmware: [0, 1, 0],
            serial: *b"serialnumber",
            min_period_us: 1000,
        }),
        Command::Status => Answer::Status(sound_status()),
        Command::SetBaud { baud: 12_345 } => Answer::Refused(Refusal::OutOfRange),
        _ => Answer::Done,
    }
}

#[test]
fn a_rate_is_set_at_both_ends_and_used_from_then_on() {
    let dir = tempfile::tempdir().unwrap();
    let board = RatedBoard::start(1_000_000);
    let (_, said) = ended(&dir, &format!("board {} baud 115200", board.port), 0);
    assert!(said.contains("`--baud 115200`"), "{said}");
    assert_eq!(board.rate(), 115_200);
    succeed(dir.path(), &format!("board {} --baud 115200 identify", board.port));
    let error = refused(dir.path(), &format!("board {} --baud 115200 baud 12345", board.port));
    assert!(error.contains("9600") && error.contains("921600"), "{error}");
}

#[test]
fn a_rate_that_fails_on_the_wire_keeps_the_old_rate() {
    let dir = tempfile::tempdir().unwrap();
    let board = RatedBoard::start(115_200);
    let error = refused(dir.path(), &format!("board {} baud 921600", board.port));
    assert!(error.contains("not heard at `921600` baud, and is back at `57600`"), "{error}");
    assert_eq!(board.rate(), 57_600);
    succeed(dir.path(), &format!("board {} identify", board.port));
}

#[test]
fn the_bootloader_is_entered_and_the_next_step_is_printed() {
    let dir = tempfile::tempdir().unwrap();
    let board = RatedBoard::start(1_000_000);
    let (_, said) = ended(&dir, &format!("board {} bootloader", board.port), 0);
    assert!(said.contains(&format!("-g 0x08000000 {}`", board.port)), "{said}");
    assert!(board.in_bootloader.load(Ordering::Relaxed));
}

#[test]
fn a_simulated_board_refuses_rate_and_bootloader() {
    let dir = tempfile::tempdir().unwrap();
    let mut child = program::start(dir.path(), "board --simulate --symlink board");
    let deadline = Instant::now() + Duration::from_secs(60);
    while !dir.path().join("board").exists() {
        assert!(Instant::now() < deadline, "there is no board");
        thread::sleep(Duration::from_millis(10));
    }
    let error = refused(dir.path(), "board board bootloader");
    assert!(
        error.contains("nothing on this board that could do it; it has no bootloader"),
        "{error}"
    );
    let error = refused(dir.path(), "board board baud 115200");
    assert!(error.contains("its line has no rate"), "{error}");
    program::interrupt(&child);
    child.wait().unwrap();
}
