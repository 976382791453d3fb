//! The image for the emulated Cortex-M4F in QEMU, through its serial port.
//!
//! `SHELLCAL_EMULATED_IMAGE` names the image; without it the test says that it was skipped. See the
//! README for how to build one.

use firmware::Converter;
use shared_proto::{
    Answer, Board, Calibration, Command, Decoder, Event, Framing, MAX_PIECE, Packet, Piece,
    Refusal, Sample, Status, Stream, Values, crc32,
};
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

const PLAYED_FRAMES: usize = 700;

/// Dark and lit code of a channel in a frame of the script.
fn played(frame: usize, channel: usize) -> (u16, u16) {
    let dark = (frame * 7 + channel * 31) % 300;
    let lit = dark + 500 + (frame * 13 + channel * 401) % 3_000;
    (dark as u16, lit as u16)
}

fn script() -> Vec<u8> {
    let mut bytes = (PLAYED_FRAMES as u32).to_le_bytes().to_vec();
    for frame in 0..PLAYED_FRAMES {
        for channel in 0..8 {
            let (dark, lit) = played(frame, channel);
            bytes.extend([dark.to_le_bytes(), lit.to_le_bytes()].concat());
        }
    }
    bytes
}

fn expected_readings(frame: usize) -> [u16; 8] {
    std::array::from_fn(|channel| {
        let (dark, lit) = played(frame % PLAYED_FRAMES, channel);
        16 * (lit - dark)
    })
}

struct Emulation {
    qemu: Child,
    serial: TcpStream,
    decoder: Decoder,
    samples: Vec<Sample>,
    answers: Vec<(u16, Answer)>,
    booted: bool,
    number: u16,
    script: PathBuf,
}

impl Emulation {
    fn start(image: &Path) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a free port");
        let port = listener.local_addr().expect("bound").port();
        let script = std::env::temp_dir().join(format!("shellcal-script-{}", std::process::id()));
        std::fs::write(&script, self::script()).expect("a temporary file");
        let qemu = std::process::Command::new("qemu-system-arm")
            .args(["-M", "mps2-an386", "-display", "none", "-monitor", "none"])
            // The guest's time is counted in its instructions: it runs as fast as the host can,
            // and always the same.
            .args(["-icount", "shift=4,sleep=off"])
            .args(["-semihosting-config", "enable=on,target=native"])
            .args(["-serial", &format!("tcp:127.0.0.1:{port},nodelay=on")])
            .arg("-device")
            .arg(format!("loader,file={},addr=0x21000000,force-raw=on", script.display()))
            .arg("-kernel")
            .arg(image)
            .stdin(Stdio::null())
            .spawn()
            .expect("qemu-system-arm is installed");
        let (serial, _) = listener.accept().expect("QEMU connects");
        serial.set_read_timeout(Some(Duration::from_secs(20))).expect("a timeout");
        Self {
            qemu,
            serial,
            decoder: Decoder::new(Framing::Cobs),
            samples: Vec::new(),
            answers: Vec::new(),
            booted: false,
            number: 0,
            script,
        }
    }

    fn read(&mut self) {
        let mut bytes = [0; 4096];
        let count = self.serial.read(&mut bytes).expect("the board sends");
        assert!(count > 0, "QEMU has ended");
        self.decoder.feed(&bytes[..count], |event| match event {
            Event::Sample { sample, .. } => self.samples.push(sample),
            Event::Answer { number, answer } => self.answers.push((number, answer)),
            Event::Boot(boot) => {
                assert_eq!(boot.board, Board::Emulated);
                self.booted = true;
            }
            other => panic!("{other:?}"),
        });
    }

    fn ask(&mut self, command: Command) -> Answer {
        self.number += 1;
        let frame = Packet::Command { number: self.number, command }.encode();
        self.serial.write_all(&frame).expect("the board listens");
        let deadline = Instant::now() + Duration::from_secs(20);
        loop {
            assert!(Instant::now() < deadline, "{command:?} is not answered");
            if let Some(&(number, answer)) = self.answers.last()
                && number == self.number
            {
                return answer;
            }
            self.read();
        }
    }

    fn done(&mut self, command: Command) {
        assert_eq!(self.ask(command), Answer::Done, "{command:?}");
    }

    fn status(&mut self) -> Status {
        match self.ask(Command::Status) {
            Answer::Status(status) => status,
            other => panic!("{other:?}"),
        }
    }

    /// The next so many samples.
    fn samples(&mut self, count: usize) -> Vec<Sample> {
        while self.samples.len() < count {
            self.read();
        }
        self.samples.drain(..count).collect()
    }
}

impl Drop for Emulation {
    fn drop(&mut self) {
        _ = self.qemu.kill();
        _ = self.qemu.wait();
        _ = std::fs::remove_file(&self.script);
    }
}

fn calibration() -> Calibration {
    let mut coefficients = [[0.0; 6]; 24];
    for (i, value) in coefficients.as_flattened_mut().iter_mut().enumerate() {
        *value = ((i * 7 % 11) as f32 - 5.0) / 8.0;
    }
    let centre = std::array::from_fn(|channel| 30_000.0 + 500.0 * channel as f32);
    Calibration { centre, scale: [6e-5; 8], coefficients, intercept: [0.5; 6] }
}

/// The model in double precision.
fn wrench(calibration: &Calibration, readings: &[u16; 8]) -> [f64; 6] {
    std::array::from_fn(|axis| {
        let mut sum = f64::from(calibration.intercept[axis]);
        for (channel, &reading) in readings.iter().enumerate() {
            let offset = f64::from(reading) - f64::from(calibration.centre[channel]);
            let z = offset * f64::from(calibration.scale[channel]);
            for power in 1..=3 {
                let coefficient = calibration.coefficients[3 * channel + power as usize - 1][axis];
                sum += f64::from(coefficient) * z.powi(power);
            }
        }
        sum
    })
}

#[test]
fn half_a_minute_of_samples_then_commands_and_wrenches() {
    let Some(image) = std::env::var_os("SHELLCAL_EMULATED_IMAGE").map(PathBuf::from) else {
        println!("skipped: SHELLCAL_EMULATED_IMAGE is not set");
        return;
    };
    let mut board = Emulation::start(&image);
    let Answer::Identity(identity) = board.ask(Command::Identify) else { panic!("no identity") };
    assert_eq!((identity.board, identity.firmware), (Board::Emulated, firmware::VERSION));

    // 30 s at 100 Hz: every sequence number, every 10 ms ± 0.1 ms from the first, what was played.
    board.done(Command::Start);
    let samples = board.samples(3_001);
    let first_us = samples[0].clock_us;
    for (i, sample) in samples.iter().enumerate() {
        assert_eq!(usize::from(sample.sequence), i);
        let due_us = first_us + 10_000 * i as u32;
        assert!(sample.clock_us.abs_diff(due_us) <= 100, "{} {due_us}", sample.clock_us);
        assert_eq!(sample.values, Values::Readings(expected_readings(i)));
        assert_eq!((sample.saturated, sample.dropped), (0, 0));
    }

    board.done(Command::SetPeriod { period_us: 5_000 });
    // The answer overtakes the samples that wait, 16 at most.
    board.samples.clear();
    board.samples(16);
    let samples = board.samples(100);
    let steps = samples.windows(2).map(|pair| pair[1].clock_us - pair[0].clock_us);
    assert!(steps.into_iter().all(|step_us| step_us.abs_diff(5_000) <= 100));
    board.done(Command::Stop);
    let status = board.status();
    assert!(!status.streaming);
    assert_eq!((status.late, status.overflowed, status.damaged), (0, 0, 0));

    let wrenches = Command::SetStream(Stream::Wrench);
    assert_eq!(board.ask(wrenches), Answer::Refused(Refusal::NoCalibration));
    let bytes = calibration().to_bytes();
    let crc = crc32(&bytes);
    board.done(Command::BeginCalibration { size: bytes.len() as u32, crc32: crc });
    for (i, piece) in bytes.chunks(MAX_PIECE).enumerate() {
        let data = Piece::copy_of(piece).expect("pieces fit");
        board.done(Command::CalibrationPiece { offset: (i * MAX_PIECE) as u16, data });
    }
    board.done(Command::CommitCalibration);
    board.done(wrenches);
    let taken = board.status();
    assert_eq!(taken.calibration_crc32, crc);

    // What waited when streaming stopped has come by now.
    board.samples.clear();
    // Frames are played in the order in which they are taken.
    board.done(Command::Start);
    let mut converter = Converter::new(&calibration());
    for (i, sample) in board.samples(1_000).iter().enumerate() {
        let readings = expected_readings(taken.frames as usize + i);
        let Values::Wrench(measured) = sample.values else { panic!("{sample:?}") };
        let host = converter.convert(&readings);
        for ((measured, host), exact) in
            measured.into_iter().zip(host).zip(wrench(&calibration(), &readings))
        {
            assert!((measured - host).abs() <= 1e-5, "{measured} {host}");
            assert!((f64::from(measured) - exact).abs() <= 1e-4, "{measured} {exact}");
        }
    }
    let counters = board.decoder.counters();
    assert_eq!((counters.missing, counters.bad_crc, counters.malformed), (0, 0, 0));
    assert!(board.booted);
}
