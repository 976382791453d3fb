//! The host's end of the flashed board's line.

use shared_proto::{
    Answer, Board, BoardId, Boot, Calibration, Command, Cubic, Decoder, Edge, Event, Framing,
    Health, MAX_PIECE, Packet, PacketOrigin, Piece, Sample, Status, crc32,
};
use system_tests::flashed::{FlashedBoard, Model, PlayedFrame, Report, SERIAL};
pub use system_tests::random::Random;

/// Timeout of an answer: two frames on the line, and samples on their way.
const ANSWER_S: f64 = 0.03;

pub struct Modelled {
    pub model: Model,
    pub board: Board,
    pub conversion_ns: u32,
}

pub fn boards() -> [Modelled; 2] {
    let (skinproc, nucleo) = (Model::find(), Model::find_nucleo());
    [
        Modelled { model: skinproc, board: Board::SkinProc, conversion_ns: 3_250 },
        Modelled { model: nucleo, board: Board::NucleoG491re, conversion_ns: 2_625 },
    ]
}

pub struct Host {
    pub board: FlashedBoard,
    pub decoder: Decoder,
    pub samples: Vec<Sample>,
    pub boots: Vec<Boot>,
    pub healths: Vec<Health>,
    pub edges: Vec<Edge>,
    pub origin: Option<PacketOrigin>,
    pub resets: Vec<String>,
    pub last: Report,
    number: u16,
}

impl Host {
    pub fn start(model: &Model, played: &[PlayedFrame]) -> Self {
        let dir = tempfile::tempdir().unwrap();
        let mut board = FlashedBoard::start(model, played, dir.path());
        // After a report, the script has been read.
        let last = board.run(0.02);
        let mut host = Self {
            board,
            decoder: Decoder::new(Framing::Cobs),
            samples: Vec::new(),
            boots: Vec::new(),
            healths: Vec::new(),
            edges: Vec::new(),
            origin: None,
            resets: Vec::new(),
            last: last.clone(),
            number: 0,
        };
        host.take(last);
        assert_eq!(host.resets, ["power"]);
        host
    }

    /// Starts a freshly flashed board, without a script.
    pub fn new(model: &Model) -> Self {
        Self::start(model, &[])
    }

    fn take(&mut self, report: Report) -> Vec<(u16, Answer)> {
        let bytes = report.sent.clone();
        self.resets.extend(report.resets.iter().cloned());
        self.last = report;
        self.take_bytes(&bytes)
    }

    fn take_bytes(&mut self, bytes: &[u8]) -> Vec<(u16, Answer)> {
        let Self { decoder, samples, boots, healths, edges, origin, .. } = self;
        let mut answers = Vec::new();
        decoder.feed(bytes, |event| {
            let Event::Packet(received) = event else { panic!("{event:?}") };
            *origin = received.origin;
            match received.packet {
                Packet::Sample(sample) => samples.push(sample),
                Packet::Boot(boot) => boots.push(boot),
                Packet::Health(health) => healths.push(health),
                Packet::Edge(edge) => edges.push(edge),
                Packet::Answer { number, answer } => answers.push((number, answer)),
                Packet::Command { .. } => panic!("{received:?}"),
            }
        });
        answers
    }

    pub fn run(&mut self, time_s: f64) {
        let report = self.board.run(time_s);
        self.take(report);
    }

    /// Runs the board; `noise` changes the bytes from it before they are decoded.
    pub fn run_behind(&mut self, time_s: f64, noise: impl FnOnce(&mut Vec<u8>)) {
        let mut report = self.board.run(time_s);
        noise(&mut report.sent);
        self.take(report);
    }

    pub fn ask(&mut self, command: Command) -> Option<Answer> {
        self.number += 1;
        let to = Some(BoardId::from_serial(&SERIAL));
        let packet = Packet::Command { number: self.number, to, command };
        self.board.send(&packet.encode());
        // Answers overtake samples, but not frames in the driver; erasing a page takes time.
        for _ in 0..10 {
            let report = self.board.run(ANSWER_S);
            let answers = self.take(report);
            if let Some((_, answer)) = answers.iter().find(|(number, _)| *number == self.number) {
                return Some(*answer);
            }
            if !self.last.on {
                return None;
            }
        }
        None
    }

    pub fn order(&mut self, command: Command) {
        assert_eq!(self.ask(command), Some(Answer::Done), "{command:?}");
    }

    pub fn status(&mut self) -> Status {
        match self.ask(Command::Status) {
            Some(Answer::Status(status)) => status,
            other => panic!("{other:?}"),
        }
    }

    pub fn last_words(&mut self) -> String {
        let mut words = Vec::new();
        loop {
            match self.ask(Command::LastWords { offset: words.len() as u16 }) {
                Some(Answer::LastWords { text, .. }) if text.is_empty() => break,
                Some(Answer::LastWords { text, .. }) => words.extend_from_slice(&text),
                other => panic!("{other:?}"),
            }
        }
        String::from_utf8(words).unwrap()
    }

    pub fn begin_upload(&mut self, calibration: &Calibration) {
        let bytes = calibration.to_bytes();
        let crc32 = crc32(&bytes);
        self.order(Command::BeginCalibration { size: bytes.len() as u32, crc32 });
        for (i, piece) in bytes.chunks(MAX_PIECE).enumerate() {
            let data = Piece::copy_of(piece).unwrap();
            self.order(Command::CalibrationPiece { offset: (i * MAX_PIECE) as u16, data });
        }
    }

    /// Returns the answer to the commit, `None` if the power was cut.
    pub fn upload(&mut self, calibration: &Calibration) -> Option<Answer> {
        self.begin_upload(calibration);
        self.ask(Command::CommitCalibration)
    }

    /// Runs `branch` and undoes its effects on the board; the account of samples continues.
    pub fn branch(&mut self, branch: impl FnOnce(&mut Self)) {
        self.board.open_branch();
        branch(self);
        self.board.leave_branch();
    }
}

pub fn calibration(number: u8) -> Calibration {
    Calibration::Cubic(Cubic {
        centre: [30_000.0; 8],
        scale: [1e-4; 8],
        coefficients: [[f32::from(number); 6]; 24],
        intercept: [0.5; 6],
    })
}

pub fn crc_of(calibration: &Calibration) -> u32 {
    crc32(&calibration.to_bytes())
}

pub fn played(frames: usize, code: impl Fn(usize, usize) -> (u16, u16)) -> Vec<PlayedFrame> {
    (0..frames).map(|frame| std::array::from_fn(|channel| code(frame, channel))).collect()
}
