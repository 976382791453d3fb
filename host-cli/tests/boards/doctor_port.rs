//! `shellcal doctor` on boards: a fake one with a planted fault, and the simulated board.

use std::fs;
use std::io::{Read, Write};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use serialport::{SerialPort, TTYPort};
use shared_proto::{
    Answer, Board, BoardId, Command, Decoder, Event, Framing, Identity, MAX_PIECE, Packet, Piece,
    ResetCause, Sample, Status, Stream, Values, xbee::Mode,
};
use system_tests::program::{self, succeed};
use system_tests::{on_the_wire, random::Random};

use crate::board::{pty, sound_status};
use crate::doctor::examine;
use crate::recording::calibration;

/// With more boards and programs at once, some may be late while other tests run.
const BOARDS_AT_ONCE: usize = 8;

#[derive(Clone)]
struct Plan {
    serials: Vec<[u8; 12]>,
    firmware: [u8; 3],
    status: Status,
    baud: Option<u32>,
    sends: Sends,
    sample: fn(u64) -> Option<Sample>,
}

#[derive(Clone, Copy, PartialEq)]
enum Sends {
    /// Answers, and samples once it was started.
    All,
    Answers,
    /// Samples without a start and no answers, framed by the radio.
    Samples(Framing),
    /// Answers any question in this version of the protocol.
    Version(u8),
    Noise,
    Nothing,
}

const SERIAL: [u8; 12] = *b"serialnumber";

/// Readings that wander like those of an unloaded shell.
fn readings(index: u64) -> [u16; 8] {
    let mut random = Random(index * 77 + 1);
    std::array::from_fn(|channel| 24_000 + 2_000 * channel as u16 + random.bits(7) as u16)
}

fn sample(index: u64) -> Option<Sample> {
    Some(Sample {
        sequence: index as u16,
        clock_us: (1_000_000 + index * 10_000) as u32,
        values: Values::Readings(readings(index)),
        saturated: 0,
        dropped: 0,
    })
}

impl Plan {
    fn sound() -> Self {
        let version = env!("CARGO_PKG_VERSION").split('.').map(|part| part.parse().unwrap());
        let version: Vec<u8> = version.collect();
        Self {
            serials: vec![SERIAL],
            firmware: version.try_into().unwrap(),
            status: sound_status(),
            baud: None,
            sends: Sends::All,
            sample,
        }
    }

    fn with_status(change: impl FnOnce(&mut Status)) -> Self {
        let mut plan = Self::sound();
        change(&mut plan.status);
        plan
    }

    fn answer(&self, command: &Command, serial: [u8; 12]) -> Answer {
        match command {
            Command::Identify => Answer::Identity(Identity {
                board: Board::Simulated,
                firmware: self.firmware,
                serial,
                min_period_us: 1000,
            }),
            Command::Status => Answer::Status(self.status),
            Command::LastWords { offset } => {
                let words = &b"panicked at board.rs:12, the flash did not answer"[..];
                let rest = &words[usize::from(*offset).min(words.len())..];
                let text = Piece::copy_of(&rest[..rest.len().min(MAX_PIECE)]).unwrap();
                Answer::LastWords { len: words.len() as u16, text }
            }
            _ => Answer::Done,
        }
    }
}

/// A refusal of another version, under the header of this version (shared-proto/README.md).
fn other_version(version: u8) -> Vec<u8> {
    let content = [version << 4 | 9, 0, 0, 3, 2];
    let crc = |bytes: &[u8]| {
        bytes.iter().fold(0xFFFF_u16, |crc, &byte| {
            (0..8).fold(crc ^ u16::from(byte) << 8, |crc, _| {
                if crc & 0x8000 != 0 { crc << 1 ^ 0x5935 } else { crc << 1 }
            })
        })
    };
    // With this mask no byte is zero, so COBS only adds a length byte in front.
    let packet = |mask: u8| {
        let masked: Vec<u8> = [0].iter().chain(&content).map(|byte| byte ^ mask).collect();
        let crc = match version {
            0..=2 => crc(&content).to_le_bytes().map(|byte| byte ^ mask),
            _ => crc(&masked).to_le_bytes(),
        };
        [masked, crc.to_vec()].concat()
    };
    let packet = (1..=255).map(packet).find(|packet| !packet.contains(&0)).unwrap();
    [&[packet.len() as u8 + 1], &packet[..], &[0]].concat()
}

struct Running {
    port: String,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Running {
    fn start(plan: Plan) -> Self {
        let ((mut board, port), stop) = (pty(), Arc::new(AtomicBool::new(false)));
        let stopped = Arc::clone(&stop);
        let thread = thread::spawn(move || run(&plan, &mut board, &stopped));
        Self { port, stop, thread: Some(thread) }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        self.thread.take().unwrap().join().unwrap();
    }
}

fn run(plan: &Plan, board: &mut TTYPort, stop: &AtomicBool) {
    let mut decoder = Decoder::new(Framing::Cobs);
    let (mut streams, mut sent, mut started) = (plan.status.streaming, 0, Instant::now());
    let mut random = Random(3);
    let mut buffer = [0; 256];
    while !stop.load(Ordering::Relaxed) {
        let count = board.read(&mut buffer).unwrap_or_else(|_| {
            thread::sleep(Duration::from_millis(2));
            0
        });
        let is_heard = plan.baud.is_none_or(|baud| board.baud_rate().unwrap() == baud);
        let mut replies = Vec::new();
        decoder.feed(&buffer[..count], |event| {
            let Event::Packet(received) = event else { return };
            let Packet::Command { number, to, command } = received.packet else { return };
            for &serial in &plan.serials {
                if to.is_none_or(|to| to == BoardId::from_serial(&serial)) {
                    let answer = plan.answer(&command, serial);
                    replies.push(Packet::Answer { number, answer });
                }
            }
            match command {
                Command::Start => (streams, sent, started) = (true, 0, Instant::now()),
                Command::Stop => streams = false,
                _ => {}
            }
        });
        if let Sends::Version(version) = plan.sends {
            replies.iter().for_each(|_| _ = board.write_all(&other_version(version)));
        }
        if matches!(plan.sends, Sends::All | Sends::Answers) && is_heard {
            for reply in replies {
                let _ = board.write_all(&reply.encode());
            }
        }
        let framing = match plan.sends {
            Sends::All if streams && is_heard => Framing::Cobs,
            Sends::Samples(framing) => framing,
            Sends::Noise => {
                let _ = board.write_all(&random.bits(32).to_le_bytes()[..4]);
                continue;
            }
            _ => continue,
        };
        // Keep to the rate that was set, even on a busy machine.
        let due = started.elapsed().as_micros() / u128::from(plan.status.period_us);
        while u128::from(sent) < due {
            if let Some(sample) = (plan.sample)(sent) {
                let _ = board.write_all(&on_the_wire(&Packet::Sample(sample), framing));
            }
            sent += 1;
        }
    }
}

type Case<'a> = (&'a str, Plan, &'a str, Vec<(&'a str, &'a str)>);

#[test]
fn planted_faults_of_boards_are_found() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    calibration(dir);
    let label = "ff".repeat(12);
    succeed(dir, &format!("fit --model cubic training.csv --output other.json --serial {label}"));
    let fault = |check: &'static str| vec![(check, "fault")];
    let warning = |check: &'static str| vec![(check, "warning")];
    let stream = |sample: fn(u64) -> Option<Sample>| Plan { sample, ..Plan::sound() };
    let sends = |sends: Sends| Plan { sends, ..Plan::sound() };
    let cases: Vec<Case<'_>> = vec![
        ("sound", Plan::sound(), "", vec![]),
        ("silent", sends(Sends::Nothing), "", fault("silent")),
        ("noise", sends(Sends::Noise), "", fault("noise")),
        ("an older protocol", sends(Sends::Version(1)), "", fault("protocol-version")),
        ("a newer protocol", sends(Sends::Version(4)), "", fault("protocol-version")),
        ("baud", Plan { baud: Some(115_200), ..Plan::sound() }, "", fault("baud")),
        (
            "framing, and no way to the board",
            sends(Sends::Samples(Framing::Xbee(Mode::Plain))),
            "",
            [fault("framing"), fault("deaf")].concat(),
        ),
        ("deaf", sends(Sends::Samples(Framing::Cobs)), "", fault("deaf")),
        ("no frames", sends(Sends::Answers), "", fault("no-frames")),
        (
            "two boards",
            Plan { serials: vec![SERIAL, *b"another one."], ..Plan::sound() },
            "",
            fault("several-boards"),
        ),
        ("firmware", Plan { firmware: [0, 0, 9], ..Plan::sound() }, "", warning("firmware")),
        (
            "crash",
            Plan::with_status(|status| status.reset_cause = ResetCause::Panic),
            "",
            fault("crash"),
        ),
        (
            "watchdog",
            Plan::with_status(|status| status.reset_cause = ResetCause::Watchdog),
            "",
            fault("crash"),
        ),
        ("late", Plan::with_status(|status| status.late = 7), "", warning("late")),
        ("overflow", Plan::with_status(|status| status.overflowed = 7), "", warning("overflow")),
        ("uplink", Plan::with_status(|status| status.damaged = 7), "", warning("uplink")),
        (
            "wrenches without a calibration",
            Plan::with_status(|status| status.stream = Stream::Wrench),
            "",
            fault("board-calibration"),
        ),
        (
            "another calibration",
            Plan::with_status(|status| {
                (status.calibrated, status.calibration_crc32) = (true, 0x1234);
            }),
            "--calibration cal.json",
            fault("board-calibration"),
        ),
        ("another sensor", Plan::sound(), "--calibration other.json", fault("serial")),
        (
            "half the rate",
            stream(|index| {
                let clock_us = (1_000_000 + index * 20_000) as u32;
                Some(Sample { clock_us, ..sample(index)? })
            }),
            "",
            fault("rate"),
        ),
        ("losses", stream(|index| sample(index).filter(|_| index % 9 != 5)), "", fault("losses")),
        (
            "frames that the board drops",
            stream(|index| Some(Sample { dropped: (index / 4) as u8, ..sample(index)? })),
            "",
            fault("dropped"),
        ),
        (
            "saturated",
            stream(|index| {
                let mut readings = readings(index);
                readings[4] = if index % 3 == 0 { 4095 * 16 } else { readings[4] };
                Some(Sample { values: Values::Readings(readings), ..sample(index)? })
            }),
            "",
            fault("channel-saturated"),
        ),
        (
            "slow",
            Plan {
                sample: |index| {
                    let clock_us = (1_000_000 + index * 100_000) as u32;
                    // Send too few samples, however long the program listens.
                    (index < 15).then_some(Sample { clock_us, ..sample(index)? })
                },
                ..Plan::with_status(|status| status.period_us = 100_000)
            },
            "",
            warning("short"),
        ),
        (
            "dead",
            stream(|index| {
                let mut readings = readings(index);
                readings[2] = 9_000;
                Some(Sample { values: Values::Readings(readings), ..sample(index)? })
            }),
            "",
            fault("channel-dead"),
        ),
        (
            "two inputs on a wire",
            stream(|index| {
                let mut readings = readings(index);
                readings[2] = readings[6];
                Some(Sample { values: Values::Readings(readings), ..sample(index)? })
            }),
            "",
            fault("channels-identical"),
        ),
    ];
    let mut cases = cases.into_iter().peekable();
    while cases.peek().is_some() {
        thread::scope(|scope| {
            for (name, plan, options, expected) in cases.by_ref().take(BOARDS_AT_ONCE) {
                scope.spawn(move || {
                    let board = Running::start(plan);
                    let arguments = format!("{} --listen 1 {options}", board.port);
                    // This calibration consists of random numbers, so no reading is in its range.
                    let (_, mut found, report) = examine(dir, &arguments);
                    found.retain(|(check, _)| check != "range" && check != "channels-swapped");
                    let found: Vec<_> =
                        found.iter().map(|(c, s)| (c.as_str(), s.as_str())).collect();
                    assert_eq!(found, expected, "{name}: {report}");
                });
            }
        });
    }
}

#[test]
fn last_words_of_a_crashed_board_are_reported() {
    let dir = tempfile::tempdir().unwrap();
    let board = Running::start(Plan::with_status(|status| status.reset_cause = ResetCause::Panic));
    let output = program::output(dir.path(), &format!("doctor {} --listen 0.5", board.port));
    let said = String::from_utf8(output.stdout).unwrap();
    assert!(said.contains("the flash did not answer"), "{said}");
    assert!(said.ends_with("1 fault, 0 warnings\n"), "{said}");
}

#[test]
fn a_port_in_use_names_the_other_program() {
    let dir = tempfile::tempdir().unwrap();
    let (_board, port) = pty();
    let mut other = program::start(dir.path(), &format!("record {port} -o log.csv"));
    let deadline = Instant::now() + Duration::from_secs(20);
    while !dir.path().join("log.csv").exists() {
        assert!(Instant::now() < deadline, "nobody has opened the port");
        thread::sleep(Duration::from_millis(5));
    }
    let (_, found, report) = examine(dir.path(), &port);
    assert_eq!(found, [("port-in-use".to_owned(), "fault".to_owned())], "{report}");
    if cfg!(target_os = "linux") {
        assert!(report.contains(&format!("`shellcal` ({})", other.id())), "{report}");
    }
    program::interrupt(&other);
    let _ = other.wait();
}

/// Repeats [`examine`] until the board answers: a busy machine or lossy radio may lose an attempt.
fn examine_patiently(dir: &Path, arguments: &str) -> (Vec<(String, String)>, String) {
    let is_deaf = |found: &[(String, String)]| found.iter().any(|(check, _)| check == "deaf");
    let mut attempts = (0..20).map(|_| examine(dir, arguments));
    let (_, found, report) = attempts.find(|(_, found, _)| !is_deaf(found)).expect("an answer");
    (found, report)
}

#[test]
fn a_simulated_board_is_sound_and_a_lossy_radio_is_not() {
    let dir = tempfile::tempdir().unwrap();
    let train =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../calibration-data/synthetic-train.csv");
    succeed(dir.path(), &format!("fit --model cubic {} --output cal.json", train.display()));
    fs::write(
        dir.path().join("rest.csv"),
        "t_s,fx_n,fy_n,fz_n,mx_nm,my_nm,mz_nm\n0,0,0,0,0,0,0\n60,0,0,0,0,0,0\n",
    )
    .unwrap();
    let simulate = |link: &str, options: &str| {
        let command = format!("board --simulate --load rest.csv --symlink {link} {options}");
        let child = program::start(dir.path(), &command);
        let deadline = Instant::now() + Duration::from_secs(60);
        while !dir.path().join(link).exists() {
            assert!(Instant::now() < deadline, "there is no board");
            thread::sleep(Duration::from_millis(10));
        }
        child
    };
    let mut board = simulate("sound", "");
    succeed(dir.path(), "board sound upload cal.json");
    let (found, report) = examine_patiently(dir.path(), "sound --calibration cal.json");
    assert!(found.is_empty(), "{report}");
    let status = succeed(dir.path(), "board sound status");
    assert!(status.starts_with("stopped"), "{status}");
    let mut lossy = simulate("lossy", "--radio loss=0.1 --seed 4");
    let (found, report) = examine_patiently(dir.path(), "lossy");
    assert!(found.contains(&("losses".to_owned(), "fault".to_owned())), "{report}");
    for board in [&mut board, &mut lossy] {
        program::interrupt(board);
        board.wait().unwrap();
    }
}
